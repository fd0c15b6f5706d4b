//! Encoding of colours to 8 bits, sixteen at a time, bit-identical to [`encode_rgba8`].
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::Real;
use surfel_math::srgb::encode_rgba8;

/// Coefficients, highest power first, of a polynomial in v, the fourth root of a linear value. It approximates the
/// 8-bit sRGB level plus ½, 255·(1.055·v^(5/3) − 0.055) + ½, for v in [0.2365, 1]. Chebyshev interpolation with an
/// error of at most 1.3e-4.
const LEVEL_OF_FOURTH_ROOT: [f64; 8] = [
    -17.338_026_837_540_79,
    91.531_325_390_237_07,
    -212.615_563_363_983_63,
    292.361_329_173_549_8,
    -285.816_569_595_426_24,
    369.811_735_231_356_6,
    32.004_051_028_566_34,
    -14.438_328_509_291_58,
];

/// Largest distance of the approximate level from a bound between two levels at which the exact tables decide instead.
/// It is about twice the sum of the polynomial's error, 1.3e-4, and the errors of roots and sums in f32, together 1e-4.
const ROUNDING_MARGIN: f64 = 5e-4;

/// Encodes a block's linear premultiplied colours as sRGB with straight alpha, 8 bits each.
#[inline(always)]
pub(super) fn rgba8<S: Simd>(color: [Lanes<S>; 4]) -> [[u8; 4]; LANES] {
    let [.., a] = color;
    let simd = a.0.simd;
    let (zero, one) = (a.zero(), a.one());
    let has_alpha = zero.lt(a);
    // The division is skipped if every alpha is 1.
    let divides = a.lt(one).to_bitmask() != 0 || one.lt(a).to_bitmask() != 0;
    let divisor = Lanes::select(has_alpha, a, one);
    let mut unsure = mask32x16::splat(simd, false);
    let mut packed = i32x16::splat(simd, 0);
    for (c, shift) in color[..3].iter().zip([0, 8, 16]) {
        let straight = if divides { *c / divisor } else { *c };
        // The comparison is false for NaN, too.
        let linear = Lanes::select(zero.lt(straight), straight.min(one), zero);
        let root = linear.sqrt().sqrt();
        let mut level = root.constant(LEVEL_OF_FOURTH_ROOT[0]);
        for c in &LEVEL_OF_FOURTH_ROOT[1..] {
            level = level.mul_add(root, root.constant(*c));
        }
        let near_black = linear.lt(linear.constant(0.003_130_8));
        let level = Lanes::select(near_black, linear.mul_add(one.constant(12.92 * 255.0), one.constant(0.5)), level);
        let whole: i32x16<S> = level.0.to_int();
        let part = level - Lanes(whole.to_float());
        unsure |= part.lt(part.constant(ROUNDING_MARGIN)) | part.constant(1.0 - ROUNDING_MARGIN).lt(part);
        packed |= whole << shift;
    }
    let alpha = a.min(one) * one.constant(255.0) + one.constant(0.5);
    let alpha: i32x16<S> = alpha.0.to_int();
    packed |= alpha << 24;
    let packed = has_alpha.select(packed, i32x16::splat(simd, 0));
    let mut pixels = packed.to_array().map(i32::to_le_bytes);
    let unsure = (unsure & has_alpha).to_bitmask();
    if unsure != 0 {
        let [r, g, b, a] = color.map(Lanes::to_array);
        for i in ones(unsure) {
            pixels[i] = encode_rgba8([r[i], g[i], b[i], a[i]]);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};

    /// Compares sixteen colours encoded together with the same colours encoded one by one.
    #[inline(always)]
    fn check<S: Simd>(simd: S, colors: &[[f32; 4]]) {
        for sixteen in colors.as_chunks::<LANES>().0 {
            let lanes = [0, 1, 2, 3].map(|c| Lanes::load(simd, &sixteen.map(|color| color[c])));
            for (encoded, color) in rgba8(lanes).iter().zip(sixteen) {
                assert_eq!(*encoded, encode_rgba8(*color), "{color:?}");
            }
        }
    }

    #[test]
    fn rgba8_is_that_of_single_pixels_to_the_bit() {
        let mut colors = Vec::new();
        for i in 0..400_000_u32 {
            let v = i as f32 / 399_999.0;
            let [g, b] = [v * v, 1.0 - v];
            colors.push([v, g, b, 1.0]);
            colors.push([v * 0.3, g * 0.3, b * 0.3, 0.3]);
        }
        // The bounds of each level, and their neighbours.
        for level in 0..256 {
            let bound = surfel_math::srgb::decode((f64::from(level) - 0.5).max(0.0) / 255.0) as f32;
            let near = [bound.next_down(), bound, bound.next_up(), bound * 1.000_001];
            colors.extend(near.map(|v| [v, 0.5, bound, 1.0]));
        }
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -0.0, 0.0, 1e-38, 1e-45, 0.5, 1.0, 2.0, 1e30];
        for a in odd {
            colors.extend(odd.iter().flat_map(|&v| [[v, 0.2, 0.1, a], [0.7, v, v, a]]));
        }
        colors.resize(colors.len().next_multiple_of(LANES), [0.0; 4]);
        for &level in SimdLevel::ALL {
            let instructions = Instructions::new(level).unwrap();
            with_instructions!(instructions, simd => simd.vectorize(|| check(simd, &colors)));
        }
    }
}
