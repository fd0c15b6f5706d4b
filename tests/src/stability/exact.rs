//! Splat in exact arithmetic.
//!
//! A finite f64 is an integer times a power of two, and the forms of splats are homogeneous. If all inputs are scaled
//! by a common power of two, the forms are integers, and only results are rounded.

use num_bigint::BigInt;
use num_rational::BigRational;
use num_traits::{Signed, ToPrimitive, Zero};
use surfel_math::project::ViewSplat;
use surfel_math::projection::Projection;

/// Returns the numbers multiplied by the smallest power of two that makes all of them integers, and that power.
fn whole<const N: usize>(values: [f64; N]) -> ([BigInt; N], BigInt) {
    let exact = values.map(|value| BigRational::from_float(value).expect("sweeps are of finite numbers"));
    // Denominators are powers of two in lowest terms, so the largest is a multiple of all others.
    let scale = exact.iter().map(BigRational::denom).max().cloned().unwrap_or_else(|| 1.into());
    (exact.map(|value| value.numer() * (&scale / value.denom())), scale)
}

/// Returns the quotient, rounded once; 0 if the divisor is 0. The divisor must not be negative.
fn quotient(dividend: BigInt, divisor: BigInt) -> f64 {
    if divisor.is_zero() {
        return 0.0;
    }
    // The fraction isn't reduced to lowest terms, which would take longer than everything else.
    BigRational::new_raw(dividend, divisor).to_f64().unwrap_or(f64::INFINITY)
}

/// Intersection of a ray with a splat's disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// ρ² = u² + v², at most 1.
    pub rho_squared: f64,
    /// Planar depth.
    pub z: f64,
}

/// Exact forms of a splat over pixels: adj([s t p]) and its determinant (G06 §3).
///
/// Lengths of the scene are multiplied by one power of two, lengths of the image by another.
pub struct Exact {
    rows: [[BigInt; 3]; 3],
    /// Determinant of [s t p], multiplied by both focal lengths.
    determinant: BigInt,
    /// Power of two by which lengths of the scene were multiplied to make them integers.
    scene_scale: BigInt,
    /// Depth of the near plane, in scaled lengths of the scene.
    near: BigInt,
    /// Focal lengths, in scaled lengths of the image.
    focal: [BigInt; 2],
    /// Position of the principal point, in scaled lengths of the image.
    principal: [BigInt; 2],
    /// Half the width of a pixel, in scaled lengths of the image.
    half_pixel: BigInt,
}

impl Exact {
    /// Computes the exact forms of a splat in a perspective projection.
    ///
    /// # Panics
    /// If a coordinate isn't finite.
    pub fn new(splat: &ViewSplat<f64>, projection: &Projection) -> Self {
        let ViewSplat { p, s, t, .. } = splat;
        let lengths = [p.x, p.y, p.z, s.x, s.y, s.z, t.x, t.y, t.z, projection.near];
        let ([px, py, pz, sx, sy, sz, tx, ty, tz, near], scene_scale) = whole(lengths);
        let (p, s, t) = ([px, py, pz], [sx, sy, sz], [tx, ty, tz]);
        let cross =
            |a: &[BigInt; 3], b: &[BigInt; 3]| [(1, 2), (2, 0), (0, 1)].map(|(i, j)| &a[i] * &b[j] - &a[j] * &b[i]);
        let mut rows = [cross(&t, &p), cross(&p, &s), cross(&s, &t)];
        let mut determinant = &rows[2][0] * &p[0] + &rows[2][1] * &p[1] + &rows[2][2] * &p[2];
        if determinant.is_negative() {
            determinant = -determinant;
            rows.iter_mut().flatten().for_each(|entry| *entry = -&*entry);
        }
        let ([fx, fy], [cx, cy]) = (projection.focal_px, projection.principal_px);
        let ([fx, fy, cx, cy, half_pixel], _) = whole([fx, fy, cx, cy, 0.5]);
        determinant = determinant * &fx * &fy;
        Self { rows, determinant, scene_scale, near, focal: [fx, fy], principal: [cx, cy], half_pixel }
    }

    /// Returns the homogeneous disk coordinates (U, V, W) of the ray through the centre of a pixel of the whole image:
    /// u = U/W and v = V/W, in half-axes. W > 0 in front of the eye.
    fn at(&self, pixel: [u32; 2]) -> [BigInt; 3] {
        let center = |axis: usize| (2 * u64::from(pixel[axis]) + 1) * &self.half_pixel - &self.principal[axis];
        let [fx, fy] = &self.focal;
        let ray = [center(0) * fy, center(1) * fx, fx * fy];
        self.rows.each_ref().map(|row| &row[0] * &ray[0] + &row[1] * &ray[1] + &row[2] * &ray[2])
    }

    /// Intersects the unfiltered, unclipped splat with the ray through the centre of a pixel of the whole image. `None`
    /// if the ray misses the splat.
    pub fn hit(&self, pixel: [u32; 2]) -> Option<Hit> {
        let [u, v, w] = self.at(pixel);
        let (square, limit) = (&u * &u + &v * &v, &w * &w);
        // Depth is determinant/W.
        if !w.is_positive() || square > limit || self.determinant < &w * &self.near {
            return None;
        }
        Some(Hit { rho_squared: quotient(square, limit), z: quotient(self.determinant.clone(), w * &self.scene_scale) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_math::V3;
    use surfel_math::projection::ProjectionKind;

    const PROJECTION: Projection =
        Projection { kind: ProjectionKind::Perspective, focal_px: [64.0, 32.0], principal_px: [8.5, 8.5], near: 0.5 };

    /// Returns a disk that faces the eye at depth 2, with axes 8 px long in the image, all lengths times `scale`.
    fn facing(scale: f64) -> ViewSplat<f64> {
        let v = |x: f64, y: f64, z: f64| V3::new(x * scale, y * scale, z * scale);
        ViewSplat { p: v(0.0, 0.0, 2.0), s: v(0.25, 0.0, 0.0), t: v(0.0, 0.5, 0.0), n: V3::new(0.0, 0.0, -1.0) }
    }

    #[test]
    fn quotients_are_those_of_f64_where_f64_is_exact_and_rounded_once_elsewhere() {
        let over = |a: f64, b: f64| {
            let ([a, b], _) = whole([a, b]);
            quotient(a, b)
        };
        assert_eq!(over(-3.375, 1.0), -3.375);
        assert_eq!(over(1.0, 3.0), 1.0 / 3.0);
        assert_eq!(over(5e-324, 5e-324), 1.0);
        assert_eq!(over(1e-300, 1e300), 0.0);
        assert_eq!(over(1.0, 0.0), 0.0);
        // 0.1 as f64 is a little more than a tenth, which f64's product rounds away.
        let ([tenth, ten, one], scale) = whole([0.1, 10.0, 1.0]);
        assert!(tenth * ten > one * scale && 0.1f64 * 10.0 == 1.0);
    }

    #[test]
    fn exact_hit_of_a_facing_disk() {
        // Integers of any size, and numbers far from integers.
        for scale in [1.0, 1e-12, 3e200] {
            let projection = Projection { near: 0.5 * scale, ..PROJECTION };
            let exact = Exact::new(&facing(scale), &projection);
            let z = 2.0 * scale;
            assert_eq!(exact.hit([8, 8]), Some(Hit { rho_squared: 0.0, z }));
            assert_eq!(exact.hit([12, 8]), Some(Hit { rho_squared: 0.25, z }));
            assert_eq!(exact.hit([8, 16]), Some(Hit { rho_squared: 1.0, z }));
            assert_eq!(exact.hit([9, 16]), None);
        }
        let behind_near = Projection { near: 2.5, ..PROJECTION };
        assert_eq!(Exact::new(&facing(1.0), &behind_near).hit([8, 8]), None);
    }
}
