//! The kernel e^(−cρ²) as a polynomial of ρ² (rendering model §2).

use crate::simd::lanes::Lanes;
use fearless_simd::Simd;
use surfel_math::Real;

/// Degree of the polynomial that approximates the kernel.
const DEGREE: usize = 5;

/// Largest exponent c' of e^(−c'ρ²) that the polynomial itself approximates. For a larger cutoff, c is halved until it
/// is small enough, and the result is squared as often.
const LARGEST: f64 = 1.25;

/// The kernel e^(−cρ²) for ρ² in [0, 1], by a Chebyshev series of e^(−c'ρ²) that is squared until c' is c. The series
/// is cut after degree 5, with an absolute error below 1.4e-6 at c' = 1.25 (4.2e-7 at 1).
///
/// Source: the series of e^(−a·x) on [−1, 1] has the coefficients 2·(−1)^k·I_k(a), with I_k the modified Bessel
/// functions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kernel {
    /// Coefficients of the polynomial in ρ², lowest power first.
    coefficients: [f32; DEGREE + 1],
    /// Number of times that the polynomial's value is squared.
    squarings: u32,
}

impl Kernel {
    pub(crate) fn new(cutoff: f64) -> Self {
        let mut c = cutoff;
        let mut squarings = 0;
        while c > LARGEST {
            c *= 0.5;
            squarings += 1;
        }
        Self { coefficients: series(c), squarings }
    }

    /// Returns the kernel's weights at sixteen ρ². Outside [0, 1] the result is meaningless, but finite as long as ρ²
    /// is below 1e5.
    #[inline(always)]
    pub(crate) fn at<S: Simd>(&self, rho_squared: Lanes<S>) -> Lanes<S> {
        let c = &self.coefficients;
        let k = |c: f32| Lanes::splat(rho_squared.0.simd, c);
        // Horner's scheme: a loop over four splats at a time is bound by throughput, not by the length of this chain.
        let mut p = k(c[DEGREE]);
        for &c in c[..DEGREE].iter().rev() {
            p = p.mul_add(rho_squared, k(c));
        }
        for _ in 0..self.squarings {
            p = p * p;
        }
        p
    }

    /// Returns the results of [`Self::at`] for four arguments, with interleaved operations.
    #[inline(always)]
    pub(crate) fn at_four<S: Simd>(&self, rho_squared: [Lanes<S>; 4]) -> [Lanes<S>; 4] {
        let c = &self.coefficients;
        let k = |c: f32| Lanes::splat(rho_squared[0].0.simd, c);
        let mut p = [k(c[DEGREE]); 4];
        for &c in c[..DEGREE].iter().rev() {
            for j in 0..4 {
                p[j] = p[j].mul_add(rho_squared[j], k(c));
            }
        }
        // The usual cutoff needs one squaring, without a loop.
        if self.squarings == 1 {
            square(&mut p);
        } else {
            for _ in 0..self.squarings {
                square(&mut p);
            }
        }
        p
    }

    /// Returns the kernel's weight at one ρ², by the same polynomial as [`Self::at`].
    pub(crate) fn at_one(&self, rho_squared: f32) -> f32 {
        let p = self.coefficients.iter().rev().fold(0.0, |p: f32, &c| p.mul_add(rho_squared, c));
        (0..self.squarings).fold(p, |p, _| p * p)
    }
}

#[inline(always)]
fn square<S: Simd>(four: &mut [Lanes<S>; 4]) {
    for p in four {
        *p = *p * *p;
    }
}

/// Returns the Chebyshev series of e^(−c·t) for t in [0, 1], cut after `TERMS` terms, as a polynomial: lowest power
/// first.
pub(crate) fn series<const TERMS: usize>(c: f64) -> [f32; TERMS] {
    let a = 0.5 * c;
    // Shifted Chebyshev polynomials T_k(2t − 1), by T_(k+1) = (4t − 2)·T_k − T_(k−1).
    let mut previous = [0.0; TERMS];
    let mut current = [0.0; TERMS];
    previous[0] = 1.0;
    (current[0], current[1]) = (-1.0, 2.0);
    let mut sum = [0.0; TERMS];
    sum[0] = bessel_i(0, a);
    for k in 1..TERMS {
        let factor = if k % 2 == 0 { 2.0 } else { -2.0 } * bessel_i(k, a);
        for (s, t) in sum.iter_mut().zip(current) {
            *s += factor * t;
        }
        let mut next = [0.0; TERMS];
        for i in 0..TERMS {
            next[i] = -2.0 * current[i] - previous[i];
            if i > 0 {
                next[i] += 4.0 * current[i - 1];
            }
        }
        (previous, current) = (current, next);
    }
    let scale = 1.0 / exp(a);
    sum.map(|s| (s * scale) as f32)
}

/// Computes the modified Bessel function I_k(a) by its series, for a in [0, 1]. The bits are the same on any machine,
/// which a library's exponential doesn't guarantee.
fn bessel_i(k: usize, a: f64) -> f64 {
    let half = 0.5 * a;
    let mut term = (1..=k).fold(1.0, |term, i| term * half / i as f64);
    let mut sum = 0.0;
    for m in 1..20 {
        sum += term;
        term *= half * half / (m * (m + k)) as f64;
    }
    sum
}

/// Computes e^a by its series, for a in [0, 1]. The bits are the same on any machine.
fn exp(a: f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 0.0;
    for i in 1..25 {
        sum += term;
        term *= a / f64::from(i);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};

    #[test]
    fn kernel_polynomial_against_f64() {
        // 1.4e-6 of the series at c' = 1.25, a few roundings, and twice the relative error for every squaring.
        for (cutoff, tolerance) in
            [(1e-6, 2e-7), (0.5, 3e-7), (1.0, 6e-7), (1.25, 1.6e-6), (2.0, 1.2e-6), (4.5, 4e-6), (100.0, 5e-5)]
        {
            let kernel = Kernel::new(cutoff);
            let worst = (0..=1000).map(|i| {
                let rho_squared = i as f32 / 1000.0;
                (f64::from(kernel.at_one(rho_squared)) - (-cutoff * f64::from(rho_squared)).exp()).abs()
            });
            let worst = worst.fold(0.0, f64::max);
            assert!(worst < tolerance, "c = {cutoff}: {worst:e}");
        }
    }

    #[test]
    fn kernel_in_lanes_is_the_kernel_of_one() {
        let kernel = Kernel::new(4.5);
        let instructions = Instructions::new(SimdLevel::Best).unwrap();
        with_instructions!(instructions, simd => {
            for i in 0..100 {
                let x = i as f32 / 100.0;
                assert_eq!(kernel.at(Lanes::splat(simd, x)).to_array()[7], kernel.at_one(x));
            }
        });
    }
}
