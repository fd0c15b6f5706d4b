//! Scenes that the reference backend stores between frames.

use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_math::srgb::limit_color;
use surfel_model::{
    GaussianCloud, Geometry, Light, Matcap, Material, Mesh, MipmapCache, Mipmaps, Object, Scene, SplatCloud,
};
use surfel_render::{RenderError, SceneSummary};

/// Scene uploaded to the reference backend: shared clouds and meshes, and their objects' placements and materials.
pub struct ResidentScene {
    pub(crate) summary: SceneSummary,
    pub(crate) objects: Vec<ResidentObject>,
    pub(crate) meshes: Vec<ResidentMesh>,
    /// Clouds of trained Gaussians with their matrices from object to world space; empty in a scene of surfaces.
    pub(crate) gaussians: Vec<(Arc<GaussianCloud>, DAffine3)>,
    /// Material of the scene's first object. Its factors are used for all splats in scenes whose objects have equal
    /// materials.
    pub(crate) material: Material,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: DVec3,
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Background colour as linear premultiplied RGBA.
    pub(crate) background: [f64; 4],
}

/// Object of a resident scene that consists of splats.
#[derive(Clone)]
pub(crate) struct ResidentObject {
    /// Index of the object among all objects of the scene.
    pub source: usize,
    pub cloud: Arc<SplatCloud>,
    pub world_from_object: DAffine3,
    pub material: Material,
    pub interior_weight: Option<f64>,
    pub first_splat: u32,
}

/// Object of a resident scene that consists of polygons.
#[derive(Clone)]
pub(crate) struct ResidentMesh {
    /// Index of the object among all objects of the scene.
    pub source: usize,
    pub mesh: Arc<Mesh>,
    pub world_from_object: DAffine3,
    pub material: Material,
    /// Mip levels of the mesh's texture; `None` without a texture.
    pub mipmaps: Option<Arc<Mipmaps>>,
}

impl ResidentScene {
    /// Converts a scene to its stored form: shares clouds and meshes, and builds the mip levels of textures.
    ///
    /// # Errors
    /// [`RenderError`] for an invalid scene, and for more splats than 32 bits can number.
    pub(crate) fn of(scene: &Scene) -> Result<Self, RenderError> {
        scene.validate()?;
        let mut first_splat = 0u64;
        let (mut objects, mut meshes) = (Vec::new(), Vec::new());
        let mut add = |source: usize, object: &Object, cloud: Arc<SplatCloud>| {
            let first = first_splat as u32;
            first_splat += cloud.len() as u64;
            objects.push(ResidentObject {
                source,
                world_from_object: object.world_from_object,
                material: object.material,
                interior_weight: object.material.interior_weight.or(cloud.data().interior_weight),
                first_splat: first,
                cloud,
            });
        };
        // Among equally near polygons the first is drawn; an octree's polygons follow all meshes.
        let (mut octrees, mut gaussians, mut mipmaps) = (Vec::new(), Vec::new(), MipmapCache::new());
        for (source, object) in scene.objects.iter().enumerate() {
            match &object.geometry {
                Geometry::Splats(cloud) => add(source, object, cloud.clone()),
                Geometry::Mesh(mesh) => {
                    mesh.validate()?;
                    for part in mesh.by_texture() {
                        meshes.push(resident_mesh(source, object, &part, &mut mipmaps));
                    }
                }
                Geometry::Gaussians(cloud) => gaussians.push((cloud.clone(), object.world_from_object)),
                Geometry::Octree(octree) => {
                    add(source, object, octree.shared_cloud());
                    octrees.push((source, object, octree.shared_mesh()));
                }
            }
        }
        for (source, object, mesh) in octrees {
            meshes.push(resident_mesh(source, object, &mesh, &mut mipmaps));
        }
        if first_splat > u64::from(u32::MAX) {
            return Err(RenderError::Backend {
                backend: "reference",
                message: format!("the scene has {first_splat} splats, at most {} can be drawn", u32::MAX),
            });
        }
        let [r, g, b, a] = scene.background;
        Ok(Self {
            summary: SceneSummary::of(scene),
            objects,
            meshes,
            gaussians,
            material: scene.objects.first().map_or(Material::default(), |o| o.material),
            lights: scene.lights.clone(),
            ambient: DVec3::from(scene.ambient),
            matcap: scene.matcap.clone(),
            background: [r * a, g * a, b * a, a].map(limit_color),
        })
    }
}

/// Converts a mesh object to its stored form. Objects with the same texture share its mip levels.
fn resident_mesh(source: usize, object: &Object, mesh: &Arc<Mesh>, known: &mut MipmapCache) -> ResidentMesh {
    let mipmaps = Mipmaps::of_mesh(mesh, known);
    let (world_from_object, material) = (object.world_from_object, object.material);
    ResidentMesh { source, mesh: mesh.clone(), world_from_object, material, mipmaps }
}
