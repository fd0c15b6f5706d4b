//! Occlusion culling: chunks behind all that a cell shows aren't set up.
//!
//! Chunks come from near to far. Where several layers of them would fill a cell, the first layers are set up and their
//! depth thresholds found, block by block; of the others only those remain that reach before them somewhere.

use crate::cull::chunks::VisibleChunk;
use crate::cull::object::{ObjectView, inside};
use crate::tiles::grid::{BLOCK, Grid};
use surfel_render::Region;

/// Slack of a chunk's nearest depth, relative to its farthest: far above rounding in setup.
const DEPTH_SLACK: f64 = 1e-5;

/// The farthest depth threshold of each block of a cell: nothing behind it is seen there.
pub(crate) struct OcclusionMap {
    region: Region,
    /// Column and row of the first block, and blocks a row.
    first: [u32; 2],
    columns: usize,
    /// Row by row; +∞ where some pixel shows nothing.
    farthest: Vec<f32>,
}

impl OcclusionMap {
    /// Nothing occludes anything yet.
    pub(crate) fn new(grid: &Grid) -> Self {
        let side = grid.tile_blocks;
        let columns = (grid.columns * side) as usize;
        Self {
            region: grid.region,
            first: grid.origin.map(|px| px / BLOCK),
            columns,
            farthest: vec![f32::INFINITY; columns * (grid.rows * side) as usize],
        }
    }

    /// Sets the farthest threshold of the block whose first pixel is given.
    pub(crate) fn set(&mut self, (x, y): (i32, i32), farthest: f32) {
        let (column, row) = (x as u32 / BLOCK - self.first[0], y as u32 / BLOCK - self.first[1]);
        self.farthest[row as usize * self.columns + column as usize] = farthest;
    }

    /// True if no pixel can show a splat of a chunk. Never so of a transparent object's: where filtered splats are the
    /// nearest in a pixel without any weight there, nothing occludes what is transparent.
    pub(crate) fn occludes(&self, objects: &[ObjectView<'_>], chunk: &VisibleChunk) -> bool {
        let (object, chunk) = chunk.of(objects);
        if object.is_transparent() {
            return false;
        }
        let center = object.center(chunk);
        let [near, far] = object.depths(center, chunk);
        let nearest = near - far.abs() * DEPTH_SLACK;
        let [x0, y0, x1, y1] = inside(object.pixels(center, chunk), self.region);
        if x0 > x1 || y0 > y1 {
            return true;
        }
        let block = |px: f64, axis: usize| (px as u32 / BLOCK).saturating_sub(self.first[axis]) as usize;
        let columns = block(x0, 0)..(block(x1, 0) + 1).min(self.columns);
        let rows = self.farthest.chunks(self.columns).take(block(y1, 1) + 1).skip(block(y0, 1));
        rows.into_iter().all(|row| row[columns.clone()].iter().all(|&farthest| f64::from(farthest) < nearest))
    }
}
