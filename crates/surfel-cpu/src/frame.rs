//! Drawing of a frame: its visible chunks are divided into cells. One thread sets up, draws and lights a cell while the
//! cell's records are in that thread's cache.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`]). A *record* is a splat projected to the screen ([`Record`]). A *tile* is a square of blocks
//! ([`Grid`](crate::tiles::grid::Grid)).

mod samples;
mod totals;

use crate::cull::balls::BallView;
use crate::cull::cells::{self, Cell, CellLimits, OtherParts};
use crate::cull::chunks::{VisibleChunk, visible_chunks};
use crate::cull::object::ObjectView;
use crate::frame::samples::SampleView;
use crate::frame::totals::Totals;
use crate::gaussians;
use crate::raster::depth::occlusion;
use crate::raster::inputs::{RasterFrame, RasterInputs};
use crate::raster::listing::Listing;
use crate::raster::sums::number_of;
use crate::scene::balls::StoredBalls;
use crate::scene::mesh::StoredMesh;
use crate::scene::numbers::SplatNumbers;
use crate::scene::resident::ResidentScene;
use crate::screen::composite::{CompositeJob, Extras};
use crate::screen::gbuffer::GBuffer;
use crate::screen::layer_steps::LayerSteps;
use crate::screen::steps::StepPlanes;
use crate::screen::tile::{TileJob, TileScratch};
use crate::setup::balls::BallSegment;
use crate::setup::near::NearSplat;
use crate::setup::prepare::{CellSetup, CellSplats, SetupPool};
use crate::setup::record::Record;
use crate::setup::segment::TransparentSegment;
use crate::setup::tiny::TinyFinder;
use crate::setup::triangles::{TriangleSegment, project};
use crate::shade::balls::BallShading;
use crate::shade::lighting::Lighting;
use crate::shade::shadow_draw::ShadowDrawing;
use crate::shade::shadow_map::ShadowMap;
use crate::shade::transparent::{Layers, light_splats};
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::driver::{self, Tuning};
use crate::tiles::grid::Grid;
use crate::tiles::pool::Pool;
use crate::tiles::target::{Target, TileBackground};
use fearless_simd::Simd;
use surfel_model::{Cull, Filter, Light, Shader};
use surfel_render::clock::Instant;
use surfel_render::{Attributes, Frame, FramePlan, Pass, Region, Stats, View};

/// Buffers that are reused from frame to frame, because fresh memory is slow.
#[derive(Default)]
pub(crate) struct FramePools {
    /// Lists of projected splats (records) from the setup of cells.
    setup: SetupPool,
    /// Scratch buffers of the threads that draw tiles.
    scratch: Pool<TileScratch<'static>>,
    /// G-buffers of cells, for screen-space passes.
    gbuffers: Pool<GBuffer>,
}

/// The scene, view and plan of a frame, and the resources to draw it with.
#[derive(Clone, Copy)]
pub(crate) struct FrameInputs<'a> {
    pub instructions: Instructions,
    pub tuning: Tuning,
    pub pools: &'a FramePools,
    pub scene: &'a ResidentScene,
    pub view: &'a View,
    pub plan: &'a FramePlan,
}

/// Draws a frame on the current thread pool.
pub(crate) fn draw(inputs: &FrameInputs<'_>, frame: &mut Frame, stats: &mut Stats) {
    let FrameInputs { instructions, tuning, pools, scene, view, plan } = *inputs;
    if plan.has(Pass::Gaussians) {
        return gaussians::draw(instructions, scene, (view, plan), frame, stats);
    }
    let start = Instant::now();
    frame.resize(view.region.width, view.region.height, plan.planes);
    let shadows = ShadowDrawing { instructions, tuning, pool: &pools.setup, scene, plan, image: view }.draw_all();
    let mut totals = Totals::default();
    totals.shadow_bytes = shadows.iter().map(ShadowMap::bytes).sum();
    if !shadows.is_empty() {
        totals.shadows_ms = start.elapsed().as_secs_f64() * 1e3;
    }
    let after_shadows = Instant::now();
    let mut objects = ObjectView::all(&scene.clouds, view, plan, Cull::Back);
    let numbers = if plan.has(Pass::Nearest) { scene.numbers() } else { SplatNumbers::default() };
    objects.iter_mut().for_each(|object| object.first_number = numbers.first(object.index));
    let mut balls = BallView::all(&scene.balls, view, plan, 0.0);
    let first_of_balls = scene.clouds.len() as u32;
    balls.iter_mut().for_each(|of| of.first_number = numbers.first(first_of_balls + of.index).unwrap_or(0));
    let tiny = (tuning.finds_tiny && supports_tiny_tiles(plan)).then(|| TinyFinder::new(plan, view));
    let of_samples = plan.has(Pass::EdgeSamples).then(|| (view.of_samples(), plan.of_samples()));
    let lighting = lighting(scene, view, plan, shadows);
    let samples = of_samples.as_ref().map(|(view, plan)| SampleView {
        objects: ObjectView::all(&scene.clouds, view, plan, Cull::Back),
        balls: BallView::all(&scene.balls, view, plan, 0.0),
        view,
        raster: raster_frame(scene, view, plan),
        lighting: lighting.of_samples(plan, view),
    });
    let drawing = Drawing {
        inputs,
        samples,
        setup: CellSetup { instructions, objects: &objects, tiny: tiny.as_ref(), pool: &pools.setup },
        balls: &balls,
        ball_looks: ball_looks(scene, plan),
        meshes: if plan.has(Pass::Polygons) { &scene.meshes } else { &[] },
        raster: RasterFrame { numbers: numbers.clone(), ..raster_frame(scene, view, plan) },
        layers: Layers::new(plan),
        lighting,
    };
    let visible = visible_chunks(&objects);
    (totals.outside, totals.back_facing) = (visible.outside, visible.back_facing);
    totals.cull_ms = after_shadows.elapsed().as_secs_f64() * 1e3;
    drawing.draw_cells(&visible.chunks, frame, &mut totals);
    frame.finish(view, |number| scene.identity(&numbers, number));
    totals.report(plan, stats);
}

/// Returns the shading parameters of each object of balls: its material's factors and, for the unlit shader, its stored
/// light.
fn ball_looks<'a>(scene: &'a ResidentScene, plan: &FramePlan) -> Vec<BallShading<'a>> {
    let shows_light = plan.shader == Shader::Unlit;
    let look = |of: &'a StoredBalls| BallShading {
        factors: of.material.factors().map(|f| f as f32),
        light: of.light.as_deref().filter(|_| shows_light),
    };
    scene.balls.iter().map(look).collect()
}

/// Data shared by all cells of a frame.
struct Drawing<'a> {
    inputs: &'a FrameInputs<'a>,
    setup: CellSetup<'a>,
    balls: &'a [BallView<'a>],
    /// Material factors and stored light of each object of balls.
    ball_looks: Vec<BallShading<'a>>,
    meshes: &'a [StoredMesh],
    raster: RasterFrame,
    layers: Layers,
    lighting: Lighting,
    /// The view whose pixels are samples, for edges antialiased by samples; `None` if edges aren't sampled.
    samples: Option<SampleView<'a>>,
}

impl Drawing<'_> {
    /// Draws the frame cell by cell.
    fn draw_cells(&self, chunks: &[VisibleChunk], frame: &mut Frame, totals: &mut Totals) {
        let start = Instant::now();
        let FrameInputs { tuning, pools, view, plan, .. } = *self.inputs;
        let (region, objects) = (view.region, self.setup.objects);
        let grid = Grid::new(region, tuning.tile_blocks);
        let threads = rayon::current_num_threads();
        let limits = CellLimits { splats: tuning.cell_splats, reach_px: plan.reach_px(), threads };
        let others = OtherParts { meshes: self.meshes, octrees: &plan.octrees, balls: self.balls };
        let cells = cells::divide(objects, chunks, others, view, &grid, &limits);
        let parts: Vec<Region> = cells.iter().map(|cell| cell.region).collect();
        let (planes, background) = frame.planes_and_background();
        let counts = [grid.columns, grid.rows];
        let tiles = background.squares(self.lighting.background, region, grid.tile_px(), counts);
        let background = TileBackground { grid: &grid, tiles };
        let targets = Target::cut(planes, region, &parts, background, plan.reach_px() == 0);
        let jobs = cells.into_iter().zip(targets).collect();
        let own = || (Totals::default(), pools.scratch.take());
        let threads = driver::run(jobs, own, |(totals, scratch), (cell, mut target)| {
            let mut own = std::mem::take(scratch).for_others();
            self.draw_cell(&cell, &mut target, &mut own, totals);
            *scratch = own.for_others();
        });
        let (threads, scratch): (Vec<Totals>, Vec<_>) = threads.into_iter().unzip();
        scratch.into_iter().for_each(|scratch| pools.scratch.give_back(scratch));
        totals.add_threads(&threads, start.elapsed().as_secs_f64() * 1e3);
    }

    /// Sets up and draws a cell. If screen-space passes follow, a margin of the neighbouring cells' pixels is drawn
    /// too, because the passes read it.
    fn draw_cell(&self, cell: &Cell, target: &mut Target<'_>, scratch: &mut TileScratch<'static>, totals: &mut Totals) {
        let start = Instant::now();
        let FrameInputs { instructions, tuning, pools, view, plan, .. } = *self.inputs;
        if cell.chunks.is_empty() && cell.mesh_parts.is_empty() && cell.ball_parts.is_empty() {
            let grid = Grid::new(cell.region, tuning.tile_blocks);
            for tile in 0..grid.tiles() {
                target.select_tile(&grid, tile);
                target.fill_empty(self.lighting.background);
            }
            totals.tiles_ms += start.elapsed().as_secs_f64() * 1e3;
            return;
        }
        let grid = Grid::new(cell.region.grown(plan.reach_px(), view.size), tuning.tile_blocks);
        let mut splats = self.set_up(cell, &grid, totals);
        let triangles = project(instructions, self.meshes, &cell.mesh_parts, view, &grid, Cull::Back);
        let all = (&grid, DrawnBlocks::default());
        let balls = BallSegment::project(instructions, self.balls, &cell.ball_parts, all, plan.ball_alphas);
        if plan.has(Pass::RemainingLayer) {
            let CellSplats { transparent, near, .. } = &mut splats;
            transparent.iter_mut().for_each(|segment| self.light_splats((&self.lighting, &self.raster), segment, near));
        }
        let after_setup = Instant::now();
        totals.set_up_in(after_setup - start, &splats);
        let job = CompositeJob {
            tiles: TileJob {
                listing: Listing { segments: &splats.segments, grid },
                inputs: self.raster_inputs(&splats),
                lighting: &self.lighting,
                by_splats: self.setup.tiny.is_some(),
            },
            extras: Extras {
                meshes: self.meshes,
                triangles: &triangles,
                transparent: &splats.transparent,
                layers: self.layers,
                balls: &balls,
                ball_looks: &self.ball_looks,
            },
            opaque_splats_only: is_opaque_splats_only(plan),
        };
        let mut own = std::mem::take(scratch).for_others();
        let mut bytes = triangles.iter().map(TriangleSegment::bytes).sum::<usize>() + balls.bytes();
        if plan.reach_px() > 0 {
            let mut gbuffer = pools.gbuffers.take();
            gbuffer.reset_for(&grid, plan);
            for tile in 0..grid.tiles() {
                target.select_tile(&grid, tile);
                totals.counters += job.draw(instructions, target, Some(&mut gbuffer.tile(tile)), &mut own);
            }
            let after_tiles = Instant::now();
            totals.tiles_ms += (after_tiles - after_setup).as_secs_f64() * 1e3;
            let mut layer_steps = LayerSteps::new(&grid, plan);
            for tile in 0..grid.tiles() {
                target.select_tile(&grid, tile);
                totals.counters += job.finish_on(instructions, target, &gbuffer, Some(&mut layer_steps), &mut own);
            }
            if let Some(samples) = &self.samples {
                let planes = StepPlanes { gbuffer: &gbuffer, layers: &layer_steps, grid: &grid };
                let mut for_samples = own.for_others();
                bytes += self.draw_samples(samples, cell, &planes, target, &mut for_samples, totals);
                own = for_samples.for_others();
            }
            with_instructions!(instructions, simd => simd.vectorize(#[inline(always)] || {
                for tile in 0..grid.tiles() {
                    target.select_tile(&grid, tile);
                    target.encode(simd);
                }
            }));
            totals.screen_ms += after_tiles.elapsed().as_secs_f64() * 1e3;
            bytes += gbuffer.bytes() + layer_steps.bytes();
            pools.gbuffers.give_back(gbuffer);
        } else {
            for tile in 0..grid.tiles() {
                target.select_tile(&grid, tile);
                totals.counters += job.draw(instructions, target, None, &mut own);
            }
            totals.tiles_ms += after_setup.elapsed().as_secs_f64() * 1e3;
        }
        *scratch = own.for_others();
        totals.add_cell(&splats, bytes);
        totals.add_balls(&balls, balls.counted(view.region, cell.region));
        pools.setup.give_back(splats.segments);
    }

    /// Sets up a cell's chunks. With occlusion culling, the nearest chunks are set up first. Of the remaining chunks,
    /// those hidden by the splats of the nearest ones are then culled.
    fn set_up(&self, cell: &Cell, grid: &Grid, totals: &mut Totals) -> CellSplats {
        let FrameInputs { instructions, tuning, plan, .. } = *self.inputs;
        let mut splats = CellSplats::default();
        // Edge antialiasing draws splats behind the nearest surface, so nothing is occluded.
        let culls_occluded = tuning.culls_occluded && !plan.has(Pass::EdgeAntialiasing);
        let (nearest, others) = cell.chunks.split_at(if culls_occluded { cell.first } else { cell.chunks.len() });
        self.setup.add(nearest, grid, cell.region, &mut splats);
        if !others.is_empty() {
            let listing = Listing { segments: &splats.segments, grid: *grid };
            let mut scratch = self.inputs.pools.scratch.take().for_others();
            let map = occlusion(instructions, &listing, &self.raster_inputs(&splats), &mut scratch.lists.splats);
            self.inputs.pools.scratch.give_back(scratch.for_others());
            let objects = self.setup.objects;
            let (occluded, others): (Vec<VisibleChunk>, Vec<VisibleChunk>) =
                others.iter().partition(|chunk| map.occludes(objects, chunk));
            totals.occluded += occluded.iter().map(|chunk| chunk.of(objects).1.count as u64).sum::<u64>();
            self.setup.add(&others, grid, cell.region, &mut splats);
        }
        splats
    }

    /// Returns the inputs of rasterisation that all blocks of a cell share.
    fn raster_inputs<'a>(&'a self, splats: &'a CellSplats) -> RasterInputs<'a> {
        let largest_epsilon = splats.largest_epsilon();
        RasterInputs { frame: &self.raster, near: &splats.near, clips: &splats.clips, largest_epsilon }
    }

    /// Lights transparent splats one by one, for the layer into which the fragments behind the peeled layers are
    /// blended.
    fn light_splats(
        &self,
        (lighting, raster): (&Lighting, &RasterFrame),
        TransparentSegment { segment, splats }: &mut TransparentSegment,
        near: &[NearSplat],
    ) {
        let factors = |record: &Record| match self.inputs.plan.attributes.material {
            true => {
                let object = raster.numbers.object_of(number_of(record, near));
                raster.factors.get(object).copied().unwrap_or_default()
            }
            false => self.lighting.material,
        };
        with_instructions!(self.inputs.instructions, simd => {
            simd.vectorize(#[inline(always)] || light_splats(simd, lighting, &segment.records, splats, factors));
        });
    }
}

fn raster_frame(scene: &ResidentScene, view: &View, plan: &FramePlan) -> RasterFrame {
    RasterFrame {
        factors: scene.clouds.iter().map(|cloud| cloud.material.factors().map(|f| f as f32)).collect(),
        coverage: scene.clouds.iter().map(|cloud| cloud.coverage_per_weight(plan.splat_filter.cutoff)).collect(),
        coverage_of_weight: coverage_of_weight(scene, plan),
        ..RasterFrame::depth_only(plan, view)
    }
}

fn lighting(scene: &ResidentScene, view: &View, plan: &FramePlan, shadows: Vec<ShadowMap>) -> Lighting {
    let headlight = [Light::Directional { direction: view.forward().to_array(), color: [1.0; 3], shadow: false }];
    let lights = scene.lights.as_deref().unwrap_or(&headlight);
    Lighting::new(plan, view, lights, shadows, scene.ambient, scene.material.factors(), scene.background)
        .with_matcap(scene.matcap.clone())
}

/// Returns the factor from a pixel's sum of weights to its coverage. `None` if coverage isn't needed, if the scene has
/// no clouds, or if the factor differs among splats and coverage must be summed.
fn coverage_of_weight(scene: &ResidentScene, plan: &FramePlan) -> Option<f32> {
    let filter = &plan.splat_filter;
    let mut scales = scene.clouds.iter().map(|cloud| cloud.coverage_per_weight(filter.cutoff));
    let first = scales.next()?;
    // Under `clamp` and `adjust`, weights lack the area ratio a of rendering model §5, which differs from splat to
    // splat.
    let carried = !matches!(filter.filter, Filter::Clamp | Filter::Adjust);
    (plan.attributes.coverage && carried && scales.all(|scale| scale == first)).then_some(first)
}

/// True if the frame has only opaque splats, without polygons, balls, outlines or eye-dome lighting.
fn is_opaque_splats_only(plan: &FramePlan) -> bool {
    let others = [Pass::Polygons, Pass::Outlines, Pass::EyeDome, Pass::Balls];
    !plan.separates_transparent && !others.into_iter().any(|pass| plan.has(pass))
}

/// True if a tile whose splats are all tiny, of at most 3×3 pixels, may be drawn splat by splat. This requires that the
/// frame has only opaque splats, that no screen-space pass follows, and that the filter isn't `clamp`. It also requires
/// that the plan needs only the sums that such a tile computes.
fn supports_tiny_tiles(plan: &FramePlan) -> bool {
    let Attributes { material, coverage, .. } = plan.attributes;
    // A disk drawn by `clamp` isn't an ellipse.
    let ellipses = plan.splat_filter.filter != Filter::Clamp;
    let sums_alone = plan.reach_px() == 0 && !plan.has(Pass::Nearest);
    is_opaque_splats_only(plan) && sums_alone && !material && !coverage && !plan.keeps_facings && ellipses
}
