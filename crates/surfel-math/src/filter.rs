//! Screen-space filters (rendering model §4), which change a splat's footprint and weight so that the splat covers a
//! pixel.

use crate::basis;
use crate::clip::Turn;
use crate::mapping::{Footprint, Linear};
use crate::project::{Projected, ViewSplat};
use crate::svd::Svd2;
use crate::{Real, V2, V3};

/// A splat's footprint and weight after a screen-space filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filtered<R> {
    /// Footprint with the half-axes lengthened by the filter.
    pub footprint: Footprint<R>,
    /// Factor of the kernel's weight: the ratio of the splat's area to the filtered area if the filter scales weights,
    /// else 1.
    pub weight_scale: R,
    /// Factor of the coverage (rendering model §5): the ratio of the splat's area to the filtered area if the weight
    /// doesn't include it, else 1.
    pub coverage_scale: R,
    /// Map from the filtered footprint's (u, v) to the splat's own (u, v). Only clips need it (rendering model §7).
    pub turn: Turn<R>,
}

impl<R: Real> Filtered<R> {
    /// Returns a footprint unchanged, with factors of 1.
    #[inline(always)]
    pub fn unfiltered(footprint: Footprint<R>) -> Self {
        let one = footprint.w.c.one();
        Self { footprint, weight_scale: one, coverage_scale: one, turn: Turn::none(one) }
    }
}

/// Applies `principal`, Surfel's own filter: lengthens the projected ellipse's principal half-axes to at least h
/// pixels. The weight is multiplied by ∏ min(1, ℓ/h), where ℓ are the unfiltered lengths of the half-axes in pixels. If
/// `projective` is false, the footprint is affine: its form W is 1 everywhere.
///
/// Source: rendering model §4; the elliptic-splat filter that G06 §8 leaves as future work. A half-axis of at least h
/// stays exact, also in perspective; a lengthened one becomes parallel to the screen (G06 eq. 9).
#[inline(always)]
pub fn principal<R: Real>(projected: &Projected<R>, h_px: R, projective: bool) -> Filtered<R> {
    principal_or_unturned(projected, h_px, projective, true)
}

/// Applies the filter as [`principal`] does, but computes the result's `turn` only if `turned`; otherwise `turn` is the
/// identity. Only clips need it.
#[inline(always)]
pub fn principal_or_unturned<R: Real>(
    projected: &Projected<R>,
    h_px: R,
    projective: bool,
    turned: bool,
) -> Filtered<R> {
    let one = h_px.one();
    let svd = Svd2::of_columns(projected.j_s, projected.j_t, projected.det_j);
    let (major, minor) = (svd.major_axis, svd.minor_axis());
    let (is_short, is_thin) = (svd.major.lt(h_px), svd.minor.lt(h_px));
    let (per_long, per_short) = (one / svd.major.max(h_px), one / svd.minor.max(h_px));
    let (u, v) = (major * per_long, minor * per_short);
    let zero = h_px.zero();
    let gradient = if projective {
        // Component of the depth gradient along each axis that keeps its length: −a'_i/ℓ_i = g·axis.
        let g = projected.depth_gradient;
        let along = R::select(is_short, zero, g.dot(major));
        let across = R::select(is_thin, zero, g.dot(minor));
        -(major * along + minor * across)
    } else {
        V2::new(zero, zero)
    };
    Filtered {
        footprint: Footprint { u: Linear::new(zero, u), v: Linear::new(zero, v), w: Linear::new(one, gradient) },
        // The scale is exactly 1 if both axes keep their length.
        weight_scale: R::select(is_short, svd.major * per_long, one) * R::select(is_thin, svd.minor * per_short, one),
        coverage_scale: one,
        turn: if turned { principal_turn(projected, &svd) } else { Turn::none(one) },
    }
}

/// Applies `ewa` (Z01 eq. 6–9): the affine projection convolved with a Gaussian of standard deviation h/√(2c).
///
/// In the terms of rendering model §4, ρ² = β/c = dᵀ(JJᵀ + h²I)⁻¹d at the pixel offset d, for any cutoff c. It is
/// evaluated along the ellipse's axes, of half-length √(ℓ² + h²), so that no covariance matrix is inverted. The
/// weight's factor is √(det JJᵀ/det(JJᵀ + h²I)) = ∏ ℓ/√(ℓ² + h²).
#[inline(always)]
pub fn ewa<R: Real>(projected: &Projected<R>, h_px: R) -> Filtered<R> {
    let (zero, one) = (h_px.zero(), h_px.one());
    let svd = Svd2::of_columns(projected.j_s, projected.j_t, projected.det_j);
    let (long, short) = (widened(svd.major, h_px), widened(svd.minor, h_px));
    let u = svd.major_axis * (one / long);
    let v = svd.minor_axis() * (one / short);
    let flat = Linear::new(one, V2::new(zero, zero));
    Filtered {
        footprint: Footprint { u: Linear::new(zero, u), v: Linear::new(zero, v), w: flat },
        weight_scale: (svd.major / long) * (svd.minor / short),
        coverage_scale: one,
        turn: principal_turn(projected, &svd),
    }
}

/// Returns √(length² + h²), the half-length in pixels of an axis that `ewa` has widened.
#[inline(always)]
fn widened<R: Real>(length: R, h_px: R) -> R {
    length.mul_add(length, h_px * h_px).sqrt()
}

/// True where both principal half-axes of the projected ellipse certainly measure at least h pixels, so that
/// `principal` changes nothing. Near the limit it may be false although both measure h. The test doesn't compute the
/// half-axes: the smaller is |det J| over the larger, and the larger is at most ‖J‖.
#[inline(always)]
pub fn is_unaffected_by_principal<R: Real>(projected: &Projected<R>, h_px: R) -> R::Mask {
    let (s, t) = (projected.j_s, projected.j_t);
    let norm = (s.dot(s) + t.dot(t)).sqrt();
    (h_px * norm).le(projected.det_j.abs())
}

/// Returns V of J = U·diag(ℓ)·Vᵀ: the map from coordinates along the ellipse's axes on the screen to the splat's (u,
/// v).
#[inline(always)]
fn principal_turn<R: Real>(projected: &Projected<R>, svd: &Svd2<R>) -> Turn<R> {
    let (zero, one) = (projected.det_j.zero(), projected.det_j.one());
    let axis = svd.major_axis;
    // Jᵀ·u₁ = ℓ₁·v₁. The second column is the quarter turn with det J's sign, which avoids dividing by the smaller
    // value.
    let along = V2::new(projected.j_s.dot(axis), projected.j_t.dot(axis));
    let length = along.length();
    let first = along * (one / R::select(zero.lt(length), length, one));
    let handedness = R::select(projected.det_j.lt(zero), -one, one);
    Turn { first, second: V2::new(-first.y, first.x) * handedness }
}

/// Returns ∏ ℓ/max(ℓ, h), over the half-lengths ℓ of the projected ellipse's two axes in pixels. It is the area ratio
/// by which the filters `clamp` and `adjust` scale the coverage instead of the weight (rendering model §5).
#[inline(always)]
pub fn area_ratio<R: Real>(projected: &Projected<R>, h_px: R) -> R {
    let svd = Svd2::of_columns(projected.j_s, projected.j_t, projected.det_j);
    (svd.major / svd.major.max(h_px)) * (svd.minor / svd.minor.max(h_px))
}

/// Applies `adjust` (G06 §4.1, eq. 8–9) to the half-axes chosen by [`adjust_axes`]. Each half-axis is lengthened
/// separately if its projected diameter is shorter than 2h. The result's `turn` is the identity, relative to these
/// half-axes.
///
/// Eq. 8 divides by p_z² − t_z², which is zero or negative for a disk that reaches the eye plane. Here both sides of
/// the comparison are multiplied by it, factored as (1 − a)(1 + a).
#[inline(always)]
pub fn adjust<R: Real>(projected: &Projected<R>, h_px: R, projective: bool) -> Filtered<R> {
    let (zero, one) = (h_px.zero(), h_px.one());
    let (s, t) = (projected.j_s, projected.j_t);
    let (new_s, new_t) = (lengthened(s, t, projected.slope.x, h_px), lengthened(t, s, projected.slope.y, h_px));
    let unchanged = !(new_s.was_short | new_t.was_short);
    let determinant = R::select(unchanged, projected.det_j, new_s.j.cross(new_t.j));
    let slope = if projective { V2::new(new_s.slope, new_t.slope) } else { V2::new(zero, zero) };
    Filtered {
        footprint: Footprint::about_center(new_s.j, new_t.j, determinant, slope),
        weight_scale: one,
        coverage_scale: area_ratio(projected, h_px),
        turn: Turn::none(one),
    }
}

/// A projected half-axis after the filter `adjust` (G06 eq. 8–9).
struct Lengthened<R: Real> {
    /// The half-axis in the image, in pixels.
    j: V2<R>,
    /// Change of depth along the half-axis, relative to p_z. 0 if the half-axis was lengthened, which makes it parallel
    /// to the screen.
    slope: R,
    /// Mask of the lanes in which the half-axis was lengthened.
    was_short: R::Mask,
}

/// Lengthens one projected half-axis to `h_px` pixels if it is shorter by the measure of G06 eq. 8. `j` is the
/// half-axis and `other` the second one, both in pixels; `a` is the change of depth along `j`, relative to p_z.
#[inline(always)]
fn lengthened<R: Real>(j: V2<R>, other: V2<R>, a: R, h_px: R) -> Lengthened<R> {
    let (zero, one) = (h_px.zero(), h_px.one());
    let length = j.length();
    let limit = h_px * ((one - a) * (one + a));
    let short = length.lt(limit);
    // Along j, or if j is zero, perpendicular to the other axis.
    let none = length.le(zero);
    let direction = V2::select(none, V2::new(-other.y, other.x), j);
    let norm = direction.length();
    let unit = direction * (one / R::select(zero.lt(norm), norm, one));
    Lengthened { j: V2::select(short, unit * h_px, j), slope: R::select(short, zero, a), was_short: short }
}

/// Returns the half-axes that `adjust` lengthens (rendering model §4). For an ellipse, they are the principal
/// half-axes. For a disk (half-axes equal within 1e-3), they are the half-axes of G06 eq. 10: s along p × n and t along
/// n × s. In an orthographic projection, p is the view direction.
///
/// Eq. 10 specifies neither the scale nor the case p ∥ n, in which the principal half-axes are returned. For a nearly
/// round ellipse (within 1e-3), the principal half-axes s, t are turned by the angle that is exact for a circle,
/// atan2(d·t, d·s) with d = p × n.
pub fn adjust_axes(splat: &ViewSplat<f64>, perspective: bool) -> (V3<f64>, V3<f64>) {
    let (s, t, _) = adjust_axes_turned(splat, perspective);
    (s, t)
}

/// Returns the half-axes of [`adjust_axes`], and the map from coordinates (u, v) along them to those along the splat's
/// own half-axes, in which clips are given.
pub fn adjust_axes_turned(splat: &ViewSplat<f64>, perspective: bool) -> (V3<f64>, V3<f64>, Turn<f64>) {
    let (s, t) = (splat.s, splat.t);
    // Right singular vectors of [s t]: the angle that makes the turned pair orthogonal.
    let scale = basis::largest_singular_value(glam::DVec3::new(s.x, s.y, s.z), glam::DVec3::new(t.x, t.y, t.z));
    let (s1, t1) = (s * (1.0 / scale), t * (1.0 / scale));
    let (a, b, c) = (s1.dot(s1), s1.dot(t1), t1.dot(t1));
    let by = |angle: f64| {
        let (sin, cos) = angle.sin_cos();
        Turn { first: V2::new(cos, sin), second: V2::new(-sin, cos) }
    };
    let turned =
        |s: V3<f64>, t: V3<f64>, by: &Turn<f64>| (s * by.first.x + t * by.first.y, s * by.second.x + t * by.second.y);
    let principal = by(0.5 * (2.0 * b).atan2(a - c));
    let (major, minor) = turned(s, t, &principal);
    if scale - minor.length() > 1e-3 * scale {
        return (major, minor, principal);
    }
    let p = if perspective { splat.p } else { V3::new(0.0, 0.0, 1.0) };
    let along = p.cross(splat.n);
    // Turns the pair so that s is along p × n: (s·along, t·along) is that direction in (u, v).
    let (u, v) = (along.dot(major), along.dot(minor));
    if along.length() <= 1e-12 * p.length() || (u == 0.0 && v == 0.0) {
        return (major, minor, principal);
    }
    let to_view = by(v.atan2(u));
    let (first, second) = turned(major, minor, &to_view);
    (first, second, principal.after(&to_view))
}
