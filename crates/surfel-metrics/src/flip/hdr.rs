//! HDR-FLIP: the largest LDR-FLIP error over the exposures that a viewer may choose.

use super::{Encoding, FlipMap, FlipOptions, check, map_without_nan};
use crate::error::MetricsError;

/// Maximum number of exposures that [`hdr`] compares. Without this limit, it is the number of stops between the first
/// and the last exposure, rounded up, and at least 2.
pub const MAX_EXPOSURES: usize = 32;

/// Result of HDR-FLIP: the error map, and the exposures that were compared.
#[derive(Clone, Debug, PartialEq)]
pub struct HdrFlip {
    /// Largest error of every pixel over all exposures, and the mean of these errors.
    pub map: FlipMap,
    /// First exposure in stops, at which the reference's brightest pixel is tone-mapped to 0.85; 0 if all pixels are
    /// black.
    pub start_exposure: f64,
    /// Last exposure in stops, at which the reference's median luminance, as [`hdr`] defines it, is tone-mapped to
    /// 0.85; 0 if all pixels are black.
    pub stop_exposure: f64,
    /// Number of exposures that were compared, evenly spaced from the first to the last.
    pub exposures: usize,
}

/// Computes HDR-FLIP (Andersson et al. 2021) between two images of opaque linear RGB pixels, row by row from the top.
/// The exposure range is the reference's, and the tone mapper is ACES (Narkowicz's fit, without its pre-exposure of
/// 0.6).
///
/// Negative values count as 0, and infinite values as the largest f32.
///
/// Deviation from the paper: the paper's median luminance is 0 if half of the reference is black. This is common for an
/// object in front of a black background. The median of the pixels that aren't black then replaces it. If all pixels
/// are black, the exposure is 0.
///
/// # Errors
/// Errors of [`ldr`](super::ldr()), and [`MetricsError::OutOfRange`] for an encoding other than linear.
pub fn hdr(
    width: u32,
    height: u32,
    reference: &[[f32; 3]],
    test: &[[f32; 3]],
    options: &FlipOptions,
) -> Result<HdrFlip, MetricsError> {
    check(width, height, reference, test, options)?;
    if options.encoding != Encoding::Linear {
        return Err(MetricsError::OutOfRange {
            field: "encoding",
            found: 1.0,
            expected: "linear: high dynamic range isn't sRGB-encoded",
        });
    }
    let (start, stop) = exposure_range(reference);
    let exposures = ((stop - start).ceil().max(2.0) as usize).min(MAX_EXPOSURES);
    let step = (stop - start) / (exposures - 1) as f64;
    let mut worst = vec![0.0f32; reference.len()];
    for i in 0..exposures {
        let gain = (start + i as f64 * step).exp2();
        let view = |pixels: &[[f32; 3]], i: usize| pixels[i].map(|v| aces(finite_light(v) * gain).clamp(0.0, 1.0));
        let errors = map_without_nan(width, height, reference, test, options, view);
        worst.iter_mut().zip(errors).for_each(|(worst, e)| *worst = worst.max(e));
    }
    let map = FlipMap::new(width, height, worst);
    Ok(HdrFlip { map, start_exposure: start, stop_exposure: stop, exposures })
}

/// Coefficients n₂ and n₁ of the numerator in the ACES tone mapper's fit (n₂x² + n₁x)/(d₂x² + d₁x + d₀).
const ACES_NUMERATOR: [f64; 2] = [0.6 * 0.6 * 2.51, 0.6 * 0.03];
/// Coefficients d₂, d₁ and d₀ of the denominator in the ACES tone mapper's fit ([`ACES_NUMERATOR`]).
const ACES_DENOMINATOR: [f64; 3] = [0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

/// Tone-maps linear light `x` by the ACES fit.
fn aces(x: f64) -> f64 {
    let [n2, n1] = ACES_NUMERATOR;
    let [d2, d1, d0] = ACES_DENOMINATOR;
    (n2 * x + n1) * x / ((d2 * x + d1) * x + d0)
}

/// Returns the linear light that [`aces`] maps to `target`, which must be in (0, 1).
fn aces_inverse(target: f64) -> f64 {
    let [n2, n1] = ACES_NUMERATOR;
    let [d2, d1, d0] = ACES_DENOMINATOR;
    let (a, half_b, c) = (n2 - target * d2, 0.5 * (n1 - target * d1), -target * d0);
    (-half_b + (half_b * half_b - a * c).sqrt()) / a
}

fn finite_light(v: f32) -> f64 {
    f64::from(v.clamp(0.0, f32::MAX))
}

/// Returns the first and last exposure in stops, computed from the reference's brightest and median luminance.
fn exposure_range(reference: &[[f32; 3]]) -> (f64, f64) {
    let luminance = |p: &[f32; 3]| {
        let [r, g, b] = p.map(|v| if v.is_nan() { 0.0 } else { finite_light(v) });
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let mut sorted: Vec<f64> = reference.iter().map(luminance).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let lit = &sorted[sorted.partition_point(|&y| y <= 0.0)..];
    let Some(&brightest) = lit.last() else { return (0.0, 0.0) };
    // The upper median of an even number, as in the authors' program.
    let median = |sorted: &[f64]| sorted[sorted.len() / 2];
    let all = median(&sorted);
    let typical = if all > 0.0 { all } else { median(lit) };
    let full = aces_inverse(0.85);
    ((full / brightest).log2(), (full / typical).log2())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aces_inverse_is_an_inverse() {
        for target in [0.1, 0.5, 0.85, 0.95] {
            // 1e-13: a few f64 roundings at values of about 1.
            assert!((aces(aces_inverse(target)) - target).abs() < 1e-13);
        }
    }

    #[test]
    fn exposure_range_survives_black_bright_and_bad_references() {
        assert_eq!(exposure_range(&[[0.0; 3]; 4]), (0.0, 0.0));
        assert_eq!(exposure_range(&[]), (0.0, 0.0));
        let mostly_black = [[0.0; 3], [0.0; 3], [0.0; 3], [1.0; 3], [f32::NAN; 3], [-1.0; 3]];
        let (start, stop) = exposure_range(&mostly_black);
        assert_eq!(start, stop);
        let (start, stop) = exposure_range(&[[f32::INFINITY; 3], [f32::MIN_POSITIVE; 3], [f32::MIN_POSITIVE; 3]]);
        assert!(start.is_finite() && stop.is_finite() && start < stop);
    }
}
