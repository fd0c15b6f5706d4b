//! Measures of the difference between two images.
//!
//! [`compare`] measures two linear premultiplied RGBA images, [`compare_plane`] a single plane (depth, a normal
//! component, a weight). [`flip`] has the perceptual metric on its own, and [`colormap`] converts an error map to an
//! image.
//!
//! # Values that aren't finite
//! [`abs_difference`] defines one rule for all metrics. Equal values differ by 0, equal infinities included: an empty
//! pixel's depth is +∞ on both sides. An infinity on one side only, or of the other sign, is an infinite error. So is
//! NaN on either side or both, because no renderer may write it.
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
