//! Ranges of the values of columns, which decide the fields that store them.

/// Minimum and maximum of a column's finite values.
#[derive(Clone, Copy, Debug)]
pub(super) struct ValueRange {
    pub(super) least: f64,
    pub(super) most: f64,
    /// True if every value is an integer.
    pub(super) whole: bool,
    /// True if every value is finite.
    pub(super) all_finite: bool,
}

impl ValueRange {
    /// Returns the range of no values: the minimum is +∞ and the maximum −∞.
    pub(super) fn none() -> Self {
        Self { least: f64::INFINITY, most: f64::NEG_INFINITY, whole: true, all_finite: true }
    }

    pub(super) fn add(&mut self, value: f64) {
        if value.is_finite() {
            (self.least, self.most) = (self.least.min(value), self.most.max(value));
            self.whole &= value.fract() == 0.0;
        } else {
            (self.whole, self.all_finite) = (false, false);
        }
    }

    pub(super) fn join(&mut self, other: &Self) {
        (self.least, self.most) = (self.least.min(other.least), self.most.max(other.most));
        self.whole &= other.whole;
        self.all_finite &= other.all_finite;
    }
}
