//! Footprints as linear forms over pixels: the exact (projective) and the affine mapping (rendering model §3).

use crate::project::{Projected, ViewSplat};
use crate::projection::{Projection, ProjectionKind};
use crate::{Real, V2, V3};

/// A linear form c + x·d_x + y·d_y over pixel offsets d from an anchor, such as a splat's projected centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear<R> {
    /// Value of the form at the anchor, where the offset is 0.
    pub c: R,
    /// Change of the form per pixel to the right.
    pub x: R,
    /// Change of the form per pixel down.
    pub y: R,
}

impl<R: Real> Linear<R> {
    /// Creates a form from its value at the anchor and its gradient, the change per pixel to the right and down.
    #[inline(always)]
    pub fn new(c: R, gradient: V2<R>) -> Self {
        Self { c, x: gradient.x, y: gradient.y }
    }

    /// Returns the value of the form at pixel offset `d`.
    #[inline(always)]
    pub fn at(&self, d: V2<R>) -> R {
        self.x.mul_add(d.x, self.y.mul_add(d.y, self.c))
    }
}

/// A splat's plane over pixels: at offset d from the anchor, (u·w, v·w, w) = (U(d), V(d), W(d)). (u, v) is the position
/// on the splat's unit disk.
///
/// Source: rendering model §3 after G06 §3.
///
/// Inside ⇔ W > 0 and U² + V² ≤ W² (no division). W ≡ 1 for an affine footprint. The forms are scaled so that W = 1 at
/// the anchor of an ordinary splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint<R> {
    /// Linear form of u·w, with (u, v) the position on the splat's unit disk and w the homogeneous coordinate.
    pub u: Linear<R>,
    /// Linear form of v·w, with (u, v) the position on the splat's unit disk and w the homogeneous coordinate.
    pub v: Linear<R>,
    /// Linear form of the homogeneous coordinate w: 1/z up to a factor, or constantly 1 for an affine footprint.
    pub w: Linear<R>,
}

impl<R: Real> Footprint<R> {
    /// Returns the forms' values (u·w, v·w, w) at pixel offset `d`.
    #[inline(always)]
    pub fn at(&self, d: V2<R>) -> (R, R, R) {
        (self.u.at(d), self.v.at(d), self.w.at(d))
    }

    /// True where the pixel at offset `d` is inside the splat's unit disk.
    #[inline(always)]
    pub fn contains(&self, d: V2<R>) -> R::Mask {
        let (u, v, w) = self.at(d);
        w.zero().lt(w) & u.mul_add(u, v * v).le(w * w)
    }

    /// Creates the footprint of half-axes with affine projections `j_s` and `j_t` (pixels), relative to the projected
    /// centre. `det_j` is the determinant of (`j_s` `j_t`). `slope` is (s_z/p_z, t_z/p_z), or zero for an affine
    /// footprint.
    #[inline(always)]
    pub fn about_center(j_s: V2<R>, j_t: V2<R>, det_j: R, slope: V2<R>) -> Self {
        let (zero, one) = (det_j.zero(), det_j.one());
        let inverse = one / det_j;
        let u = V2::new(j_t.y * inverse, -(j_t.x * inverse));
        let v = V2::new(-(j_s.y * inverse), j_s.x * inverse);
        let w = -(u * slope.x + v * slope.y);
        Self { u: Linear::new(zero, u), v: Linear::new(zero, v), w: Linear::new(one, w) }
    }

    /// Creates the unfiltered footprint: projective, or affine (W ≡ 1). `projective` must be false in an orthographic
    /// projection.
    #[inline(always)]
    pub fn unfiltered(projected: &Projected<R>, projective: bool) -> Self {
        let zero = projected.det_j.zero();
        let mut footprint = Self::about_center(projected.j_s, projected.j_t, projected.det_j, V2::new(zero, zero));
        if projective {
            // The plane's own gradient, from the normal, is more precise near edge-on than a combination of U and V.
            footprint.w = Linear::new(zero.one(), -projected.depth_gradient);
        }
        footprint
    }
}

/// The exact mapping of a splat whose centre may be behind the eye: its footprint, and its plane's depth z =
/// `depth_scale`/W.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThroughNear {
    /// Footprint whose linear forms are relative to `anchor_px`, not to the splat's projected centre.
    pub footprint: Footprint<f64>,
    /// Pixel position from which the forms' offsets count: the optical axis, since the splat's centre may have no
    /// projection.
    pub anchor_px: V2<f64>,
    /// Numerator of the depth: z = depth_scale/W where the footprint's form W > 0.
    pub depth_scale: f64,
}

/// Computes the exact mapping of a splat anywhere, even on the eye's own plane (G06 §3: adj(M) without division by
/// det(M), times its sign). Perspective only. Few splats need it, so it is in f64 for every backend.
pub fn through_near(splat: &ViewSplat<f64>, projection: &Projection) -> ThroughNear {
    assert!(projection.kind == ProjectionKind::Perspective);
    let ViewSplat { p, s, t, .. } = *splat;
    // A power of two keeps every product within range and changes no bit of the quotients.
    let largest = [p, s, t].iter().flat_map(|v| [v.x, v.y, v.z]).fold(0.0f64, |a, b| a.max(b.abs()));
    let k = if largest > 0.0 && largest.is_finite() { (-largest.log2().floor()).exp2() } else { 1.0 };
    let (p, s, t) = (p * k, s * k, t * k);
    let rows = [t.cross(p), p.cross(s), s.cross(t)];
    let determinant = rows[2].dot(p);
    let sign = if determinant < 0.0 { -1.0 } else { 1.0 };
    let form = |row: V3<f64>| {
        let gradient = V2::new(row.x / projection.focal_px[0], row.y / projection.focal_px[1]);
        Linear::new(row.z * sign, gradient * sign)
    };
    ThroughNear {
        footprint: Footprint { u: form(rows[0]), v: form(rows[1]), w: form(rows[2]) },
        anchor_px: V2::new(projection.principal_px[0], projection.principal_px[1]),
        depth_scale: determinant.abs() / k,
    }
}
