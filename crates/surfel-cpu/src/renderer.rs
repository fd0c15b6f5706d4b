//! The backend: scenes in, frames out.

use crate::bins::{BLOCK, TILE_BLOCKS};
use crate::frame::draw;
use crate::level::{Instructions, SimdLevel};
use crate::mesh::StoredMesh;
use crate::recycle::Recycled;
use crate::store::StoredObject;
use std::sync::Arc;
use std::time::Instant;
use surfel_model::{Geometry, Light, Matcap, Material, Scene, Settings};
use surfel_render::{
    Capabilities, Feature, Frame, Planes, RenderError, RendererInfo, SceneSummary, Stats, Storage, View, plan,
};

const CAPABILITIES: Capabilities = Capabilities { backend: "cpu", lacks: &[Feature::Margin] };

/// How a [`Renderer`] works.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Threads; 0: as many as there are cores, or as the environment's `RAYON_NUM_THREADS` says.
    pub threads: usize,
    /// SIMD instructions.
    pub simd: SimdLevel,
    /// How a frame is cut into work.
    pub work: Work,
    /// How splats are kept in memory.
    pub storage: Storage,
}

/// How a frame is cut into work. Changes the speed and memory, and no bit of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Work {
    /// Side of a tile, pixels: 8, 16 or 32.
    pub tile_px: u32,
    /// Most splats that a thread sets up before it draws them, as near as tiles allow; 0 counts as 1. A splat of many tiles counts
    /// for more. At 140 bytes each they should about fit its cache. A frame of no more is set up as a whole. Splats on the border of
    /// two cells are set up twice.
    pub cell_splats: usize,
    /// Most splats and triangles, counted likewise, that all threads together set up, and the rows of the picture that have them, where a frame has
    /// polygons or isn't cut into cells, and for shadow maps.
    pub batch_splats: usize,
    /// Whether chunks behind all that a cell shows are found and left out. Splats of theirs that would be drawn then aren't counted
    /// as drawn.
    pub culls_hidden: bool,
    /// How splats of four pixels at most are drawn.
    pub dots: Dots,
    /// How layers of transparent splats are found.
    pub peeling: Peeling,
    /// How splats are evaluated. The one choice here that changes bits of a picture, within rounding.
    pub evaluation: Evaluation,
    /// Whether records are counted by the evaluator that draws them: counters `records_shallow`, `records_soft`, `records_plain`,
    /// `records_general`, `records_dot` and `records_near`. A splat that two cells draw has two records. Costs a look at every record.
    pub counts_evaluators: bool,
}

impl Default for Work {
    fn default() -> Self {
        Self {
            tile_px: 32,
            cell_splats: 1 << 15,
            batch_splats: 1 << 20,
            culls_hidden: true,
            dots: Dots::default(),
            peeling: Peeling::default(),
            evaluation: Evaluation::default(),
            counts_evaluators: false,
        }
    }
}

/// How splats are evaluated at pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Evaluation {
    /// Each by the cheapest of the evaluators whose error is bound to be below 5e-7 relative: without the filter where it does
    /// nothing, and by a polynomial in place of a reciprocal where the depth hardly changes.
    #[default]
    Cheapest,
    /// All by the one that is right for any splat. To measure against.
    General,
}

/// How splats of four pixels at most are drawn. The same picture in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dots {
    /// They are computed during setup, and tiles of them drawn splat by splat.
    #[default]
    BySplats,
    /// They are computed during setup, and tiles drawn block by block.
    ByBlocks,
    /// As others are. To measure against.
    Off,
}

/// How layers of transparent splats are found. The same layers either way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Peeling {
    /// A block's fragments are computed once for all layers.
    #[default]
    Once,
    /// They are computed anew for each layer, as by G06's passes over all splats: slower. To measure against.
    Anew,
}

/// The processor backend. It has its own threads; the global thread pool is left alone.
pub struct Renderer {
    info: RendererInfo,
    pool: rayon::ThreadPool,
    instructions: Instructions,
    work: Work,
    storage: Storage,
    recycled: Recycled,
}

/// A scene as this backend keeps it.
pub struct ResidentScene {
    pub(crate) summary: SceneSummary,
    pub(crate) objects: Vec<StoredObject>,
    pub(crate) meshes: Vec<StoredMesh>,
    /// Of the first object.
    pub(crate) material: Material,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Linear, premultiplied.
    pub(crate) background: [f64; 4],
}

impl ResidentScene {
    /// Bytes of heap memory that the splats use.
    pub fn bytes(&self) -> usize {
        self.objects.iter().map(StoredObject::bytes).sum()
    }
}

impl Renderer {
    /// A renderer with `threads` threads of its own; 0: as many as there are cores.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if threads can't be started.
    pub fn new(threads: usize) -> Result<Self, RenderError> {
        Self::with_options(&Options { threads, ..Options::default() })
    }

    /// A renderer with these options.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if threads can't be started, or for a tile size that there is not.
    pub fn with_options(options: &Options) -> Result<Self, RenderError> {
        if ![8, 16, BLOCK * TILE_BLOCKS].contains(&options.work.tile_px) {
            let message = format!("tile_px is {}, expected 8, 16 or 32", options.work.tile_px);
            return Err(RenderError::Backend { backend: "cpu", message });
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(options.threads)
            .build()
            .map_err(|e| RenderError::Backend { backend: "cpu", message: e.to_string() })?;
        let instructions = Instructions::new(options.simd).ok_or_else(|| RenderError::Backend {
            backend: "cpu",
            message: "this processor has no SIMD instructions that the backend knows; use the reference backend".into(),
        })?;
        let info = RendererInfo {
            backend: "cpu",
            adapter: instructions.name().into(),
            driver: format!("surfel {}", env!("CARGO_PKG_VERSION")),
            threads: pool.current_num_threads(),
            capabilities: CAPABILITIES,
        };
        Ok(Self {
            info,
            pool,
            instructions,
            work: options.work,
            storage: options.storage,
            recycled: Recycled::default(),
        })
    }
}

/// A scene's clouds and meshes, on the threads that the caller is on.
fn stored(scene: &Scene, storage: Storage) -> Result<(Vec<StoredObject>, Vec<StoredMesh>), RenderError> {
    let (mut objects, mut meshes) = (Vec::new(), Vec::new());
    for object in &scene.objects {
        match &object.geometry {
            Geometry::Splats(cloud) => {
                objects.push(StoredObject::new(cloud, object.world_from_object, object.material, storage));
            }
            Geometry::Mesh(mesh) => {
                mesh.validate()?;
                meshes.push(StoredMesh::new(object, mesh, &meshes));
            }
        }
    }
    Ok((objects, meshes))
}

impl surfel_render::Renderer for Renderer {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        &self.info
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        scene.validate()?;
        let [r, g, b, a] = scene.background;
        let (objects, meshes) = self.pool.install(|| stored(scene, self.storage))?;
        Ok(ResidentScene {
            summary: SceneSummary::of(scene),
            objects,
            meshes,
            material: scene.objects.first().map_or(Material::default(), |o| o.material),
            lights: scene.lights.clone(),
            ambient: scene.ambient,
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
        let start = Instant::now();
        let plan = plan(&scene.summary, view, settings, planes, &CAPABILITIES)?;
        let mut stats = Stats { splats: scene.summary.splats, threads: self.info.threads, ..Stats::default() };
        let (instructions, work, recycled) = (self.instructions, self.work, &self.recycled);
        stats.bytes_per_splat = scene.bytes() as f64 / scene.summary.splats.max(1) as f64;
        self.pool.install(|| draw(instructions, work, recycled, (scene, view, &plan), frame, &mut stats));
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }
}
