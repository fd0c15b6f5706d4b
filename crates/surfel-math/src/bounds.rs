//! Bounding boxes of the pixels that a footprint can touch (rendering model §3): conservative and tight.

use crate::mapping::Footprint;
use crate::project::{Projected, ViewSplat};
use crate::projection::Projection;
use crate::{Real, V2};

/// A box of pixel offsets from an anchor, such as a splat's projected centre or the image's upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent<R> {
    /// Smallest offset along x and y, in pixels.
    pub min: V2<R>,
    /// Largest offset along x and y, in pixels.
    pub max: V2<R>,
}

impl<R: Real> Extent<R> {
    /// Returns the smallest box that contains both boxes.
    #[inline(always)]
    pub fn union(self, o: Self) -> Self {
        Self {
            min: V2::new(self.min.x.min(o.min.x), self.min.y.min(o.min.y)),
            max: V2::new(self.max.x.max(o.max.x), self.max.y.max(o.max.y)),
        }
    }

    /// Returns the box of offsets between −`half` and `half`, in pixels.
    #[inline(always)]
    pub fn symmetric(half: V2<R>) -> Self {
        Self { min: -half, max: half }
    }

    /// Returns the box grown by `by` pixels on every side.
    #[inline(always)]
    pub fn grow(self, by: R) -> Self {
        let g = V2::new(by, by);
        Self { min: self.min - g, max: self.max + g }
    }
}

/// Returns the box of a projective ellipse: of the offsets J·(u, v)/(1 + a·(u, v)) over the unit disk, |a| ≤ ½.
/// J has the columns `j_s` and `j_t`, in pixels, and a is `slope`.
///
/// Source: the dual conic (Sigg 2006), relative to the projected centre. With j a row of J, its extremes k solve k²(1 −
/// |a|²) + 2k·(j·a) − |j|² = 0. In absolute pixel coordinates the terms of the same conic cancel, with an error of up
/// to 1.8 px in f32 at 4K. Relative to the centre, the root is at least 0.86·|j| and |j·a| at most half of |j|, so the
/// nearer extreme loses at most two bits.
#[inline(always)]
pub fn ellipse<R: Real>(j_s: V2<R>, j_t: V2<R>, slope: V2<R>) -> Extent<R> {
    let one = slope.x.one();
    let d = one - slope.dot(slope);
    let inverse = one / d;
    let (x0, x1) = extremes(V2::new(j_s.x, j_t.x), slope, d, inverse);
    let (y0, y1) = extremes(V2::new(j_s.y, j_t.y), slope, d, inverse);
    Extent { min: V2::new(x0, y0), max: V2::new(x1, y1) }
}

/// Returns the minimum and maximum of one coordinate over the ellipse of [`ellipse`]. `j` is the coordinate's row of J,
/// `slope` is a, `d` = 1 − |a|², and `inverse` = 1/d. A function, since a closure isn't inlined into SIMD code.
#[inline(always)]
fn extremes<R: Real>(j: V2<R>, slope: V2<R>, d: R, inverse: R) -> (R, R) {
    let b = j.dot(slope);
    let root = R::sum_of_products(b, b, j.dot(j), d).sqrt();
    (-((root + b) * inverse), (root - b) * inverse)
}

/// Returns the bounding box of an unfiltered splat's footprint, as offsets from its projected centre. If `projective`,
/// the disk must be well in front of the eye (depth extent e ≤ p_z/2).
#[inline(always)]
pub fn unfiltered<R: Real>(projected: &Projected<R>, projective: bool) -> Extent<R> {
    let zero = projected.det_j.zero();
    let slope = if projective { projected.slope } else { V2::new(zero, zero) };
    ellipse(projected.j_s, projected.j_t, slope)
}

/// Returns the bounding box of a footprint from its linear forms alone, as offsets from its centre. The constant terms
/// of the forms must be 0, 0 and 1.
///
/// The footprint's own half-axes are the columns of the inverse of its (U, V) gradients.
#[inline(always)]
pub fn footprint<R: Real>(f: &Footprint<R>) -> Extent<R> {
    let one = f.w.c.one();
    let (u, v) = (V2::new(f.u.x, f.u.y), V2::new(f.v.x, f.v.y));
    let inverse = one / u.cross(v);
    let j_s = V2::new(v.y * inverse, -(v.x * inverse));
    let j_t = V2::new(-(u.y * inverse), u.x * inverse);
    // W = 1 − a·(U, V), solved for a.
    let g = V2::new(f.w.x, f.w.y);
    // Computed from products of the forms rather than −g·j: near edge-on, g is steep across j_s, whose rounding would
    // be magnified a hundredfold.
    ellipse(j_s, j_t, V2::new(-(g.cross(v) * inverse), g.cross(u) * inverse))
}

/// Largest ratio of a disk's size to its distance for which [`through_near`] computes a finite box. Larger disks get an
/// infinite box.
const BOUNDLESS: f64 = 1e5;

/// Returns the box, in pixel coordinates, of the part of a disk at or beyond z_near, in a perspective projection. The
/// disk's centre may be anywhere. `None` if no part of the disk is at or beyond z_near. The box is exact: over that
/// part, a projected coordinate is quasi-linear. Its extremes are therefore at tangent points, or at the ends of the
/// chord that z_near cuts.
///
/// The box of a disk larger than 10⁵ times its distance is infinite. Tangents are found from differences, whose sign
/// may be lost to rounding if the disk's axes are along the image's axes. This happens from 10⁸ times the distance on.
pub fn through_near(splat: &ViewSplat<f64>, projection: &Projection) -> Option<Extent<f64>> {
    let ViewSplat { p, s, t, .. } = *splat;
    let near = projection.near;
    let slope = V2::new(s.z, t.z);
    let e = slope.length();
    if p.z + e < near {
        return None;
    }
    if s.max_abs().max(t.max_abs()) > BOUNDLESS * p.max_abs().max(near) {
        let infinite = V2::new(f64::INFINITY, f64::INFINITY);
        return Some(Extent { min: -infinite, max: infinite });
    }
    let mut extent: Option<Extent<f64>> = None;
    let mut add = |u: f64, v: f64| {
        // A chord end is at z_near exactly; rounding must not move it behind the eye.
        let z = (p.z + u * s.z + v * t.z).max(near);
        let x = projection.focal_px[0] * (p.x + u * s.x + v * t.x) / z + projection.principal_px[0];
        let y = projection.focal_px[1] * (p.y + u * s.y + v * t.y) / z + projection.principal_px[1];
        let point = Extent { min: V2::new(x, y), max: V2::new(x, y) };
        extent = Some(extent.map_or(point, |b| b.union(point)));
    };
    if p.z - e < near && e > 0.0 {
        let (m, distance) = (slope * (1.0 / e), ((near - p.z) / e).clamp(-1.0, 1.0));
        let half = (1.0 - distance * distance).sqrt();
        add(m.x * distance - m.y * half, m.y * distance + m.x * half);
        add(m.x * distance + m.y * half, m.y * distance - m.x * half);
    }
    // Tangents in x and y: k²(p_z² − e²) − 2k(a0·p_z − a·m) + a0² − |a|² = 0, for lines through the eye that touch the
    // rim.
    for (a, a0) in [(V2::new(s.x, t.x), p.x), (V2::new(s.y, t.y), p.y)] {
        let (qa, qb, qc) = (p.z * p.z - e * e, a0 * p.z - a.dot(slope), a0 * a0 - a.dot(a));
        let discriminant = qb * qb - qa * qc;
        if discriminant < 0.0 {
            continue;
        }
        let q = qb + discriminant.sqrt().copysign(qb);
        for k in [q / qa, qc / q] {
            let direction = a - slope * k;
            let length = direction.length();
            if !k.is_finite() || length <= 0.0 {
                continue;
            }
            let unit = direction * ((k * p.z - a0).signum() / length);
            if p.z + unit.dot(slope) >= near {
                add(unit.x, unit.y);
            }
        }
    }
    extent
}
