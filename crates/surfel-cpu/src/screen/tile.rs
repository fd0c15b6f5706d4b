//! Drawing of tiles of opaque splats: lists the splats of each block, then draws each block from visibility to finished
//! pixels.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *record* is a splat projected to the screen ([`Record`]). A *tile* is
//! a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::raster::balls::BallFragments;
use crate::raster::block::{self, BlockScratch};
use crate::raster::facing::ByFacing;
use crate::raster::filter::{EveryFragment, MeshBlend};
use crate::raster::inputs::{RasterInputs, Wanted};
use crate::raster::layers::{LayerScratch, TransparentItem};
use crate::raster::listing::{ListScratch, Listing};
use crate::raster::nearest::{self, Nearest};
use crate::raster::sums::Sums;
use crate::raster::tiny_tile::{TinyScratch, TinyTile, is_faster_by_splats};
use crate::screen::gbuffer::GBufferTile;
use crate::screen::neighbourhood::Neighbourhood;
use crate::setup::balls::BallRecord;
use crate::setup::record::Record;
use crate::shade::lighting::Lighting;
use crate::shade::resolve::resolve;
use crate::simd::compress::ones;
use crate::simd::lanes::Lanes;
use crate::tiles::driver::Counters;
use crate::tiles::grid::block_px;
use crate::tiles::lists::{BlockList, ItemLists};
use crate::tiles::target::Target;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16};

/// Per-thread scratch buffers for drawing tiles, reused between tiles.
#[derive(Default)]
pub(crate) struct TileScratch<'a> {
    pub lists: ListScratch<'a>,
    pub block: Box<BlockScratch>,
    tiny: TinyScratch<'a>,
    pub transparent: ItemLists<TransparentItem<'a>>,
    pub layers: LayerScratch,
    pub balls: ItemLists<&'a BallRecord>,
    pub ball_fragments: Box<BallFragments>,
    pub neighbourhood: Box<Neighbourhood>,
}

impl TileScratch<'_> {
    /// Empties the buffers and returns their memory for records of another lifetime.
    pub(crate) fn for_others<'b>(self) -> TileScratch<'b> {
        let Self { lists, block, tiny, transparent, layers, balls, ball_fragments, neighbourhood } = self;
        TileScratch {
            lists: lists.for_others(),
            block,
            tiny: tiny.for_others(),
            transparent: transparent.for_others(),
            layers,
            balls: balls.for_others(),
            ball_fragments,
            neighbourhood,
        }
    }
}

/// Number of blocks that are lit together. The CPU computes one while another's operands aren't ready.
const TOGETHER: usize = 4;

/// Inputs for drawing the tiles of a cell's opaque splats.
pub(crate) struct TileJob<'a> {
    pub listing: Listing<'a>,
    pub inputs: RasterInputs<'a>,
    pub lighting: &'a Lighting,
    /// True if tiles of tiny splats may be drawn splat by splat, where that is faster.
    pub by_splats: bool,
}

impl<'a> TileJob<'a> {
    /// Draws the target's current tile block by block, or splat by splat if that is faster.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(
        &self,
        simd: S,
        target: &mut Target<'_>,
        mut gbuffer: Option<&mut GBufferTile<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let tile = target.tile;
        let is_empty = self.listing.is_empty(tile);
        if let Some(gbuffer) = &mut gbuffer {
            gbuffer.begin(is_empty);
        }
        if is_empty {
            target.fill_empty(self.lighting.background);
            return counters;
        }
        if gbuffer.is_none() && self.by_splats && is_faster_by_splats(self.listing.segments, tile) {
            return self.draw_tiny(simd, target, &mut scratch.tiny);
        }
        let mut contributing = i32x16::splat(simd, 0);
        let mut left = self.listing.grid.blocks(tile);
        self.listing.list(tile, left, &mut scratch.lists.splats);
        let touched = left & scratch.lists.splats.touched();
        let origin = self.listing.grid.block_px(tile, 0);
        target.put_empty(origin, left & !touched, self.lighting.background);
        left = touched;
        let mut sums = [Sums::new(simd); TOGETHER];
        while left != 0 {
            let (first, mut count) = (left, 0);
            for (block, sums) in ones(first).zip(&mut sums) {
                left &= left - 1;
                count += 1;
                let block = block as u32;
                let at = block_px(origin, block);
                let list = scratch.lists.splats.of(simd, block);
                if let Some(nearest) = self.draw_splats(simd, list, at, None, &mut scratch.block, sums) {
                    target.put_index(at, nearest.numbers());
                }
                counters.block_pairs += u64::from(sums.tested);
                counters.inside += u64::from(sums.inside);
            }
            for (block, sums) in ones(first).zip(&sums[..count]) {
                let block = block as u32;
                let inside = target.rect.lanes_inside(simd, block_px(origin, block));
                contributing += sums.fragments.0.to_int::<i32x16<S>>() * inside;
                if let Some(gbuffer) = &mut gbuffer {
                    gbuffer.put_edges(block, sums, None);
                }
            }
            finish(simd, self.lighting, &sums[..count], first, origin, target);
        }
        counters.contributing = contributing.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }

    /// Draws a block's opaque splats, in front of the nearest polygons if it has any. Returns the nearest splats if the
    /// frame outputs them.
    #[inline(always)]
    pub(super) fn draw_splats<S: Simd>(
        &self,
        simd: S,
        list: BlockList<'_, '_, Record>,
        at: (i32, i32),
        polygon: Option<&mut Lanes<S>>,
        scratch: &mut BlockScratch,
        sums: &mut Sums<S>,
    ) -> Option<Nearest<S>> {
        let inputs = &self.inputs;
        let Wanted { nearest, facings, .. } = inputs.frame.wanted;
        match (polygon, facings) {
            (Some(polygon), _) if nearest => {
                return Some(nearest::draw(simd, list, at, inputs, polygon, scratch, sums));
            }
            (None, _) if nearest => {
                let mut polygon = Lanes::splat(simd, f32::INFINITY);
                return Some(nearest::draw(simd, list, at, inputs, &mut polygon, scratch, sums));
            }
            (None, false) => block::draw(simd, list, at, inputs, EveryFragment, scratch, sums),
            (None, true) => {
                let filter = ByFacing::new(simd, EveryFragment);
                block::draw(simd, list, at, inputs, filter, scratch, sums);
            }
            (Some(polygon), false) => block::draw(simd, list, at, inputs, MeshBlend { polygon }, scratch, sums),
            (Some(polygon), true) => {
                let filter = ByFacing::new(simd, MeshBlend { polygon });
                block::draw(simd, list, at, inputs, filter, scratch, sums);
            }
        }
        None
    }

    /// Draws the target's current tile splat by splat.
    #[inline(always)]
    fn draw_tiny<S: Simd>(&self, simd: S, target: &mut Target<'_>, scratch: &mut TinyScratch<'a>) -> Counters {
        let mut counters = Counters::default();
        let tile = TinyTile {
            listing: &self.listing,
            inputs: &self.inputs,
            number: target.tile,
            rect: target.rect,
            counts: target.has_fragments(),
        };
        if tile.sums_all() {
            let touched = tile.draw::<S, 8>(simd, scratch, &mut counters);
            self.finish_tiny::<S, 8>(simd, &tile, touched, scratch, target);
        } else {
            let touched = tile.draw::<S, 4>(simd, scratch, &mut counters);
            self.finish_tiny::<S, 4>(simd, &tile, touched, scratch, target);
        }
        counters
    }

    /// Lights the touched blocks of a tile that is drawn splat by splat, and writes their pixels. Not inlined: a short
    /// function keeps its operands in registers.
    #[inline(never)]
    fn finish_tiny<S: Simd, const N: usize>(
        &self,
        simd: S,
        tile: &TinyTile<'a, '_>,
        touched: u64,
        scratch: &mut TinyScratch<'a>,
        target: &mut Target<'_>,
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let (grid, number) = (&self.listing.grid, target.tile);
                let (blocks, origin) = (grid.blocks(number), grid.block_px(number, 0));
                target.put_empty(origin, blocks & !touched, self.lighting.background);
                for block in ones(blocks & touched) {
                    let at = block_px(origin, block as u32);
                    let sums = tile.sums_of::<S, N>(simd, at, scratch);
                    target.put(at, &resolve(simd, self.lighting, &sums, at));
                }
            },
        );
    }
}

/// Divides the sums of some of a tile's blocks, lights the results, and writes the pixels. The blocks are the first
/// whose bits are set in `blocks`, one for each entry of `sums`. The tile begins at pixel `origin`. Several blocks are
/// processed at once: each is a long chain of operations, and a CPU overlaps adjacent chains.
///
/// Not inlined: a short function keeps its operands in registers.
#[inline(never)]
fn finish<S: Simd>(
    simd: S,
    lighting: &Lighting,
    sums: &[Sums<S>],
    blocks: u64,
    origin: (i32, i32),
    target: &mut Target<'_>,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            for (block, sums) in ones(blocks).zip(sums) {
                let at = block_px(origin, block as u32);
                target.put(at, &resolve(simd, lighting, sums, at));
            }
        },
    );
}
