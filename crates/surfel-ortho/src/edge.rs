//! Coverage of pixels by the upper of two surfaces, near the edge between them.

/// Coverage by the upper surface near an edge, as a function of the position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    value: f64,
    slopes: [f64; 2],
    /// True if coverage is the logistic function of `value` + `slopes`·offset. Otherwise, coverage is ½ plus this
    /// linear function, clamped to [0, 1].
    pub(crate) is_logistic: bool,
}

impl Edge {
    pub(crate) fn linear([value, along_x, along_y]: [f64; 3]) -> Self {
        Self { value, slopes: [along_x, along_y], is_logistic: false }
    }

    pub(crate) fn logistic(value: f64, slopes: [f64; 2]) -> Self {
        Self { value, slopes, is_logistic: true }
    }

    pub(crate) fn constant(share: f64) -> Self {
        Self::linear([share - 0.5, 0.0, 0.0])
    }

    /// Returns the coverage, 0 to 1, at an offset from the position for which the edge was located.
    pub(crate) fn share(&self, dx: f64, dy: f64) -> f64 {
        let linear = self.value + self.slopes[0] * dx + self.slopes[1] * dy;
        if self.is_logistic { 1.0 / (1.0 + (-linear).exp()) } else { (0.5 + linear).clamp(0.0, 1.0) }
    }
}
