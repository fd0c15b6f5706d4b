//! Singular values of 2×2 matrices.

use crate::{Real, V2};

/// The singular value decomposition J = U·diag(ℓ)·Vᵀ of a 2×2 matrix, without V. For a splat's J, it yields the axes of
/// the projected ellipse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Svd2<R> {
    /// Larger singular value ℓ of J, at least 0.
    pub major: R,
    /// Smaller singular value ℓ of J, at least 0.
    pub minor: R,
    /// First column of U, the unit vector that belongs to `major`. The second column is its quarter turn (−y, x).
    pub major_axis: V2<R>,
}

impl<R: Real> Svd2<R> {
    /// Decomposes the matrix with columns `s` and `t`, from the eigenvector of JJᵀ by its double angle. The caller
    /// supplies the determinant, because computing it from the columns loses precision if the matrix is nearly
    /// singular.
    ///
    /// Entries between 1e-15 and 1e15 neither overflow nor underflow in f32. The larger value and its axis are precise
    /// to a few ulp; the smaller value inherits the relative error of `determinant`. For equal values the axis is (1,
    /// 0).
    #[inline(always)]
    pub fn of_columns(s: V2<R>, t: V2<R>, determinant: R) -> Self {
        let zero = s.x.zero();
        let one = s.x.one();
        let scale = s.x.abs().max(s.y.abs()).max(t.x.abs().max(t.y.abs()));
        let safe = R::select(zero.lt(scale), scale, one);
        let inverse = safe.scale_to_one();
        let (a, b, c, d) = (s.x * inverse, t.x * inverse, s.y * inverse, t.y * inverse);
        // JJᵀ = [[p, q], [q, r]]; (cos 2φ, sin 2φ) of its major axis is along ((p − r)/2, q). The difference is
        // factored, since it cancels for p ≈ r.
        let half = s.x.constant(0.5);
        let difference = R::sum_of_products(a + c, a - c, b + d, b - d) * half;
        let q = R::sum_of_products(a, c, b, d);
        let sum = (a.mul_add(a, b * b) + c.mul_add(c, d * d)) * half;
        let length = R::sum_of_products(difference, difference, q, q).sqrt();
        let major = (sum + length).sqrt();
        // Half the angle, from the larger of |cos| and |sin| so that nothing cancels.
        let positive = zero.le(difference);
        let big = length + difference.abs();
        let x = R::select(positive, big, q.abs());
        let y = R::select(positive, q, R::select(q.lt(zero), -big, big));
        let square = R::sum_of_products(x, x, y, y);
        let round = square.le(zero);
        let inverse_norm = R::select(round, one, square).inverse_sqrt();
        let major_axis = V2::new(R::select(round, one, x * inverse_norm), y * inverse_norm);
        let major_px = major * inverse.scale_to_one();
        let safe_major = R::select(zero.lt(major_px), major_px, one);
        // For a circle, rounding may raise the quotient above the larger value.
        let minor = (determinant.abs() / safe_major).min(major_px);
        Self { major: major_px, minor, major_axis }
    }

    /// Returns the second left singular vector: `major_axis` turned by 90°.
    #[inline(always)]
    pub fn minor_axis(&self) -> V2<R> {
        V2::new(-self.major_axis.y, self.major_axis.x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Checks U·diag(ℓ²)·Uᵀ, which the filters use, against JJᵀ.
    fn check(s: V2<f64>, t: V2<f64>) {
        let svd = Svd2::of_columns(s, t, s.cross(t));
        let (u, v) = (svd.major_axis, svd.minor_axis());
        let (l, m) = (svd.major * svd.major, svd.minor * svd.minor);
        let scale = s.dot(s) + t.dot(t);
        let jjt = [s.x * s.x + t.x * t.x, s.x * s.y + t.x * t.y, s.y * s.y + t.y * t.y];
        let got = [l * u.x * u.x + m * v.x * v.x, l * u.x * u.y + m * v.x * v.y, l * u.y * u.y + m * v.y * v.y];
        for (a, b) in jjt.iter().zip(got) {
            assert!((a - b).abs() <= 1e-14 * scale, "{s:?} {t:?}: {jjt:?} {got:?}");
        }
    }

    proptest! {
        #[test]
        fn svd_rebuilds_jjt(e in -15.0..15.0f64, k in -8.0..0.0f64, a in 0.0..7.0f64, b in 0.0..7.0f64) {
            let (major, minor) = (10f64.powf(e), 10f64.powf(e + k));
            let (u, v) = (V2::new(a.cos(), a.sin()), V2::new(-a.sin(), a.cos()));
            let s = u * (major * b.cos()) + v * (minor * b.sin());
            let t = u * (-major * b.sin()) + v * (minor * b.cos());
            check(s, t);
            let svd = Svd2::of_columns(s, t, major * minor);
            prop_assert!((svd.major / major - 1.0).abs() < 1e-14 && (svd.minor / minor - 1.0).abs() < 1e-14);
            let svd = Svd2::of_columns(V2::new(s.x as f32, s.y as f32), V2::new(t.x as f32, t.y as f32), 1.0f32);
            prop_assert!((f64::from(svd.major) / major - 1.0).abs() < 4e-7);
            let length = svd.major_axis.x.hypot(svd.major_axis.y);
            prop_assert!((length - 1.0).abs() < 3e-7);
        }
    }

    #[test]
    fn svd_of_circles_zero_and_axis_aligned_ellipses() {
        let circle = Svd2::of_columns(V2::new(0.0, 3.0), V2::new(-3.0, 0.0), 9.0);
        assert_eq!((circle.major, circle.minor), (3.0, 3.0));
        let zero = Svd2::of_columns(V2::new(0.0, 0.0), V2::new(0.0, 0.0), 0.0);
        assert_eq!((zero.major, zero.minor), (0.0, 0.0));
        for (s, t) in [((2.0, 0.0), (0.0, 1.0)), ((0.0, 2.0), (1.0, 0.0)), ((1.0, 0.0), (0.0, 2.0))] {
            check(V2::new(s.0, s.1), V2::new(t.0, t.1));
        }
    }
}
