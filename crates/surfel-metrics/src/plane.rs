//! Comparison of single planes, such as depths or weights.

use crate::error::{MetricsError, check_length};

/// Returns the absolute difference |a − b|, which is never NaN. Equal values, including equal infinities, differ by 0.
/// The difference is infinite for an infinity on one side only, and for NaN on either side or both.
pub fn abs_difference(a: f32, b: f32) -> f64 {
    if a == b {
        return 0.0;
    }
    let difference = (f64::from(a) - f64::from(b)).abs();
    if difference.is_nan() { f64::INFINITY } else { difference }
}

/// Options of [`compare_plane`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneOptions<'a> {
    /// Flag per value of the planes, true if the value is compared. `None` compares all values.
    pub mask: Option<&'a [bool]>,
    /// Largest difference, at least 0, at which values count as equal; [`PlaneComparison::differing`] counts the
    /// others.
    pub tolerance: f64,
}

/// Differences between two planes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneComparison {
    /// Number of values that were compared, which the mask selects.
    pub compared: usize,
    /// Largest absolute difference, 0 if nothing was compared; it may be infinite by the rule of [`abs_difference`].
    pub max_abs: f64,
    /// Index of the first compared value with the difference `max_abs`; `None` if no compared value differs.
    pub max_abs_index: Option<usize>,
    /// Root mean squared difference (RMSE): 0 if nothing was compared, infinite if `non_finite` > 0.
    pub rmse: f64,
    /// Number of compared values that differ by more than [`PlaneOptions::tolerance`].
    pub differing: usize,
    /// Number of compared values with an infinite difference, because of NaN or of an infinity in one plane only.
    pub non_finite: usize,
}

impl PlaneComparison {
    /// Returns the peak signal-to-noise ratio (PSNR) in dB; `peak` is the largest value of a signal. See
    /// [`psnr_of_rmse`].
    ///
    /// # Errors
    /// [`MetricsError::OutOfRange`] if `peak` isn't finite and above 0.
    pub fn psnr(&self, peak: f64) -> Result<f64, MetricsError> {
        psnr_of_rmse(self.rmse, peak)
    }
}

/// Compares two planes of one quantity, value by value.
///
/// # Errors
/// [`MetricsError::Length`] if `a`, `b` and the mask aren't equally long, [`MetricsError::OutOfRange`] for a tolerance
/// that is negative or NaN.
pub fn compare_plane(a: &[f32], b: &[f32], options: &PlaneOptions) -> Result<PlaneComparison, MetricsError> {
    check_length("the second plane", b.len(), a.len(), "as many as the first")?;
    if let Some(mask) = options.mask {
        check_length("the mask", mask.len(), a.len(), "one for each value")?;
    }
    check_tolerance(options.tolerance)?;
    let mut result = PlaneComparison::default();
    let mut squares = 0.0;
    for (i, (&a, &b)) in a.iter().zip(b).enumerate() {
        if options.mask.is_some_and(|mask| !mask[i]) {
            continue;
        }
        let difference = abs_difference(a, b);
        result.compared += 1;
        squares += difference * difference;
        result.differing += usize::from(difference > options.tolerance);
        result.non_finite += usize::from(difference.is_infinite());
        if difference > result.max_abs {
            result.max_abs = difference;
            result.max_abs_index = Some(i);
        }
    }
    result.rmse = root_mean(squares, result.compared);
    Ok(result)
}

/// Returns the largest absolute difference of two planes. The `mask` and infinite results are defined as in
/// [`compare_plane`].
///
/// # Errors
/// [`MetricsError::Length`] if the slices aren't equally long.
pub fn max_abs(a: &[f32], b: &[f32], mask: Option<&[bool]>) -> Result<f64, MetricsError> {
    Ok(compare_plane(a, b, &PlaneOptions { mask, tolerance: 0.0 })?.max_abs)
}

/// Returns the root mean squared difference of two planes. The `mask` and infinite results are defined as in
/// [`compare_plane`].
///
/// # Errors
/// [`MetricsError::Length`] if the slices aren't equally long.
pub fn rmse(a: &[f32], b: &[f32], mask: Option<&[bool]>) -> Result<f64, MetricsError> {
    Ok(compare_plane(a, b, &PlaneOptions { mask, tolerance: 0.0 })?.rmse)
}

/// Returns the peak signal-to-noise ratio of two planes in dB. The `mask` is defined as in [`compare_plane`], and
/// extreme results as in [`psnr_of_rmse`].
///
/// # Errors
/// [`MetricsError::Length`] if the slices aren't equally long, [`MetricsError::OutOfRange`] if `peak` isn't finite and
/// above 0.
pub fn psnr(a: &[f32], b: &[f32], mask: Option<&[bool]>, peak: f64) -> Result<f64, MetricsError> {
    psnr_of_rmse(rmse(a, b, mask)?, peak)
}

/// Returns the peak signal-to-noise ratio 20·log10(`peak`/`rmse`) in dB: +∞ for an error of 0, −∞ for an infinite
/// error.
///
/// # Errors
/// [`MetricsError::OutOfRange`] if `peak` isn't finite and above 0.
pub fn psnr_of_rmse(rmse: f64, peak: f64) -> Result<f64, MetricsError> {
    if !(peak.is_finite() && peak > 0.0) {
        return Err(MetricsError::OutOfRange { field: "peak", found: peak, expected: "a finite number above 0" });
    }
    Ok(20.0 * (peak.log10() - rmse.log10()))
}

/// Returns the root mean √(`squares`/`count`) of a sum of squares, or 0 if `count` is 0.
pub(crate) fn root_mean(squares: f64, count: usize) -> f64 {
    if count == 0 { 0.0 } else { (squares / count as f64).sqrt() }
}

pub(crate) fn check_tolerance(tolerance: f64) -> Result<(), MetricsError> {
    if tolerance >= 0.0 {
        Ok(())
    } else {
        Err(MetricsError::OutOfRange { field: "tolerance", found: tolerance, expected: "a number of at least 0" })
    }
}
