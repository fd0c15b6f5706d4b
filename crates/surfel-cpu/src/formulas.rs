//! Formulas of the rasteriser and alternatives to them, which `cargo xtask tradeoff` measures.
//!
//! This module isn't part of the public interface. Its measurements are the reason why no setting selects a formula.

use crate::setup::kernel::Kernel;
#[cfg(target_family = "wasm")]
use crate::simd::fused;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::level::{Instructions, SimdLevel, with_instructions};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16};
use surfel_math::Real;

/// A method of computing the kernel e^(−cρ²), the weight of a fragment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// The standard library's exponential in f64, rounded to f32.
    Exact,
    /// 2^x by setting the exponent's bits for the whole part of x, and by a polynomial of degree 6 for the rest.
    PowerOfTwo,
    /// The renderer's own method: a Chebyshev series of degree 5 for e^(−(c/2)ρ²), squared.
    Polynomial,
    /// The renderer's own method with a Chebyshev series of degree 3 instead of 5.
    Cubic,
    /// A table of 33 values of the kernel, interpolated linearly.
    Interpolated,
    /// A table of 256 values of the kernel, read at the nearest one.
    Nearest,
}

/// A method of computing 1/x for x in [0.66, 2.01]. This is the range, within a splat, of its centre's depth divided by
/// a fragment's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reciprocal {
    /// The CPU's division instruction.
    Division,
    /// The renderer's own method: the best linear guess, improved by two Halley steps.
    Halley,
    /// The best linear guess, improved by one Halley step.
    HalleyOnce,
    /// The CPU's reciprocal estimate, improved by one Newton step.
    NewtonOnce,
    /// The CPU's reciprocal estimate alone.
    Estimate,
}

/// A formula for measurements, which is applied to slices of numbers with the CPU's best instructions.
pub struct Formula {
    instructions: Instructions,
    of: Of,
}

enum Of {
    Weight { way: Weight, cutoff: f32, kernel: Kernel, cubic: [f32; 4], table: Vec<f32> },
    Reciprocal(Reciprocal),
}

impl Formula {
    /// Creates the formula of the kernel e^(−cρ²) at cutoff c = 2, for ρ² in [0, 1]. `None` if the CPU has no SIMD
    /// instructions that the renderer supports.
    pub fn weight(way: Weight) -> Option<Self> {
        const CUTOFF: f64 = 2.0;
        let entries = match way {
            Weight::Interpolated => 33,
            Weight::Nearest => 256,
            _ => 0,
        };
        let entry = |i: usize| (-CUTOFF * i as f64 / (entries - 1) as f64).exp() as f32;
        let of = Of::Weight {
            way,
            cutoff: CUTOFF as f32,
            kernel: Kernel::new(CUTOFF),
            cubic: crate::setup::kernel::series(0.5 * CUTOFF),
            table: (0..entries).map(entry).collect(),
        };
        Some(Self { instructions: Instructions::new(SimdLevel::Best)?, of })
    }

    /// Creates the formula of 1/x for x in [0.66, 2.01]. `None` if the CPU has no SIMD instructions that the renderer
    /// supports.
    pub fn reciprocal(way: Reciprocal) -> Option<Self> {
        Some(Self { instructions: Instructions::new(SimdLevel::Best)?, of: Of::Reciprocal(way) })
    }

    /// Applies the formula to the numbers of `inputs` in groups of 16, and writes the results to the front of
    /// `outputs`. Numbers after the last whole group are ignored.
    pub fn apply(&self, inputs: &[f32], outputs: &mut [f32]) {
        with_instructions!(self.instructions, simd => simd.vectorize(#[inline(always)] || match &self.of {
            Of::Weight { way, cutoff, kernel, cubic, table } => match way {
                Weight::Exact => each(simd, inputs, outputs, #[inline(always)] |x| {
                    one_by_one(simd, x, |x| (-f64::from(*cutoff) * f64::from(x)).exp() as f32)
                }),
                Weight::PowerOfTwo => {
                    let per_bit = -f64::from(*cutoff) * std::f64::consts::LOG2_E;
                    each(simd, inputs, outputs, #[inline(always)] |x| (x * x.constant(per_bit)).exp2());
                }
                Weight::Polynomial => each(simd, inputs, outputs, #[inline(always)] |x| kernel.at(x)),
                Weight::Cubic => each(simd, inputs, outputs, #[inline(always)] |x| {
                    let k = |c: f32| Lanes::splat(simd, c);
                    let p = k(cubic[3]).mul_add(x, k(cubic[2])).mul_add(x, k(cubic[1])).mul_add(x, k(cubic[0]));
                    p * p
                }),
                Weight::Interpolated => each(simd, inputs, outputs, #[inline(always)] |x| one_by_one(simd, x, |x| {
                    let at = x * (table.len() - 1) as f32;
                    let whole = (at as usize).min(table.len() - 2);
                    (table[whole + 1] - table[whole]).mul_add(at - whole as f32, table[whole])
                })),
                Weight::Nearest => each(simd, inputs, outputs, #[inline(always)] |x| one_by_one(simd, x, |x| {
                    table[((x * (table.len() - 1) as f32 + 0.5) as usize).min(table.len() - 1)]
                })),
            },
            Of::Reciprocal(way) => match way {
                Reciprocal::Division => each(simd, inputs, outputs, #[inline(always)] |x| x.one() / x),
                Reciprocal::Halley => each(simd, inputs, outputs, Lanes::reciprocal_near_one),
                Reciprocal::HalleyOnce => {
                    each(simd, inputs, outputs, #[inline(always)] |x| x.guess_near_one().halley(x));
                }
                Reciprocal::NewtonOnce => each(simd, inputs, outputs, #[inline(always)] |x| {
                    let r = Lanes(x.0.approximate_recip());
                    (-x).mul_add(r, x.one()).mul_add(r, r)
                }),
                Reciprocal::Estimate => {
                    each(simd, inputs, outputs, #[inline(always)] |x| Lanes(x.0.approximate_recip()));
                }
            },
        }));
    }
}

/// Tests the fused multiply-add on `count` random and hard cases, and returns the number of wrong results. `None` if
/// the CPU has no SIMD instructions that the renderer supports.
#[cfg(target_family = "wasm")]
pub fn fused_errors(count: usize) -> Option<usize> {
    let instructions = Instructions::new(SimdLevel::Best)?;
    Some(with_instructions!(instructions, simd => simd.vectorize(#[inline(always)] || fused::errors(simd, count))))
}

#[inline(always)]
fn each<S: Simd>(simd: S, inputs: &[f32], outputs: &mut [f32], f: impl Fn(Lanes<S>) -> Lanes<S>) {
    for (x, y) in inputs.chunks_exact(LANES).zip(outputs.chunks_exact_mut(LANES)) {
        f(Lanes::load(simd, x)).store(y);
    }
}

#[inline(always)]
fn one_by_one<S: Simd>(simd: S, x: Lanes<S>, f: impl Fn(f32) -> f32) -> Lanes<S> {
    Lanes(f32x16::load_array(simd, x.to_array().map(f)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the largest absolute error of a formula over 1008 evenly spaced inputs from `low` to `high`.
    fn worst(formula: Formula, [low, high]: [f32; 2], exact: impl Fn(f64) -> f64) -> f64 {
        let inputs: Vec<f32> = (0..1008).map(|i| low + (high - low) * (i as f32 / 1007.0)).collect();
        let mut outputs = vec![0.0; inputs.len()];
        formula.apply(&inputs, &mut outputs);
        inputs.iter().zip(&outputs).map(|(&x, &y)| (f64::from(y) - exact(f64::from(x))).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn formulas_err_as_their_terms_and_steps_say() {
        use Weight::{Cubic, Exact, Interpolated, Nearest, Polynomial, PowerOfTwo};
        // Bounds, in order: half an ulp; the error of the exponential; the bound of the kernel's own test; 2.1e-4 of
        // the cubic, doubled by squaring; h²f''/8 of 32 steps; half a step of 255 times the steepest slope, 2.
        for (way, most) in [
            (Exact, 3.1e-8),
            (PowerOfTwo, 4e-7),
            (Polynomial, 1.2e-6),
            (Cubic, 5e-4),
            (Interpolated, 5e-4),
            (Nearest, 4e-3),
        ] {
            let found = worst(Formula::weight(way).unwrap(), [0.0, 1.0], |x| (-2.0 * x).exp());
            assert!(found <= most && found > 0.01 * most, "{way:?}: {found:e}");
        }
        use Reciprocal::{Division, Estimate, Halley, HalleyOnce, NewtonOnce};
        // Bounds for results up to 1.52: half an ulp; two ulps; the guess's error of 0.147, cubed; the estimate's error
        // squared; the estimate's error, which is at most 2⁻⁸ on CPUs of any make.
        for (way, most) in
            [(Division, 6e-8), (Halley, 2.4e-7), (HalleyOnce, 5e-3), (NewtonOnce, 2.4e-5), (Estimate, 6e-3)]
        {
            let found = worst(Formula::reciprocal(way).unwrap(), [0.66, 2.01], |x| 1.0 / x);
            assert!(found <= most, "{way:?}: {found:e}");
        }
        assert!(worst(Formula::reciprocal(HalleyOnce).unwrap(), [0.66, 2.01], |x| 1.0 / x) > 1e-3);
    }
}
