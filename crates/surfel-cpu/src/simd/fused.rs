//! Fused multiply-add of SIMD lanes: a·b + c, rounded once.
//!
//! AVX2, AVX-512 and NEON have an instruction for it. WebAssembly has `relaxed_madd`, which rounds once or twice as the
//! host likes, and browsers without relaxed SIMD don't have even that. So Surfel has two WebAssembly modules (see
//! `surfel-web`):
//!
//! - one with the target feature `relaxed-simd`, for hosts where a probe at start shows that `relaxed_madd` rounds
//!   once;
//! - one without, which emulates the operation in f64. The emulation is a hundred instructions, so it is out of line:
//!   inlined everywhere it needs more than 24 GB of the compiler's memory.
//!
//! The emulation is exact. A product of two f32 is exact in f64. The sum with a third is rounded to f64, then to f32.
//! To round only once, an inexact sum whose f64 lies between two f32 is first rounded to odd (Boldo and Melquiond,
//! 2008).

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, f32x16};

macro_rules! fused {
    ($($name:ident, $lanes:ident);*) => {$(
        /// Returns a·b + c, rounded once.
        #[cfg_attr(not(all(target_arch = "wasm32", not(target_feature = "relaxed-simd"))), inline(always))]
        #[cfg_attr(all(target_arch = "wasm32", not(target_feature = "relaxed-simd")), inline(never))]
        pub(crate) fn $name<S: Simd>(a: $lanes<S>, b: $lanes<S>, c: $lanes<S>) -> $lanes<S> {
            if cfg!(all(target_arch = "wasm32", target_feature = "relaxed-simd")) {
                a.mul_add(b, c)
            } else {
                a.mul_add_precise(b, c)
            }
        }
    )*};
}

fused!(fused_4, f32x4; fused_8, f32x8; fused_16, f32x16);

/// Tests [`fused_16`] on `count` random and hard cases, and returns the number of results that differ from the standard
/// library's `f32::mul_add`.
#[cfg(any(test, target_family = "wasm"))]
#[inline(always)]
pub(crate) fn errors<S: Simd>(simd: S, count: usize) -> usize {
    let mut bits = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move || {
        bits ^= bits << 13;
        bits ^= bits >> 7;
        bits ^= bits << 17;
        bits
    };
    let mut wrong = 0;
    for _ in 0..count.div_ceil(16) {
        let mut numbers = [[0.0_f32; 16]; 3];
        for lane in 0..16 {
            let hard = hard_case(&mut random);
            for (numbers, number) in numbers.iter_mut().zip(hard) {
                numbers[lane] = number;
            }
        }
        let [a, b, c] = numbers.map(|numbers| f32x16::load_array(simd, numbers));
        let found = fused_16(a, b, c).to_array();
        let is_wrong = |lane: &usize| {
            let exact = numbers[0][*lane].mul_add(numbers[1][*lane], numbers[2][*lane]);
            found[*lane].to_bits() != exact.to_bits() && !(found[*lane].is_nan() && exact.is_nan())
        };
        wrong += (0..16).filter(is_wrong).count();
    }
    wrong
}

/// Returns three numbers a, b and c for testing the fused multiply-add a·b + c. They are of any size, or the result in
/// f64 is at or next to the middle of two f32, where rounding twice errs. `random` returns 64 random bits.
#[cfg(any(test, target_family = "wasm"))]
fn hard_case(random: &mut impl FnMut() -> u64) -> [f32; 3] {
    let any = f32::from_bits(random() as u32);
    let unit = |bits: u64| f32::from_bits(0x3f80_0000 | (bits as u32 & 0x7f_ffff));
    match random() % 4 {
        0 => [any, f32::from_bits(random() as u32), f32::from_bits(random() as u32)],
        // Numbers of similar size, as in images.
        1 => [unit(random()) - 1.5, unit(random()), unit(random()) - 1.5],
        // A tiny c decides on which side of the middle the sum is: (1 + 2⁻¹²)(1 + k·2⁻¹²) often has a last bit at half
        // an ulp.
        2 => {
            let a = 1.0 + (1 + 2 * (random() % 2048)) as f32 * 2.0_f32.powi(-12);
            let b = 1.0 + (1 + 2 * (random() % 2048)) as f32 * 2.0_f32.powi(-12);
            let c = 2.0_f32.powi(-60 - (random() % 80) as i32);
            [a, b, if random() & 1 == 0 { c } else { -c }]
        }
        // Results at and below the smallest normal number.
        _ => {
            let scale = 2.0_f32.powi(-64 - (random() % 12) as i32);
            let c = f32::from_bits(random() as u32 & 0x80ff_ffff);
            [unit(random()) * scale, unit(random()) * 2.0_f32.powi(-62 - (random() % 12) as i32), c]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};

    #[test]
    fn sums_of_products_are_rounded_once_by_any_instructions() {
        for &level in SimdLevel::ALL {
            let instructions = Instructions::new(level).unwrap();
            with_instructions!(instructions, simd => assert_eq!(errors(simd, 200_000), 0));
        }
        // Without an instruction for it, as in WebAssembly.
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = fearless_simd::Level::new().as_sse4_2() {
            assert_eq!(errors(simd, 2_000_000), 0);
        }
    }

    #[test]
    fn hard_cases_tell_one_rounding_from_two() {
        let (mut state, mut by_f64, mut by_f32) = (1_u64, 0, 0);
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 16 ^ state << 40
        };
        for _ in 0..100_000 {
            let [a, b, c] = hard_case(&mut random);
            let exact = a.mul_add(b, c);
            if exact.is_nan() {
                continue;
            }
            by_f64 += usize::from(((f64::from(a) * f64::from(b) + f64::from(c)) as f32).to_bits() != exact.to_bits());
            by_f32 += usize::from((a * b + c).to_bits() != exact.to_bits());
        }
        assert!(by_f64 > 1000 && by_f32 > 10_000, "{by_f64} {by_f32}");
    }
}
