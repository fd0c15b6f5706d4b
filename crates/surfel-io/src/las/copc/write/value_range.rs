//! Ranges of the values of columns, which decide the fields that store them.

/// Minimum and maximum of a column's finite values.
#[derive(Clone, Copy, Debug)]
pub(super) struct ValueRange {
    pub(super) min: f64,
    pub(super) max: f64,
    /// True if every value is an integer.
    pub(super) whole: bool,
    /// True if every value is finite.
    pub(super) all_finite: bool,
}

impl ValueRange {
    /// Returns the range of no values: the minimum is +∞ and the maximum −∞.
    pub(super) fn none() -> Self {
        Self { min: f64::INFINITY, max: f64::NEG_INFINITY, whole: true, all_finite: true }
    }

    /// Extends the range by a value.
    pub(super) fn add(&mut self, value: f64) {
        if value.is_finite() {
            (self.min, self.max) = (self.min.min(value), self.max.max(value));
            self.whole &= value.fract() == 0.0;
        } else {
            (self.whole, self.all_finite) = (false, false);
        }
    }

    /// Extends the range by all values of another one.
    pub(super) fn join(&mut self, other: &Self) {
        (self.min, self.max) = (self.min.min(other.min), self.max.max(other.max));
        self.whole &= other.whole;
        self.all_finite &= other.all_finite;
    }
}
