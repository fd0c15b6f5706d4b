//! Size of a point's splat: the radius of its disk, or an ellipse if the points around it are spaced more widely in one
//! direction, as in scan lines. Lengths are in the grid steps of [`SortedPoints`](crate::sorted::SortedPoints), the
//! unit of its quantised coordinates.

use crate::class::Evidence;

/// Axis ratio of a point's Voronoi cell ([`Cell`](crate::cell::Cell)) above which the sampling around the point counts
/// as stretched, so that the splat is an ellipse.
pub(crate) const ANISOTROPIC_RATIO: f64 = 1.5;

/// Largest axis ratio of a splat's ellipse; larger ones are limited to this value.
pub(crate) const MAX_AXIS_RATIO: f64 = 48.0;

/// Size of one point's splat, estimated from the neighbouring points, and the measured properties ([`Evidence`]) that
/// determine the point's [`PointClass`](crate::class::PointClass): surface, border, crease, foliage, line or isolated.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Size {
    /// Radius of the disk in grid steps; 0 if the point has no neighbours.
    pub(crate) radius: f32,
    /// Square root of the surface area per point around the point, in grid steps.
    pub(crate) spacing: f32,
    pub(crate) evidence: Evidence,
}

/// Ellipse of a splat, stored in 64 bits. A ratio of 0 means that the splat is a disk.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ellipse {
    /// Geometric mean of the half-axes, in grid steps.
    pub(crate) mean: f32,
    /// Angle of the long axis in the tangent frame of the splat's normal ([`crate::block::tangents`]), as a multiple of
    /// π / [`Self::STEPS`].
    angle: u16,
    /// Ratio of the long to the short axis, as a multiple of [`MAX_AXIS_RATIO`] / [`Self::STEPS`]; 0 for a disk.
    pub(crate) ratio: u16,
}

impl Ellipse {
    /// Number of quantisation steps for half a turn, and for the range of axis ratios.
    const STEPS: f64 = 65_535.0;

    pub(crate) fn new(mean: f32, angle: f64, ratio: f64) -> Self {
        let turn = (angle / std::f64::consts::PI).rem_euclid(1.0);
        let ratio = (ratio / MAX_AXIS_RATIO * Self::STEPS).round() as u16;
        Self { mean, angle: (turn * Self::STEPS).round() as u16, ratio }
    }

    /// Returns the angle of the long axis in the tangent frame, in radians.
    pub(crate) fn angle(self) -> f64 {
        f64::from(self.angle) / Self::STEPS * std::f64::consts::PI
    }

    /// Returns the axis ratio (long to short); 0 if there is no ellipse.
    pub(crate) fn ratio(self) -> f64 {
        f64::from(self.ratio) / Self::STEPS * MAX_AXIS_RATIO
    }
}
