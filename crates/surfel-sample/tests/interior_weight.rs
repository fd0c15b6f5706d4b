//! Tests of the interior weight against its definition, evaluated by brute force.

use crate::common;

use common::Lcg;
use glam::{DVec3, Vec3};
use surfel_model::{CloudData, Column3, OnInvalid, Shape, SplatCloud};
use surfel_sample::interior_weight;

fn cloud(origin: DVec3, centers: &[DVec3], shape: Shape) -> SplatCloud {
    SplatCloud::new(CloudData::new(origin, Column3::from_f64(centers), shape), OnInvalid::Refuse).unwrap().0
}

/// Computes the interior weight literally by its definition in rendering model §5, over all pairs of splats.
fn brute(cloud: &SplatCloud) -> f64 {
    let n = cloud.len();
    let m = n.min(4096);
    let mut sums: Vec<f64> = (0..m)
        .map(|i| {
            let k = i * n / m;
            let ((s, t), normal) = (cloud.axes(k), cloud.normal(k));
            let x = cloud.data().centers.get(k) + 0.5 * s + 0.5 * t;
            let mut sum = 0.0;
            for j in 0..n {
                if cloud.normal(j).dot(normal) < 60.0_f64.to_radians().cos() - 1e-12 {
                    continue;
                }
                let ((s, t), d) = (cloud.axes(j), x - cloud.data().centers.get(j));
                // d + λ·normal = u s + v t, by Cramer's rule.
                let det = glam::DMat3::from_cols(s, t, -normal).determinant();
                let u = glam::DMat3::from_cols(d, t, -normal).determinant() / det;
                let v = glam::DMat3::from_cols(s, d, -normal).determinant() / det;
                let lambda = glam::DMat3::from_cols(s, t, d).determinant() / det;
                let rho2 = u * u + v * v;
                if lambda.abs() <= cloud.radius_max(k) && rho2 <= 1.0 {
                    sum += (-2.0 * rho2).exp();
                }
            }
            sum
        })
        .collect();
    sums.sort_by(f64::total_cmp);
    sums[(m - 1) / 2]
}

#[test]
fn interior_weight_of_zwickers_unit_grid() {
    let centers: Vec<DVec3> = (0..40 * 40).map(|i| DVec3::new(f64::from(i % 40), f64::from(i / 40), 0.0)).collect();
    let normals = Column3::from_f32(vec![Vec3::Z; centers.len()]);
    let grid = cloud(DVec3::ZERO, &centers, Shape::Disks { normals, radii: vec![2.0; centers.len()] });
    let weight = interior_weight(&grid).unwrap();
    // The integral 2π·(1 − e⁻²) = 5.433, and a ripple of a few percent at p + ½s + ½t: the points (1, 1) away.
    assert!((weight - 5.43).abs() < 0.2, "{weight}");
    assert!((weight - brute(&grid)).abs() < 1e-12);
}

#[test]
fn interior_weight_agrees_with_its_definition() {
    let mut random = Lcg(8);
    // Scatter of the normals: 2 brings many pairs to either side of 60°.
    let cases = [
        (1, 0.3, false, 0.3),
        (2, 1.0, false, 0.3),
        (700, 0.3, false, 0.3),
        (900, 0.8, false, 2.0),
        (4500, 1.0, true, 0.3),
    ];
    for (count, stretch, giants, stray) in cases {
        let (mut centers, mut s, mut t) = (Vec::new(), Vec::new(), Vec::new());
        let size = (8.0 / f64::from(count)).sqrt();
        for i in 0..count {
            let n = random.sphere();
            let (a, b) = surfel_math::basis::orthonormal((n + stray * random.sphere()).normalize());
            let size = if giants && i % 1000 == 7 { 0.7 } else { size * (0.5 + random.unit()) };
            centers.push(n);
            s.push((a * size + 0.2 * b * size).as_vec3());
            t.push((b * size * stretch).as_vec3());
        }
        let shape = Shape::Ellipses { s: Column3::from_f32(s), t: Column3::from_f32(t) };
        let cloud = cloud(DVec3::new(4.5e6, -7.1e6, 300.0), &centers, shape);
        let (fast, slow) = (interior_weight(&cloud).unwrap(), brute(&cloud));
        // The same sum in another order.
        assert!((fast - slow).abs() < 1e-11 * slow, "{count}: {fast} {slow}");
    }
    let empty = cloud(DVec3::ZERO, &[], Shape::Disks { normals: Column3::default(), radii: Vec::new() });
    assert_eq!(interior_weight(&empty), None);
}

#[test]
fn interior_weight_counts_splats_within_60_degrees_only() {
    for (degrees, counts) in [(59.0_f32, true), (61.0, false)] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        // Two equal splats, whose sum is the lower median of three for any third sum, and a third one through their
        // probe.
        let normals = Column3::from_f32(vec![Vec3::Z, Vec3::Z, Vec3::new(sin, 0.0, cos)]);
        let shape = Shape::Disks { normals, radii: vec![1.0; 3] };
        let centers = [DVec3::ZERO, DVec3::ZERO, DVec3::new(0.5, 0.5, 0.0)];
        let weight = interior_weight(&cloud(DVec3::ZERO, &centers, shape)).unwrap();
        // ρ² = ½ at p + ½s + ½t, and 0 at the third's centre.
        let expected = 2.0 * (-1.0_f64).exp() + if counts { 1.0 } else { 0.0 };
        assert!((weight - expected).abs() < 1e-12, "{degrees}: {weight}");
    }
}
