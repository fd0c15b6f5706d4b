//! Differences of single planes.

use crate::error::{MetricsError, check_length};

/// |a − b| under the crate's rule: equal values, equal infinities included, are 0 apart; an infinity on one
/// side only and NaN on either side or both are infinitely far apart. Never NaN.
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
    /// One flag a value, `true` where it counts; `None`: all count.
    pub mask: Option<&'a [bool]>,
    /// A value *differs* where its absolute difference is larger than this. At least 0.
    pub tolerance: f64,
}

/// How far two planes are apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneComparison {
    /// How many values were compared: those the mask lets through.
    pub compared: usize,
    /// The largest absolute difference, 0 where nothing was compared; infinite as [`abs_difference`] says.
    pub max_abs: f64,
    /// Index of the first value that is `max_abs` away; `None` where the planes are equal.
    pub max_abs_index: Option<usize>,
    /// Root of the mean squared difference, 0 where nothing was compared, infinite where `non_finite` > 0.
    pub rmse: f64,
    /// How many values differ by more than the tolerance.
    pub differing: usize,
    /// How many values are infinitely far apart (one-sided infinities and NaN).
    pub non_finite: usize,
}

impl PlaneComparison {
    /// Peak signal-to-noise ratio in dB for signals that reach `peak`; see [`psnr_of_rmse`].
    ///
    /// # Errors
    /// [`MetricsError::OutOfRange`] where `peak` isn't finite and above 0.
    pub fn psnr(&self, peak: f64) -> Result<f64, MetricsError> {
        psnr_of_rmse(self.rmse, peak)
    }
}

/// Compares two planes of any one quantity, value by value.
///
/// # Errors
/// [`MetricsError::Length`] where `a`, `b` and the mask aren't equally long, [`MetricsError::OutOfRange`] for a
/// tolerance that is negative or NaN.
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

/// Largest absolute difference; `mask` and infinite results as in [`compare_plane`].
///
/// # Errors
/// [`MetricsError::Length`] where the slices aren't equally long.
pub fn max_abs(a: &[f32], b: &[f32], mask: Option<&[bool]>) -> Result<f64, MetricsError> {
    Ok(compare_plane(a, b, &PlaneOptions { mask, tolerance: 0.0 })?.max_abs)
}

/// Root mean squared difference; `mask` and infinite results as in [`compare_plane`].
///
/// # Errors
/// [`MetricsError::Length`] where the slices aren't equally long.
pub fn rmse(a: &[f32], b: &[f32], mask: Option<&[bool]>) -> Result<f64, MetricsError> {
    Ok(compare_plane(a, b, &PlaneOptions { mask, tolerance: 0.0 })?.rmse)
}

/// Peak signal-to-noise ratio in dB; `mask` as in [`compare_plane`], extremes as in [`psnr_of_rmse`].
///
/// # Errors
/// [`MetricsError::Length`] where the slices aren't equally long, [`MetricsError::OutOfRange`] where `peak`
/// isn't finite and above 0.
pub fn psnr(a: &[f32], b: &[f32], mask: Option<&[bool]>, peak: f64) -> Result<f64, MetricsError> {
    psnr_of_rmse(rmse(a, b, mask)?, peak)
}

/// 20·log10(`peak`/`rmse`) in dB: +∞ for an error of 0, −∞ for an infinite one.
///
/// # Errors
/// [`MetricsError::OutOfRange`] where `peak` isn't finite and above 0.
pub fn psnr_of_rmse(rmse: f64, peak: f64) -> Result<f64, MetricsError> {
    if !(peak.is_finite() && peak > 0.0) {
        return Err(MetricsError::OutOfRange { field: "peak", found: peak, expected: "a finite number above 0" });
    }
    Ok(20.0 * (peak.log10() - rmse.log10()))
}

/// √(`squares`/`count`), 0 for none.
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
