//! How far two images are apart.
//!
//! [`compare`] measures two linear premultiplied RGBA images, [`compare_plane`] a single plane (depth, a
//! normal component, a weight); [`flip`] holds the perceptual metric on its own and [`colormap`] turns an
//! error map into an image.
//!
//! # Values that aren't finite
//! One rule everywhere, see [`abs_difference`]: equal values differ by 0, equal infinities included (an empty
//! pixel's depth is +∞ on both sides); an infinity on one side only, or of the other sign, is an infinite
//! error; so is NaN on either side or both, because no renderer may write one.
//!
//! # Reproducibility
//! Sums run in pixel order in f64, on one thread: the same input gives the same output. FLIP calls the
//! platform's `powf`, `cbrt` and `exp`, so across machines it may differ in the last bits of its f32 map.

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
