//! Sixteen f32 in SIMD lanes as a [`Real`], and the functions of the hot loops.

use crate::simd::fused::fused_16;
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, mask32x16};
use std::ops::{Add, Div, Mul, Neg, Sub};
use surfel_math::Real;

/// Number of lanes, independent of the SIMD level, so that results don't depend on the machine.
pub(crate) const LANES: usize = 16;

/// True for a SIMD level without SIMD instructions, where an operation on sixteen inlined lanes would be hundreds of
/// instructions.
const fn is_scalar<S: Simd>() -> bool {
    // Of the levels that an x86-64 build has, only the scalar one has vectors of four.
    cfg!(target_arch = "x86_64") && <S::f32s as SimdBase<S>>::LEN == 4
}

/// Inlines a block of code, except at the scalar level. With out-of-line functions that level is a tenth of the
/// program's code instead of most of it.
macro_rules! in_line_unless_scalar {
    ($level:ident, ($($argument:ident: $type:ty),*) -> $result:ty $body:block) => {{
        #[inline(never)]
        fn out_of_line<$level: Simd>($($argument: $type),*) -> $result $body
        if const { is_scalar::<$level>() } { out_of_line::<$level>($($argument),*) } else $body
    }};
}

/// Sixteen f32 numbers in SIMD lanes.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd>(pub f32x16<S>);

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(crate) fn splat(simd: S, value: f32) -> Self {
        Self(f32x16::splat(simd, value))
    }

    /// Loads the first sixteen numbers of a slice; zeros if the slice has fewer than sixteen.
    #[inline(always)]
    pub(crate) fn load(simd: S, values: &[f32]) -> Self {
        match values.first_chunk::<LANES>() {
            Some(chunk) => Self(f32x16::load_array_ref(simd, chunk)),
            None => Self::splat(simd, 0.0),
        }
    }

    /// Stores the lanes to the first sixteen numbers of a slice; does nothing if the slice has fewer than sixteen.
    #[inline(always)]
    pub(crate) fn store(self, values: &mut [f32]) {
        if let Some(chunk) = values.first_chunk_mut::<LANES>() {
            self.0.store_array(chunk);
        }
    }

    #[inline(always)]
    pub(crate) fn to_array(self) -> [f32; LANES] {
        self.0.to_array()
    }

    /// Returns the magnitudes of `self` with the signs of `signs`, including those of NaN.
    #[inline(always)]
    pub(crate) fn copysign(self, signs: Self) -> Self {
        Self(self.0.copysign(signs.0))
    }

    /// Returns the columns of a block's 4×4 pixels: 0 1 2 3, four times.
    #[inline(always)]
    pub(crate) fn block_columns(simd: S) -> Self {
        Self(f32x16::load_array(simd, std::array::from_fn(|i| (i % 4) as f32)))
    }

    /// Returns the rows of a block's 4×4 pixels: 0 four times, 1 four times, …
    #[inline(always)]
    pub(crate) fn block_rows(simd: S) -> Self {
        Self(f32x16::load_array(simd, std::array::from_fn(|i| (i / 4) as f32)))
    }

    /// Returns the columns and the rows of a block's pixels in the image, given the block's first pixel.
    #[inline(always)]
    pub(crate) fn block_pixels(simd: S, (x, y): (i32, i32)) -> (Self, Self) {
        let k = |v: i32| Self::splat(simd, v as f32);
        (Self::block_columns(simd) + k(x), Self::block_rows(simd) + k(y))
    }

    /// Transposes sixteen consecutive rows of N numbers to N columns of sixteen. For N = 16, lane j of result i is lane
    /// i of input j.
    #[inline(always)]
    pub(crate) fn transpose<const N: usize>(mut v: [Self; N]) -> [Self; N] {
        // Each perfect shuffle of all numbers rotates the bits of their index by one; the row's number has four bits.
        for _ in 0..4 {
            let from = v;
            for i in 0..N / 2 {
                let (a, b) = (from[i].0, from[i + N / 2].0);
                (v[2 * i], v[2 * i + 1]) = (Self(a.zip_low(b)), Self(a.zip_high(b)));
            }
        }
        v
    }

    /// Converts four planes of a 4×4 block, such as r, g, b and a, to four rows of pixels. A pixel's four numbers are
    /// then side by side.
    #[inline(always)]
    pub(crate) fn interleave4([r, g, b, a]: [Self; 4]) -> [Self; 4] {
        let (rb, ga) = ((r.0.zip_low(b.0), r.0.zip_high(b.0)), (g.0.zip_low(a.0), g.0.zip_high(a.0)));
        [Self(rb.0.zip_low(ga.0)), Self(rb.0.zip_high(ga.0)), Self(rb.1.zip_low(ga.1)), Self(rb.1.zip_high(ga.1))]
    }

    /// Returns 1/x for x in [0.66, 2.01] to about 1 ulp, by the best linear guess (relative error 0.147) and two Halley
    /// steps, each of which cubes the error.
    ///
    /// Sixteen divisions take several times as long, and the CPU's own estimate differs between makes.
    #[inline(always)]
    pub(crate) fn reciprocal_near_one(self) -> Self {
        let x = self;
        in_line_unless_scalar!(S, (x: Lanes<S>) -> Lanes<S> { x.guess_near_one().halley(x).halley(x) })
    }

    /// Returns the best linear approximation of 1/x on [0.66, 2.01], from which [`Self::reciprocal_near_one`] starts.
    #[inline(always)]
    pub(crate) fn guess_near_one(self) -> Self {
        // Chebyshev: 1 − x·r = T₂((2x − a − b)/(b − a))/T₂((a + b)/(b − a)) on [a, b].
        const A: f64 = 0.66;
        const B: f64 = 2.01;
        const T2: f64 = 2.0 * ((A + B) / (B - A)) * ((A + B) / (B - A)) - 1.0;
        const SLOPE: f64 = -8.0 / ((B - A) * (B - A)) / T2;
        const CONSTANT: f64 = 8.0 * (A + B) / ((B - A) * (B - A)) / T2;
        self.mul_add(self.constant(SLOPE), self.constant(CONSTANT))
    }

    /// Improves `self`, an approximation of 1/x, by a Halley step, which cubes the relative error.
    #[inline(always)]
    pub(crate) fn halley(self, x: Self) -> Self {
        let error = (-x).mul_add(self, x.one());
        error.mul_add(error, error).mul_add(self, self)
    }

    /// Returns 2^x for x in [−126, 126]: relative error below 2e-7 (Taylor polynomial of degree 6 on [−½, ½]).
    #[inline(always)]
    pub(crate) fn exp2(self) -> Self {
        let x = self;
        in_line_unless_scalar!(S, (x: Lanes<S>) -> Lanes<S> {
            let whole = Lanes(x.0.round_ties_even());
            let f = x - whole;
            const C: [f64; 6] = {
                let l = std::f64::consts::LN_2;
                [
                    l * l * l * l * l * l / 720.0,
                    l * l * l * l * l / 120.0,
                    l * l * l * l / 24.0,
                    l * l * l / 6.0,
                    l * l / 2.0,
                    l,
                ]
            };
            let mut p = x.constant(C[0]);
            for c in &C[1..] {
                p = p.mul_add(f, x.constant(*c));
            }
            p = p.mul_add(f, x.one());
            let exponent: i32x16<S> = whole.0.to_int();
            let scale: f32x16<S> = ((exponent + 127) << 23).bitcast();
            p * Lanes(scale)
        })
    }

    /// Returns log₂ x for positive normal x; absolute error below 3e-7 plus half an ulp of the result.
    #[inline(always)]
    fn log2(self) -> Self {
        let x = self;
        in_line_unless_scalar!(S, (x: Lanes<S>) -> Lanes<S> {
            let simd = x.0.simd;
            let bits: i32x16<S> = x.0.bitcast();
            // The exponent is what has to be removed to bring the mantissa to [√½, √2).
            let shifted = bits - 0x3f35_04f3;
            let exponent = shifted >> 23;
            let mantissa = Lanes((bits - (exponent << 23)).bitcast());
            let exponent = Lanes(exponent.to_float());
            // log(m) = 2·atanh(y), y = (m − 1)/(m + 1), |y| ≤ 0.1716: y⁹/9 is the last term that matters in f32. 0.8·(m
            // + 1) is in [1.36, 1.94].
            let one = Lanes::splat(simd, 1.0);
            let scale = Lanes::splat(simd, 0.8);
            let inverse = mantissa.mul_add(scale, scale).reciprocal_near_one() * scale;
            let y = (mantissa - one) * inverse;
            let y2 = y * y;
            let k = 2.0 / std::f64::consts::LN_2;
            let mut p = x.constant(k / 9.0);
            for c in [k / 7.0, k / 5.0, k / 3.0, k] {
                p = p.mul_add(y2, x.constant(c));
            }
            y.mul_add(p, exponent)
        })
    }

    /// Returns self^exponent for self in [0, 1] and exponent ≥ 0, with 0⁰ = 1.
    #[inline(always)]
    pub(crate) fn power(self, exponent: Self) -> Self {
        let zero = self.zero();
        let tiny = self.constant(f64::from(f32::MIN_POSITIVE));
        let least = self.constant(-126.0);
        let scaled = self.max(tiny).log2() * exponent;
        let vanishes = (self.lt(tiny) & zero.lt(exponent)) | scaled.lt(least);
        Self::select(vanishes, zero, scaled.max(least).exp2())
    }

    /// Returns self to the n-th power, n ≥ 1, by repeated squaring: the relative error is below n·2⁻²⁴.
    #[inline(always)]
    pub(crate) fn whole_power(self, n: u32) -> Self {
        let mut square = self;
        let mut left = n;
        while left & 1 == 0 && left > 1 {
            square = square * square;
            left >>= 1;
        }
        let mut power = square;
        left >>= 1;
        while left != 0 {
            square = square * square;
            if left & 1 == 1 {
                power = power * square;
            }
            left >>= 1;
        }
        power
    }
}

/// True if the SIMD level has an instruction for the fused multiply-add; known at compile time.
#[inline(always)]
pub(crate) fn has_fused_multiply_add<S: Simd>(simd: S) -> bool {
    !simd.level().is_fallback()
}

/// Defines a method of lanes with first argument `self`, inlined except at the scalar level.
macro_rules! method {
    ($name:ident($a:ident $(, $b:ident)*) -> $result:ty $body:block) => {
        #[inline(always)]
        fn $name(self $(, $b: Self)*) -> $result {
            let $a = self;
            in_line_unless_scalar!(S, ($a: Lanes<S> $(, $b: Lanes<S>)*) -> $result $body)
        }
    };
}

macro_rules! operator {
    ($trait:ident, $name:ident($($argument:ident),*)) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            method!($name($($argument),*) -> Lanes<S> { Lanes($trait::$name($($argument.0),*)) });
        }
    };
}

operator!(Add, add(a, b));
operator!(Sub, sub(a, b));
operator!(Mul, mul(a, b));
operator!(Div, div(a, b));
operator!(Neg, neg(a));

impl<S: Simd> Real for Lanes<S> {
    type Mask = mask32x16<S>;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(self.0.simd, value as f32)
    }
    method!(mul_add(a, b, c) -> Lanes<S> { Lanes(fused_16(a.0, b.0, c.0)) });
    method!(sqrt(a) -> Lanes<S> { Lanes(a.0.sqrt()) });
    method!(abs(a) -> Lanes<S> { Lanes(a.0.abs()) });
    method!(min(a, b) -> Lanes<S> { Lanes(a.0.min(b.0)) });
    method!(max(a, b) -> Lanes<S> { Lanes(a.0.max(b.0)) });
    method!(lt(a, b) -> mask32x16<S> { a.0.simd_lt(b.0) });
    method!(le(a, b) -> mask32x16<S> { a.0.simd_le(b.0) });
    #[inline(always)]
    fn select(mask: mask32x16<S>, a: Self, b: Self) -> Self {
        in_line_unless_scalar!(S, (mask: mask32x16<S>, a: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
            Lanes(mask.select(a.0, b.0))
        })
    }

    /// Returns a power of two that scales a positive normal number below 2^126 to (½, 1].
    #[inline(always)]
    fn scale_to_one(self) -> Self {
        let x = self;
        in_line_unless_scalar!(S, (x: Lanes<S>) -> Lanes<S> {
            let bits: i32x16<S> = x.0.bitcast();
            let exponent = (i32x16::splat(x.0.simd, 0x7f00_0000) - bits) & i32x16::splat(x.0.simd, 0x7f80_0000);
            Lanes(exponent.bitcast())
        })
    }

    /// Returns 1/√x for positive normal x, to 1 ulp; a finite number for 0 and subnormal or negative x.
    ///
    /// A guess y from the exponent has an error of at most 0.035. The polynomial nearest to 1/√(1 + d), for d = x·y² −
    /// 1, reduces the error to 2.3e-8. Newton's steps need more operations and round more often.
    #[inline(always)]
    fn inverse_sqrt(self) -> Self {
        let x = self;
        in_line_unless_scalar!(S, (x: Lanes<S>) -> Lanes<S> {
            let bits: i32x16<S> = x.0.bitcast();
            let magic = i32x16::splat(x.0.simd, 0x5f37_5a86);
            let guess: f32x16<S> = (magic - (bits >> 1)).bitcast();
            let y = Lanes(guess);
            let d = (x * y).mul_add(y, -x.one());
            let mut p = x.constant(0.274_036_98);
            for c in [-0.313_939_38, 0.375_000_7, -0.499_998_32] {
                p = p.mul_add(d, x.constant(c));
            }
            (y * d).mul_add(p, y)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};

    #[inline(always)]
    fn check<S: Simd>(simd: S) {
        let mut worst = [0.0f64; 3];
        for i in 0..4000 {
            let x = 0.66 + 1.35 * (i as f32 / 4000.0);
            let r = Lanes::splat(simd, x).reciprocal_near_one().to_array()[3];
            worst[0] = worst[0].max((f64::from(r) * f64::from(x) - 1.0).abs());
            let y = -100.0 + i as f32 * 0.05;
            let e = Lanes::splat(simd, y).exp2().to_array()[5];
            worst[1] = worst[1].max((f64::from(e) / f64::from(y).exp2() - 1.0).abs());
            let b = (i as f32 + 0.5) / 4000.0;
            for n in [0.0f32, 1.0, 5.5, 7.0, 24.0, 32.0, 200.0] {
                let p = Lanes::splat(simd, b).power(Lanes::splat(simd, n)).to_array()[0];
                let exact = f64::from(b).powf(f64::from(n));
                if n.fract() == 0.0 && n > 0.0 {
                    let p = Lanes::splat(simd, b).whole_power(n as u32).to_array()[0];
                    let slack = f64::from(n) * 6e-8 * exact + f64::from(f32::MIN_POSITIVE);
                    assert!((f64::from(p) - exact).abs() <= slack, "{b}^{n}: {p} {exact}");
                }
                worst[2] = worst[2].max((f64::from(p) - exact).abs());
            }
        }
        // An ulp is 1.2e-7; a power's error is the logarithm's times the exponent, damped by the power itself.
        assert!(worst[0] < 1.3e-7, "{worst:?}");
        assert!(worst[1] < 3e-7, "{worst:?}");
        assert!(worst[2] < 2e-6, "{worst:?}");
        // Two octaves, after which the guess repeats. The largest error over all their numbers is 1e-7; an ulp is up to
        // 1.2e-7.
        for i in 0..30_000 {
            let x = (1.0 + i as f32 * 1e-4) * 2f32.powi(2 * (i % 60 - 30));
            let lanes = Lanes::splat(simd, x);
            let off = f64::from(lanes.inverse_sqrt().to_array()[7]) * f64::from(x).sqrt() - 1.0;
            assert!(off.abs() < 1.1e-7, "1/√{x} is {off} off");
            let scale = lanes.scale_to_one().to_array()[7];
            assert!((0.5..=1.0).contains(&(x * scale)) && scale.to_bits() & 0x7f_ffff == 0, "{x} by {scale}");
        }
        let zero = Lanes::splat(simd, 0.0);
        assert!(zero.inverse_sqrt().to_array()[0].is_finite() && zero.scale_to_one().to_array()[0].is_finite());
        assert_eq!(zero.power(zero).to_array()[0], 1.0);
        assert_eq!(zero.power(zero.one()).to_array()[0], 0.0);
    }

    #[test]
    fn reciprocal_roots_exponential_and_power_against_f64() {
        for &level in SimdLevel::ALL {
            let instructions = Instructions::new(level).unwrap();
            with_instructions!(instructions, simd => check(simd));
        }
    }
}
