//! Random splats whose coordinates are f32, and exact arithmetic on them.

use glam::DVec3;
use num_bigint::BigInt;
use num_rational::BigRational;
use num_traits::{Signed, ToPrimitive};
use surfel_math::project::ViewSplat;
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_math::{V2, V3};

pub(crate) type Q = BigRational;

/// Projection of a 3840×2160 image, f = 2000 px, with the principal point off the centre.
pub(crate) const UHD: Projection = Projection {
    kind: ProjectionKind::Perspective,
    focal_px: [2000.0, 2000.0],
    principal_px: [1920.25, 1080.5],
    near: 0.01,
};

pub(crate) fn q(value: f64) -> Q {
    Q::from_float(value).unwrap()
}

pub(crate) fn to_f64(value: &Q) -> f64 {
    value.to_f64().unwrap()
}

pub(crate) fn int(value: i64) -> Q {
    Q::from_integer(BigInt::from(value))
}

/// The pseudo-random generator SplitMix64.
pub(crate) struct Random(pub u64);

impl Random {
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 * (-53.0f64).exp2()
    }

    pub(crate) fn log_range(&mut self, low: f64, high: f64) -> f64 {
        self.range(low.ln(), high.ln()).exp()
    }
}

pub(crate) fn v3(v: DVec3) -> V3<f64> {
    V3::new(v.x, v.y, v.z)
}

pub(crate) fn dvec(v: V3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

fn round(v: DVec3) -> V3<f64> {
    V3::new(f64::from(v.x as f32), f64::from(v.y as f32), f64::from(v.z as f32))
}

/// Parameters of an ellipse with f32 coordinates. Its longer half-axis measures `radius_px` pixels if it faces the eye.
/// `elevation` is the angle between its plane and the view ray, in radians; `aspect` is the ratio of its half-axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spec {
    pub(crate) pixel: [f64; 2],
    pub(crate) z: f64,
    pub(crate) radius_px: f64,
    pub(crate) elevation: f64,
    pub(crate) aspect: f64,
    pub(crate) turn: [f64; 2],
}

impl Spec {
    /// Returns parameters of all sizes and tilts over the image; elevation at least `least_elevation` radians.
    pub(crate) fn random(random: &mut Random, least_elevation: f64) -> Self {
        Self {
            pixel: [random.range(0.0, 3840.0), random.range(0.0, 2160.0)],
            z: random.log_range(0.5, 20.0),
            radius_px: random.log_range(0.05, 900.0),
            elevation: random.log_range(least_elevation, 1.57),
            aspect: random.log_range(1.0, 10.0),
            turn: [random.range(0.0, 6.0), random.range(0.0, 6.0)],
        }
    }

    /// Creates the splat, with coordinates representable in f32. The normal is that of the rounded half-axes, in f64.
    pub(crate) fn splat(&self, projection: &Projection) -> ViewSplat<f64> {
        let x = (self.pixel[0] - projection.principal_px[0]) / projection.focal_px[0];
        let y = (self.pixel[1] - projection.principal_px[1]) / projection.focal_px[1];
        let p = DVec3::new(x, y, 1.0) * self.z;
        let along = p.normalize();
        let a = along.cross(DVec3::new(0.3, 0.5, -0.81)).normalize();
        let b = along.cross(a);
        let (sin, cos) = self.turn[0].sin_cos();
        let (a, b) = (a * cos + b * sin, b * cos - a * sin);
        let tilted = b * self.elevation.sin() + along * self.elevation.cos();
        let radius = self.radius_px * self.z / projection.focal_px[0];
        let (sin, cos) = self.turn[1].sin_cos();
        let (s, t) = ((a * cos + tilted * sin) * radius, (tilted * cos - a * sin) * (radius / self.aspect));
        let (p, s, t) = (round(p), round(s), round(t));
        let n = dvec(s.cross(t)).normalize();
        ViewSplat { p, s, t, n: v3(n) }
    }
}

/// Returns half of the disk's depth range, divided by the depth p_z of its centre.
pub(crate) fn reach(splat: &ViewSplat<f64>) -> f64 {
    splat.s.z.hypot(splat.t.z) / splat.p.z
}

pub(crate) fn single(v: V3<f64>) -> V3<f32> {
    V3::new(v.x as f32, v.y as f32, v.z as f32)
}

pub(crate) fn single_splat(s: &ViewSplat<f64>) -> ViewSplat<f32> {
    ViewSplat { p: single(s.p), s: single(s.s), t: single(s.t), n: single(s.n) }
}

pub(crate) fn wide(v: V2<f32>) -> V2<f64> {
    V2::new(f64::from(v.x), f64::from(v.y))
}

/// Exact linear forms U, V, W in ray coordinates (X, Y, 1): adj[s t p] times the sign of its determinant.
pub(crate) struct Exact {
    rows: [[Q; 3]; 3],
}

impl Exact {
    pub(crate) fn new(splat: &ViewSplat<f64>) -> Self {
        let vector = |v: V3<f64>| [q(v.x), q(v.y), q(v.z)];
        let (p, s, t) = (vector(splat.p), vector(splat.s), vector(splat.t));
        let cross = |a: &[Q; 3], b: &[Q; 3]| {
            let term = |i: usize, j: usize| &a[i] * &b[j] - &a[j] * &b[i];
            [term(1, 2), term(2, 0), term(0, 1)]
        };
        let mut rows = [cross(&t, &p), cross(&p, &s), cross(&s, &t)];
        let determinant = &rows[2][0] * &p[0] + &rows[2][1] * &p[1] + &rows[2][2] * &p[2];
        if determinant.is_negative() {
            for row in rows.iter_mut().flatten() {
                *row = -row.clone();
            }
        }
        Self { rows }
    }

    /// Returns (U, V, W) at exact ray coordinates.
    pub(crate) fn at(&self, x: &Q, y: &Q) -> [Q; 3] {
        self.rows.each_ref().map(|r| &r[0] * x + &r[1] * y + &r[2])
    }

    /// True if the ellipse meets the line on which ray coordinate `axis` (0: X, 1: Y) is `value`. Exact for a disk
    /// wholly in front of the eye.
    pub(crate) fn meets(&self, axis: usize, value: &Q) -> bool {
        let along: Vec<Q> = self.rows.iter().map(|r| r[1 - axis].clone()).collect();
        let constant: Vec<Q> = self.rows.iter().map(|r| &r[axis] * value + &r[2]).collect();
        let form = |a: &[Q], b: &[Q]| &a[0] * &b[0] + &a[1] * &b[1] - &a[2] * &b[2];
        let (a, b, c) = (form(&along, &along), form(&along, &constant), form(&constant, &constant));
        assert!(a.is_positive(), "an ellipse on the screen");
        &b * &b >= a * c
    }
}

/// Returns the ray coordinate of an exact pixel coordinate.
pub(crate) fn ray_coordinate(pixel: &Q, axis: usize, projection: &Projection) -> Q {
    (pixel - q(projection.principal_px[axis])) / q(projection.focal_px[axis])
}
