//! Eigenvalues and eigenvectors of symmetric 3×3 and 2×2 matrices.

use glam::{DMat3, DVec2, DVec3};

/// Symmetric 3×3 matrix as its six entries xx, xy, xz, yy, yz, zz.
pub(crate) type Symmetric3 = [f64; 6];

/// Computes the eigenvalues of a symmetric matrix, in ascending order, and its unit eigenvectors in the same order. The
/// method, cyclic Jacobi rotations, is unconditionally stable, and exact for diagonal matrices (Golub and Van Loan,
/// Matrix Computations, §8.5). A zero or non-finite matrix gives zeros and the coordinate axes.
pub(crate) fn symmetric3(m: Symmetric3) -> ([f64; 3], [DVec3; 3]) {
    let scale = m.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
    if scale == 0.0 || !scale.is_finite() {
        return ([0.0; 3], [DVec3::X, DVec3::Y, DVec3::Z]);
    }
    let [xx, xy, xz, yy, yz, zz] = m.map(|x| x / scale);
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    // Convergence is quadratic: five sweeps reach rounding for any 3×3 matrix, and ten are a safe bound.
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
            // θ² overflows from 1e154 on: the rotation by 1/(2θ) is then negligible.
            let t = 1.0_f64.copysign(theta) / (theta.abs() + (1.0 + theta * theta).sqrt());
            let c = 1.0 / (1.0 + t * t).sqrt();
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

/// Computes the eigenvalues of a positive semidefinite matrix, in ascending order, and the unit eigenvector of the
/// smallest one.
///
/// Newton's method finds the smallest root of the characteristic polynomial from below, where the polynomial is
/// concave. The eigenvector is the cross product of two rows of the matrix from which the eigenvalue is subtracted. If
/// all rows are nearly parallel, [`symmetric3`] is used instead.
pub(crate) fn smallest3(m: Symmetric3) -> ([f64; 3], DVec3) {
    let trace = m[0] + m[3] + m[5];
    if !(trace > 0.0 && trace.is_finite()) {
        let (values, vectors) = symmetric3(m);
        return (values, vectors[0]);
    }
    let [xx, xy, xz, yy, yz, zz] = m.map(|x| x / trace);
    // The characteristic polynomial λ³ − λ² + bλ − c, scaled so that the trace is 1.
    let b = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
    let c = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    let mut smallest = 0.0;
    for _ in 0..NEWTON {
        let value = ((smallest - 1.0) * smallest + b) * smallest - c;
        let slope = (3.0 * smallest - 2.0) * smallest + b;
        let step = value / slope;
        // Rounding may make the polynomial's value at 0 positive.
        if step.is_nan() || step >= -1e-15 {
            break;
        }
        smallest -= step;
    }
    let rows =
        [DVec3::new(xx - smallest, xy, xz), DVec3::new(xy, yy - smallest, yz), DVec3::new(xz, yz, zz - smallest)];
    let crosses = [rows[0].cross(rows[1]), rows[0].cross(rows[2]), rows[1].cross(rows[2])];
    let lengths = crosses.map(DVec3::length_squared);
    let largest = (0..3).fold(0, |best, i| if lengths[i] > lengths[best] { i } else { best });
    if lengths[largest] < PARALLEL {
        let (values, vectors) = symmetric3(m);
        return (values, vectors[0]);
    }
    // Sum and product of the other two eigenvalues.
    let (sum, product) = (1.0 - smallest, b - smallest * (1.0 - smallest));
    let root = (0.25 * sum * sum - product).max(0.0).sqrt();
    let values = [smallest, (0.5 * sum - root).max(smallest), 0.5 * sum + root];
    (values.map(|v| v * trace), crosses[largest] / lengths[largest].sqrt())
}

/// Maximum number of Newton steps in [`smallest3`]. From a triple root, each step covers a third of the way.
const NEWTON: usize = 24;
/// Squared length of the largest cross product of two rows of the matrix minus its smallest eigenvalue, scaled to trace
/// 1, below which [`smallest3`] calls [`symmetric3`]. Below this limit the two smaller eigenvalues differ by less than
/// 1e-6, and rounding would turn the eigenvector by 1e-4.
const PARALLEL: f64 = 1e-12;

/// Computes the eigenvalues of the matrix [[xx, xy], [xy, yy]], larger first, and the unit eigenvector of the larger
/// one.
pub(crate) fn symmetric2(xx: f64, xy: f64, yy: f64) -> ([f64; 2], DVec2) {
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let radius = (half * half + xy * xy).sqrt();
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
        // All ones: the eigenvalues are 0, 0, 3, the last along (1, 1, 1).
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
                // Tolerance: a few roundings of the largest entry, 2e-30.
                assert!((again[k] - m[k]).abs() < 2e-44, "{k}: {again:?} {m:?}");
            }
            assert!(found[0] <= found[1] && found[1] <= found[2]);
            assert!(vectors[0].cross(vectors[1]).dot(vectors[2]).abs() > 1.0 - 1e-14);
        }
    }

    #[test]
    fn smallest3_agrees_with_rotations_at_any_conditioning() {
        let mut random = crate::mesh::random::Random::new(5);
        for round in 0..2000 {
            let (s, t) = surfel_math::basis::orthonormal(DVec3::new(random.unit() - 0.5, random.unit(), random.unit()));
            let (u, w) = surfel_math::basis::orthonormal(s + t * random.unit());
            let middle = 10.0_f64.powi(-(round % 7));
            let values = [middle * random.unit() * f64::from(round % 3) * 0.5, middle, 1.0 + random.unit()];
            let mut values = values;
            values.sort_by(f64::total_cmp);
            let m = product(values, [u, w, u.cross(w)]).map(|x| x * 1e12);
            let ((found, vector), (exact, vectors)) = (smallest3(m), symmetric3(m));
            for k in 0..3 {
                assert!((found[k] - exact[k]).abs() < 1e-8 * exact[2], "{k}: {found:?} {exact:?}");
            }
            // Rounding moves the eigenvalue by 1e-16 over the gap to the next one; dividing by the gap again gives the
            // turn of the vector.
            let gap = (exact[1] - exact[0]) / exact[2];
            let turn = vector.cross(vectors[0]).length();
            assert!(turn < 1e-13 + 2e-15 / (gap * gap), "{round}: {turn} at {gap}");
            assert!((vector.length() - 1.0).abs() < 1e-14);
        }
        let (values, vector) = smallest3([3.0, 0.0, 0.0, 1.0, 0.0, 2.0]);
        // Tolerance: a few roundings.
        assert!(values.into_iter().zip([1.0, 2.0, 3.0]).all(|(v, exact)| (v - exact).abs() < 4e-15), "{values:?}");
        assert!(vector.abs().distance(DVec3::Y) < 4e-15, "{vector}");
        for m in [[0.0; 6], [f64::NAN; 6], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0], [1.0; 6], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]] {
            let (values, vector) = smallest3(m);
            assert!(values.iter().all(|v| v.is_finite()) && (vector.length() - 1.0).abs() < 1e-14, "{m:?}");
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
