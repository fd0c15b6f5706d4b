//! Range checks of numbers.

use crate::ModelError;

/// Returns an error that names `field` if one of `values` isn't finite.
pub(crate) fn finite(field: &str, values: &[f64]) -> Result<(), ModelError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(ModelError::range(field, v, "finite numbers")),
        None => Ok(()),
    }
}

/// Returns an error that names `field` if `value` isn't finite or not greater than 0.
pub(crate) fn positive(field: &str, value: f64) -> Result<(), ModelError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(ModelError::range(field, value, "a finite number greater than 0"))
}
