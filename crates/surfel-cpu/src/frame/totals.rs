//! Times and counts of a frame.
//!
//! A *cell* is a part of the view that one thread draws alone ([`Cell`](crate::cull::cells::Cell)). A *record* is a
//! splat projected to the screen ([`Record`](crate::setup::record::Record)). A *tile* is a square of 8 to 32 pixels a
//! side ([`Grid`](crate::tiles::grid::Grid)).

use crate::setup::balls::BallSegment;
use crate::setup::prepare::CellSplats;
use crate::tiles::driver::Counters;
use std::time::Duration;
use surfel_render::{FramePlan, Pass, PassTime, Stats};

/// Times and counts of a frame, or of the cells that one thread draws. In a thread's totals, the times of setup, tiles
/// and screen-space passes are the thread's own. In a frame's totals, they are fractions of the wall time.
#[derive(Default)]
pub(crate) struct Totals {
    /// Wall time of drawing shadow maps, in milliseconds.
    pub shadows_ms: f64,
    /// Wall time of culling chunks outside the view and back-facing ones, in milliseconds. The division into cells
    /// counts as part of drawing, in proportion to the times of setup, tiles and screen-space passes.
    pub cull_ms: f64,
    /// Time of setup, including the sorting of records into tiles, in milliseconds.
    setup_ms: f64,
    /// Part of the time of setup that the sorting of records into tiles takes, in milliseconds.
    binning_ms: f64,
    /// Time of drawing tiles, in milliseconds.
    pub tiles_ms: f64,
    /// Time of screen-space passes, in milliseconds.
    pub screen_ms: f64,
    /// Number of cells with splats, balls or triangles.
    cells: usize,
    /// Number of splats in chunks that were culled because they are outside the view.
    pub outside: u64,
    /// Number of splats in chunks that were culled because they are back-facing.
    pub back_facing: u64,
    /// Number of splats in chunks that were culled in a cell because nearer splats hide them there. A splat counts in
    /// each cell in which it was culled.
    pub occluded: u64,
    /// Number of splats that were set up, including those for which setup made no record. A splat counts in each cell
    /// that it may touch.
    set_up: u64,
    /// Number of drawn splats, each counted in one cell.
    drawn: u64,
    /// Number of clips that setup converted to forms over pixels. A clipped splat counts in each cell that it touches.
    clips: u64,
    /// Number of pairs of a tile and a projected splat (record) that may touch it: the entries of all tiles' lists.
    tile_pairs: u64,
    /// Largest memory that a cell needed, in bytes; in a frame's totals, the sum of the threads' largest.
    cell_bytes: usize,
    /// Memory of shadow maps, in bytes.
    pub shadow_bytes: usize,
    /// Memory of the records and tile lists of all cells together, in bytes.
    bytes: u64,
    pub counters: Counters,
}

impl Totals {
    /// Adds `time`, which setting up a cell with these splats took. Sorting into tiles gets its measured fraction of
    /// it.
    pub(crate) fn set_up_in(&mut self, time: Duration, splats: &CellSplats) {
        let ms = time.as_secs_f64() * 1e3;
        self.setup_ms += ms;
        self.binning_ms += ms * splats.sort_share();
    }

    /// Counts a cell, its splats, and `bytes` of memory that the cell needed besides its splats.
    pub(crate) fn add_cell(&mut self, splats: &CellSplats, bytes: usize) {
        self.cells += 1;
        self.set_up += splats.set_up();
        self.drawn += splats.drawn();
        self.clips += splats.clips.count() as u64;
        self.tile_pairs += splats.tile_pairs();
        self.bytes += splats.bytes() as u64;
        self.cell_bytes = self.cell_bytes.max(splats.bytes() + bytes);
    }

    /// Counts a cell's balls. `drawn` is the number of those whose centre is in the cell, so that each ball counts in
    /// one cell.
    pub(crate) fn add_balls(&mut self, balls: &BallSegment, drawn: usize) {
        self.set_up += balls.set_up as u64;
        self.drawn += drawn as u64;
        self.tile_pairs += balls.lists.len() as u64;
        self.bytes += balls.bytes() as u64;
    }

    /// Adds the totals of all threads, which together took `wall_ms` milliseconds of wall time. Threads set up and draw
    /// cells concurrently, so each stage gets its fraction of the wall time.
    pub(crate) fn add_threads(&mut self, threads: &[Self], wall_ms: f64) {
        let busy: f64 = threads.iter().map(|t| t.setup_ms + t.tiles_ms + t.screen_ms).sum();
        let wall = wall_ms / busy.max(f64::MIN_POSITIVE);
        for thread in threads {
            self.setup_ms += thread.setup_ms * wall;
            self.binning_ms += thread.binning_ms * wall;
            self.tiles_ms += thread.tiles_ms * wall;
            self.screen_ms += thread.screen_ms * wall;
            self.cells += thread.cells;
            self.occluded += thread.occluded;
            self.set_up += thread.set_up;
            self.drawn += thread.drawn;
            self.clips += thread.clips;
            self.tile_pairs += thread.tile_pairs;
            self.bytes += thread.bytes;
            self.counters += thread.counters;
            self.cell_bytes += thread.cell_bytes;
        }
    }

    pub(crate) fn report(&self, plan: &FramePlan, stats: &mut Stats) {
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
        if plan.reach_px() > 0 {
            stats.passes.push(pass("edges", self.screen_ms));
        }
        stats.drawn = self.drawn;
        // Fragments are counted only on request, since counting costs time.
        if plan.planes.fragments {
            stats.fragments = self.counters.contributing;
            stats.counters.push(("fragments_inside", self.counters.inside as f64));
        }
        let pairs = self.counters.block_pairs.max(1) as f64;
        stats.counters.extend([
            ("cells", self.cells as f64),
            ("culled_outside", self.outside as f64),
            ("culled_back_facing", self.back_facing as f64),
            ("culled_occluded", self.occluded as f64),
            ("set_up", self.set_up as f64),
            ("culled", (stats.splats.saturating_sub(self.drawn)) as f64),
            ("clips", self.clips as f64),
            ("tile_pairs", self.tile_pairs as f64),
            ("block_pairs", self.counters.block_pairs as f64),
            ("fragments_tested", (16 * self.counters.block_pairs).saturating_sub(self.counters.skipped_pixels) as f64),
            ("edge_pixels", self.counters.edge_pixels as f64),
            ("batch_bytes", self.cell_bytes as f64),
            ("shadow_bytes", self.shadow_bytes as f64),
            // Splats are read once; records and lists are written once and read once.
            ("bytes_moved", self.set_up as f64 * stats.bytes_per_splat + 2.0 * self.bytes as f64),
            ("tile_ns_per_block_pair", (self.tiles_ms + self.screen_ms) * 1e6 * stats.threads as f64 / pairs),
        ]);
    }
}
