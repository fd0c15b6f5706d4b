//! The backend: scenes in, frames out.

use crate::bins::{Grid, Segment, TILE};
use crate::level::{Instructions, SimdLevel, with_instructions};
use crate::near::NearSplat;
use crate::record::Record;
use crate::setup::{ObjectSetup, SetupOutput};
use crate::shade::{self, BandPlanes, Lighting};
use crate::store::StoredObject;
use crate::tile::{self, TileBuffers, TileRect, Wants};
use fearless_simd::Simd;
use rayon::prelude::*;
use std::time::Instant;
use surfel_model::{Geometry, Light, Material, Scene, Settings};
use surfel_render::{
    Capabilities, Frame, FramePlan, PassTime, Planes, RenderError, RendererInfo, SceneSummary, Stats, View, plan,
};

const CAPABILITIES: Capabilities = Capabilities { backend: "cpu", features: &[] };

/// Chunks that one task sets up and bins: enough splats (64 × 256) to be worth a list per tile.
const CHUNKS_PER_SEGMENT: usize = 64;

/// How a [`Renderer`] works.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Threads; 0: as many as there are cores.
    pub threads: usize,
    /// SIMD instructions.
    pub simd: SimdLevel,
}

/// The processor backend. It has its own threads; the global thread pool is left alone.
pub struct Renderer {
    info: RendererInfo,
    pool: rayon::ThreadPool,
    instructions: Instructions,
}

/// A scene as this backend keeps it.
pub struct ResidentScene {
    summary: SceneSummary,
    objects: Vec<StoredObject>,
    lights: Option<Vec<Light>>,
    ambient: [f64; 3],
    /// Linear, premultiplied.
    background: [f64; 4],
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
    /// [`RenderError::Backend`] if threads can't be started.
    pub fn with_options(options: &Options) -> Result<Self, RenderError> {
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
        Ok(Self { info, pool, instructions })
    }
}

impl surfel_render::Renderer for Renderer {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        &self.info
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        scene.validate()?;
        let [r, g, b, a] = scene.background;
        let objects = self.pool.install(|| {
            let splats = scene.objects.iter().filter_map(|object| match &object.geometry {
                Geometry::Splats(cloud) => Some(StoredObject::new(cloud, object.world_from_object, object.material)),
                Geometry::Mesh(_) => None,
            });
            splats.collect()
        });
        Ok(ResidentScene {
            summary: SceneSummary::of(scene),
            objects,
            lights: scene.lights.clone(),
            ambient: scene.ambient,
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
        let instructions = self.instructions;
        self.pool.install(|| draw(instructions, scene, view, &plan, frame, &mut stats));
        stats.bytes_per_splat = scene.bytes() as f64 / scene.summary.splats.max(1) as f64;
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }
}

fn draw(
    instructions: Instructions,
    scene: &ResidentScene,
    view: &View,
    plan: &FramePlan,
    frame: &mut Frame,
    stats: &mut Stats,
) {
    let mut last = Instant::now();
    let mut lap = |stats: &mut Stats, name| {
        let now = Instant::now();
        stats.passes.push(PassTime { name, ms: (now - last).as_secs_f64() * 1e3 });
        last = now;
    };
    let grid = Grid::new(view.region);
    let setups: Vec<ObjectSetup<'_>> =
        scene.objects.iter().enumerate().map(|(i, o)| ObjectSetup::new(o, i as u32, view, plan)).collect();
    let tasks: Vec<(usize, std::ops::Range<usize>)> = scene
        .objects
        .iter()
        .enumerate()
        .flat_map(|(i, object)| {
            let n = object.chunks.len();
            (0..n).step_by(CHUNKS_PER_SEGMENT).map(move |at| (i, at..(at + CHUNKS_PER_SEGMENT).min(n)))
        })
        .collect();
    let segments: Vec<Segment> = tasks
        .into_par_iter()
        .map(|(object, chunks)| {
            let mut out = SetupOutput::default();
            with_instructions!(instructions, simd => set_up(simd, &setups[object], chunks, &mut out));
            Segment::new(out.records, out.near, &grid)
        })
        .collect();
    stats.drawn = segments.iter().map(|s| (s.records.len() + s.near.len()) as u64).sum();
    let pairs: usize = segments.iter().map(Segment::pairs).sum();
    lap(stats, "setup");
    let headlight = [Light::Directional { direction: view.forward().to_array(), color: [1.0; 3], shadow: false }];
    let lights = scene.lights.as_deref().unwrap_or(&headlight);
    let factors: Vec<[f32; 4]> = scene.objects.iter().map(|o| o.material.factors().map(|f| f as f32)).collect();
    let material = scene.objects.first().map_or(Material::default(), |o| o.material).factors();
    let job = TileJob {
        segments: &segments,
        grid,
        wants: Wants::new(plan, view),
        factors,
        lighting: Lighting::new(plan, view, lights, scene.ambient, material, scene.background),
    };
    frame.reset(view.region.width, view.region.height, plan.planes);
    stats.fragments = job.run(instructions, frame);
    lap(stats, "tiles");
    let bytes: usize =
        segments.iter().map(|s| size_of_val(s.records.as_slice()) + size_of_val(s.near.as_slice())).sum();
    stats.counters.extend([("pairs", pairs as f64), ("record_bytes", bytes as f64)]);
    debug_assert!(size_of::<Record>() <= 160 && size_of::<NearSplat>() <= 320);
}

#[inline(always)]
fn set_up<S: Simd>(simd: S, setup: &ObjectSetup<'_>, chunks: std::ops::Range<usize>, out: &mut SetupOutput) {
    simd.vectorize(
        #[inline(always)]
        || {
            for chunk in &setup.object.chunks[chunks] {
                setup.chunk(simd, chunk, out);
            }
        },
    );
}

/// All tiles of a frame.
struct TileJob<'a> {
    segments: &'a [Segment],
    grid: Grid,
    wants: Wants,
    factors: Vec<[f32; 4]>,
    lighting: Lighting,
}

impl TileJob<'_> {
    /// Draws band after band of tiles; each band writes its own rows of the frame.
    fn run(&self, instructions: Instructions, frame: &mut Frame) -> u64 {
        let width = self.grid.region.width as usize;
        let band = width * TILE as usize;
        let bands = self.grid.rows as usize;
        let (mut color, mut depth, mut normal, mut weight, mut fragments) = (
            bands_of(&mut frame.color, band, bands),
            bands_of(&mut frame.depth, band, bands),
            bands_of(&mut frame.normal, band, bands),
            bands_of(&mut frame.weight, band, bands),
            bands_of(&mut frame.fragments, band, bands),
        );
        let planes: Vec<BandPlanes<'_>> = (0..bands)
            .map(|_| BandPlanes {
                color: color.next().unwrap_or_default(),
                depth: depth.next().unwrap_or_default(),
                normal: normal.next().unwrap_or_default(),
                weight: weight.next().unwrap_or_default(),
                fragments: fragments.next().unwrap_or_default(),
            })
            .collect();
        planes
            .into_par_iter()
            .enumerate()
            .with_max_len(1)
            .map_init(
                TileBuffers::new,
                |buffers, (row, mut out)| with_instructions!(instructions, simd => self.band(simd, row as u32, buffers, &mut out)),
            )
            .sum()
    }

    #[inline(always)]
    fn band<S: Simd>(&self, simd: S, row: u32, buffers: &mut TileBuffers, out: &mut BandPlanes<'_>) -> u64 {
        simd.vectorize(
            #[inline(always)]
            || {
                let mut fragments = 0;
                for column in 0..self.grid.columns {
                    let tile = (row * self.grid.columns + column) as usize;
                    let rect = TileRect::new(&self.grid, column, row);
                    fragments += tile::run(simd, self.segments, tile, rect, &self.wants, &self.factors, buffers);
                    let at = (self.grid.region.x, self.grid.region.width as usize);
                    shade::resolve(simd, &self.lighting, buffers, rect, at, out);
                }
                fragments
            },
        )
    }
}

/// A plane cut into bands; a plane that wasn't asked for gives empty ones.
fn bands_of<T>(plane: &mut [T], band: usize, bands: usize) -> impl Iterator<Item = &mut [T]> {
    plane.chunks_mut(band.max(1)).chain(std::iter::repeat_with(Default::default)).take(bands)
}
