//! Eigenvalues and eigenvectors of symmetric 3×3 and 2×2 matrices.

use glam::{DMat3, DVec2, DVec3};

/// A symmetric 3×3 matrix: xx, xy, xz, yy, yz, zz.
pub(crate) type Symmetric3 = [f64; 6];

/// Eigenvalues in ascending order and the unit eigenvectors of a symmetric matrix, by cyclic Jacobi rotations:
/// unconditionally stable, and exact for diagonal matrices (Golub and Van Loan, Matrix Computations, §8.5).
pub(crate) fn symmetric3(m: Symmetric3) -> ([f64; 3], [DVec3; 3]) {
    let scale = m.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
    if scale == 0.0 || !scale.is_finite() {
        return ([0.0; 3], [DVec3::X, DVec3::Y, DVec3::Z]);
    }
    let [xx, xy, xz, yy, yz, zz] = m.map(|x| x / scale);
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    // Convergence is quadratic: five sweeps reach rounding for any 3×3 matrix, ten are a bound, not a hope.
    for _ in 0..10 {
        let off = a[0][1].abs().max(a[0][2].abs()).max(a[1][2].abs());
        if off < 1e-17 {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = 1.0_f64.copysign(theta) / (theta.abs() + theta.hypot(1.0));
            let c = 1.0 / t.hypot(1.0);
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..3 {
                (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                (v[p][k], v[q][k]) = (c * v[p][k] - s * v[q][k], s * v[p][k] + c * v[q][k]);
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i] * scale), order.map(|i| DVec3::from_array(v[i]).normalize_or(DVec3::Z)))
}

/// Eigenvalues (larger first) of [[xx, xy], [xy, yy]] and the larger one's unit eigenvector.
pub(crate) fn symmetric2(xx: f64, xy: f64, yy: f64) -> ([f64; 2], DVec2) {
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let radius = half.hypot(xy);
    let angle = 0.5 * xy.atan2(half);
    ([mean + radius, mean - radius], DVec2::from_angle(angle))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn product(values: [f64; 3], vectors: [DVec3; 3]) -> Symmetric3 {
        let at = |i: usize, j: usize| (0..3).map(|k| values[k] * vectors[k][i] * vectors[k][j]).sum();
        [at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)]
    }

    #[test]
    fn symmetric3_exact_cases() {
        let (values, _) = symmetric3([2.0, 1.0, 0.0, 2.0, 0.0, 5.0]);
        for (found, exact) in values.into_iter().zip([1.0, 3.0, 5.0]) {
            assert!((found - exact).abs() < 4e-15, "{found} {exact}");
        }
        // All ones: 0, 0, 3, the last along (1, 1, 1).
        let (values, vectors) = symmetric3([1.0; 6]);
        assert!(values[0].abs() < 4e-15 && values[1].abs() < 4e-15 && (values[2] - 3.0).abs() < 4e-15, "{values:?}");
        assert!((vectors[2].dot(DVec3::ONE).abs() - 3.0_f64.sqrt()).abs() < 4e-15);
        assert_eq!(symmetric3([3.0, 0.0, 0.0, 1.0, 0.0, 2.0]).0, [1.0, 2.0, 3.0]);
        assert_eq!(symmetric3([0.0; 6]).0, [0.0; 3]);
        assert_eq!(symmetric3([f64::NAN; 6]).0, [0.0; 3]);
    }

    #[test]
    fn symmetric3_vectors_rebuild_the_matrix_at_any_conditioning() {
        let mut random = crate::mesh::random::Random::new(3);
        for round in 0..500 {
            let (s, t) = surfel_math::basis::orthonormal(DVec3::new(random.unit() - 0.5, random.unit(), random.unit()));
            let (u, w) = surfel_math::basis::orthonormal(s + t * random.unit());
            let n = u.cross(w);
            let small = 10.0_f64.powi(-(round % 14));
            let values = [small * random.unit(), small, 1.0 + random.unit()];
            let m = product(values, [u, w, n]).map(|x| x * 1e-30);
            let (found, vectors) = symmetric3(m);
            let again = product(found, vectors);
            for k in 0..6 {
                // A few roundings of the largest entry, 2e-30.
                assert!((again[k] - m[k]).abs() < 2e-44, "{k}: {again:?} {m:?}");
            }
            assert!(found[0] <= found[1] && found[1] <= found[2]);
            assert!(vectors[0].cross(vectors[1]).dot(vectors[2]).abs() > 1.0 - 1e-14);
        }
    }

    #[test]
    fn symmetric2_of_a_turned_ellipse() {
        let d = DVec2::from_angle(0.7);
        let e = d.perp();
        let m = |i: usize, j: usize| 9.0 * d[i] * d[j] + 4.0 * e[i] * e[j];
        let (values, vector) = symmetric2(m(0, 0), m(0, 1), m(1, 1));
        assert!((values[0] - 9.0).abs() < 1e-14 && (values[1] - 4.0).abs() < 1e-14);
        assert!((vector.dot(d).abs() - 1.0).abs() < 1e-15);
    }
}
