//! One tile: lists of its blocks' splats, then block after block from visibility to finished pixels.

use crate::bins::{BLOCK, Grid, Segment, TILE_BLOCKS};
use crate::composite::CompositeScratch;
use crate::dot_tiles::DotScratch;
use crate::finish::finish;
use crate::light::Lighting;
use crate::limit::Unlimited;
use crate::lists::BlockLists;
use crate::planes::TilePlanes;
use crate::raster::{self, Scratch, Shared, Sums};
use crate::target::{Rect, TileTarget};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16};

/// What was counted while tiles were drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counters {
    /// Pairs of block and splat that were computed.
    pub block_pairs: u64,
    /// Fragments inside a filtered footprint.
    pub inside: u64,
    /// Pixels of these pairs that weren't computed, since the splat is a dot.
    pub spared: u64,
    /// Fragments that contributed to a pixel.
    pub kept: u64,
    /// Edge pixels that were blended.
    pub edge_pixels: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, o: Self) {
        self.block_pairs += o.block_pairs;
        self.inside += o.inside;
        self.spared += o.spared;
        self.kept += o.kept;
        self.edge_pixels += o.edge_pixels;
    }
}

/// What a thread reuses from tile to tile.
pub(crate) struct TileScratch<'a> {
    pub lists: BlockLists<'a>,
    pub block: Box<Scratch>,
    pub dots: DotScratch<'a>,
    pub composite: CompositeScratch<'a>,
}

impl Default for TileScratch<'_> {
    fn default() -> Self {
        Self {
            lists: BlockLists::default(),
            block: Scratch::new(),
            dots: DotScratch::default(),
            composite: CompositeScratch::default(),
        }
    }
}

impl TileScratch<'_> {
    /// The same memory, for tiles of other records.
    pub(crate) fn for_others<'b>(self) -> TileScratch<'b> {
        let Self { lists, block, dots, composite } = self;
        TileScratch { lists: lists.for_others(), block, dots: dots.for_others(), composite: composite.for_others() }
    }
}

/// First pixel of a block of the tile that has this first one.
#[inline(always)]
pub(crate) fn block_px((x, y): (i32, i32), block: u32) -> (i32, i32) {
    (x + (block % TILE_BLOCKS * BLOCK) as i32, y + (block / TILE_BLOCKS * BLOCK) as i32)
}

/// Opaque splats in tiles.
#[derive(Clone, Copy)]
pub(crate) struct Listing<'a> {
    pub segments: &'a [Segment],
    pub grid: Grid,
}

impl<'a> Listing<'a> {
    /// First pixel of a block of a tile.
    pub(crate) fn block_px(&self, tile: usize, block: u32) -> (i32, i32) {
        let size = self.grid.tile_px();
        let [x, y] = [tile as u32 % self.grid.columns, tile as u32 / self.grid.columns];
        let px = |tile: u32, axis: usize| (self.grid.origin[axis] + tile * size) as i32;
        block_px((px(x, 0), px(y, 1)), block)
    }

    /// Blocks of a tile as bits: those with pixels of the region.
    pub(crate) fn blocks(&self, tile: usize) -> u64 {
        let rect = Rect::of_tile(&self.grid, tile, self.grid.region);
        let (x, y) = self.block_px(tile, 0);
        let block = |px: i32| (px.max(0) as u32).div_ceil(BLOCK);
        let (x0, y0) = ((rect.x - x) as u32 / BLOCK, (rect.y - y) as u32 / BLOCK);
        let row = (1u64 << block(rect.end_x - x)) - (1u64 << x0);
        (y0..block(rect.end_y - y)).fold(0, |bits, y| bits | row << (TILE_BLOCKS * y))
    }

    /// True if no opaque splat touches a tile.
    pub(crate) fn is_empty(&self, tile: usize) -> bool {
        self.segments.iter().all(|s| s.of(tile).is_empty())
    }

    /// Fills the lists of a tile's blocks, those that are `wanted`.
    #[inline(always)]
    pub(crate) fn list(&self, tile: usize, wanted: u64, lists: &mut BlockLists<'a>) {
        lists.clear();
        for segment in self.segments {
            lists.extend(&segment.records, segment.of(tile), wanted);
        }
        lists.finish();
    }

    /// [`Self::list`] of few blocks.
    #[inline(always)]
    pub(crate) fn list_some(&self, tile: usize, wanted: u64, lists: &mut BlockLists<'a>) {
        lists.clear();
        for segment in self.segments {
            lists.extend_some(&segment.records, segment.of(tile), wanted);
        }
        lists.finish();
    }
}

/// Blocks that are lit together: the processor computes one where another's numbers aren't there yet.
const TOGETHER: usize = 4;

/// All tiles of a frame.
pub(crate) struct TileJob<'a> {
    pub listing: Listing<'a>,
    pub shared: Shared<'a>,
    pub lighting: &'a Lighting,
    /// Which tiles are drawn splat by splat.
    pub dots: Vec<bool>,
}

impl<'a> TileJob<'a> {
    /// Draws a tile.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        mut planes: Option<&mut TilePlanes<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let tile = target.tile;
        let is_empty = self.listing.is_empty(tile);
        if let Some(planes) = &mut planes {
            planes.begin(is_empty);
        }
        if is_empty {
            target.fill_empty(self.lighting.background);
            return counters;
        }
        if planes.is_none() && self.dots.get(tile) == Some(&true) {
            return self.draw_dots(simd, target, &mut scratch.dots);
        }
        let mut kept = i32x16::splat(simd, 0);
        let mut left = self.listing.blocks(tile);
        self.listing.list(tile, left, &mut scratch.lists);
        let touched = left & scratch.lists.touched();
        let origin = self.listing.block_px(tile, 0);
        target.put_empty(origin, left & !touched, self.lighting.background);
        left = touched;
        let mut sums = [Sums::new(simd); TOGETHER];
        while left != 0 {
            let first = left;
            let mut count = 0;
            while let Some(sums) = sums.get_mut(count)
                && left != 0
            {
                let block = left.trailing_zeros();
                left &= left - 1;
                count += 1;
                let at = block_px(origin, block);
                raster::block(
                    simd,
                    scratch.lists.of(simd, block),
                    at,
                    &self.shared,
                    Unlimited,
                    &mut scratch.block,
                    sums,
                );
                counters.block_pairs += u64::from(sums.tested);
                counters.inside += u64::from(sums.inside);
            }
            let mut these = first;
            for sums in &sums[..count] {
                let block = these.trailing_zeros();
                these &= these.wrapping_sub(1);
                let inside = target.rect.lanes_inside(simd, block_px(origin, block));
                kept += sums.fragments.0.to_int::<i32x16<S>>() * inside;
                if let Some(planes) = &mut planes {
                    planes.put_edges(block, sums, None);
                }
            }
            finish(simd, self.lighting, (&sums[..count], first), origin, target);
        }
        counters.kept = kept.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }
}
