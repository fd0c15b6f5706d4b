//! Division of a region into tiles, and of tiles into blocks of 4×4 pixels.

use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::Real;
use surfel_render::Region;

/// Side of a block in pixels. A block, the unit of rasterisation, has sixteen pixels, one for each lane.
pub(crate) const BLOCK: u32 = 4;

/// Largest number of blocks along a tile's side, so that a `u64` has one bit for each block of a tile.
pub(crate) const TILE_BLOCKS: u32 = 8;

/// A region of the image divided into tiles. Tile corners are multiples of the tile size in the image, so that a
/// block's results don't depend on the region.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    pub region: Region,
    /// Number of blocks of 4×4 pixels along a tile's side: 2, 4 or 8.
    pub tile_blocks: u32,
    /// Column and row of the first tile's first pixel in the image.
    pub origin: [u32; 2],
    pub columns: u32,
    pub rows: u32,
}

impl Grid {
    pub(crate) fn new(region: Region, tile_blocks: u32) -> Self {
        let tile = tile_blocks * BLOCK;
        let first = [region.x / tile, region.y / tile];
        Self {
            region,
            tile_blocks,
            origin: first.map(|i| i * tile),
            columns: (region.x + region.width).div_ceil(tile) - first[0],
            rows: (region.y + region.height).div_ceil(tile) - first[1],
        }
    }

    pub(crate) fn tiles(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Returns the index of the tile that contains a pixel of the region.
    pub(crate) fn tile_of(&self, x: i32, y: i32) -> usize {
        let [column, row] =
            [(x, self.origin[0]), (y, self.origin[1])].map(|(at, first)| (at as u32 - first) / self.tile_px());
        (row * self.columns + column) as usize
    }

    /// Returns the side of a tile, in pixels.
    pub(crate) fn tile_px(&self) -> u32 {
        self.tile_blocks * BLOCK
    }

    /// Returns the column and row in the image of the first (upper left) pixel of a tile's block.
    pub(crate) fn block_px(&self, tile: usize, block: u32) -> (i32, i32) {
        let [x, y] = [tile as u32 % self.columns, tile as u32 / self.columns];
        let px = |tile: u32, axis: usize| (self.origin[axis] + tile * self.tile_px()) as i32;
        block_px((px(x, 0), px(y, 1)), block)
    }

    /// Returns bits of those blocks of a tile that have pixels of the region.
    pub(crate) fn blocks(&self, tile: usize) -> u64 {
        let rect = Rect::of_tile(self, tile, self.region);
        let (x, y) = self.block_px(tile, 0);
        let block = |px: i32| (px.max(0) as u32).div_ceil(BLOCK);
        let (x0, y0) = ((rect.x - x) as u32 / BLOCK, (rect.y - y) as u32 / BLOCK);
        let row = (1u64 << block(rect.end_x - x)) - (1u64 << x0);
        (y0..block(rect.end_y - y)).fold(0, |bits, y| bits | row << (TILE_BLOCKS * y))
    }
}

/// Returns the column and row in the image of a block's first (upper left) pixel, given the first pixel of its tile.
#[inline(always)]
pub(crate) fn block_px((x, y): (i32, i32), block: u32) -> (i32, i32) {
    (x + (block % TILE_BLOCKS * BLOCK) as i32, y + (block / TILE_BLOCKS * BLOCK) as i32)
}

/// A rectangle of pixels of an image: its first column and row, and the column and row after its last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rect {
    pub x: i32,
    pub y: i32,
    pub end_x: i32,
    pub end_y: i32,
}

impl Rect {
    pub(crate) fn of(region: Region) -> Self {
        let [x, y, w, h] = [region.x, region.y, region.width, region.height].map(|v| v as i32);
        Self { x, y, end_x: x + w, end_y: y + h }
    }

    /// Returns the rectangle of a tile's pixels inside `region`, which may be empty.
    pub(crate) fn of_tile(grid: &Grid, tile: usize, region: Region) -> Self {
        let size = grid.tile_px();
        let column = tile as u32 % grid.columns;
        let row = tile as u32 / grid.columns;
        let [x, y] = [grid.origin[0] + column * size, grid.origin[1] + row * size].map(|v| v as i32);
        let whole = Self { x, y, end_x: x + size as i32, end_y: y + size as i32 };
        whole.common(&Self::of(region))
    }

    /// Returns the smallest rectangle that contains both rectangles.
    pub(crate) fn with(&self, o: &Self) -> Self {
        Self { x: self.x.min(o.x), y: self.y.min(o.y), end_x: self.end_x.max(o.end_x), end_y: self.end_y.max(o.end_y) }
    }

    /// Returns the intersection of both rectangles, which may be empty.
    pub(crate) fn common(&self, o: &Self) -> Self {
        Self { x: self.x.max(o.x), y: self.y.max(o.y), end_x: self.end_x.min(o.end_x), end_y: self.end_y.min(o.end_y) }
    }

    /// True if the rectangle has no pixel.
    pub(crate) fn is_empty(&self) -> bool {
        self.x >= self.end_x || self.y >= self.end_y
    }

    /// True if the pixel (x, y) is inside the rectangle.
    pub(crate) fn has(&self, x: i32, y: i32) -> bool {
        (self.x..self.end_x).contains(&x) && (self.y..self.end_y).contains(&y)
    }

    /// Returns a mask of those pixels, given by columns and rows, that are inside the rectangle.
    #[inline(always)]
    pub(crate) fn contains_lanes<S: Simd>(&self, (x, y): (Lanes<S>, Lanes<S>)) -> mask32x16<S> {
        let k = |v: i32| f64::from(v);
        let column = x.constant(k(self.x)).le(x) & x.lt(x.constant(k(self.end_x)));
        column & y.constant(k(self.y)).le(y) & y.lt(y.constant(k(self.end_y)))
    }

    /// Returns 1 for each pixel of a block that is inside the rectangle, else 0. (x, y) is the block's first pixel.
    #[inline(always)]
    pub(crate) fn lanes_inside<S: Simd>(&self, simd: S, (x, y): (i32, i32)) -> i32x16<S> {
        if self.x <= x && x + 4 <= self.end_x && self.y <= y && y + 4 <= self.end_y {
            return i32x16::splat(simd, 1);
        }
        let bits = self.lanes_of_block((x, y));
        let mut inside = [0; LANES];
        for (i, lane) in inside.iter_mut().enumerate() {
            *lane = (bits >> i & 1) as i32;
        }
        i32x16::load_array(simd, inside)
    }

    /// Returns bits of a block's pixels that are inside the rectangle. (x, y) is the block's first pixel.
    pub(crate) fn lanes_of_block(&self, (x, y): (i32, i32)) -> u64 {
        let row = (0..4).filter(|i| (self.x..self.end_x).contains(&(x + i))).fold(0u64, |bits, i| bits | 1 << i);
        let inside = |j: &i32| (self.y..self.end_y).contains(&(y + j));
        (0..4).filter(inside).fold(0, |bits, j| bits | row << (4 * j))
    }
}
