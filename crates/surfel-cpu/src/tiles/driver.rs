//! Execution of jobs on all threads in a given order, the parameters by which work is divided, and counters for
//! statistics.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *tile* is a square of blocks
//! ([`Grid`](crate::tiles::grid::Grid)).

use crate::tiles::grid::TILE_BLOCKS;
use std::sync::{Mutex, PoisonError};

/// Parameters of the division of work. They change speed and memory, but no bit of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tuning {
    /// Number of blocks of 4×4 pixels along the side of a tile: 2, 4 or 8.
    pub tile_blocks: u32,
    /// Largest number of splats and triangles in a cell, the part of an image that one thread sets up and then draws.
    /// Cells consist of whole tiles, so some exceed it. At 140 bytes each, a cell's splats should about fit the
    /// thread's cache. Splats on the border of two cells are set up twice.
    pub cell_splats: usize,
    /// True if chunks behind everything visible in a cell are culled (occlusion culling).
    pub culls_occluded: bool,
    /// True if setup computes the fragments of tiny splats, and tiles of tiny splats may be drawn splat by splat.
    pub finds_tiny: bool,
}

impl Default for Tuning {
    fn default() -> Self {
        Self { tile_blocks: TILE_BLOCKS, cell_splats: 1 << 15, culls_occluded: true, finds_tiny: true }
    }
}

/// Runs every job on some thread, starting them in the given order. Each thread has a state of its own, which `own`
/// creates. `take` runs a job with its thread's state. Returns the threads' states.
pub(crate) fn run<T: Send, A: Send>(
    jobs: Vec<T>,
    own: impl Fn() -> A + Sync,
    take: impl Fn(&mut A, T) + Sync,
) -> Vec<A> {
    let queue = Mutex::new(jobs.into_iter());
    rayon::broadcast(|_| {
        let mut own = own();
        loop {
            // A poisoned queue needs no handling: a thread's panic ends the whole frame.
            let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(job) = next else { return own };
            take(&mut own, job);
        }
    })
}

/// Counts of events while tiles are drawn, for a frame's statistics.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counters {
    /// Number of pairs of a block and a splat whose fragments were computed.
    pub block_pairs: u64,
    /// Number of fragments of the pairs in `block_pairs` that are inside the splat's filtered footprint.
    pub inside: u64,
    /// Number of pixels of the pairs in `block_pairs` that weren't computed, since the splat is tiny and has fewer
    /// pixels than a block.
    pub skipped_pixels: u64,
    /// Number of fragments that contributed to a pixel.
    pub contributing: u64,
    /// Number of edge pixels that were antialiased.
    pub edge_pixels: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, o: Self) {
        self.block_pairs += o.block_pairs;
        self.inside += o.inside;
        self.skipped_pixels += o.skipped_pixels;
        self.contributing += o.contributing;
        self.edge_pixels += o.edge_pixels;
    }
}
