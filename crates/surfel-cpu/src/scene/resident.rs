//! A whole scene as this backend stores it.

use crate::scene::cloud::StoredObject;
use crate::scene::mesh::StoredMesh;
use std::sync::Arc;
use surfel_model::{Geometry, Light, Matcap, Material, Scene, Storage};
use surfel_render::{RenderError, SceneSummary};

/// A scene as this backend stores it.
pub struct ResidentScene {
    pub(crate) summary: SceneSummary,
    pub(crate) clouds: Vec<StoredObject>,
    pub(crate) meshes: Vec<StoredMesh>,
    /// The first object's.
    pub(crate) material: Material,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Linear, premultiplied.
    pub(crate) background: [f64; 4],
}

impl ResidentScene {
    /// Stores a scene that is valid, on the threads that the caller is on.
    pub(crate) fn new(scene: &Scene, storage: Storage) -> Result<Self, RenderError> {
        let (mut clouds, mut meshes) = (Vec::new(), Vec::new());
        // Of equally near polygons the first is seen: those of octrees come after all meshes.
        let mut octrees = Vec::new();
        for (index, object) in scene.objects.iter().enumerate() {
            match &object.geometry {
                Geometry::Splats(cloud) => {
                    clouds.push(StoredObject::new(cloud, object.world_from_object, object.material, storage));
                }
                Geometry::Mesh(mesh) => {
                    mesh.validate()?;
                    for part in mesh.by_texture() {
                        meshes.push(StoredMesh::new(object, &part, &meshes));
                    }
                }
                Geometry::Octree(octree) => {
                    clouds.push(StoredObject::of_octree(index, octree, object, storage));
                    octrees.push((index, octree, object));
                }
            }
        }
        for (index, octree, object) in octrees {
            meshes.push(StoredMesh::of_octree(index, octree, object, &meshes));
        }
        let [r, g, b, a] = scene.background;
        Ok(Self {
            summary: SceneSummary::of(scene),
            clouds,
            meshes,
            material: scene.objects.first().map_or(Material::default(), |object| object.material),
            lights: scene.lights.clone(),
            ambient: scene.ambient,
            matcap: scene.matcap.clone(),
            background: [r * a, g * a, b * a, a],
        })
    }

    /// Bytes of heap memory that the splats use.
    pub fn bytes(&self) -> usize {
        self.clouds.iter().map(StoredObject::bytes).sum()
    }
}
