//! Occlusion culling: chunks behind everything visible in a cell aren't set up.
//!
//! Chunks are sorted from near to far. If several layers of chunks fill a cell, the first layers are set up and each
//! block's farthest depth threshold is found. A later chunk is set up only if it reaches in front of that threshold in
//! some block.
//!
//! A *cell* is a part of the view that one thread draws alone ([`Cell`](crate::cull::cells::Cell)).

use crate::cull::chunks::VisibleChunk;
use crate::cull::object::{ObjectView, inside};
use crate::tiles::grid::{BLOCK, Grid};
use surfel_render::Region;

/// Amount by which a chunk's nearest depth is reduced in the test of occlusion, as a fraction of its farthest depth. It
/// is far above the rounding of setup.
const DEPTH_SLACK: f64 = 1e-5;

/// The farthest depth threshold of each block (4×4 pixels) of a cell. No splat behind the threshold is visible in the
/// block.
pub(crate) struct OcclusionMap {
    region: Region,
    /// Column and row of the first block, counted from the image's corner.
    first: [u32; 2],
    /// Number of blocks per row.
    columns: usize,
    /// Farthest depth threshold of each block, row by row; +∞ if some pixel of the block is empty.
    farthest: Vec<f32>,
}

impl OcclusionMap {
    /// Returns a map of a grid's blocks in which nothing is occluded.
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

    /// Sets the farthest depth threshold of the block whose first pixel is given.
    pub(crate) fn set(&mut self, (x, y): (i32, i32), farthest: f32) {
        let (column, row) = (x as u32 / BLOCK - self.first[0], y as u32 / BLOCK - self.first[1]);
        self.farthest[row as usize * self.columns + column as usize] = farthest;
    }

    /// True if no pixel can show a splat of the chunk. Always false for an object with transparent splats: a pixel
    /// without weight hides none of them, even if it has a depth threshold (rendering model §5).
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
