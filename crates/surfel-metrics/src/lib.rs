//! Measures of the difference between two images: maximum error, RMSE, PSNR and FLIP.
//!
//! Main types, in reading order:
//!
//! 1. [`Image`]: a borrowed image of linear premultiplied RGBA;
//! 2. [`compare()`]: compares two images with [`CompareOptions`], and returns a [`Comparison`];
//! 3. [`compare_plane`]: compares two planes of numbers, such as depths or weights, and returns a [`PlaneComparison`];
//! 4. [`flip`]: the perceptual metric FLIP on its own; [`colormap`] converts an error map to an image.
//!
//! ```
//! use surfel_metrics::{CompareOptions, Image, compare};
//! # fn main() -> Result<(), surfel_metrics::MetricsError> {
//! let reference = [0.5_f32, 0.5, 0.5, 1.0].repeat(16 * 16);
//! let mut test = reference.clone();
//! test[0] = 0.6; // red of the first pixel
//!
//! let images = [Image::new(16, 16, &reference)?, Image::new(16, 16, &test)?];
//! let difference = compare(&images[0], &images[1], &CompareOptions::default())?;
//! assert_eq!(difference.max_abs_at, Some((0, 0)));
//! assert!((difference.max_abs - 0.1).abs() < 1e-6);
//! assert_eq!(difference.differing, 1);
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate is at the bottom of the workspace: it depends on `surfel-math` only, for sRGB, and has no terms of
//! splatting. `surfel-app` uses it to compare image files, and the conformance tests use it to compare backends. It has
//! no Cargo features.
//!
//! # Values that aren't finite
//! [`abs_difference`] defines one rule for all metrics. Equal values differ by 0, including equal infinities: the depth
//! of an empty pixel is +∞ in both images. An infinity in one image only, or with the other sign, is an infinite error.
//! NaN in either image is an infinite error too, because no renderer may write it.
//!
//! # Reproducibility
//! Sums run in pixel order in f64, on one thread: the same input yields the same output. FLIP calls the platform's
//! `powf`, `cbrt` and `exp`, so its f32 map may differ in the last bits between machines.

pub mod colormap;
mod compare;
mod error;
pub mod flip;
mod image;
mod plane;

pub use compare::{CompareOptions, Comparison, MID_GREY, compare};
pub use error::MetricsError;
pub use image::Image;
pub use plane::{PlaneComparison, PlaneOptions, abs_difference, compare_plane, max_abs, psnr, psnr_of_rmse, rmse};
