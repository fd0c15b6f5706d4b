//! Sums of attributes that are stored in memory pixel by pixel, for tiles of tiny splats.

use crate::simd::fused;
use crate::simd::lanes::{LANES, has_fused_multiply_add};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4, f32x8, mask32x8};
use surfel_render::Attributes;

/// A buffer of numbers whose start is aligned to a cache line.
#[derive(Default)]
pub(crate) struct Aligned(pub Vec<f32>);

impl Aligned {
    pub(crate) fn numbers(&mut self) -> &mut [f32] {
        let before = self.0.as_ptr().align_offset(64).min(self.0.len());
        &mut self.0[before..]
    }

    /// Makes room for `count` numbers. Their values are unspecified, and old values are lost.
    pub(crate) fn reserve(&mut self, count: usize) {
        if self.0.len() < count + LANES {
            self.0.resize(count + LANES, 0.0);
        }
    }
}

/// A splat's attributes, in the order of a pixel's `N` sums; each is multiplied by a fragment's weight and added. For
/// `N` = 8: colour, normal, 1 and depth. For `N` = 4: the normal, or the colour if the plan needs no normals, and 1.
pub(crate) struct Numbers<S: Simd, const N: usize> {
    eight: f32x8<S>,
    four: f32x4<S>,
    is_depth: mask32x8<S>,
}

impl<S: Simd, const N: usize> Numbers<S, N> {
    #[inline(always)]
    pub(crate) fn of(simd: S, [r, g, b, x, y, z]: [f32; 6], attributes: &Attributes) -> Self {
        let three = if attributes.normal { [x, y, z, 1.0] } else { [r, g, b, 1.0] };
        let four = f32x4::load_array(simd, three);
        let eight = [r, g, b, x, y, z, 1.0, 0.0];
        let last = f32x8::load_array(simd, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let is_depth = f32x8::splat(simd, 0.0).simd_lt(last);
        Self { eight: f32x8::load_array(simd, eight), four, is_depth }
    }

    /// Adds the attributes, times a fragment's `weight`, to a pixel's sums; `depth` is the fragment's depth.
    #[inline(always)]
    pub(crate) fn add(&self, simd: S, weight: f32, depth: f32, sums: &mut [f32; N]) {
        if let Some(sums) = sums.first_chunk_mut::<8>() {
            let numbers = self.is_depth.select(f32x8::splat(simd, depth), self.eight);
            let sum = f32x8::load_array_ref(simd, sums);
            fused_8(f32x8::splat(simd, weight), numbers, sum).store_array(sums);
        } else if let Some(sums) = sums.first_chunk_mut::<4>() {
            let sum = f32x4::load_array_ref(simd, sums);
            fused_4(f32x4::splat(simd, weight), self.four, sum).store_array(sums);
        }
    }
}

macro_rules! fused {
    ($name:ident, $lanes:ident) => {
        /// Returns a·b + c, rounded once.
        #[inline(always)]
        fn $name<S: Simd>(a: $lanes<S>, b: $lanes<S>, c: $lanes<S>) -> $lanes<S> {
            if has_fused_multiply_add(a.simd) {
                return fused::$name(a, b, c);
            }
            let (a, b, mut sums) = (a.to_array(), b.to_array(), c.to_array());
            for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(&b)) {
                *sum = a.mul_add(*b, *sum);
            }
            $lanes::load_array(c.simd, sums)
        }
    };
}

fused!(fused_4, f32x4);
fused!(fused_8, f32x8);
