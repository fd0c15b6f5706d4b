//! Depth thresholds of a block without attributes: for shadow maps and for occlusion culling.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)).

use crate::cull::occlusion::OcclusionMap;
use crate::raster::batch::{Pixels, Visit, for_each_batch};
use crate::raster::facing::Sides;
use crate::raster::inputs::RasterInputs;
use crate::raster::listing::Listing;
use crate::setup::evaluate::Fragment;
use crate::setup::record::Record;
use crate::simd::lanes::Lanes;
use crate::simd::level::{Instructions, with_instructions};
use crate::simd::math::largest;
use crate::tiles::lists::{BlockList, BlockLists};
use fearless_simd::Simd;
use surfel_math::Real;

/// Returns the depth thresholds min(z + ε) of a block's pixels; +∞ in pixels without a visibility fragment. No
/// attributes are summed.
#[inline(always)]
pub(crate) fn thresholds<S: Simd>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    first_px: (i32, i32),
    inputs: &RasterInputs<'_>,
) -> Lanes<S> {
    let mut nearest = Nearest { threshold: Lanes::splat(simd, f32::INFINITY) };
    for_each_batch(simd, list, f32::INFINITY, &Pixels::new(simd, first_px), inputs, &mut nearest);
    nearest.threshold
}

/// Returns the depths, per pixel, behind which a block's splats occlude others: the depth thresholds. If front and back
/// sides of oriented clouds have thresholds of their own, this is the farther of both.
#[inline(always)]
fn occluding<S: Simd>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    first_px: (i32, i32),
    inputs: &RasterInputs<'_>,
) -> Lanes<S> {
    if !inputs.frame.wanted.facings {
        return thresholds(simd, list, first_px, inputs);
    }
    let mut nearest = NearestSides(Sides::new(simd));
    for_each_batch(simd, list, f32::INFINITY, &Pixels::new(simd, first_px), inputs, &mut nearest);
    nearest.0.farthest()
}

/// State of the loop in [`occluding`] if front- and back-facing sides of oriented clouds are kept apart.
struct NearestSides<S: Simd>(Sides<S>);

impl<S: Simd> Visit<S> for NearestSides<S> {
    #[inline(always)]
    fn add(&mut self, simd: S, fragment: Fragment<S>, _: usize, record: &Record) {
        let z = Lanes::select(fragment.visible, fragment.z, Lanes::splat(simd, f32::INFINITY));
        self.0.add::<false>(simd, record, z);
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        Some(largest(self.0.farthest()))
    }
}

/// State of the loop in [`thresholds`]: the pixels' depth thresholds so far.
struct Nearest<S: Simd> {
    threshold: Lanes<S>,
}

impl<S: Simd> Visit<S> for Nearest<S> {
    #[inline(always)]
    fn add(&mut self, simd: S, fragment: Fragment<S>, _: usize, record: &Record) {
        let k = |v: f32| Lanes::splat(simd, v);
        self.threshold =
            self.threshold.min(Lanes::select(fragment.visible, fragment.z, k(f32::INFINITY)) + k(record.epsilon()));
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        Some(largest(self.threshold))
    }
}

/// Returns the occlusion map of a cell: the farthest depth threshold of each block, from the opaque splats that are set
/// up so far.
pub(crate) fn occlusion<'a>(
    instructions: Instructions,
    listing: &Listing<'a>,
    inputs: &RasterInputs<'_>,
    lists: &mut BlockLists<'a, Record>,
) -> OcclusionMap {
    let mut map = OcclusionMap::new(&listing.grid);
    with_instructions!(instructions, simd => find_occlusion(simd, listing, inputs, lists, &mut map));
    map
}

#[inline(always)]
fn find_occlusion<'a, S: Simd>(
    simd: S,
    listing: &Listing<'a>,
    inputs: &RasterInputs<'_>,
    lists: &mut BlockLists<'a, Record>,
    map: &mut OcclusionMap,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            for tile in 0..listing.grid.tiles() {
                let mut left = listing.grid.blocks(tile);
                listing.list(tile, left, lists);
                left &= lists.touched();
                while left != 0 {
                    let block = left.trailing_zeros();
                    left &= left - 1;
                    let at = listing.grid.block_px(tile, block);
                    map.set(at, largest(occluding(simd, lists.of(simd, block), at, inputs)));
                }
            }
        },
    );
}
