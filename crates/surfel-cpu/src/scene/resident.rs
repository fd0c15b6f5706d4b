//! A scene as this backend stores it.

use crate::scene::cloud::StoredObject;
use crate::scene::mesh::StoredMesh;
use crate::scene::numbers::SplatNumbers;
use glam::DAffine3;
use std::sync::Arc;
use surfel_math::srgb::limit_color;
use surfel_model::{GaussianCloud, Geometry, KnownMipmaps, Light, Matcap, Material, NO_LABEL, Scene, Storage};
use surfel_render::{Identity, RenderError, SceneSummary};

/// An object of Gaussians.
pub(crate) struct StoredGaussians {
    pub(crate) gaussians: Arc<GaussianCloud>,
    pub(crate) world_from_object: DAffine3,
}

/// A scene as this backend stores it.
pub struct ResidentScene {
    pub(crate) summary: SceneSummary,
    pub(crate) clouds: Vec<StoredObject>,
    pub(crate) meshes: Vec<StoredMesh>,
    /// Objects of Gaussians; empty in a scene of surfaces.
    pub(crate) gaussians: Vec<StoredGaussians>,
    /// Material of the scene's first object.
    pub(crate) material: Material,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Background colour, linear and premultiplied.
    pub(crate) background: [f64; 4],
}

impl ResidentScene {
    /// Stores a valid scene, on the current thread pool.
    pub(crate) fn new(scene: &Scene, storage: Storage) -> Result<Self, RenderError> {
        let (mut clouds, mut meshes, mut mipmaps) = (Vec::new(), Vec::new(), KnownMipmaps::new());
        // Among equally near polygons the first is visible; an octree's polygons follow all meshes.
        let (mut octrees, mut gaussians) = (Vec::new(), Vec::new());
        for (index, object) in scene.objects.iter().enumerate() {
            match &object.geometry {
                Geometry::Splats(cloud) => {
                    let mut stored = StoredObject::new(cloud, object.world_from_object, object.material, storage);
                    stored.source = index;
                    clouds.push(stored);
                }
                Geometry::Mesh(mesh) => {
                    mesh.validate()?;
                    for part in mesh.by_texture() {
                        let mut stored = StoredMesh::new(object, &part, &mut mipmaps);
                        stored.source = index;
                        meshes.push(stored);
                    }
                }
                Geometry::Gaussians(cloud) => {
                    let world_from_object = object.world_from_object;
                    gaussians.push(StoredGaussians { gaussians: cloud.clone(), world_from_object });
                }
                Geometry::Octree(octree) => {
                    let mut stored = StoredObject::of_octree(index, octree, object, storage);
                    stored.source = index;
                    clouds.push(stored);
                    octrees.push((index, octree, object));
                }
            }
        }
        for (index, octree, object) in octrees {
            let mut stored = StoredMesh::of_octree(index, octree, object, &mut mipmaps);
            stored.source = index;
            meshes.push(stored);
        }
        let [r, g, b, a] = scene.background;
        Ok(Self {
            summary: SceneSummary::of(scene),
            clouds,
            meshes,
            gaussians,
            material: scene.objects.first().map_or(Material::default(), |object| object.material),
            lights: scene.lights.clone(),
            ambient: scene.ambient,
            matcap: scene.matcap.clone(),
            background: [r * a, g * a, b * a, a].map(limit_color),
        })
    }

    /// Returns the row, object and label of a number in the plane of the nearest splat.
    pub(crate) fn identity(&self, numbers: &SplatNumbers, number: u32) -> Identity {
        if number == SplatNumbers::NOTHING {
            return Identity::NOTHING;
        }
        if number & SplatNumbers::POLYGON != 0 {
            let mesh = self.meshes.get((number & !SplatNumbers::POLYGON) as usize);
            return Identity { object: mesh.map_or(NO_LABEL, |mesh| mesh.source as u32), ..Identity::NOTHING };
        }
        let (object, slot) = numbers.place(number);
        let Some(object) = self.clouds.get(object) else { return Identity::NOTHING };
        let of = |column: Option<&[u32]>| column.and_then(|c| c.get(slot)).copied().unwrap_or(NO_LABEL);
        let (row, label) = (of(object.rows.as_deref()), of(object.labels.as_deref()));
        Identity { row, object: object.source as u32, label }
    }

    /// Returns the background's linear colour with straight alpha.
    pub(crate) fn straight_background(&self) -> [f64; 4] {
        let [r, g, b, a] = self.background;
        let [r, g, b] = [r, g, b].map(|c| if a > 0.0 { c / a } else { 0.0 });
        [r, g, b, a]
    }

    /// Returns the heap memory used by the splats, in bytes.
    pub fn bytes(&self) -> usize {
        let gaussians = self.gaussians.iter().map(|stored| stored.gaussians.bytes());
        self.clouds.iter().map(StoredObject::bytes).chain(gaussians).sum()
    }
}
