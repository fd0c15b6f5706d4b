//! Chunks that lie behind all that a cell shows: they aren't set up.
//!
//! Chunks come from near to far. Where several layers of them would fill a cell, the first layers are set up and what they keep is
//! found out, block by block; of the others only those remain that reach before it somewhere.

use crate::bins::BLOCK;
use crate::fours;
use crate::level::{Instructions, with_instructions};
use crate::lists::BlockLists;
use crate::placed::{ObjectSetup, inside};
use crate::prepare::Seen;
use crate::raster::Shared;
use crate::store::Chunk;
use crate::tile::Listing;
use crate::visibility::visibility;
use fearless_simd::Simd;
use surfel_render::Region;

/// Splats over each point of a cell that come first: some surfaces, of three or four each.
const LAYERS: f64 = 10.0;

/// Share of a cell's splats that must lie behind the first layers for a look at what hides them to pay.
const WORTHWHILE: f64 = 0.3;

/// Share of the most splats of a cell of which so much is asked: fewer are drawn as soon as it is known what hides them.
const ENOUGH: f64 = 0.5;

/// Slack of a chunk's nearest depth, relative to its farthest: far above rounding in setup.
const DEPTH_SLACK: f64 = 1e-5;

/// What a chunk is in a cell.
pub(crate) struct Share {
    pub splats: f64,
    /// Areas of its splats in the cell together, pixels.
    pub area_px: f64,
    /// Nearest and farthest depth.
    pub depths: [f64; 2],
}

/// How many of a cell's chunks, from near to far, are set up before others are asked whether something hides them: all, or the first
/// layers. `most` is how many splats a cell may have.
pub(crate) fn first(chunks: impl ExactSizeIterator<Item = Share> + Clone, cell_px: f64, most: f64) -> usize {
    let all = chunks.len();
    let (enough, mut area, mut farthest) = (LAYERS * cell_px, 0.0, 0.0f64);
    let Some(first) = chunks.clone().position(|chunk| {
        area += chunk.area_px;
        if area <= enough {
            farthest = farthest.max(chunk.depths[1]);
        }
        area > enough
    }) else {
        return all;
    };
    let behind: f64 =
        chunks.clone().skip(first).filter(|chunk| chunk.depths[0] > farthest).map(|chunk| chunk.splats).sum();
    let total: f64 = chunks.map(|chunk| chunk.splats).sum();
    if total > ENOUGH * most && behind > WORTHWHILE * total { first } else { all }
}

/// What is kept at most in each block of a cell: what lies behind it there isn't seen.
pub(crate) struct Hiding {
    region: Region,
    /// Column and row of the first block, and blocks a row.
    first: [u32; 2],
    columns: usize,
    /// Row by row; +∞ where some pixel shows nothing.
    farthest: Vec<f32>,
}

impl Hiding {
    /// Of the opaque splats that are set up so far.
    pub(crate) fn of<'a>(
        instructions: Instructions,
        listing: &Listing<'a>,
        shared: &Shared<'_>,
        lists: &mut BlockLists<'a>,
    ) -> Self {
        let grid = &listing.grid;
        let side = grid.tile_blocks;
        let columns = (grid.columns * side) as usize;
        let mut hiding = Self {
            region: grid.region,
            first: grid.origin.map(|px| px / BLOCK),
            columns,
            farthest: vec![f32::INFINITY; columns * (grid.rows * side) as usize],
        };
        with_instructions!(instructions, simd => hiding.find(simd, listing, shared, lists));
        hiding
    }

    #[inline(always)]
    fn find<'a, S: Simd>(&mut self, simd: S, listing: &Listing<'a>, shared: &Shared<'_>, lists: &mut BlockLists<'a>) {
        simd.vectorize(
            #[inline(always)]
            || {
                for tile in 0..listing.grid.tiles() {
                    let mut left = listing.blocks(tile);
                    listing.list(tile, left, lists);
                    left &= lists.touched();
                    while left != 0 {
                        let block = left.trailing_zeros();
                        left &= left - 1;
                        let at = listing.block_px(tile, block);
                        let kept = visibility(simd, lists.of(simd, block), at, shared);
                        let (column, row) = (at.0 as u32 / BLOCK - self.first[0], at.1 as u32 / BLOCK - self.first[1]);
                        self.farthest[row as usize * self.columns + column as usize] = fours::largest(kept);
                    }
                }
            },
        );
    }

    /// True if no pixel can show a splat of a chunk. Never so of a transparent object's: where filtered splats leave a pixel that they
    /// keep without weight, nothing hides what is transparent.
    pub(crate) fn hides(&self, setups: &[ObjectSetup<'_>], seen: &Seen) -> bool {
        let (setup, chunk) = chunk_of(setups, seen);
        if setup.is_transparent() {
            return false;
        }
        let center = setup.center(chunk);
        let [near, far] = setup.depths(center, chunk);
        let nearest = near - far.abs() * DEPTH_SLACK;
        let [x0, y0, x1, y1] = inside(setup.pixels(center, chunk), self.region);
        if x0 > x1 || y0 > y1 {
            return true;
        }
        let block = |px: f64, axis: usize| (px as u32 / BLOCK).saturating_sub(self.first[axis]) as usize;
        let columns = block(x0, 0)..(block(x1, 0) + 1).min(self.columns);
        let rows = self.farthest.chunks(self.columns).take(block(y1, 1) + 1).skip(block(y0, 1));
        rows.into_iter().all(|row| row[columns.clone()].iter().all(|&farthest| f64::from(farthest) < nearest))
    }
}

fn chunk_of<'a, 's>(setups: &'a [ObjectSetup<'s>], seen: &Seen) -> (&'a ObjectSetup<'s>, &'a Chunk) {
    let setup = &setups[seen.object as usize];
    (setup, &setup.object.chunks[seen.chunk as usize])
}
