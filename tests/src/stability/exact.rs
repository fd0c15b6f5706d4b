//! One splat in exact arithmetic: all that a splat is made of is a whole number times a power of two, and so is every form
//! over it. Nothing is rounded but the result.

use num_bigint::BigInt;
use num_traits::{Signed, ToPrimitive, Zero};
use surfel_math::V3;
use surfel_math::project::ViewSplat;
use surfel_math::projection::Projection;

/// A whole number times a power of two.
#[derive(Clone, Debug)]
pub struct Dyadic {
    mantissa: BigInt,
    exponent: i64,
}

impl Dyadic {
    /// A finite number, exactly.
    pub fn new(value: f64) -> Self {
        let bits = value.to_bits();
        let (biased, fraction) = ((bits >> 52 & 0x7ff) as i64, (bits & ((1 << 52) - 1)) as i64);
        let (mantissa, exponent) = if biased == 0 { (fraction, -1074) } else { (fraction | 1 << 52, biased - 1075) };
        Self { mantissa: BigInt::from(if value.is_sign_negative() { -mantissa } else { mantissa }), exponent }
    }

    /// The product.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        Self { mantissa: &self.mantissa * &other.mantissa, exponent: self.exponent + other.exponent }
    }

    /// The sum.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let exponent = self.exponent.min(other.exponent);
        let at = |d: &Self| &d.mantissa << (d.exponent - exponent);
        Self { mantissa: at(self) + at(other), exponent }
    }

    /// The negative.
    #[must_use]
    pub fn negative(&self) -> Self {
        Self { mantissa: -&self.mantissa, exponent: self.exponent }
    }

    /// The difference.
    #[must_use]
    pub fn minus(&self, other: &Self) -> Self {
        self.plus(&other.negative())
    }

    /// Above 0.
    pub fn is_positive(&self) -> bool {
        self.mantissa.is_positive()
    }

    /// Below 0.
    pub fn is_negative(&self) -> bool {
        self.mantissa.is_negative()
    }

    /// The quotient, rounded; 0 for a divisor of 0.
    pub fn over(&self, divisor: &Self) -> f64 {
        if divisor.mantissa.is_zero() {
            return 0.0;
        }
        // 66 bits of quotient: f64's 53 come out rounded once, but for ties that the cut bits would break.
        let shift = divisor.mantissa.bits() as i64 - self.mantissa.bits() as i64 + 66;
        let quotient = (&self.mantissa << shift.max(0)) / (&divisor.mantissa << (-shift).max(0));
        let exponent = self.exponent - divisor.exponent - shift;
        let value = quotient.to_f64().unwrap_or(f64::INFINITY);
        // In two steps, so that neither power leaves f64's range before the product does.
        let half = (exponent / 2).clamp(-1100, 1100) as i32;
        let rest = (exponent - exponent / 2).clamp(-1100, 1100) as i32;
        value * 2f64.powi(half) * 2f64.powi(rest)
    }
}

/// Where a ray meets a splat's disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// ρ² = u² + v², at most 1.
    pub rho_squared: f64,
    /// Planar depth.
    pub z: f64,
}

/// A splat's exact forms over pixels: adj([s t p]) and its determinant (G06 §3), times both focal lengths.
pub struct Exact {
    rows: [[Dyadic; 3]; 3],
    determinant: Dyadic,
    focal: [Dyadic; 2],
    principal: [Dyadic; 2],
    near: Dyadic,
}

impl Exact {
    /// The forms of a splat in perspective.
    pub fn new(splat: &ViewSplat<f64>, projection: &Projection) -> Self {
        let vector = |v: V3<f64>| [v.x, v.y, v.z].map(Dyadic::new);
        let (p, s, t) = (vector(splat.p), vector(splat.s), vector(splat.t));
        let cross = |a: &[Dyadic; 3], b: &[Dyadic; 3]| {
            [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i].times(&b[j]).minus(&a[j].times(&b[i])))
        };
        let mut rows = [cross(&t, &p), cross(&p, &s), cross(&s, &t)];
        let dot =
            |a: &[Dyadic; 3], b: &[Dyadic; 3]| a[0].times(&b[0]).plus(&a[1].times(&b[1])).plus(&a[2].times(&b[2]));
        let mut determinant = dot(&rows[2], &p);
        if determinant.is_negative() {
            determinant = determinant.negative();
            rows.iter_mut().flatten().for_each(|d| *d = d.negative());
        }
        let focal = projection.focal_px.map(Dyadic::new);
        determinant = determinant.times(&focal[0]).times(&focal[1]);
        let principal = projection.principal_px.map(Dyadic::new);
        Self { rows, determinant, focal, principal, near: Dyadic::new(projection.near) }
    }

    /// Homogeneous (U, V, W) at the centre of a pixel of the whole image; W > 0 before the eye.
    pub fn at(&self, pixel: [u32; 2]) -> [Dyadic; 3] {
        let center = |axis: usize| Dyadic::new(f64::from(pixel[axis]) + 0.5).minus(&self.principal[axis]);
        let [fx, fy] = &self.focal;
        let ray = [center(0).times(fy), center(1).times(fx), fx.times(fy)];
        self.rows.each_ref().map(|r| r[0].times(&ray[0]).plus(&r[1].times(&ray[1])).plus(&r[2].times(&ray[2])))
    }

    /// What the unfiltered, unclipped splat has at the centre of a pixel of the whole image.
    pub fn hit(&self, pixel: [u32; 2]) -> Option<Hit> {
        let [u, v, w] = self.at(pixel);
        let (square, limit) = (u.times(&u).plus(&v.times(&v)), w.times(&w));
        let before_near = self.determinant.minus(&w.times(&self.near)).is_negative();
        if !w.is_positive() || square.minus(&limit).is_positive() || before_near {
            return None;
        }
        Some(Hit { rho_squared: square.over(&limit), z: self.determinant.over(&w) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_math::projection::ProjectionKind;

    #[test]
    fn exact_arithmetic_is_that_of_f64_where_f64_is_exact() {
        let d = Dyadic::new;
        assert_eq!(d(1.5).times(&d(-2.25)).over(&d(1.0)), -3.375);
        assert_eq!(
            d(1e300).times(&d(1e-300)).minus(&d(1.0)).over(&d(1.0)).abs().max(1e-16),
            1e300f64.mul_add(1e-300, -1.0).abs().max(1e-16)
        );
        assert_eq!(d(1.0).over(&d(3.0)), 1.0 / 3.0);
        assert_eq!(d(5e-324).over(&d(5e-324)), 1.0);
        assert_eq!(d(1e-300).over(&d(1e300)), 0.0);
        assert!(d(0.1).minus(&d(0.1)).over(&d(1.0)) == 0.0 && !d(0.0).is_positive());
    }

    #[test]
    fn exact_hit_of_a_facing_disk() {
        let projection = Projection {
            kind: ProjectionKind::Perspective,
            focal_px: [64.0, 32.0],
            principal_px: [8.5, 8.5],
            near: 0.5,
        };
        let v = V3::new;
        let splat = ViewSplat { p: v(0.0, 0.0, 2.0), s: v(0.25, 0.0, 0.0), t: v(0.0, 0.5, 0.0), n: v(0.0, 0.0, -1.0) };
        let exact = Exact::new(&splat, &projection);
        // 8 px to the side along both axes.
        assert_eq!(exact.hit([8, 8]), Some(Hit { rho_squared: 0.0, z: 2.0 }));
        assert_eq!(exact.hit([12, 8]), Some(Hit { rho_squared: 0.25, z: 2.0 }));
        assert_eq!(exact.hit([8, 16]), Some(Hit { rho_squared: 1.0, z: 2.0 }));
        assert_eq!(exact.hit([9, 16]), None);
        let far_plane = Projection { near: 2.5, ..projection };
        assert_eq!(Exact::new(&splat, &far_plane).hit([8, 8]), None);
    }
}
