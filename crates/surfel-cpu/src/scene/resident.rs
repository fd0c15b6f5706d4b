//! A scene as this backend stores it.
//!
//! A *slot* is the index of a stored splat in the columns of its object ([`StoredObject`]).

use crate::scene::balls::StoredBalls;
use crate::scene::cloud::StoredObject;
use crate::scene::mesh::StoredMesh;
use crate::scene::numbers::SplatNumbers;
use glam::DAffine3;
use std::sync::Arc;
use surfel_math::srgb::limit_color;
use surfel_model::{GaussianCloud, Geometry, Light, Matcap, Material, MipmapCache, NO_LABEL, Object, Scene, Storage};
use surfel_render::{Identity, RenderError, SceneGeometry, SceneSummary};

/// An object of trained Gaussians, as this backend stores it.
pub(crate) struct StoredGaussians {
    /// Index of the object in the scene.
    pub(crate) source: usize,
    pub(crate) gaussians: Arc<GaussianCloud>,
    pub(crate) world_from_object: DAffine3,
}

/// A scene as this backend stores it, returned by an upload and drawn any number of times.
pub struct ResidentScene {
    pub(crate) summary: SceneSummary,
    /// Identity of the objects' geometry, by which an update recognises a scene with the same splats.
    pub(crate) geometry: SceneGeometry,
    pub(crate) clouds: Vec<StoredObject>,
    pub(crate) balls: Vec<StoredBalls>,
    pub(crate) meshes: Vec<StoredMesh>,
    /// Objects of trained Gaussians; empty in a scene of surfaces.
    pub(crate) gaussians: Vec<StoredGaussians>,
    /// Material of the scene's first object, whose factors all objects share unless the scene's materials differ.
    pub(crate) material: Material,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Background colour, linear and premultiplied.
    pub(crate) background: [f64; 4],
}

impl ResidentScene {
    /// Stores a validated scene, on the current thread pool.
    pub(crate) fn new(scene: &Scene, storage: Storage) -> Result<Self, RenderError> {
        let (mut clouds, mut meshes, mut mipmaps) = (Vec::new(), Vec::new(), MipmapCache::new());
        // Among equally near polygons the first is visible; an octree's polygons follow all meshes.
        let (mut octrees, mut gaussians, mut balls) = (Vec::new(), Vec::new(), Vec::new());
        for (index, object) in scene.objects.iter().enumerate() {
            match &object.geometry {
                Geometry::Splats(cloud) if cloud.is_balls() => {
                    balls.extend(StoredBalls::new(cloud, object.world_from_object, object.material, index));
                }
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
                    gaussians.push(StoredGaussians { source: index, gaussians: cloud.clone(), world_from_object });
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
        let mut resident = Self {
            summary: SceneSummary::of(scene),
            geometry: SceneGeometry::of(scene),
            clouds,
            balls,
            meshes,
            gaussians,
            material: Material::default(),
            lights: None,
            ambient: [0.0; 3],
            matcap: None,
            background: [0.0; 4],
        };
        resident.light(scene);
        Ok(resident)
    }

    /// Stores a scene's lights, ambient light, background, matcap and first material.
    fn light(&mut self, scene: &Scene) {
        let [r, g, b, a] = scene.background;
        self.material = scene.objects.first().map_or(Material::default(), |object| object.material);
        self.lights.clone_from(&scene.lights);
        self.ambient = scene.ambient;
        self.matcap.clone_from(&scene.matcap);
        self.background = [r * a, g * a, b * a, a].map(limit_color);
    }

    /// Replaces everything but the geometry by that of `scene`, whose geometry must be the same.
    pub(crate) fn update(&mut self, scene: &Scene) {
        self.light(scene);
        self.summary = SceneSummary::of(scene);
        for stored in &mut self.clouds {
            let Some(object) = scene.objects.get(stored.source) else { continue };
            stored.world_from_object = object.world_from_object;
            match &object.geometry {
                Geometry::Splats(cloud) => stored.set_material(object.material, cloud),
                Geometry::Octree(octree) => stored.set_material(object.material, octree.cloud()),
                Geometry::Mesh(_) | Geometry::Gaussians(_) => {}
            }
        }
        for stored in &mut self.balls {
            if let Some(Object { geometry: Geometry::Splats(cloud), world_from_object, material }) =
                scene.objects.get(stored.source)
            {
                stored.place(cloud, *world_from_object, *material);
            }
        }
        for stored in &mut self.meshes {
            if let Some(object) = scene.objects.get(stored.source) {
                stored.place(object);
            }
        }
        for stored in &mut self.gaussians {
            if let Some(object) = scene.objects.get(stored.source) {
                stored.world_from_object = object.world_from_object;
            }
        }
    }

    /// Returns the row, object and label of the splat or polygon with a number ([`SplatNumbers`]). Polygons have
    /// neither row nor label. Returns [`Identity::NOTHING`] for [`SplatNumbers::NOTHING`], and if no object has the
    /// number.
    pub(crate) fn identity(&self, numbers: &SplatNumbers, number: u32) -> Identity {
        if number == SplatNumbers::NOTHING {
            return Identity::NOTHING;
        }
        if number & SplatNumbers::POLYGON != 0 {
            let mesh = self.meshes.get((number & !SplatNumbers::POLYGON) as usize);
            return Identity { object: mesh.map_or(NO_LABEL, |mesh| mesh.source as u32), ..Identity::NOTHING };
        }
        let (object, slot) = numbers.place(number);
        let of = |column: Option<&[u32]>| column.and_then(|c| c.get(slot)).copied().unwrap_or(NO_LABEL);
        // Balls are numbered after clouds.
        let (rows, labels, source) =
            match (self.clouds.get(object), self.balls.get(object - self.clouds.len().min(object))) {
                (Some(cloud), _) => (cloud.rows.as_deref(), cloud.labels.as_deref(), cloud.source),
                (None, Some(balls)) => (balls.rows.as_deref(), balls.labels.as_deref(), balls.source),
                (None, None) => return Identity::NOTHING,
            };
        Identity { row: of(rows), object: source as u32, label: of(labels) }
    }

    /// Numbers the slots of all objects: those of clouds, then those of balls.
    pub(crate) fn numbers(&self) -> SplatNumbers {
        let (clouds, balls) = (self.clouds.iter().map(|c| c.rows.clone()), self.balls.iter().map(|b| b.rows.clone()));
        SplatNumbers::new(clouds.chain(balls))
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
        let balls = self.balls.iter().map(StoredBalls::bytes);
        self.clouds.iter().map(StoredObject::bytes).chain(balls).chain(gaussians).sum()
    }
}
