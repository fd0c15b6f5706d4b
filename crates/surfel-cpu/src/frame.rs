//! A frame: chunks from near to far, in batches of rows, each set up, sorted into tiles and drawn.

use crate::bins::{BLOCK, Grid, Segment};
use crate::edge::EdgePlanes;
use crate::level::{Instructions, with_instructions};
use crate::raster::{Shared, Wants};
use crate::recycle::Recycled;
use crate::renderer::{ResidentScene, Work};
use crate::setup::{ObjectSetup, SetupOutput};
use crate::shade::Lighting;
use crate::target::TileTarget;
use crate::tile::{Counters, EdgeRows, TileJob, TileScratch};
use fearless_simd::Simd;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use surfel_model::{Light, Material};
use surfel_render::{Frame, FramePlan, Pass, PassTime, Region, Stats, View};

/// Chunks that one task sets up and bins, at most: enough splats (64 × 256) to be worth a list per tile.
const CHUNKS_PER_SEGMENT: usize = 64;

/// Tasks a thread, at least, so that none waits long for the last.
const SEGMENTS_PER_THREAD: usize = 8;

/// A chunk that may be seen.
#[derive(Clone, Copy)]
struct Seen {
    object: u32,
    chunk: u32,
    /// Depth of its centre: what is near comes first, so that what it hides is found early.
    z: f64,
}

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
    let material = scene.objects.first().map_or(Material::default(), |o| o.material).factors();
    let drawing = Drawing {
        instructions,
        work,
        recycled,
        scene,
        view,
        plan,
        wants: Wants::new(plan, view),
        factors: scene.objects.iter().map(|o| o.material.factors().map(|f| f as f32)).collect(),
        coverage: scene.objects.iter().map(|o| o.coverage_per_weight(plan.splat_filter.cutoff)).collect(),
        lighting: Lighting::new(plan, view, lights, scene.ambient, material, scene.background),
    };
    let chunks = drawing.seen();
    let mut totals = Totals { cull_ms: start.elapsed().as_secs_f64() * 1e3, ..Totals::default() };
    for rows in drawing.batches(&chunks) {
        drawing.batch(&chunks, rows, frame, &mut totals);
    }
    totals.report(plan, stats);
}

/// Times and counts of a frame.
#[derive(Default)]
struct Totals {
    cull_ms: f64,
    setup_ms: f64,
    tiles_ms: f64,
    edges_ms: f64,
    batches: usize,
    set_up: u64,
    drawn: u64,
    tile_pairs: u64,
    edge_pixels: u64,
    batch_bytes: usize,
    counters: Counters,
}

impl Totals {
    fn report(&self, plan: &FramePlan, stats: &mut Stats) {
        let pass = |name, ms| PassTime { name, ms };
        stats.passes.extend([pass("cull", self.cull_ms), pass("setup", self.setup_ms), pass("tiles", self.tiles_ms)]);
        if plan.has(Pass::EdgeAntialiasing) {
            stats.passes.push(pass("edges", self.edges_ms));
        }
        stats.drawn = self.drawn;
        stats.fragments = self.counters.kept;
        let pairs = self.counters.block_pairs.max(1) as f64;
        stats.counters.extend([
            ("batches", self.batches as f64),
            ("set_up", self.set_up as f64),
            ("culled", (stats.splats.saturating_sub(self.drawn)) as f64),
            ("tile_pairs", self.tile_pairs as f64),
            ("block_pairs", self.counters.block_pairs as f64),
            ("fragments_tested", self.counters.block_pairs as f64 * 16.0),
            ("fragments_inside", self.counters.inside as f64),
            ("edge_pixels", self.edge_pixels as f64),
            ("batch_bytes", self.batch_bytes as f64),
            ("tile_ns_per_block_pair", self.tiles_ms * 1e6 * stats.threads as f64 / pairs),
        ]);
    }
}

/// What all batches of a frame share.
struct Drawing<'a> {
    instructions: Instructions,
    work: Work,
    recycled: &'a Recycled,
    scene: &'a ResidentScene,
    view: &'a View,
    plan: &'a FramePlan,
    wants: Wants,
    factors: Vec<[f32; 4]>,
    coverage: Vec<f32>,
    lighting: Lighting,
}

impl Drawing<'_> {
    fn grid(&self, region: Region) -> Grid {
        Grid::new(region, self.work.tile_px / BLOCK)
    }

    fn setups<'s>(&'s self, view: &'s View, grid: Grid) -> Vec<ObjectSetup<'s>> {
        let objects = self.scene.objects.iter().enumerate();
        objects.map(|(i, o)| ObjectSetup::new(o, i as u32, view, self.plan, grid)).collect()
    }

    /// Chunks that are not outside the view or turned away, from near to far.
    fn seen(&self) -> Vec<Seen> {
        let setups = self.setups(self.view, self.grid(self.view.region));
        let mut seen: Vec<Seen> = setups
            .par_iter()
            .enumerate()
            .flat_map(|(object, setup)| {
                let chunks = setup.object.chunks.par_iter().enumerate().with_min_len(1024);
                chunks.filter_map(move |(chunk, c)| {
                    let center = setup.center(c);
                    let hidden = setup.is_outside(center, c) || setup.is_turned_away(c);
                    (!hidden).then_some(Seen { object: object as u32, chunk: chunk as u32, z: center.z })
                })
            })
            .collect();
        let order = |a: &Seen, b: &Seen| a.z.total_cmp(&b.z).then((a.object, a.chunk).cmp(&(b.object, b.chunk)));
        seen.par_sort_unstable_by(order);
        seen
    }

    /// Rows of the view's region, in batches that each set up about as many splats as they may.
    fn batches(&self, seen: &[Seen]) -> Vec<Region> {
        let region = self.view.region;
        let objects = &self.scene.objects;
        let splats: usize = seen.iter().map(|s| objects[s.object as usize].chunks[s.chunk as usize].count).sum();
        let most = self.work.batch_splats.max(1);
        if splats <= most || region.height == 0 {
            return vec![region];
        }
        let tile = self.work.tile_px;
        let strips = (region.y + region.height).div_ceil(tile) - region.y / tile;
        let mut load = vec![0.0; strips as usize];
        let setups = self.setups(self.view, self.grid(region));
        for s in seen {
            let setup = &setups[s.object as usize];
            let chunk = &setup.object.chunks[s.chunk as usize];
            let [top, bottom] = setup.rows(chunk);
            let strip = |row: f64| {
                let strip = (row / f64::from(tile)).floor() - f64::from(region.y / tile);
                strip.clamp(0.0, f64::from(strips - 1)) as usize
            };
            let covered = strip(top)..=strip(bottom);
            let share = chunk.count as f64 / (covered.end() - covered.start() + 1) as f64;
            load[covered].iter_mut().for_each(|l| *l += share);
        }
        let mut batches = Vec::new();
        let (mut first, mut sum) = (region.y, 0.0);
        for (i, load) in load.iter().enumerate() {
            let strip_y = ((region.y / tile + i as u32) * tile).max(region.y);
            if sum > 0.0 && sum + load > most as f64 {
                batches.push(Region { y: first, height: strip_y - first, ..region });
                (first, sum) = (strip_y, 0.0);
            }
            sum += load;
        }
        batches.push(Region { y: first, height: region.y + region.height - first, ..region });
        batches
    }

    /// Draws some rows of the frame.
    fn batch(&self, seen: &[Seen], rows: Region, frame: &mut Frame, totals: &mut Totals) {
        let start = Instant::now();
        let has_edges = self.plan.has(Pass::EdgeAntialiasing);
        let region = if has_edges { EdgePlanes::grown(rows, self.view) } else { rows };
        let view = View { region, ..self.view.clone() };
        let grid = self.grid(region);
        let setups = self.setups(&view, grid);
        let threads = rayon::current_num_threads();
        let per_task = seen.len().div_ceil(threads * SEGMENTS_PER_THREAD).clamp(1, CHUNKS_PER_SEGMENT);
        let mut segments: Vec<Segment> = seen
            .par_chunks(per_task)
            .map(|chunks| {
                let splats = chunks.iter().map(|s| setups[s.object as usize].object.chunks[s.chunk as usize].count);
                let (mut segment, mut entries) = (self.recycled.segment(), self.recycled.entries());
                // Memory that isn't written costs nothing.
                segment.records.reserve(splats.sum());
                let mut out = SetupOutput { segment: &mut segment, entries: &mut entries };
                with_instructions!(self.instructions, simd => set_up(simd, &setups, chunks, &mut out));
                segment.sort(&entries, &grid);
                self.recycled.give_back_entries(entries);
                segment
            })
            .collect();
        let (mut near, mut clips) = (Vec::new(), Vec::new());
        for segment in &mut segments {
            segment.move_rare(&mut near, &mut clips);
        }
        totals.batches += 1;
        totals.set_up += segments.iter().map(|s| s.set_up).sum::<u64>();
        totals.drawn += segments.iter().map(|s| s.records.len() as u64).sum::<u64>();
        totals.tile_pairs += segments.iter().map(|s| s.pairs() as u64).sum::<u64>();
        totals.batch_bytes = totals.batch_bytes.max(
            segments.iter().map(Segment::bytes).sum::<usize>()
                + size_of_val(near.as_slice())
                + size_of_val(clips.as_slice()),
        );
        let after_setup = Instant::now();
        totals.setup_ms += (after_setup - start).as_secs_f64() * 1e3;
        let shared =
            Shared { wants: self.wants, near: &near, clips: &clips, factors: &self.factors, coverage: &self.coverage };
        let job = TileJob { segments: &segments, grid, shared, lighting: &self.lighting };
        let order = heavy_first(&segments, &grid);
        if !has_edges {
            let targets = TileTarget::cut(frame, &grid, rows, self.view.region);
            let counters = self.each_tile(sorted(targets, &order), |simd_level, target, scratch| {
                with_instructions!(simd_level, simd => simd.vectorize(#[inline(always)] || job.draw(simd, target, None, scratch)))
            });
            totals.counters += counters;
            totals.tiles_ms += after_setup.elapsed().as_secs_f64() * 1e3;
            self.recycled.give_back(segments);
            return;
        }
        let mut planes = EdgePlanes::new(region);
        let targets = TileTarget::cut(frame, &grid, rows, self.view.region);
        let pairs: Vec<(TileTarget<'_>, EdgeRows<'_>)> = targets.into_iter().zip(planes.cut(&grid)).collect();
        totals.counters += self.each_tile(sorted(pairs, &order), |simd_level, (target, edges), scratch| {
            with_instructions!(simd_level, simd => simd.vectorize(#[inline(always)] || job.draw(simd, target, Some(edges), scratch)))
        });
        let after_tiles = Instant::now();
        totals.tiles_ms += (after_tiles - after_setup).as_secs_f64() * 1e3;
        let targets = TileTarget::cut(frame, &grid, rows, self.view.region);
        let edges = self.each_tile(sorted(targets, &order), |simd_level, target, scratch| {
            with_instructions!(simd_level, simd => simd.vectorize(#[inline(always)] || job.blend_edges(simd, target, &planes, scratch)))
        });
        totals.edge_pixels += edges.edge_pixels;
        totals.edges_ms += after_tiles.elapsed().as_secs_f64() * 1e3;
        self.recycled.give_back(segments);
    }

    /// Runs `each` on every tile, on all threads, in the order given.
    fn each_tile<'t, T: Send>(
        &self,
        tiles: Vec<T>,
        each: impl Fn(Instructions, &mut T, &mut TileScratch<'t>) -> Counters + Sync,
    ) -> Counters {
        let queue = Mutex::new(tiles.into_iter());
        let counters = rayon::broadcast(|_| {
            let mut scratch = TileScratch::new();
            let mut sum = Counters::default();
            loop {
                // A thread that panics takes the whole frame with it, whatever the queue says.
                let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some(mut tile) = next else { return sum };
                sum += each(self.instructions, &mut tile, &mut scratch);
            }
        });
        counters.into_iter().fold(Counters::default(), |mut a, b| {
            a += b;
            a
        })
    }
}

/// Tiles with more to do than this many times the mean come first: no thread then waits long for the last one.
const HEAVY: usize = 8;

/// The order in which tiles are drawn: heavy ones, most first; then row by row, since neighbours share records and a cache
/// still has them.
fn heavy_first(segments: &[Segment], grid: &Grid) -> Vec<usize> {
    let load = |tile| segments.iter().map(|s| s.of(tile).len()).sum::<usize>();
    let loads: Vec<usize> = (0..grid.tiles()).map(load).collect();
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

#[inline(always)]
fn set_up<S: Simd>(simd: S, setups: &[ObjectSetup<'_>], chunks: &[Seen], out: &mut SetupOutput<'_>) {
    simd.vectorize(
        #[inline(always)]
        || {
            for seen in chunks {
                let setup = &setups[seen.object as usize];
                setup.chunk(simd, &setup.object.chunks[seen.chunk as usize], out);
            }
        },
    );
}
