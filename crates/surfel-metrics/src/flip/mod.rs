//! ꟻLIP, a measure of the difference between two images that alternate on one screen.
//!
//! - LDR ([`ldr()`]): P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström, M. D. Fairchild, *ꟻLIP: A
//!   Difference Evaluator for Alternating Images*, HPG 2020.
//! - HDR ([`hdr()`]): P. Andersson, J. Nilsson, P. Shirley, T. Akenine-Möller, *Visualizing Errors in Rendered High
//!   Dynamic Range Images*, Eurographics 2021.
//!
//! Deviation from the papers: filters run separably, in f64, which yields the same sums. A Gaussian is separable, and
//! the blue-yellow filter is a sum of two Gaussians.
//!
//! A pixel that is NaN in either image has error 1. The filters read such a pixel as black in both images, so that the
//! error doesn't spread. Infinities and other values outside [0, 1] are clamped.

mod color;
mod filter;
mod hdr;
mod ldr;

use crate::error::{MetricsError, check_length, pixel_count};
pub use hdr::{HdrFlip, MAX_EXPOSURES, hdr};

/// Number of pixels per degree of visual angle for the papers' viewer, who sits 0.7 m from a screen 0.7 m wide with
/// 3840 pixels.
pub const DEFAULT_PIXELS_PER_DEGREE: f64 = 0.7 * (3840.0 / 0.7) * (std::f64::consts::PI / 180.0);

/// Encoding of the colours in images that FLIP compares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Linear light, Rec. 709 primaries.
    #[default]
    Linear,
    /// sRGB-encoded values, which are decoded to linear light.
    Srgb,
}

/// Viewing conditions of FLIP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlipOptions {
    /// Number of pixels per degree of the visual angle, from 1 to 1000. Default [`DEFAULT_PIXELS_PER_DEGREE`].
    pub pixels_per_degree: f64,
    /// Encoding of both images' colours.
    pub encoding: Encoding,
}

impl Default for FlipOptions {
    fn default() -> Self {
        Self { pixels_per_degree: DEFAULT_PIXELS_PER_DEGREE, encoding: Encoding::Linear }
    }
}

/// Result of FLIP: the error of every pixel, and their mean.
#[derive(Clone, Debug, PartialEq)]
pub struct FlipMap {
    /// Width of the error map in pixels.
    pub width: u32,
    /// Height of the error map in pixels.
    pub height: u32,
    /// Error of every pixel in [0, 1], row by row from the top.
    pub error: Vec<f32>,
    /// Mean error over all pixels; 0 for an empty image.
    pub mean: f64,
}

impl FlipMap {
    fn new(width: u32, height: u32, error: Vec<f32>) -> Self {
        let sum: f64 = error.iter().map(|&e| f64::from(e)).sum();
        let mean = if error.is_empty() { 0.0 } else { sum / error.len() as f64 };
        Self { width, height, error, mean }
    }

    /// Converts the error map to [`magma`](crate::colormap::magma) colours, sRGB-encoded, row by row from the top.
    pub fn to_magma(&self) -> Vec<[u8; 3]> {
        crate::colormap::magma_image(&self.error, 1.0)
    }
}

/// Computes LDR-FLIP (Andersson et al. 2020) between two images of opaque RGB pixels, row by row from the top, with
/// values in [0, 1]. Each image has `width`·`height` pixels, without padding.
///
/// # Errors
/// [`MetricsError::Length`] if an image doesn't have `width`·`height` pixels, [`MetricsError::OutOfRange`] for pixels
/// per degree outside [1, 1000].
pub fn ldr(
    width: u32,
    height: u32,
    reference: &[[f32; 3]],
    test: &[[f32; 3]],
    options: &FlipOptions,
) -> Result<FlipMap, MetricsError> {
    check(width, height, reference, test, options)?;
    let decode = decoder(options.encoding);
    let view = |pixels: &[[f32; 3]], i: usize| pixels[i].map(|v| decode(f64::from(v).clamp(0.0, 1.0)));
    let error = map_without_nan(width, height, reference, test, options, view);
    Ok(FlipMap::new(width, height, error))
}

fn decoder(encoding: Encoding) -> fn(f64) -> f64 {
    match encoding {
        Encoding::Linear => |v| v,
        Encoding::Srgb => surfel_math::srgb::decode,
    }
}

/// Returns the error map of two images. A pixel that is NaN in either image gets error 1, and is black in both for its
/// neighbours' filters. `view` returns the linear RGB in [0, 1] of pixel `i` of an image.
fn map_without_nan(
    width: u32,
    height: u32,
    reference: &[[f32; 3]],
    test: &[[f32; 3]],
    options: &FlipOptions,
    view: impl Fn(&[[f32; 3]], usize) -> [f64; 3],
) -> Vec<f32> {
    let has_nan = |i: usize| reference[i].iter().chain(&test[i]).any(|v| v.is_nan());
    let shown = |pixels: &[[f32; 3]], i: usize| if has_nan(i) { [0.0; 3] } else { view(pixels, i) };
    let (width, height) = (width as usize, height as usize);
    let kernels = filter::Kernels::new(options.pixels_per_degree);
    let mut error = ldr::error_map(width, height, &kernels, |i| shown(reference, i), |i| shown(test, i));
    (0..error.len()).filter(|&i| has_nan(i)).for_each(|i| error[i] = 1.0);
    error
}

fn check(
    width: u32,
    height: u32,
    reference: &[[f32; 3]],
    test: &[[f32; 3]],
    options: &FlipOptions,
) -> Result<(), MetricsError> {
    let count = pixel_count(width, height, 3)?;
    check_length("the reference image", reference.len(), count, "width x height")?;
    check_length("the test image", test.len(), count, "width x height")?;
    if (1.0..=1000.0).contains(&options.pixels_per_degree) {
        Ok(())
    } else {
        // Below 1 the derivative filters vanish; the upper limit bounds the rows that are stored.
        Err(MetricsError::OutOfRange {
            field: "pixels_per_degree",
            found: options.pixels_per_degree,
            expected: "a number from 1 to 1000",
        })
    }
}
