//! Directions, orthonormal bases and singular values, safe at any scale.

use crate::V3;
use glam::{DMat3, DVec3};

/// Smallest length of an ellipsoid's half-axis relative to its longest. [`shortest_axis`] lengthens shorter ones to it,
/// because the direction of a zero axis would be lost.
const MIN_AXIS: f64 = 1e-9;
/// Largest cosine of the angle between two half-axes that count as perpendicular, so that they need no further
/// rotation.
const RIGHT_ANGLE: f64 = 1e-12;
/// Largest relative difference of the lengths of two half-axes that count as equally long.
const EQUAL_AXES: f64 = 1e-6;
/// Largest number of sweeps of Jacobi rotations in [`shortest_axis`]; far fewer are needed, because they converge
/// quadratically.
const JACOBI_SWEEPS: usize = 12;

/// Scales `v` of any magnitude (1e±300) to unit length; zero stays zero, and an infinite vector becomes zero.
pub fn unit(v: DVec3) -> DVec3 {
    let largest = v.abs().max_element();
    if largest == 0.0 || !largest.is_finite() {
        return DVec3::ZERO;
    }
    (v / largest).normalize()
}

/// Returns an orthonormal pair (s, t) with s × t along `normal`, which may have any length but zero.
///
/// Source: Duff et al. 2017, "Building an Orthonormal Basis, Revisited": no branch on the direction, and no loss of
/// precision near −z.
pub fn orthonormal(normal: DVec3) -> (DVec3, DVec3) {
    let n = unit(normal);
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), DVec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Returns the map of normals from object to world space, up to scale. It is the inverse transpose of the matrix `m`,
/// with the sign of its determinant. Normals of a mirrored object therefore still point outwards.
pub fn normal_matrix(m: &DMat3) -> DMat3 {
    // The cofactor matrix is det(A)·A⁻ᵀ: no inverse, no singularity.
    let cofactors = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    let scale = cofactors.to_cols_array().iter().fold(0.0f64, |a, b| a.max(b.abs()));
    cofactors * (1.0f64.copysign(m.determinant()) / scale)
}

/// Returns the larger singular value of the 3×2 matrix [s t], which is the larger semi-axis of the ellipse u·s + v·t.
pub fn largest_singular_value(s: DVec3, t: DVec3) -> f64 {
    let scale = s.abs().max_element().max(t.abs().max_element());
    if scale == 0.0 {
        return 0.0;
    }
    let (s, t) = (s / scale, t / scale);
    let (a, b, c) = (s.dot(s), s.dot(t), t.dot(t));
    // At most 3 each, so `hypot`, which is for numbers whose squares overflow, isn't needed.
    let half = 0.5 * (a - c);
    scale * (0.5 * (a + c) + (half * half + b * b).sqrt()).sqrt()
}

/// Returns perpendicular half-axes of the ellipse u·s + v·t with the same s × t: (s, t) turned within the unit disk.
///
/// Source: one Jacobi rotation (Golub and Van Loan, Matrix Computations, §8.5.2) of the 2×2 matrix of dot products.
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

/// Returns the unit direction of the shortest principal axis of the ellipsoid with the half-axes σ_k·axis_k. The
/// half-axes need not be perpendicular, since an object's matrix may shear them. If several principal axes are
/// shortest, the result is the one that comes from the first of the given axes.
///
/// Source: one-sided Jacobi rotations (Golub and Van Loan, Matrix Computations, §8.6.3), which turn pairs of half-axes
/// within the ellipsoid until all are perpendicular.
pub fn shortest_axis(axes: [V3<f64>; 3], sigmas: [f64; 3]) -> V3<f64> {
    let lengths = [0, 1, 2].map(|k: usize| sigmas[k] * axes[k].length());
    let largest = lengths.into_iter().fold(0.0, f64::max);
    // Half-axes of almost no length are lengthened, so that they have a direction.
    let scaled = |k: usize| match lengths[k] > MIN_AXIS * largest {
        true => axes[k] * (sigmas[k] / largest),
        false => axes[k] * (MIN_AXIS / axes[k].length().max(f64::MIN_POSITIVE)),
    };
    let mut half_axes = [0, 1, 2].map(scaled);
    let mut is_turned = false;
    for _ in 0..JACOBI_SWEEPS {
        let mut turns = false;
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (half_axes[i], half_axes[j]);
            let (aa, bb, ab) = (a.dot(a), b.dot(b), a.dot(b));
            if ab.abs() > RIGHT_ANGLE * (aa * bb).sqrt() {
                let tau = (bb - aa) / (2.0 * ab);
                let tangent = 1.0_f64.copysign(tau) / (tau.abs() + tau.hypot(1.0));
                let cosine = tangent.hypot(1.0).recip();
                let sine = tangent * cosine;
                (half_axes[i], half_axes[j]) = (a * cosine - b * sine, a * sine + b * cosine);
                turns = true;
            }
        }
        is_turned |= turns;
        if !turns {
            break;
        }
    }
    let lengths = if is_turned { half_axes.map(V3::length) } else { lengths };
    let is_shorter = |b: usize, a: usize| lengths[b] < lengths[a] * (1.0 - EQUAL_AXES);
    let least = (0..3).reduce(|a, b| if is_shorter(b, a) { b } else { a }).unwrap_or(2);
    // The other two axes are exact even if this one has no length.
    let others = if is_turned { half_axes } else { axes };
    let n = others[(least + 1) % 3].cross(others[(least + 2) % 3]);
    n * n.length().recip()
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
    fn shortest_axis_is_that_of_the_transformed_ellipsoid() {
        // For a map with singular value decomposition U·diag(ℓ)·Vᵀ and a unit ball, the axis is a column of U.
        let turned = |a: f64, b: f64| DMat3::from_rotation_z(a) * DMat3::from_rotation_x(b);
        for lengths in [[3.0, 1.0, 0.25], [1.0, 1e-5, 20.0], [0.0, 1.0, 2.0], [1e-30, 3e-30, 2e-30], [1e20, 1.0, 1e19]]
        {
            for (sigmas, azimuth) in [([1.0; 3], 0.3), ([0.3, 0.02, 0.1], -1.2), ([1e-4, 1.0, 0.5], 2.0)] {
                let (u, v) = (turned(azimuth, 0.8), turned(1.9, -0.4));
                // Half-axes U·diag(ℓ)·Vᵀ, as axes times their σ.
                let half = u * DMat3::from_diagonal(DVec3::from(lengths)) * v.transpose();
                let axis = |k: usize| V3::from(half.col(k) / sigmas[k]);
                let found = shortest_axis([axis(0), axis(1), axis(2)], sigmas);
                let least = (0..3).reduce(|a, b| if lengths[b] < lengths[a] { b } else { a }).unwrap();
                let want = V3::from(u.col(least));
                assert!(1.0 - found.dot(want).abs() < 1e-12, "{lengths:?} {sigmas:?}: {found:?} {want:?}");
            }
        }
        let axes = [0, 1, 2].map(|k| V3::from(DMat3::from_rotation_z(0.7).col(k)));
        let [x, y, z, slant] = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(1.0, 2.0, 2.0)].map(V3::from);
        // Among equal axes, and axes of no length, the first.
        assert_eq!(shortest_axis([x, y, z], [0.5; 3]), x);
        assert_eq!(shortest_axis([x, y, z], [0.5, 0.5 * (1.0 - 1e-9), 0.5]), x);
        assert_eq!(shortest_axis([x, y, z], [0.5, 0.4, 0.5]), y);
        let is_along = |a: V3<f64>, b: V3<f64>| a.dot(b).abs() > 1.0 - 1e-15;
        assert!(is_along(shortest_axis(axes, [2.0, 0.0, 0.0]), axes[1]));
        assert!(is_along(shortest_axis(axes, [0.0; 3]), axes[0]));
        // A sheared needle: the result is perpendicular to it, whatever the other axes are.
        assert!(shortest_axis([slant, y, x], [1.0, 0.0, 0.0]).dot(slant).abs() < 1e-8);
    }

    #[test]
    fn principal_axes_are_at_right_angles_and_span_the_same_ellipse() {
        let across = DVec3::new(0.36, 0.48, 0.8).cross(DVec3::new(0.6, -0.8, 0.0)).normalize();
        for (minor, shear) in [(1.0, 0.5), (0.3, -2.0), (1e-4, 1.5), (1e-6, -0.7), (2.0, 0.0)] {
            let s = DVec3::new(0.6, -0.8, 0.0) * 1e-9;
            let t = across * (1e-9 * minor) + s * shear;
            let (a, b) = principal_axes(s, t);
            // Error that the rounding of s and t causes in the minor axis, which is the difference of their multiples.
            let rounding = 1e-15 * s.length() / a.length().min(b.length());
            assert!(a.dot(b).abs() <= rounding * a.length() * b.length(), "{minor} {shear}");
            assert!((a.cross(b) - s.cross(t)).length() <= 1e-15 * s.length() * t.length(), "{minor} {shear}");
            let larger = largest_singular_value(s, t);
            assert!((a.length().max(b.length()) / larger - 1.0).abs() < 1e-14, "{minor} {shear}");
        }
        assert_eq!(principal_axes(DVec3::ZERO, DVec3::ZERO), (DVec3::ZERO, DVec3::ZERO));
    }
}
