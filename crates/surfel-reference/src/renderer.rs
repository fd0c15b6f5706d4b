//! The backend: scenes in, frames out.

use crate::frame;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_model::{Geometry, Light, Matcap, Material, Mesh, Mipmaps, Object, Scene, Settings, SplatCloud};
use surfel_render::{Capabilities, Frame, Planes, RenderError, RendererInfo, SceneSummary, Stats, View, plan};

const CAPABILITIES: Capabilities = Capabilities::everything("reference");

/// The f64 reference backend.
pub struct Renderer {
    info: RendererInfo,
    pool: rayon::ThreadPool,
}

/// A scene as the reference holds it: shared clouds and what belongs to their objects.
pub struct ResidentScene {
    pub(crate) summary: SceneSummary,
    pub(crate) objects: Vec<ResidentObject>,
    pub(crate) meshes: Vec<ResidentMesh>,
    /// Of the first object.
    pub(crate) material: Material,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: DVec3,
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Linear, premultiplied.
    pub(crate) background: [f64; 4],
}

/// One object of splats.
#[derive(Clone)]
pub(crate) struct ResidentObject {
    pub cloud: Arc<SplatCloud>,
    pub world_from_object: DAffine3,
    pub material: Material,
    pub interior_weight: Option<f64>,
    pub first_splat: u32,
}

/// One object of polygons.
#[derive(Clone)]
pub(crate) struct ResidentMesh {
    pub mesh: Arc<Mesh>,
    pub world_from_object: DAffine3,
    pub material: Material,
    /// The mesh's texture and its smaller levels.
    pub mipmaps: Option<Arc<Mipmaps>>,
}

impl Renderer {
    /// A renderer with its own `threads` threads; 0: as many as there are cores.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if threads can't be started.
    pub fn new(threads: usize) -> Result<Self, RenderError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| RenderError::Backend { backend: "reference", message: e.to_string() })?;
        let info = RendererInfo {
            backend: "reference",
            adapter: "f64, brute force".into(),
            driver: format!("surfel {}", env!("CARGO_PKG_VERSION")),
            threads: pool.current_num_threads(),
            capabilities: CAPABILITIES,
        };
        Ok(Self { info, pool })
    }

    /// Renders `samples`×`samples` samples a pixel without a pre-filter and averages them: the truth that filters
    /// approximate.
    ///
    /// # Errors
    /// As [`surfel_render::Renderer::render`]; also for more samples than fit into memory.
    pub fn render_supersampled(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        samples: u32,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let fine_view = view.supersampled(samples)?;
        let settings = Settings { prefilter_radius_px: 0.0, edge_aa: false, ..*settings };
        let planes = Planes { margin: false, ..planes };
        let mut fine = Frame::default();
        let stats = surfel_render::Renderer::render(self, scene, &fine_view, &settings, planes, &mut fine)?;
        crate::supersample::average(&fine, samples, planes, frame);
        Ok(stats)
    }
}

impl surfel_render::Renderer for Renderer {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        &self.info
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        scene.validate()?;
        let mut first_splat = 0u64;
        let (mut objects, mut meshes) = (Vec::new(), Vec::new());
        for object in &scene.objects {
            match &object.geometry {
                Geometry::Splats(cloud) => {
                    objects.push(ResidentObject {
                        cloud: cloud.clone(),
                        world_from_object: object.world_from_object,
                        material: object.material,
                        interior_weight: object.material.interior_weight.or(cloud.data().interior_weight),
                        first_splat: first_splat as u32,
                    });
                    first_splat += cloud.len() as u64;
                }
                Geometry::Mesh(mesh) => {
                    mesh.validate()?;
                    meshes.push(resident_mesh(object, mesh, &meshes));
                }
            }
        }
        if first_splat > u64::from(u32::MAX) {
            return Err(RenderError::Backend {
                backend: "reference",
                message: format!("the scene has {first_splat} splats, at most {} can be drawn", u32::MAX),
            });
        }
        let [r, g, b, a] = scene.background;
        Ok(ResidentScene {
            summary: SceneSummary::of(scene),
            objects,
            meshes,
            material: scene.objects.first().map_or(Material::default(), |o| o.material),
            lights: scene.lights.clone(),
            ambient: DVec3::from(scene.ambient),
            matcap: scene.matcap.clone(),
            background: [r * a, g * a, b * a, a],
        })
    }

    fn render(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let plan = plan(&scene.summary, view, settings, planes, &CAPABILITIES)?;
        Ok(self.pool.install(|| frame::render(scene, view, &plan, frame, self.info.threads)))
    }
}

/// A mesh as it is drawn; smaller levels of a texture that another object has are shared.
fn resident_mesh(object: &Object, mesh: &Arc<Mesh>, others: &[ResidentMesh]) -> ResidentMesh {
    let mipmaps = Mipmaps::of_mesh(mesh, others.iter().filter_map(|other| other.mipmaps.as_ref()));
    ResidentMesh { mesh: mesh.clone(), world_from_object: object.world_from_object, material: object.material, mipmaps }
}
