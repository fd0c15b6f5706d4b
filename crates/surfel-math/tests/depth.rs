//! Tests of fragments' depth and the visibility tolerance against the rendering model's definitions.

use crate::common;

use common::{Random, Spec, UHD, dvec, reach, single_splat, v3};
use glam::DVec3;
use surfel_math::basis::largest_singular_value;
use surfel_math::depth::{DepthForm, DepthPlane, Tolerance, tolerance};
use surfel_math::project::{Projected, ViewSplat};
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_math::{Real, V2, V3};

const ORTHOGRAPHIC: Projection =
    Projection { kind: ProjectionKind::Orthographic { height: 3.0, far: 50.0 }, focal_px: [720.0, 700.0], ..UHD };

fn plane(splat: &ViewSplat<f64>, projected: &Projected<f64>, linear: bool) -> DepthPlane<f64> {
    let (z, e) = (splat.p.z, projected.depth_extent);
    let gradient = if linear { projected.depth_gradient * z } else { -projected.depth_gradient };
    DepthPlane { scale: z, gradient, at_anchor: 1.0, z_min: z - e, z_max: z + e }
}

#[test]
fn depth_is_the_planes_own_clamped_to_the_disk() {
    let mut random = Random(41);
    let (mut inside, mut clamped) = (0, 0);
    for _ in 0..5000 {
        let spec = Spec { radius_px: random.log_range(0.5, 300.0), ..Spec::random(&mut random, 1e-2) };
        let splat = spec.splat(&UHD);
        if reach(&splat) > 0.5 {
            continue;
        }
        let projected = Projected::new(&splat, &UHD);
        let plane = plane(&splat, &projected, false);
        let r = 3.0 * spec.radius_px;
        let d = V2::new(random.range(-r, r), random.range(-r, r));
        let got = plane.at(d, DepthForm::Reciprocal);
        let (_, ray) = UHD.ray(UHD.pixel(splat.p) + d);
        // The ray's hit, or beyond the horizon of the plane the far end: the clamp applies to 1/z.
        let inverse = dvec(splat.n).dot(dvec(ray)) / dvec(splat.n).dot(dvec(splat.p));
        let want = if inverse > 0.0 { (1.0 / inverse).clamp(plane.z_min, plane.z_max) } else { plane.z_max };
        assert!((got - want).abs() < 1e-9 * want, "{splat:?} {d:?}: {got} {want}");
        if want == plane.z_min || want == plane.z_max { clamped += 1 } else { inside += 1 }
    }
    assert!(inside > 300 && clamped > 1000, "{inside} {clamped}");
}

#[test]
fn depth_under_an_affine_mapping_is_linear_in_u_and_v() {
    let mut random = Random(43);
    for _ in 0..1000 {
        let splat = Spec::random(&mut random, 1e-2).splat(&UHD);
        let projected = Projected::new(&splat, &UHD);
        let plane = plane(&splat, &projected, true);
        let (u, v) = (random.range(-0.7, 0.7), random.range(-0.7, 0.7));
        let d = projected.j_s * u + projected.j_t * v;
        let want = splat.p.z + u * splat.s.z + v * splat.t.z;
        let got = plane.at(d, DepthForm::Linear);
        assert!((got - want).abs() < 1e-8 * splat.p.z, "{splat:?} {u} {v}: {got} {want}");
    }
}

#[test]
fn depth_of_planes_that_turn_away_is_the_far_end() {
    let plane = DepthPlane { scale: 2.0, gradient: V2::new(-0.1, 0.0), at_anchor: 1.0, z_min: 1.5, z_max: 2.5 };
    for x in [2.0, 10.0, 10.000_001, 1e30, f64::MAX] {
        assert_eq!(plane.at(V2::new(x, 0.0), DepthForm::Reciprocal), 2.5, "{x}");
    }
    assert_eq!(plane.at(V2::new(-1e30, 0.0), DepthForm::Reciprocal), 1.5);
    assert_eq!(plane.at(V2::new(0.0, 7.0), DepthForm::Reciprocal), 2.0);
    assert_eq!(plane.at(V2::new(1e30, 0.0), DepthForm::Linear), 1.5);
    let steep =
        DepthPlane { gradient: V2::new(f32::MAX, f32::MAX), scale: 2.0, at_anchor: 1.0, z_min: 1.5, z_max: 2.5 };
    for d in [V2::new(1e6f32, 0.0), V2::new(-1e6, 0.0)] {
        assert!([1.5, 2.5].contains(&steep.at(d, DepthForm::Reciprocal)));
        assert!([1.5, 2.5].contains(&steep.at(d, DepthForm::Linear)));
    }
}

/// Computes the depth tolerance ε literally as rendering model §5 defines it.
fn literal(splat: &ViewSplat<f64>, radius: f64, h: f64, setting: Tolerance, view: &Projection) -> f64 {
    let (n, p) = (dvec(splat.n), dvec(splat.p));
    let per_pixel = (n.x / view.focal_px[0]).hypot(n.y / view.focal_px[1]);
    let (z, slope) = match view.kind {
        ProjectionKind::Perspective => {
            (p.z.max(view.near), per_pixel * p.z * p.z / n.dot(p).abs().max(0.02 * p.length()))
        }
        ProjectionKind::Orthographic { height, .. } => (height, per_pixel / n.z.abs().max(0.02)),
    };
    match setting {
        Tolerance::Relative(k) => (0.2 * z).min((k * radius).min(0.1 * z) + (h + 0.7) * slope),
        Tolerance::Absolute(distance) => distance + (h + 0.7) * slope,
    }
}

fn scaled_view(view: &Projection, k: f64) -> Projection {
    match view.kind {
        ProjectionKind::Perspective => Projection { near: view.near * k, ..*view },
        ProjectionKind::Orthographic { height, far } => Projection {
            kind: ProjectionKind::Orthographic { height: height * k, far: far * k },
            focal_px: view.focal_px.map(|f| f / k),
            near: view.near * k,
            ..*view
        },
    }
}

#[test]
fn tolerance_is_the_models_at_every_scale() {
    let mut random = Random(47);
    let (mut capped, mut sloped) = (0, 0);
    for i in 0..4000 {
        let mut spec = Spec::random(&mut random, 1e-4);
        spec.radius_px = random.log_range(0.05, 3000.0);
        let base = spec.splat(&UHD);
        for view in [UHD, ORTHOGRAPHIC] {
            for scale in [1.0, 1e15, 1e-15] {
                let view = scaled_view(&view, scale);
                let splat = ViewSplat { p: base.p * scale, s: base.s * scale, t: base.t * scale, n: base.n };
                let radius = largest_singular_value(dvec(splat.s), dvec(splat.t));
                let h = if i % 2 == 0 { 0.0 } else { 0.707 };
                for setting in [Tolerance::Relative(1.0), Tolerance::Relative(0.3), Tolerance::Absolute(0.01 * scale)] {
                    let want = literal(&splat, radius, h, setting, &view);
                    let got = tolerance(&splat, radius, h, setting, &view);
                    assert!((got / want - 1.0).abs() < 1e-11, "{splat:?} {scale:e}: {got:e} {want:e}");
                    let single = tolerance(&single_splat(&splat), radius as f32, h as f32, setting, &view);
                    // n·p of a splat near edge-on is precise to 2e-7 over its cap of 0.02.
                    assert!((f64::from(single) / want - 1.0).abs() < 5e-5, "{splat:?} {scale:e}: {single:e} {want:e}");
                }
                let full = literal(&splat, radius, h, Tolerance::Relative(1.0), &view);
                capped += u32::from(full > 0.199 * splat.p.z.max(0.0));
                sloped += u32::from(full > 2.0 * radius);
            }
        }
    }
    assert!(capped > 100 && sloped > 1000, "{capped} {sloped}");
}

fn checked<R: Real + Into<f64>>(value: R, what: &str) {
    let value: f64 = value.into();
    assert!(value.is_finite() && value >= 0.0, "{what}: {value}");
}

#[test]
fn tolerance_is_finite_wherever_a_splat_stands() {
    let places = [
        DVec3::ZERO,
        DVec3::new(0.0, 1.0, 0.0),
        DVec3::new(1e-30, 0.0, 0.0),
        DVec3::new(0.0, 0.0, -3.0),
        DVec3::new(0.3, 0.0, 1e-20),
        DVec3::new(1e15, -1e15, 1e15),
        DVec3::new(1e-15, 0.0, 1e-15),
    ];
    for p in places {
        for n in [DVec3::X, DVec3::Y, DVec3::NEG_Z, DVec3::new(0.6, 0.0, 0.8)] {
            let splat = ViewSplat { p: v3(p), s: v3(DVec3::X), t: v3(DVec3::Y), n: v3(n) };
            for setting in [Tolerance::Relative(1.0), Tolerance::Absolute(0.1)] {
                let what = format!("{p} {n}");
                checked(tolerance(&splat, 1.0, 0.7, setting, &UHD), &what);
                checked(tolerance(&single_splat(&splat), 1.0, 0.7, setting, &UHD), &what);
            }
        }
    }
}

#[test]
fn tolerance_grows_with_the_filter_only_on_slopes() {
    let at = |n: DVec3, h: f64| {
        let splat = ViewSplat { p: V3::new(0.0, 0.0, 2.0), s: v3(DVec3::X), t: v3(DVec3::Y), n: v3(n) };
        tolerance(&splat, 0.01, h, Tolerance::Relative(1.0), &UHD)
    };
    assert_eq!(at(DVec3::NEG_Z, 0.0), 0.01);
    assert_eq!(at(DVec3::NEG_Z, 5.0), 0.01);
    // 45°: a pixel is 1e-3 deep at z = 2.
    let n = DVec3::new(1.0, 0.0, -1.0).normalize();
    assert!((at(n, 1.0) - 0.01 - 1.7e-3).abs() < 1e-12);
}
