//! Directions, orthonormal bases and singular values, safe at any scale.

use glam::{DMat3, DVec3};

/// `v` scaled to unit length at any magnitude (1e±300); zero stays zero.
pub fn unit(v: DVec3) -> DVec3 {
    let largest = v.abs().max_element();
    if largest == 0.0 || !largest.is_finite() {
        return DVec3::ZERO;
    }
    (v / largest).normalize()
}

/// An orthonormal pair (s, t) with s × t along `normal` (which may have any length but zero).
///
/// Source: Duff et al. 2017, "Building an Orthonormal Basis, Revisited": no branch on the direction, and no
/// loss of precision near −z.
pub fn orthonormal(normal: DVec3) -> (DVec3, DVec3) {
    let n = unit(normal);
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), DVec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Object to world normals up to scale: the inverse transpose of a map's linear part, with the sign of its determinant,
/// so that a mirrored object stays outside-out.
pub fn normal_matrix(m: &DMat3) -> DMat3 {
    // The cofactor matrix is det(A)·A⁻ᵀ: no inverse, no singularity.
    let cofactors = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    let scale = cofactors.to_cols_array().iter().fold(0.0f64, |a, b| a.max(b.abs()));
    cofactors * (1.0f64.copysign(m.determinant()) / scale)
}

/// The larger singular value of the 3×2 matrix [s t]: the larger semi-axis of the ellipse u·s + v·t.
pub fn largest_singular_value(s: DVec3, t: DVec3) -> f64 {
    let scale = s.abs().max_element().max(t.abs().max_element());
    if scale == 0.0 {
        return 0.0;
    }
    let (s, t) = (s / scale, t / scale);
    let (a, b, c) = (s.dot(s), s.dot(t), t.dot(t));
    scale * (0.5 * (a + c) + (0.5 * (a - c)).hypot(b)).sqrt()
}

/// Half-axes at right angles of the ellipse u·s + v·t, with the same s × t: (s, t) turned within the unit disk.
///
/// Source: one Jacobi rotation (Golub and Van Loan, Matrix Computations, §8.5.2), of the 2×2 matrix of dot products.
pub fn principal_axes(s: DVec3, t: DVec3) -> (DVec3, DVec3) {
    let scale = s.abs().max_element().max(t.abs().max_element());
    let (a, b) = (s / scale, t / scale);
    let product = a.dot(b);
    if scale == 0.0 || product == 0.0 {
        return (s, t);
    }
    let tau = (b.dot(b) - a.dot(a)) / (2.0 * product);
    let tangent = 1.0f64.copysign(tau) / (tau.abs() + (1.0 + tau * tau).sqrt());
    let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
    let sine = tangent * cosine;
    (s * cosine - t * sine, s * sine + t * cosine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthonormal_pairs_are_right_handed_for_every_direction() {
        for i in 0..1000 {
            let (a, b) = (f64::from(i) * 2.399_963, 1.0 - f64::from(i) / 499.5);
            let n = DVec3::new(a.cos() * (1.0 - b * b).max(0.0).sqrt(), a.sin() * (1.0 - b * b).max(0.0).sqrt(), b);
            let (s, t) = orthonormal(n * 1e-200);
            assert!((s.cross(t) - n).length() < 1e-14 && s.dot(t).abs() < 1e-15, "{n}");
            assert!((s.length() - 1.0).abs() < 1e-14 && (t.length() - 1.0).abs() < 1e-14, "{n}");
        }
    }

    #[test]
    fn largest_singular_value_of_a_sheared_pair() {
        // [s t] = [[2, 3], [0, 2]]: singular values 4 and 1.
        let value = largest_singular_value(DVec3::new(2.0, 0.0, 0.0), DVec3::new(3.0, 2.0, 0.0));
        assert!((value - 4.0).abs() < 1e-14, "{value}");
    }
    #[test]
    fn principal_axes_are_at_right_angles_and_span_the_same_ellipse() {
        let across = DVec3::new(0.36, 0.48, 0.8).cross(DVec3::new(0.6, -0.8, 0.0)).normalize();
        for (minor, shear) in [(1.0, 0.5), (0.3, -2.0), (1e-4, 1.5), (1e-6, -0.7), (2.0, 0.0)] {
            let s = DVec3::new(0.6, -0.8, 0.0) * 1e-9;
            let t = across * (1e-9 * minor) + s * shear;
            let (a, b) = principal_axes(s, t);
            // What rounding of s and t leaves of the minor axis, which is the difference of their multiples.
            let rounding = 1e-15 * s.length() / a.length().min(b.length());
            assert!(a.dot(b).abs() <= rounding * a.length() * b.length(), "{minor} {shear}");
            assert!((a.cross(b) - s.cross(t)).length() <= 1e-15 * s.length() * t.length(), "{minor} {shear}");
            let larger = largest_singular_value(s, t);
            assert!((a.length().max(b.length()) / larger - 1.0).abs() < 1e-14, "{minor} {shear}");
        }
        assert_eq!(principal_axes(DVec3::ZERO, DVec3::ZERO), (DVec3::ZERO, DVec3::ZERO));
    }
}
