//! Search for the nearest splat in each pixel of a block, by a third loop over the block's list if a frame needs it.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::raster::batch::{Pixels, Visit, for_each_batch};
use crate::raster::block::{self, BlockScratch};
use crate::raster::facing::{ByFacing, VisibleSide};
use crate::raster::filter::{FragmentFilter, MeshBlend};
use crate::raster::inputs::RasterInputs;
use crate::raster::sums::{Sums, number_of};
use crate::scene::numbers::SplatNumbers;
use crate::setup::evaluate::Fragment;
use crate::setup::record::Record;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::largest;
use crate::tiles::lists::BlockList;
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

/// The nearest fragment in each pixel of a block, for the planes `index` and `label`.
#[derive(Clone, Copy)]
pub(crate) struct Nearest<S: Simd> {
    /// Depths of the nearest fragments; +∞ in pixels without one.
    pub z: Lanes<S>,
    /// Numbers of the splats of the nearest fragments, as counted by [`SplatNumbers`], as the bits of floats.
    number: Lanes<S>,
}

impl<S: Simd> Nearest<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        let none = Lanes::splat(simd, f32::from_bits(SplatNumbers::NOTHING));
        Self { z: Lanes::splat(simd, f32::INFINITY), number: none }
    }

    /// Adds the fragments of splat `number` in the lanes of `mask`, at depths `z`. Among equal depths the lower object
    /// and then the lower row wins.
    #[inline(always)]
    pub(crate) fn add(&mut self, z: Lanes<S>, mask: mask32x16<S>, number: u32, numbers: &SplatNumbers) {
        let own = Lanes::splat(z.0.simd, f32::from_bits(number));
        let mut closer = mask & z.lt(self.z);
        let tie = (mask & z.le(self.z) & self.z.le(z)).to_bitmask();
        if tie != 0 {
            let others = self.numbers();
            let lower = |lane: &usize| numbers.order(number) < numbers.order(others[*lane]);
            let won = (0..LANES).filter(|lane| tie >> lane & 1 == 1).filter(lower);
            closer |= mask32x16::from_bitmask(z.0.simd, won.fold(0, |bits, lane| bits | 1 << lane));
        }
        self.z = Lanes::select(closer, z, self.z);
        self.number = Lanes::select(closer, own, self.number);
    }

    /// Returns the number of the nearest splat in each pixel; [`SplatNumbers::NOTHING`] for none.
    #[inline(always)]
    pub(crate) fn numbers(&self) -> [u32; LANES] {
        self.number.to_array().map(f32::to_bits)
    }
}

/// Draws a block as [`block::draw`] does, in front of polygons at the depths `polygon` (+∞ for none). Returns the
/// nearest of the fragments that add their attributes; none in empty pixels ([`Sums::has_weight`]).
///
/// Facings and polygons are always handled. In a frame without facings all splats count for both sides, and polygons at
/// +∞ hide nothing, so the block's sums have the same bits.
#[inline(never)]
pub(crate) fn draw<S: Simd>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    first_px: (i32, i32),
    inputs: &RasterInputs<'_>,
    polygon: &mut Lanes<S>,
    scratch: &mut BlockScratch,
    sums: &mut Sums<S>,
) -> Nearest<S> {
    let mut nearest = Nearest::new(simd);
    let filter = Tracked { other: ByFacing::new(simd, MeshBlend { polygon }), nearest: &mut nearest };
    block::draw(simd, list, first_px, inputs, filter, scratch, sums);
    let covered = sums.has_weight();
    let none = Nearest::new(simd);
    Nearest {
        z: Lanes::select(covered, nearest.z, none.z),
        number: Lanes::select(covered, nearest.number, none.number),
    }
}

/// A fragment filter that finds the nearest splat of each pixel, in addition to keeping facings apart and handling
/// polygons.
struct Tracked<'a, S: Simd> {
    other: ByFacing<S, MeshBlend<'a, S>>,
    nearest: &'a mut Nearest<S>,
}

impl<S: Simd> FragmentFilter<S> for Tracked<'_, S> {
    const KEEPS_FACINGS: bool = true;
    const TRACKS: bool = true;

    #[inline(always)]
    fn settle(&mut self, threshold: Lanes<S>) {
        self.other.settle(threshold);
    }

    #[inline(always)]
    fn show(&mut self, shown: &VisibleSide<S>) {
        self.other.show(shown);
    }

    #[inline(always)]
    fn adds(&self, z: Lanes<S>, record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        self.other.adds(z, record, mask)
    }

    #[inline(always)]
    fn track(
        &mut self,
        simd: S,
        list: BlockList<'_, '_, Record>,
        pixels: &Pixels<S>,
        inputs: &RasterInputs<'_>,
        threshold: Lanes<S>,
    ) {
        // A depth of +∞ marks a missing fragment.
        let reach = threshold.min(threshold.constant(f64::from(f32::MAX)));
        let mut third = ThirdLoop { filter: &self.other, threshold: reach, nearest: Nearest::new(simd), inputs };
        for_each_batch(simd, list, largest(threshold), pixels, inputs, &mut third);
        *self.nearest = third.nearest;
    }
}

/// State of the third loop over a block's splats, which finds the nearest one in each pixel.
struct ThirdLoop<'a, 'b, S: Simd, L> {
    filter: &'a L,
    threshold: Lanes<S>,
    nearest: Nearest<S>,
    inputs: &'a RasterInputs<'b>,
}

impl<S: Simd, L: FragmentFilter<S>> Visit<S> for ThirdLoop<'_, '_, S, L> {
    #[inline(always)]
    fn add(&mut self, _: S, fragment: Fragment<S>, _: usize, record: &Record) {
        let near = fragment.inside & fragment.z.le(self.threshold);
        let mask = self.filter.adds(fragment.z, record, near);
        if mask.to_bitmask() != 0 {
            let number = number_of(record, self.inputs.near) as u32;
            self.nearest.add(fragment.z, mask, number, &self.inputs.frame.numbers);
        }
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        Some(largest(self.threshold.min(self.nearest.z)))
    }
}
