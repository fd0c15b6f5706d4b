//! Depth of a fragment, and the tolerance between depths of fragments of one surface (rendering model §3, §5).

use crate::project::{Projected, ViewSplat};
use crate::projection::{Projection, ProjectionKind};
use crate::{Real, V2, V3};

/// Planar depth of a splat's plane as a function of pixels, clamped to the disk's own depth range (rendering model §3).
/// [`DepthForm`] states the function. Pixels are offsets from an anchor, usually the splat's projected centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthPlane<R> {
    /// Numerator of the depth for [`DepthForm::Reciprocal`], or its value at the anchor for [`DepthForm::Linear`]. For
    /// an ordinary splat, it is the depth at the projected centre, in world units.
    pub scale: R,
    /// Change of the depth form per pixel to the right and down: of the denominator for [`DepthForm::Reciprocal`], of
    /// the depth for [`DepthForm::Linear`].
    pub gradient: V2<R>,
    /// Value of the denominator of [`DepthForm::Reciprocal`] at the anchor; 1 for an ordinary splat, whose anchor is
    /// its projected centre.
    pub at_anchor: R,
    /// Nearest planar depth of the disk, in world units.
    pub z_min: R,
    /// Farthest planar depth of the disk, in world units.
    pub z_max: R,
}

/// The kind of function by which a [`DepthPlane`]'s depth z varies with the pixel offset d.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthForm {
    /// z = scale/(at_anchor + gradient·d), for the exact mapping in perspective. A denominator of at most 0 yields
    /// `z_max`.
    Reciprocal,
    /// z = scale + gradient·d, for orthographic projections and the affine mapping.
    Linear,
}

impl<R: Real> DepthPlane<R> {
    /// Returns the planar depth at pixel offset `d`, clamped to the disk's own range.
    ///
    /// The clamp applies to 1/z, so that a plane that passes behind the eye yields the far end.
    #[inline(always)]
    pub fn at(&self, d: V2<R>, form: DepthForm) -> R {
        let value = self.gradient.x.mul_add(d.x, self.gradient.y * d.y);
        match form {
            DepthForm::Reciprocal => {
                let w = self.at_anchor + value;
                let z = self.scale / R::select(w.zero().lt(w), w, w.one());
                R::select(w.zero().lt(w), z.min(self.z_max).max(self.z_min), self.z_max)
            }
            DepthForm::Linear => (self.scale + value).min(self.z_max).max(self.z_min),
        }
    }
}

/// Setting of the depth tolerance: how far behind the nearest surface fragments are still blended with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// Multiple k of the splat's larger radius, at least 0.
    Relative(f64),
    /// Distance in world units, at least 0, the same for all splats.
    Absolute(f64),
}

/// Distance in pixels, in addition to the filter radius, over which a splat's slope may explain a depth difference
/// within its tolerance ε. It is half a pixel's diagonal.
const SLOPE_MARGIN_PX: f64 = 0.7;

/// Returns the change of planar depth per pixel to the right and down, in world units. The plane passes through the
/// view position `p`, and `n` is its unit normal in view space. Steepness is limited as in ε (rendering model §5).
#[inline(always)]
pub fn plane_gradient<R: Real>(p: V3<R>, n: V3<R>, projection: &Projection) -> V2<R> {
    let k = |value: f64| p.x.constant(value);
    let across = V2::new(n.x / k(projection.focal_px[0]), n.y / k(projection.focal_px[1]));
    let away_from_zero = |v: R, least: R| R::select(v.lt(v.zero()), -(-v).max(least), v.max(least));
    let (steep, scale) = match projection.kind {
        // n·(z·ray) = n·p everywhere on the plane.
        ProjectionKind::Perspective => (away_from_zero(n.dot(p), k(0.02) * p.length()), p.z * p.z),
        ProjectionKind::Orthographic { .. } => (away_from_zero(n.z, k(0.02)), p.x.one()),
    };
    across * -(scale / steep)
}

/// Returns the depth difference, in world units, that a polygon's slope may cause within a texel of a shadow map
/// (rendering model §5). `gradient` is the change of depth per texel at depth `z`. The result is the slope term of ε,
/// with its cap.
pub fn slope_allowance(z: f64, gradient: V2<f64>, projection: &Projection) -> f64 {
    let scale = match projection.kind {
        ProjectionKind::Perspective => z,
        ProjectionKind::Orthographic { height, .. } => height,
    };
    (SLOPE_MARGIN_PX * gradient.length()).min(0.2 * scale)
}

/// Number of pixels over which a polygon's slope may explain a depth step to one of its eight neighbouring pixels. It
/// includes the distance to the neighbour and some curvature.
const STEP_PX: f64 = 2.0;

/// Returns the depth difference, in world units, that a polygon's slope may cause between neighbouring pixels
/// (rendering model §5, edges by samples). `gradient` is the change of depth per pixel at depth `z`. The result is
/// limited to between 0.001 and 0.1 of `z` (orthographic: of the view's height).
pub fn step_allowance(z: f64, gradient: V2<f64>, projection: &Projection) -> f64 {
    let scale = match projection.kind {
        ProjectionKind::Perspective => z,
        ProjectionKind::Orthographic { height, .. } => height,
    };
    // The minimum, for planes that face the eye, is far above rounding.
    (STEP_PX * gradient.length()).min(0.1 * scale).max(1e-3 * scale)
}

/// Returns a splat's depth tolerance ε (rendering model §5) in world units: how much deeper than the splat a fragment
/// may be and still blend.
///
/// `radius_max` is the splat's larger radius in world units ([`crate::project::radius_max`]). `h_px` is the filter
/// radius in pixels, 0 for a splat drawn without a filter. The slope term is Surfel's own: without it, a surface at a
/// grazing angle rejects half of the fragments that its own filter adds.
#[inline(always)]
pub fn tolerance<R: Real>(
    splat: &ViewSplat<R>,
    radius_max: R,
    h_px: R,
    setting: Tolerance,
    projection: &Projection,
) -> R {
    let ViewSplat { p, n, .. } = *splat;
    let k = |value: f64| p.x.constant(value);
    let per_focal = V2::new(k(1.0 / projection.focal_px[0]), k(1.0 / projection.focal_px[1]));
    let per_pixel = n.xy().scale_by(per_focal).length();
    let (z, slope) = match projection.kind {
        ProjectionKind::Perspective => {
            let inverse = p.x.one() / p.z.abs().max(p.x.abs()).max(p.y.abs()).max(k(1e-37));
            // n·p and |p| relative to p's largest coordinate: no overflow at 1e±15.
            let (x, y, z) = (p.x * inverse, p.y * inverse, p.z * inverse);
            let facing = n.x.mul_add(x, n.y.mul_add(y, n.z * z)).abs();
            let length = x.mul_add(x, y.mul_add(y, z * z)).sqrt();
            // For a splat at the eye itself both are zero; its slope term is 0.
            let slope = per_pixel * (z * p.z) / facing.max(k(0.02) * length).max(k(1e-30));
            (p.z.max(k(projection.near)), slope)
        }
        ProjectionKind::Orthographic { height, .. } => (k(height), per_pixel / n.z.abs().max(k(0.02))),
    };
    limited(z, slope, radius_max, h_px, setting)
}

/// Returns the same as [`tolerance`], from a splat's projection. In perspective, the centre must be at or beyond
/// z_near.
#[inline(always)]
pub fn projected_tolerance<R: Real>(
    p_z: R,
    projected: &Projected<R>,
    radius_max: R,
    h_px: R,
    setting: Tolerance,
    projection: &Projection,
) -> R {
    let k = |value: f64| p_z.constant(value);
    // The gradient is a quotient by |n·p|, which is replaced by 0.02·|p| if smaller.
    let slope = projected.depth_gradient.length() * (projected.facing_cosine * k(50.0)).min(k(1.0));
    let (z, slope) = match projection.kind {
        ProjectionKind::Perspective => (p_z, slope * p_z),
        ProjectionKind::Orthographic { height, .. } => (k(height), slope),
    };
    limited(z, slope, radius_max, h_px, setting)
}

/// Returns a splat's depth tolerance ε in world units. `z` is the depth that the caps of ε are fractions of, and
/// `slope` the change of depth per pixel, in world units.
#[inline(always)]
fn limited<R: Real>(z: R, slope: R, radius_max: R, h_px: R, setting: Tolerance) -> R {
    let k = |value: f64| z.constant(value);
    let slope = (h_px + k(SLOPE_MARGIN_PX)) * slope;
    match setting {
        Tolerance::Relative(factor) => (k(0.2) * z).min((k(factor) * radius_max).min(k(0.1) * z) + slope),
        Tolerance::Absolute(distance) => k(distance) + slope,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_plane_gradient_is_the_planes_own() {
        let perspective = Projection {
            kind: ProjectionKind::Perspective,
            focal_px: [300.0, 250.0],
            principal_px: [128.0, 120.0],
            near: 0.1,
        };
        let orthographic = Projection {
            kind: ProjectionKind::Orthographic { height: 4.0, far: 9.0 },
            focal_px: [64.0; 2],
            ..perspective
        };
        for projection in [perspective, orthographic] {
            let (p, n) = (V3::new(0.4, -0.3, 2.5), V3::new(0.48, -0.36, -0.8));
            let at = projection.pixel(p);
            let depth = |dx: f64, dy: f64| {
                let (o, d) = projection.ray(V2::new(at.x + dx, at.y + dy));
                n.dot(p - o) / n.dot(d)
            };
            let h = 1e-4;
            let want = [(depth(h, 0.0) - depth(-h, 0.0)) / (2.0 * h), (depth(0.0, h) - depth(0.0, -h)) / (2.0 * h)];
            let got = plane_gradient(p, n, &projection);
            assert!((got.x - want[0]).abs() < 1e-7 && (got.y - want[1]).abs() < 1e-7, "{got:?} {want:?}");
            // The plane's other side is the same plane; a plane seen edge-on is no steeper than the limit.
            assert_eq!(plane_gradient(p, -n, &projection), got);
            let grazing = plane_gradient(p, V3::new(p.z, 0.0, -p.x) * (1.0 / p.length()), &projection);
            assert!(grazing.x.is_finite() && grazing.x.abs() < 2.5, "{grazing:?}");
        }
    }
}
