//! A frame: chunks from near to far, in batches of rows, each set up, sorted into tiles and drawn.

use crate::cells::{self, Cell};
use crate::composite::{CompositeJob, Extras};
use crate::hidden::Hiding;
use crate::level::{Instructions, with_instructions};
use crate::light::Lighting;
use crate::mesh::{self, TriangleSegment};
use crate::near::NearSplat;
use crate::placed::ObjectSetup;
use crate::planes::{NeighbourPlanes, TilePlanes};
use crate::prepare::{Preparation, Prepared, Seen, Unseen};
use crate::raster::{self, Shared, Wants};
use crate::record::{Class, Record};
use crate::recycle::Recycled;
use crate::renderer::{Dots, Peeling, ResidentScene, Work};
use crate::shadow::{self, Shadow};
use crate::small_dots;
use crate::target::TileTarget;
use crate::tile::{Counters, Listing, TileJob, TileScratch};
use crate::veil::{Layers, VeilSegment, light_splats};
use fearless_simd::Simd;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use surfel_model::{Cull, Filter, Light};
use surfel_render::{Attributes, Frame, FramePlan, Pass, PassTime, Region, Stats, View};

pub(crate) fn draw(
    instructions: Instructions,
    work: Work,
    recycled: &Recycled,
    (scene, view, plan): (&ResidentScene, &View, &FramePlan),
    frame: &mut Frame,
    stats: &mut Stats,
) {
    let start = Instant::now();
    frame.resize(view.region.width, view.region.height, plan.planes);
    let headlight = [Light::Directional { direction: view.forward().to_array(), color: [1.0; 3], shadow: false }];
    let lights = scene.lights.as_deref().unwrap_or(&headlight);
    let preparation = Preparation {
        instructions,
        objects: &scene.objects,
        view,
        plan,
        tile_px: work.tile_px,
        batch_splats: work.batch_splats,
        cull: Cull::Back,
        evaluation: work.evaluation,
        finds_dots: work.dots != Dots::Off && draws_dots(plan),
        recycled,
    };
    let shadows = shadow::draw(&preparation, scene, view.eye);
    let mut totals = Totals {
        shadow_bytes: shadows.iter().map(Shadow::bytes).sum(),
        counts_evaluators: work.counts_evaluators,
        ..Totals::default()
    };
    if !shadows.is_empty() {
        totals.shadows_ms = start.elapsed().as_secs_f64() * 1e3;
    }
    let after_shadows = Instant::now();
    let drawing = Drawing {
        preparation,
        scene,
        view,
        plan,
        wants: Wants::new(plan, view),
        layers: Layers::new(plan, work.peeling == Peeling::Anew),
        // Edges show what lies behind.
        culls_hidden: work.culls_hidden && !plan.has(Pass::EdgeAntialiasing),
        draws_dots: work.dots == Dots::BySplats,
        factors: scene.objects.iter().map(|o| o.material.factors().map(|f| f as f32)).collect(),
        coverage: scene.objects.iter().map(|o| o.coverage_per_weight(plan.splat_filter.cutoff)).collect(),
        coverage_of_weight: coverage_of_weight(scene, plan),
        lighting: Lighting::new(plan, view, lights, shadows, scene.ambient, scene.material.factors(), scene.background)
            .with_matcap(scene.matcap.clone()),
    };
    let setups = preparation.setups();
    let (chunks, unseen) = preparation.seen(&setups);
    totals.unseen = unseen;
    totals.cull_ms = after_shadows.elapsed().as_secs_f64() * 1e3;
    if plan.has(Pass::Polygons) || preparation.splats(&chunks) <= work.cell_splats {
        for rows in preparation.batches(&setups, &chunks, &scene.meshes) {
            drawing.batch(&setups, &chunks, rows, frame, &mut totals);
        }
    } else {
        drawing.cells((&setups, &chunks), work.cell_splats.max(1), frame, &mut totals);
    }
    totals.report(plan, stats);
}

/// Times and counts of a frame.
#[derive(Default)]
struct Totals {
    shadows_ms: f64,
    cull_ms: f64,
    /// Sorting included.
    setup_ms: f64,
    binning_ms: f64,
    tiles_ms: f64,
    edges_ms: f64,
    batches: usize,
    unseen: Unseen,
    /// Splats behind all that a cell shows.
    hidden: u64,
    set_up: u64,
    drawn: u64,
    /// Clips of splats that were set up, in each part of a view that they touch.
    clips: u64,
    tile_pairs: u64,
    batch_bytes: usize,
    /// Bytes of shadow maps.
    shadow_bytes: usize,
    /// Bytes of records and lists, of all batches.
    bytes: u64,
    counters: Counters,
    /// Whether the next are counted.
    counts_evaluators: bool,
    /// Records by the evaluator that draws them.
    evaluators: [u64; Class::ALL.len()],
}

impl Totals {
    /// Adds what setting up took.
    fn set_up_in(&mut self, time: Duration, prepared: &Prepared) {
        let ms = time.as_secs_f64() * 1e3;
        self.setup_ms += ms;
        self.binning_ms += ms * prepared.sort_share();
    }

    /// Counts a batch, with what it used besides its splats.
    fn add(&mut self, prepared: &Prepared, bytes: usize) {
        self.batches += 1;
        self.set_up += prepared.set_up();
        self.drawn += prepared.drawn();
        self.clips += prepared.clips.count() as u64;
        self.tile_pairs += prepared.tile_pairs();
        self.bytes += prepared.bytes() as u64;
        self.batch_bytes = self.batch_bytes.max(prepared.bytes() + bytes);
        if self.counts_evaluators {
            self.add_evaluators(prepared.evaluators());
        }
    }

    fn add_evaluators(&mut self, counts: [u64; Class::ALL.len()]) {
        self.evaluators.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
    }

    fn report(&self, plan: &FramePlan, stats: &mut Stats) {
        let pass = |name, ms| PassTime { name, ms };
        if plan.has(Pass::ShadowMap) {
            stats.passes.push(pass("shadow maps", self.shadows_ms));
        }
        stats.passes.extend([
            pass("cull", self.cull_ms),
            pass("setup", self.setup_ms - self.binning_ms),
            pass("binning", self.binning_ms),
            pass("tiles", self.tiles_ms),
        ]);
        if NeighbourPlanes::are_needed(plan) {
            stats.passes.push(pass("edges", self.edges_ms));
        }
        stats.drawn = self.drawn;
        // Counting costs time.
        if plan.planes.fragments {
            stats.fragments = self.counters.kept;
            stats.counters.push(("fragments_inside", self.counters.inside as f64));
        }
        let pairs = self.counters.block_pairs.max(1) as f64;
        stats.counters.extend([
            ("batches", self.batches as f64),
            ("culled_outside", self.unseen.outside as f64),
            ("culled_turned_away", self.unseen.turned_away as f64),
            ("culled_hidden", self.hidden as f64),
            ("set_up", self.set_up as f64),
            ("culled", (stats.splats.saturating_sub(self.drawn)) as f64),
            ("clips", self.clips as f64),
            ("tile_pairs", self.tile_pairs as f64),
            ("block_pairs", self.counters.block_pairs as f64),
            ("fragments_tested", (16 * self.counters.block_pairs).saturating_sub(self.counters.spared) as f64),
            ("edge_pixels", self.counters.edge_pixels as f64),
            ("batch_bytes", self.batch_bytes as f64),
            ("shadow_bytes", self.shadow_bytes as f64),
            // Splats are read once, records and lists written once and read once.
            ("bytes_moved", self.set_up as f64 * stats.bytes_per_splat + 2.0 * self.bytes as f64),
            ("tile_ns_per_block_pair", (self.tiles_ms + self.edges_ms) * 1e6 * stats.threads as f64 / pairs),
        ]);
        if self.counts_evaluators {
            let counts = Class::ALL.into_iter().zip(self.evaluators);
            stats.counters.extend(counts.map(|(class, count)| (class.counter(), count as f64)));
        }
    }
}

/// What all batches of a frame share.
struct Drawing<'a> {
    preparation: Preparation<'a>,
    scene: &'a ResidentScene,
    view: &'a View,
    plan: &'a FramePlan,
    wants: Wants,
    layers: Layers,
    culls_hidden: bool,
    draws_dots: bool,
    factors: Vec<[f32; 4]>,
    coverage: Vec<f32>,
    coverage_of_weight: Option<f32>,
    lighting: Lighting,
}

impl Drawing<'_> {
    /// Draws some rows of the frame.
    fn batch(&self, setups: &[ObjectSetup<'_>], seen: &[Seen], rows: Region, frame: &mut Frame, totals: &mut Totals) {
        let start = Instant::now();
        let (plan, instructions, recycled) = (self.plan, self.preparation.instructions, self.preparation.recycled);
        let looks_twice = NeighbourPlanes::are_needed(plan);
        let region = if looks_twice { rows.grown(plan.reach_px(), self.view.size) } else { rows };
        let grid = self.preparation.grid(region);
        let mut prepared = self.preparation.set_up(setups, seen, &grid, rows);
        let triangles = if plan.has(Pass::Polygons) {
            let view = View { region, ..self.view.clone() };
            mesh::project_all(instructions, &self.scene.meshes, &view, &grid, Cull::Back)
        } else {
            Vec::new()
        };
        if plan.has(Pass::RemainingLayer) {
            let Prepared { veils, near, .. } = &mut prepared;
            veils.par_iter_mut().for_each(|veil| self.light_splats(veil, near));
        }
        let dots = small_dots::unfold(&mut prepared.segments, &grid, self.draws_dots);
        let shared = self.shared(&prepared);
        let Prepared { segments, veils, .. } = &prepared;
        let after_setup = Instant::now();
        totals.set_up_in(after_setup - start, &prepared);
        let listing = Listing { segments, grid };
        let tiles = TileJob { listing, shared, lighting: &self.lighting, dots };
        let extras = Extras { meshes: &self.scene.meshes, triangles: &triangles, veils, layers: self.layers };
        let order = heavy_first(&tiles, &extras);
        let job = CompositeJob { tiles, extras, plain: is_plain(plan) };
        let mut bytes = triangles.iter().map(TriangleSegment::bytes).sum::<usize>();
        let mut targets = TileTarget::cut(frame, &grid, rows, self.view.region);
        let mut planes = looks_twice.then(|| self.preparation.recycled.planes(&grid, plan));
        let jobs = targets.iter_mut().zip(tiles_of(planes.as_mut(), grid.tiles())).collect();
        totals.counters +=
            each_tile((instructions, recycled), sorted(jobs, &order), |level, (target, planes), scratch| {
                job.draw(level, target, planes.as_mut(), scratch)
            });
        let after_tiles = Instant::now();
        totals.tiles_ms += (after_tiles - after_setup).as_secs_f64() * 1e3;
        if let Some(planes) = planes {
            bytes += planes.bytes();
            let jobs = sorted(targets.iter_mut().collect(), &order);
            totals.counters += each_tile((instructions, recycled), jobs, |level, target, scratch| {
                job.finish_on(level, target, &planes, scratch)
            });
            totals.edges_ms += after_tiles.elapsed().as_secs_f64() * 1e3;
            self.preparation.recycled.give_back_planes(planes);
        }
        totals.add(&prepared, bytes);
        self.preparation.recycled.give_back(prepared.segments);
    }

    /// Draws the frame cell by cell, each by one thread from setup to pixels.
    fn cells(
        &self,
        (setups, seen): (&[ObjectSetup<'_>], &[Seen]),
        most: usize,
        frame: &mut Frame,
        totals: &mut Totals,
    ) {
        let start = Instant::now();
        let region = self.view.region;
        let grid = self.preparation.grid(region);
        let threads = rayon::current_num_threads();
        let mut targets: Vec<_> = TileTarget::cut(frame, &grid, region, region).into_iter().map(Some).collect();
        let reach = self.plan.reach_px();
        let jobs: Vec<(Cell, Vec<TileTarget<'_>>)> = cells::divide(setups, seen, &grid, (most, reach), threads)
            .into_iter()
            .map(|cell| {
                let tiles = cell.tiles(&grid).filter_map(|tile| targets[tile].take()).collect();
                (cell, tiles)
            })
            .collect();
        let counts_evaluators = totals.counts_evaluators;
        let sums = each(
            jobs,
            || (Totals { counts_evaluators, ..Totals::default() }, 0),
            |(totals, largest), (cell, targets)| {
                let bytes = self.cell(setups, &cell, targets, totals);
                *largest = bytes.max(*largest);
            },
        );
        // Cells are set up and drawn at the same time: stages are shares of it.
        let busy: f64 = sums.iter().map(|(t, _)| t.setup_ms + t.tiles_ms + t.edges_ms).sum();
        let wall = start.elapsed().as_secs_f64() * 1e3 / busy.max(f64::MIN_POSITIVE);
        for (sum, bytes) in sums {
            totals.setup_ms += sum.setup_ms * wall;
            totals.binning_ms += sum.binning_ms * wall;
            totals.tiles_ms += sum.tiles_ms * wall;
            totals.edges_ms += sum.edges_ms * wall;
            totals.batches += sum.batches;
            totals.hidden += sum.hidden;
            totals.set_up += sum.set_up;
            totals.drawn += sum.drawn;
            totals.clips += sum.clips;
            totals.tile_pairs += sum.tile_pairs;
            totals.bytes += sum.bytes;
            totals.counters += sum.counters;
            totals.add_evaluators(sum.evaluators);
            totals.batch_bytes += bytes;
        }
    }

    /// Draws a cell: bytes of memory that it used. What is looked at twice is first drawn with some pixels of its neighbours'.
    fn cell(
        &self,
        setups: &[ObjectSetup<'_>],
        cell: &Cell,
        targets: Vec<TileTarget<'_>>,
        totals: &mut Totals,
    ) -> usize {
        let start = Instant::now();
        let background = self.lighting.background;
        if cell.seen.is_empty() {
            targets.into_iter().for_each(|mut target| target.fill_empty(background));
            totals.tiles_ms += start.elapsed().as_secs_f64() * 1e3;
            return 0;
        }
        let grid = self.preparation.grid(cell.region.grown(self.plan.reach_px(), self.view.size));
        let mut prepared = Prepared::default();
        let first = if self.culls_hidden { cell.first } else { cell.seen.len() };
        let (front, others) = cell.seen.split_at(first);
        self.preparation.set_up_alone(setups, front, (&grid, cell.region), &mut prepared);
        if !others.is_empty() {
            small_dots::unfold(&mut prepared.segments, &grid, false);
            let shared = self.shared(&prepared);
            let listing = Listing { segments: &prepared.segments, grid };
            let mut scratch = self.preparation.recycled.scratch();
            let hiding = Hiding::of(self.preparation.instructions, &listing, &shared, &mut scratch.lists);
            self.preparation.recycled.give_back_scratch(scratch);
            let (hides, others) = others.iter().partition::<Vec<Seen>, _>(|seen| hiding.hides(setups, seen));
            totals.hidden += self.preparation.splats(&hides) as u64;
            self.preparation.set_up_alone(setups, &others, (&grid, cell.region), &mut prepared);
        }
        if self.plan.has(Pass::RemainingLayer) {
            let Prepared { veils, near, .. } = &mut prepared;
            veils.iter_mut().for_each(|veil| self.light_splats(veil, near));
        }
        let after_setup = Instant::now();
        totals.set_up_in(after_setup - start, &prepared);
        let dots = small_dots::unfold(&mut prepared.segments, &grid, self.draws_dots);
        let shared = self.shared(&prepared);
        let Prepared { segments, veils, .. } = &prepared;
        let tiles = TileJob { listing: Listing { segments, grid }, shared, lighting: &self.lighting, dots };
        let extras = Extras { meshes: &[], triangles: &[], veils, layers: self.layers };
        let job = CompositeJob { tiles, extras, plain: is_plain(self.plan) };
        let mut scratch = self.preparation.recycled.scratch();
        let (recycled, instructions) = (self.preparation.recycled, self.preparation.instructions);
        let looks_twice = NeighbourPlanes::are_needed(self.plan);
        let mut planes = looks_twice.then(|| recycled.planes(&grid, self.plan));
        // A cell's grid has its own numbers, and tiles that are its neighbours'.
        let mut all: Vec<TileTarget<'_>> = (0..grid.tiles()).map(TileTarget::nowhere).collect();
        for mut target in targets {
            target.tile = grid.tile_of(target.rect.x, target.rect.y);
            let tile = target.tile;
            all[tile] = target;
        }
        for (target, mut planes) in all.iter_mut().zip(tiles_of(planes.as_mut(), grid.tiles())) {
            totals.counters += job.draw(instructions, target, planes.as_mut(), &mut scratch);
        }
        let after_tiles = Instant::now();
        totals.tiles_ms += (after_tiles - after_setup).as_secs_f64() * 1e3;
        let mut bytes = prepared.bytes();
        if let Some(planes) = planes {
            for target in &mut all {
                totals.counters += job.finish_on(instructions, target, &planes, &mut scratch);
            }
            totals.edges_ms += after_tiles.elapsed().as_secs_f64() * 1e3;
            bytes += planes.bytes();
            recycled.give_back_planes(planes);
        }
        self.preparation.recycled.give_back_scratch(scratch);
        totals.add(&prepared, 0);
        recycled.give_back(prepared.segments);
        bytes
    }

    /// What the blocks of a batch share.
    fn shared<'a>(&'a self, Prepared { near, clips, .. }: &'a Prepared) -> Shared<'a> {
        let Self { wants, coverage_of_weight, .. } = *self;
        Shared { wants, near, clips, factors: &self.factors, coverage: &self.coverage, coverage_of_weight }
    }

    /// Lights transparent splats for the remaining layer.
    fn light_splats(&self, VeilSegment { segment, splats }: &mut VeilSegment, near: &[NearSplat]) {
        let factors = |record: &Record| match self.plan.attributes.material {
            true => self.factors.get(raster::object_of(record, near)).copied().unwrap_or_default(),
            false => self.lighting.material,
        };
        with_instructions!(self.preparation.instructions, simd => {
            simd.vectorize(#[inline(always)] || light_splats(simd, &self.lighting, &segment.records, splats, factors));
        });
    }
}

/// Coverage of a unit of weight, if it is wanted and the same for all splats.
fn coverage_of_weight(scene: &ResidentScene, plan: &FramePlan) -> Option<f32> {
    let filter = &plan.splat_filter;
    let mut scales = scene.objects.iter().map(|o| o.coverage_per_weight(filter.cutoff));
    let first = scales.next()?;
    // Other filters' weights carry what they change.
    let carried = !matches!(filter.filter, Filter::Clamp | Filter::Adjust);
    (plan.attributes.coverage && carried && scales.all(|scale| scale == first)).then_some(first)
}

/// The planes of every tile of so many, where there are any.
fn tiles_of(planes: Option<&mut NeighbourPlanes>, tiles: usize) -> Vec<Option<TilePlanes<'_>>> {
    match planes {
        Some(planes) => planes.cut().into_iter().map(Some).collect(),
        None => (0..tiles).map(|_| None).collect(),
    }
}

/// True if opaque splats alone are drawn, without a look at anything else.
fn is_plain(plan: &FramePlan) -> bool {
    !plan.has(Pass::Polygons) && !plan.separates_transparent && !plan.has(Pass::Outlines) && !plan.has(Pass::EyeDome)
}

/// True if dots serve a plan: if nothing is looked at twice, and their tiles' sums are all that is wanted.
fn draws_dots(plan: &FramePlan) -> bool {
    let Attributes { material, coverage, .. } = plan.attributes;
    // A disk of `clamp` is no ellipse.
    let ellipses = plan.splat_filter.filter != Filter::Clamp;
    is_plain(plan) && !NeighbourPlanes::are_needed(plan) && !material && !coverage && ellipses
}

/// Takes every job on some thread, in the order given, with something of the thread's own.
fn each<T: Send, A: Send>(jobs: Vec<T>, own: impl Fn() -> A + Sync, take: impl Fn(&mut A, T) + Sync) -> Vec<A> {
    let queue = Mutex::new(jobs.into_iter());
    rayon::broadcast(|_| {
        let mut own = own();
        loop {
            // A thread that panics takes the whole frame with it, whatever the queue says.
            let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(job) = next else { return own };
            take(&mut own, job);
        }
    })
}

/// Runs `each` on every tile, on all threads, in the order given.
pub(crate) fn each_tile<'t, T: Send>(
    (instructions, recycled): (Instructions, &Recycled),
    tiles: Vec<T>,
    each: impl Fn(Instructions, &mut T, &mut TileScratch<'t>) -> Counters + Sync,
) -> Counters {
    let sums = self::each(
        tiles,
        || (recycled.scratch(), Counters::default()),
        |(scratch, sum), mut tile| *sum += each(instructions, &mut tile, scratch),
    );
    sums.into_iter().fold(Counters::default(), |mut sum, (scratch, counters)| {
        recycled.give_back_scratch(scratch);
        sum += counters;
        sum
    })
}

/// Tiles with more to do than this many times the mean come first: no thread then waits long for the last one.
const HEAVY: usize = 8;

/// The order in which tiles are drawn: heavy ones, most first; then row by row, since neighbours share records and a cache
/// still has them.
fn heavy_first(tiles: &TileJob<'_>, extras: &Extras<'_>) -> Vec<usize> {
    let Listing { segments, grid } = &tiles.listing;
    let mut loads = vec![0; grid.tiles()];
    fn add(loads: &mut [usize], lengths: impl Iterator<Item = usize>) {
        loads.iter_mut().zip(lengths).for_each(|(load, length)| *load += length);
    }
    segments.iter().for_each(|s| add(&mut loads, s.lengths()));
    extras.veils.iter().for_each(|v| add(&mut loads, v.segment.lengths()));
    extras.triangles.iter().for_each(|t| add(&mut loads, t.lists.lengths()));
    let busy = loads.iter().filter(|&&l| l > 0).count().max(1);
    let heavy = HEAVY * loads.iter().sum::<usize>() / busy;
    let mut tiles: Vec<usize> = (0..grid.tiles()).collect();
    tiles.sort_by_key(|&tile| if loads[tile] > heavy { (0, usize::MAX - loads[tile]) } else { (1, tile) });
    tiles
}

fn sorted<T>(items: Vec<T>, order: &[usize]) -> Vec<T> {
    let mut items: Vec<Option<T>> = items.into_iter().map(Some).collect();
    order.iter().filter_map(|&i| items[i].take()).collect()
}
