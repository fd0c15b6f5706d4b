//! Coverage of pixels by the upper of two surfaces, near the edge between them.

/// Fraction of a pixel that the upper of two surfaces covers near their edge, as a function of the pixel's position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    value: f64,
    slopes: [f64; 2],
    /// True if the coverage at an offset is the logistic function of L = `value` + `slopes`·offset. If false, the
    /// coverage is ½ + L, clamped to [0, 1].
    pub(crate) is_logistic: bool,
}

impl Edge {
    /// Creates an edge whose coverage is ½ plus a linear function, given by its value and its slopes along x and y.
    pub(crate) fn linear([value, along_x, along_y]: [f64; 3]) -> Self {
        Self { value, slopes: [along_x, along_y], is_logistic: false }
    }

    /// Creates an edge whose coverage is the logistic function of a linear function.
    pub(crate) fn logistic(value: f64, slopes: [f64; 2]) -> Self {
        Self { value, slopes, is_logistic: true }
    }

    /// Creates an edge with the coverage `share` everywhere.
    pub(crate) fn constant(share: f64) -> Self {
        Self::linear([share - 0.5, 0.0, 0.0])
    }

    /// Returns the coverage, 0 to 1, at an offset from the position for which the edge was located.
    pub(crate) fn share(&self, dx: f64, dy: f64) -> f64 {
        let linear = self.value + self.slopes[0] * dx + self.slopes[1] * dy;
        if self.is_logistic { 1.0 / (1.0 + (-linear).exp()) } else { (0.5 + linear).clamp(0.0, 1.0) }
    }
}
