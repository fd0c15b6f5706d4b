//! Search for the pixels that are sampled (rendering model §5, edges by samples): those on either side of a depth step.
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *cell* is a part of the view that one thread draws alone
//! ([`Cell`](crate::cull::cells::Cell)). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::screen::gbuffer::{GBuffer, SIDE, TileRows};
use crate::screen::layer_steps::LayerSteps;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::drawn::BlockSet;
use crate::tiles::grid::{BLOCK, Grid, Rect};
use fearless_simd::Simd;
use fearless_simd::prelude::*;
use surfel_math::Real;
use surfel_render::{Region, SAMPLES_SIDE};

// The samples of a pixel form a block.
const _: () = assert!(SAMPLES_SIDE == BLOCK, "samples of a pixel fill a block");

/// Planes of a tile without content: begin and end of surfaces (infinitely far), and number of layers (0), each twice.
static NOTHING: [[TileRows; 2]; 2] = [[TileRows::EMPTY, TileRows::EMPTY], [TileRows::ZERO, TileRows::ZERO]];

/// Flags of a tile's pixels: one word per row of pixels, one bit per pixel.
type Pixels = [u32; SIDE];

const _: () = assert!(SIDE == u32::BITS as usize, "a row of pixels has a bit each");

/// Planes of a cell in which depth steps are found.
pub(crate) struct StepPlanes<'a> {
    pub gbuffer: &'a GBuffer,
    pub layers: &'a LayerSteps,
    /// Grid of the tiles of the G-buffer and of the layers.
    pub grid: &'a Grid,
}

/// A quantity with a begin and an end that is compared between neighbouring pixels. There is a step where its begin in
/// one pixel is greater than its end in the other.
#[derive(Clone, Copy)]
enum Compared {
    /// Depth range of the nearest surface.
    Surfaces,
    /// Depth range of the nearest transparent layer.
    Layers,
    /// Number of transparent layers, as both begin and end, so that any two different numbers are a step.
    Counts,
}

impl StepPlanes<'_> {
    /// Returns the pixels of a region of the grid that must be sampled, as blocks of the view whose pixels are samples.
    #[inline(never)]
    pub(crate) fn sampled(&self, instructions: Instructions, region: Region) -> BlockSet {
        let mut found = vec![[0; SIDE]; self.grid.tiles()];
        for tile in 0..self.grid.tiles() {
            with_instructions!(instructions, simd =>
                simd.vectorize(#[inline(always)] || self.find(simd, tile, &mut found)));
        }
        let mut sampled = BlockSet::new(Grid::new(region.of_samples(), self.grid.tile_blocks));
        let (own, side) = (Rect::of(region), SAMPLES_SIDE as i32);
        for (tile, found) in found.iter().enumerate() {
            let (x, y) = self.grid.block_px(tile, 0);
            let columns = bits(own.x - x, own.end_x - x);
            for (y, bits) in (y..).zip(found).filter(|(y, _)| (own.y..own.end_y).contains(y)) {
                let mut left = bits & columns;
                while left != 0 {
                    sampled.add((x + left.trailing_zeros() as i32) * side, y * side);
                    left &= left - 1;
                }
            }
        }
        sampled.finish();
        sampled
    }

    /// Finds the pixels on both sides of depth steps within a tile, and between the tile and the tiles to its right and
    /// below.
    #[inline(always)]
    fn find<S: Simd>(&self, simd: S, tile: usize, found: &mut [Pixels]) {
        let (grid, rect) = (self.grid, Rect::of_tile(self.grid, tile, self.grid.region));
        let (size, columns) = (grid.tile_px() as usize, grid.columns as usize);
        let (x, y) = grid.block_px(tile, 0);
        let inside = bits(rect.x - x, rect.end_x - x);
        let rows = (rect.y - y) as usize..((rect.end_y - y) as usize).min(SIDE);
        let beside = (tile % columns + 1 < columns).then_some(tile + 1);
        let below = Some(tile + columns).filter(|below| *below < grid.tiles());
        for what in [Compared::Surfaces, Compared::Layers, Compared::Counts] {
            let nothing = &NOTHING[usize::from(matches!(what, Compared::Counts))];
            let planes = |tile: usize| self.planes(what, tile);
            let (own, right, under) = (planes(tile), beside.and_then(planes), below.and_then(planes));
            if let Some(own) = own {
                let mut above: Option<[[Lanes<S>; 2]; 2]> = None;
                for y in rows.clone() {
                    let here = [row(simd, own, 0, y), row(simd, own, LANES, y)];
                    let mut steps = between(here[0], row(simd, own, 1, y));
                    steps |= between(row(simd, own, LANES - 1, y), here[1]) << (LANES - 1);
                    steps &= inside & inside >> 1;
                    found[tile][y] |= steps | steps << 1;
                    if let Some([left, right]) = above {
                        let steps = (between(left, here[0]) | between(right, here[1]) << LANES) & inside;
                        found[tile][y - 1] |= steps;
                        found[tile][y] |= steps;
                    }
                    above = Some(here);
                }
            }
            if let Some(beside) = beside.filter(|_| own.is_some() || right.is_some()) {
                let ([begin, end], [begins, ends]) =
                    (own.unwrap_or(nothing.each_ref()), right.unwrap_or(nothing.each_ref()));
                for y in rows.clone() {
                    let (left, right) =
                        ([begin, end].map(|plane| plane.0[y][size - 1]), [begins, ends].map(|plane| plane.0[y][0]));
                    let steps = u32::from(left[1] < right[0] || right[1] < left[0]);
                    found[tile][y] |= steps << (size - 1);
                    found[beside][y] |= steps;
                }
            }
            if let Some(below) = below.filter(|_| own.is_some() || under.is_some()) {
                let (own, under) = (own.unwrap_or(nothing.each_ref()), under.unwrap_or(nothing.each_ref()));
                for x in [0, LANES] {
                    let steps = between(row(simd, own, x, size - 1), row(simd, under, x, 0)) << x & inside;
                    found[tile][size - 1] |= steps;
                    found[below][0] |= steps;
                }
            }
        }
    }

    /// Returns the planes of a quantity's begin and end in a tile; `None` if the tile has no such content.
    fn planes(&self, what: Compared, tile: usize) -> Option<[&TileRows; 2]> {
        let layers = || self.layers.of(tile);
        match what {
            Compared::Surfaces => {
                let [begins, ends] = self.gbuffer.reaches()?;
                if self.gbuffer.marks(tile).touched == 0 {
                    return None;
                }
                Some([begins.get(tile)?, ends.get(tile)?])
            }
            Compared::Layers => layers().map(|planes| [&planes.begin, &planes.end]),
            Compared::Counts => layers().map(|planes| [&planes.count; 2]),
        }
    }
}

/// Returns a word in which the bits of the columns `from..to` of a tile are set.
fn bits(from: i32, to: i32) -> u32 {
    let below = |to: i32| (1u64 << to.clamp(0, SIDE as i32)) - 1;
    (below(to) & !below(from)) as u32
}

/// Loads a quantity's begin and end in sixteen pixels of row `y`, from pixel `x` on.
#[inline(always)]
fn row<S: Simd>(simd: S, planes: [&TileRows; 2], x: usize, y: usize) -> [Lanes<S>; 2] {
    planes.map(|plane| Lanes::load(simd, &plane.0[y % SIDE][x % SIDE..]))
}

/// Compares sixteen pixels with sixteen neighbours, and returns bits of the pairs with a step between them.
#[inline(always)]
fn between<S: Simd>([begin, end]: [Lanes<S>; 2], [begins, ends]: [Lanes<S>; 2]) -> u32 {
    (end.lt(begins) | ends.lt(begin)).to_bitmask() as u32
}
