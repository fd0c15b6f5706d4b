//! Size of a point: the radius of its disk, or an ellipse.

use crate::class::Evidence;

/// Axis ratio from which sampling counts as anisotropic.
pub(crate) const STRETCHED: f64 = 1.5;

/// Axis ratio of the longest ellipse.
pub(crate) const MOST_STRETCHED: f64 = 48.0;

/// Size of one point as estimated from its neighbourhood, and the evidence for its class.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Size {
    /// Radius of a disk; 0 if there are no neighbours.
    pub(crate) radius: f32,
    /// Square root of the area per point.
    pub(crate) spacing: f32,
    pub(crate) evidence: Evidence,
}

/// Ellipse that fits a point better than its disk, in 64 bits; a ratio of 0 means that there is none.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ellipse {
    /// Square root of the product of the half-axes.
    pub(crate) mean: f32,
    /// Angle of the long axis in the normal's tangent frame, as a fraction of half a turn.
    angle: u16,
    /// Axis ratio (long to short), as a fraction of [`MOST_STRETCHED`].
    pub(crate) ratio: u16,
}

impl Ellipse {
    /// Number of steps in half a turn, and in the range of ratios.
    const STEPS: f64 = 65_535.0;

    pub(crate) fn new(mean: f32, angle: f64, ratio: f64) -> Self {
        let turn = (angle / std::f64::consts::PI).rem_euclid(1.0);
        let ratio = (ratio / MOST_STRETCHED * Self::STEPS).round() as u16;
        Self { mean, angle: (turn * Self::STEPS).round() as u16, ratio }
    }

    /// Returns the angle in radians.
    pub(crate) fn angle(self) -> f64 {
        f64::from(self.angle) / Self::STEPS * std::f64::consts::PI
    }

    /// Returns the axis ratio; 0 if there is no ellipse.
    pub(crate) fn ratio(self) -> f64 {
        f64::from(self.ratio) / Self::STEPS * MOST_STRETCHED
    }
}
