//! First-order projection of a splat, the basis of filters, bounds and depth (rendering model §3, §4).

use crate::projection::ProjectionKind;
use crate::{Real, V2, V3, projection::Projection};

/// Largest sine of the angle between a splat's plane and the view ray, |n·p|/|p|, at which the splat is edge-on and
/// isn't drawn (rendering model §2).
pub const EDGE_ON: f64 = 1e-5;

/// A splat in view space (x right, y down, z forward, eye at the origin), in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewSplat<R> {
    /// Position of the splat's centre.
    pub p: V3<R>,
    /// First half-axis, from the centre to the rim.
    pub s: V3<R>,
    /// Second half-axis, from the centre to the rim.
    pub t: V3<R>,
    /// Unit outward normal, along s × t or its opposite; an object's matrix that mirrors reverses the sign.
    pub n: V3<R>,
}

/// The first-order projection of a [`ViewSplat`], the same for every filter.
///
/// With a = (s_z, t_z)/p_z (orthographic: 0), the exact mapping is linear relative to the projected centre: (u·w',
/// v·w') = J⁻¹·d and w' = p_z/z = 1 − a·J⁻¹·d, where d is the pixel offset. This is G06 §3's adj(M)/det(M) times p_z:
/// its constant terms are exactly 0, 0, 1, and no term is a difference of screen coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected<R> {
    /// Affine projection of the half-axis s at the centre, in pixels: the first column of J (rendering model §4).
    pub j_s: V2<R>,
    /// Affine projection of the half-axis t at the centre, in pixels: the second column of J (rendering model §4).
    pub j_t: V2<R>,
    /// Determinant of J = (`j_s` `j_t`), in square pixels. It is computed from the normal, which is more precise than
    /// J's columns for a splat near edge-on.
    pub det_j: R,
    /// Change of depth along the half-axes relative to the centre's depth, (s_z/p_z, t_z/p_z); zero in an orthographic
    /// projection.
    pub slope: V2<R>,
    /// Gradient of the plane's depth over pixels: perspective p_z/z = 1 − g·d (dimensionless, per pixel), orthographic
    /// z = p_z + g·d (world units per pixel).
    pub depth_gradient: V2<R>,
    /// Half the disk's depth range, √(s_z² + t_z²), in world units.
    pub depth_extent: R,
    /// n·p (orthographic: n_z): negative if the splat's outward side faces the eye. Only the sign is meaningful; see
    /// `facing_cosine`.
    pub facing: R,
    /// |n·p|/|p| (orthographic: |n_z|), the absolute cosine of the angle between normal and view ray; 0 is edge-on.
    pub facing_cosine: R,
}

impl<R: Real> Projected<R> {
    /// Projects a splat. Perspective needs p_z > 0; splats nearer than z_near use [`crate::mapping::through_near`].
    #[inline(always)]
    pub fn new(splat: &ViewSplat<R>, projection: &Projection) -> Self {
        Self::with_area(splat, Area::of(splat), projection)
    }

    /// Projects a splat like [`Projected::new`], with an area vector ([`Area`]) that the caller has computed more
    /// cheaply.
    #[inline(always)]
    pub fn with_area(splat: &ViewSplat<R>, area: Area<R>, projection: &Projection) -> Self {
        let ViewSplat { p, s, t, n } = *splat;
        let one = p.x.one();
        let zero = p.x.zero();
        let focal = V2::new(p.x.constant(projection.focal_px[0]), p.x.constant(projection.focal_px[1]));
        let per_focal = V2::new(p.x.constant(1.0 / projection.focal_px[0]), p.x.constant(1.0 / projection.focal_px[1]));
        let Area { sine, k_s, k_t } = area;
        let depth_extent = s.z.mul_add(s.z, t.z * t.z).sqrt();
        match projection.kind {
            ProjectionKind::Perspective => {
                let inverse = one / p.z;
                let center = V2::new(p.x * inverse, p.y * inverse);
                let facing = n.dot(V3::new(center.x, center.y, one));
                let length = center.x.mul_add(center.x, center.y.mul_add(center.y, one)).sqrt();
                let per_pixel = one / facing;
                Self {
                    j_s: column(s * inverse, center).scale_by(focal),
                    j_t: column(t * inverse, center).scale_by(focal),
                    det_j: sine * facing * (k_s * inverse * focal.x) * (k_t * inverse * focal.y),
                    slope: V2::new(s.z * inverse, t.z * inverse),
                    depth_gradient: n.xy().scale_by(per_focal) * -per_pixel,
                    depth_extent,
                    facing,
                    facing_cosine: facing.abs() / length,
                }
            }
            ProjectionKind::Orthographic { .. } => {
                let per_pixel = one / n.z;
                Self {
                    j_s: s.xy().scale_by(focal),
                    j_t: t.xy().scale_by(focal),
                    det_j: sine * n.z * (k_s * focal.x) * (k_t * focal.y),
                    slope: V2::new(zero, zero),
                    depth_gradient: n.xy().scale_by(per_focal) * -per_pixel,
                    depth_extent,
                    facing: n.z,
                    facing_cosine: n.z.abs(),
                }
            }
        }
    }

    /// True if the splat is edge-on and drawn in no pass (rendering model §2).
    #[inline(always)]
    pub fn is_edge_on(&self) -> R::Mask {
        self.facing_cosine.le(self.facing_cosine.constant(EDGE_ON))
    }
}

/// Returns the projection of a half-axis at the centre without the focal length, (a_xy·p_z − a_z·p_xy)/p_z², from a/p_z
/// and p_xy/p_z.
#[inline(always)]
fn column<R: Real>(a: V3<R>, center: V2<R>) -> V2<R> {
    V2::new((-a.z).mul_add(center.x, a.x), (-a.z).mul_add(center.y, a.y))
}

/// The area vector s × t = sine·k_s·k_t·n of a splat, stored in factors, so that nothing overflows or vanishes for
/// sizes of 1e±15.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area<R> {
    /// Signed length of the cross product of s/k_s and t/k_t, positive along n.
    pub sine: R,
    /// Scale of the half-axis s: its largest absolute coordinate, or the radius of a disk.
    pub k_s: R,
    /// Scale of the half-axis t: its largest absolute coordinate, or the radius of a disk.
    pub k_t: R,
}

impl<R: Real> Area<R> {
    /// Computes the area vector s × t of any splat, in factors.
    #[inline(always)]
    pub fn of(splat: &ViewSplat<R>) -> Self {
        let ViewSplat { s, t, n, .. } = *splat;
        let (one, zero) = (s.x.one(), s.x.zero());
        let (k_s, k_t) = (s.max_abs(), t.max_abs());
        let cross = (s * (one / k_s)).cross(t * (one / k_t));
        let length = cross.length();
        Self { sine: R::select(zero.le(cross.dot(n)), length, -length), k_s, k_t }
    }

    /// Returns the area vector, in factors, of a disk with this radius whose s × t is along n.
    #[inline(always)]
    pub fn of_disk(radius: R) -> Self {
        Self { sine: radius.one(), k_s: radius, k_t: radius }
    }
}

/// Returns a splat's larger semi-axis r_max (rendering model §2): the larger singular value of [s t], at any scale.
#[inline(always)]
pub fn radius_max<R: Real>(s: V3<R>, t: V3<R>) -> R {
    let scale = s.max_abs().max(t.max_abs());
    let inverse = scale.scale_to_one();
    let (s, t) = (s * inverse, t * inverse);
    let half = s.x.constant(0.5);
    let (a, b, c) = (s.dot(s), s.dot(t), t.dot(t));
    let difference = (a - c) * half;
    let root = difference.mul_add(difference, b * b).sqrt();
    inverse.scale_to_one() * ((a + c).mul_add(half, root)).sqrt()
}

/// Ratio of a splat's size to its depth (orthographic: to the view's height) above which every backend sets up the
/// splat in f64. Products of its projected half-axes may exceed f32's range. A filter's effect is invisible at this
/// size.
const VAST: f64 = 1e7;

/// True for a splat so large that f32 may not represent its projection; `size` is the largest absolute coordinate of
/// its half-axes. The splat is drawn exactly, like [`Placement::Close`] ones.
#[inline(always)]
pub fn is_vast<R: Real>(size: R, p_z: R, projection: &Projection) -> R::Mask {
    let distance = match projection.kind {
        ProjectionKind::Perspective => p_z,
        ProjectionKind::Orthographic { height, .. } => size.constant(height),
    };
    (distance * size.constant(VAST)).lt(size)
}

/// Placement of a splat relative to the eye, which decides how the splat is drawn (rendering model §3, "Near splats").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// The centre is well in front of the eye: the splat is drawn with the filter and the mapping of the settings.
    Ordinary,
    /// The centre is at or beyond z_near, but in perspective the disk's depth extent is at least p_z/2. The splat is
    /// drawn by the exact mapping, without a filter.
    Close,
    /// The centre is nearer than z_near: the splat is drawn by the exact mapping, without a filter. With the setting of
    /// the affine mapping it is dropped.
    CenterBeforeNear,
    /// No part of the splat is at or beyond z_near, or all of it is beyond an orthographic far plane.
    Outside,
}

impl Placement {
    /// Classifies a splat by its centre's depth `p_z` and its disk's depth extent, both in world units.
    pub fn of(p_z: f64, depth_extent: f64, projection: &Projection) -> Self {
        if p_z + depth_extent < projection.near || p_z - depth_extent > projection.far() {
            Self::Outside
        } else if p_z < projection.near {
            Self::CenterBeforeNear
        } else if projection.is_perspective() && depth_extent >= 0.5 * p_z {
            Self::Close
        } else {
            Self::Ordinary
        }
    }
}
