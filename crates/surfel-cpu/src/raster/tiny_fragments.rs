//! Fragments of a tiny splat, four at a time. A record stores their depths and weights; a weight's sign states whether
//! the fragment is visible.
//!
//! A *record* is a splat projected to the screen ([`Record`]).

use crate::setup::record::Record;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4, mask32x4};

/// Loads four depths and four weights from a tiny splat's record. `depths` and `weights` are the indices of the first
/// field of each.
#[inline(always)]
pub(crate) fn fragments_of<S: Simd>(simd: S, record: &Record, depths: usize, weights: usize) -> (f32x4<S>, f32x4<S>) {
    let four = |first: usize| f32x4::from_slice(simd, &record.0[first..first + 4]);
    (four(depths), four(weights))
}

/// Returns a mask of the first three of four lanes.
#[inline(always)]
pub(crate) fn first_three<S: Simd>(simd: S) -> mask32x4<S> {
    f32x4::load_array(simd, [0.0, 0.0, 0.0, 1.0]).simd_lt(f32x4::splat(simd, 0.5))
}

/// Up to four fragments that are to be added to pixels' sums.
pub(crate) struct Contributing {
    /// Depths of the fragments; zero for those that don't contribute.
    pub depths: [f32; 4],
    /// Weights of the fragments; zero for those that don't contribute.
    pub weights: [f32; 4],
    /// Bits of the fragments that contribute.
    pub bits: u32,
}

/// Returns those fragments of the mask `has` that are no deeper than the thresholds of their pixels. Depths are
/// computed only if all `N` = 8 numbers are summed.
#[inline(always)]
pub(crate) fn contributing<S: Simd, const N: usize>(
    simd: S,
    depths: f32x4<S>,
    weights: f32x4<S>,
    has: mask32x4<S>,
    thresholds: f32x4<S>,
) -> Contributing {
    let zero = f32x4::splat(simd, 0.0);
    let mask = has & depths.simd_le(thresholds);
    let depths = if N == 8 { mask.select(depths, zero).to_array() } else { [0.0; 4] };
    Contributing { depths, weights: mask.select(weights.abs(), zero).to_array(), bits: mask.to_bitmask() as u32 }
}

/// Returns a mask of the fragments inside the unfiltered footprint, which the sign of their weights marks as negative.
#[inline(always)]
pub(crate) fn is_visible<S: Simd>(weights: f32x4<S>) -> mask32x4<S> {
    let simd = weights.simd;
    f32x4::splat(simd, 1.0).copysign(weights).simd_lt(f32x4::splat(simd, 0.0))
}

/// Returns the number of fragments of a mask whose pixels are inside the drawn region, that is, have a threshold above
/// −∞.
#[inline(always)]
pub(crate) fn drawn<S: Simd>(simd: S, mask: mask32x4<S>, thresholds: f32x4<S>) -> u64 {
    u64::from((mask & f32x4::splat(simd, f32::NEG_INFINITY).simd_lt(thresholds)).to_bitmask().count_ones())
}
