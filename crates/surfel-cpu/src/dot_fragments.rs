//! Fragments of a dot, four at a time: a record holds their depths and weights, whose signs say which are visible.

use crate::record::Record;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4, mask32x4};

/// Four depths and four weights of a dot, from some fields on.
#[inline(always)]
pub(crate) fn fragments_of<S: Simd>(simd: S, dot: &Record, depths: usize, weights: usize) -> (f32x4<S>, f32x4<S>) {
    (f32x4::from_slice(simd, &dot.0[depths..depths + 4]), f32x4::from_slice(simd, &dot.0[weights..weights + 4]))
}

/// The first three of four.
#[inline(always)]
pub(crate) fn first_three<S: Simd>(simd: S) -> mask32x4<S> {
    f32x4::load_array(simd, [0.0, 0.0, 0.0, 1.0]).simd_lt(f32x4::splat(simd, 0.5))
}

/// Depths and weights, zero where they aren't kept by these pixels, and where they are, as bits.
#[inline(always)]
pub(crate) fn masked<S: Simd, const N: usize>(
    simd: S,
    depths: f32x4<S>,
    weights: f32x4<S>,
    has: mask32x4<S>,
    kept: f32x4<S>,
) -> ([f32; 4], [f32; 4], u32) {
    let zero = f32x4::splat(simd, 0.0);
    let is_kept = has & depths.simd_le(kept);
    let depths = if N == 8 { is_kept.select(depths, zero).to_array() } else { [0.0; 4] };
    (depths, is_kept.select(weights.abs(), zero).to_array(), is_kept.to_bitmask() as u32)
}

/// Where weights have a sign.
#[inline(always)]
pub(crate) fn is_visible<S: Simd>(weights: f32x4<S>) -> mask32x4<S> {
    let simd = weights.simd;
    f32x4::splat(simd, 1.0).copysign(weights).simd_lt(f32x4::splat(simd, 0.0))
}

/// How many pixels of a mask are drawn, by what they keep.
#[inline(always)]
pub(crate) fn drawn<S: Simd>(simd: S, mask: mask32x4<S>, kept: f32x4<S>) -> u64 {
    u64::from((mask & f32x4::splat(simd, f32::NEG_INFINITY).simd_lt(kept)).to_bitmask().count_ones())
}
