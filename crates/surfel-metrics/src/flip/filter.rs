//! FLIP's separable filters: contrast sensitivity (HPG 2020, §4.1.1) and edges and points (§4.2).

use std::f64::consts::PI;

/// Gaussian term of a contrast sensitivity function, with amplitude and width parameters a and b of the FLIP paper:
/// a·√(π/b)·e^(−π²x²/b), with x in degrees.
struct CsfTerm {
    a: f64,
    b: f64,
}

/// Term of the achromatic contrast sensitivity function (HPG 2020, table 1).
const ACHROMATIC: CsfTerm = CsfTerm { a: 1.0, b: 0.0047 };
/// Term of the red-green contrast sensitivity function (HPG 2020, table 1).
const RED_GREEN: CsfTerm = CsfTerm { a: 1.0, b: 0.0053 };
/// Terms of the blue-yellow contrast sensitivity function (HPG 2020, table 1).
const BLUE_YELLOW: [CsfTerm; 2] = [CsfTerm { a: 34.1, b: 0.04 }, CsfTerm { a: 13.5, b: 0.025 }];

/// Width w of the filter that detects edges and points, from peak to trough, in degrees (HPG 2020, §4.2).
const FEATURE_WIDTH_DEGREES: f64 = 0.082;

/// Right halves of the one-dimensional kernels of all filters: entry `k` is the weight of pixels ±k away.
pub(super) struct Kernels {
    pub(super) achromatic: Vec<f64>,
    pub(super) red_green: Vec<f64>,
    /// Kernels of the two terms of the blue-yellow filter. Each is applied in both directions, and the results are
    /// added.
    pub(super) blue_yellow: [Vec<f64>; 2],
    pub(super) smooth: Vec<f64>,
    /// Kernel of the first derivative, which detects edges. It is antisymmetric: pixels on the left have the opposite
    /// weight.
    pub(super) first_derivative: Vec<f64>,
    pub(super) second_derivative: Vec<f64>,
}

impl Kernels {
    /// Computes the kernels for a number of pixels per degree from 1 to 1000.
    pub(super) fn new(pixels_per_degree: f64) -> Self {
        // The radius is three standard deviations of the widest term, for all terms, as in the paper.
        let csf_radius = (3.0 * (BLUE_YELLOW[0].b / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
        let term = |t: &CsfTerm| -> Vec<f64> {
            let amplitude = (t.a * (PI / t.b).sqrt()).sqrt();
            let degrees = |k: usize| k as f64 / pixels_per_degree;
            (0..=csf_radius).map(|k| amplitude * (-PI * PI * degrees(k) * degrees(k) / t.b).exp()).collect()
        };
        let mut blue_yellow = BLUE_YELLOW.each_ref().map(term);
        let area: f64 = blue_yellow.iter().map(|w| full_sum(w) * full_sum(w)).sum();
        for weight in blue_yellow.iter_mut().flatten() {
            *weight /= area.sqrt();
        }

        let sigma = 0.5 * FEATURE_WIDTH_DEGREES * pixels_per_degree;
        let feature_radius = (3.0 * sigma).ceil() as usize;
        let offsets = || (0..=feature_radius).map(|k| k as f64);
        let gaussian = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
        let mut first_derivative: Vec<f64> = offsets().map(|x| x * gaussian(x)).collect();
        let one_side: f64 = first_derivative.iter().sum();
        first_derivative.iter_mut().for_each(|w| *w /= one_side);
        let mut second_derivative: Vec<f64> =
            offsets().map(|x| (x * x / (sigma * sigma) - 1.0) * gaussian(x)).collect();
        normalize_by_sign(&mut second_derivative);

        Self {
            achromatic: normalized(term(&ACHROMATIC)),
            red_green: normalized(term(&RED_GREEN)),
            blue_yellow,
            smooth: normalized(offsets().map(gaussian).collect()),
            first_derivative,
            second_derivative,
        }
    }

    /// Returns the radius of the widest kernel in pixels: the number of neighbouring pixels that a filter reads on
    /// either side.
    pub(super) fn radius(&self) -> usize {
        self.achromatic.len().max(self.smooth.len()) - 1
    }
}

/// Returns the sum of the whole symmetric kernel whose right half is `half`.
fn full_sum(half: &[f64]) -> f64 {
    half[0] + 2.0 * half[1..].iter().sum::<f64>()
}

fn normalized(mut half: Vec<f64>) -> Vec<f64> {
    let sum = full_sum(&half);
    half.iter_mut().for_each(|w| *w /= sum);
    half
}

/// Scales positive and negative weights of a symmetric kernel so that they sum to 1 and −1.
fn normalize_by_sign(half: &mut [f64]) {
    let multiplicity = |k: usize| if k == 0 { 1.0 } else { 2.0 };
    let (mut positive, mut negative) = (0.0, 0.0);
    for (k, &w) in half.iter().enumerate() {
        *if w > 0.0 { &mut positive } else { &mut negative } += multiplicity(k) * w.abs();
    }
    for w in half {
        *w /= if *w > 0.0 { positive } else { negative };
    }
}

/// Symmetry of a kernel, by which its left half follows from the stored right half: equal (even) or negated (odd).
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Parity {
    Even,
    Odd,
}

/// Convolves a signal with the kernel whose right half is `half`: `out[i]` = Σ weight(k)·`at(k)[i]`. The function `at`
/// returns the signal shifted by k pixels.
pub(super) fn convolve<'a>(out: &mut [f64], half: &[f64], parity: Parity, at: impl Fn(isize) -> &'a [f64]) {
    match parity {
        Parity::Even => out.iter_mut().zip(at(0)).for_each(|(o, v)| *o = half[0] * v),
        Parity::Odd => out.fill(0.0),
    }
    for (k, &weight) in half.iter().enumerate().skip(1) {
        let k = k as isize;
        let pairs = out.iter_mut().zip(at(-k).iter().zip(at(k)));
        match parity {
            Parity::Even => pairs.for_each(|(o, (left, right))| *o += weight * (left + right)),
            Parity::Odd => pairs.for_each(|(o, (left, right))| *o += weight * (right - left)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // 1e-14: sums of a few dozen terms of at most 1, in f64.
    const ROUNDING: f64 = 1e-14;

    #[test]
    fn kernels_are_normalized_at_every_density() {
        for density in [1.0, 10.0, 67.02, 500.0, 1000.0] {
            let k = Kernels::new(density);
            for half in [&k.achromatic, &k.red_green, &k.smooth] {
                assert!((full_sum(half) - 1.0).abs() < ROUNDING, "{density}");
            }
            let blue_yellow: f64 = k.blue_yellow.iter().map(|w| full_sum(w).powi(2)).sum();
            assert!((blue_yellow - 1.0).abs() < ROUNDING, "{density}");
            assert!((k.first_derivative.iter().sum::<f64>() - 1.0).abs() < ROUNDING, "{density}");
            assert_eq!(k.first_derivative[0], 0.0);
            assert!(full_sum(&k.second_derivative).abs() < 20.0 * ROUNDING, "{density}");
        }
    }

    #[test]
    fn convolve_even_and_odd_match_the_written_out_sum() {
        let signal = [1.0, 2.0, 4.0, 8.0, 16.0];
        let at = |k: isize| &signal[(1 + k) as usize..(4 + k) as usize];
        let mut out = [0.0; 3];
        convolve(&mut out, &[0.5, 0.25], Parity::Even, at);
        assert_eq!(out, [2.25, 4.5, 9.0]);
        convolve(&mut out, &[0.0, 1.0], Parity::Odd, at);
        assert_eq!(out, [3.0, 6.0, 12.0]);
    }
}
