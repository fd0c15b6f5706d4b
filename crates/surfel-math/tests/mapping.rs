//! Tests of the mapping in f32 against exact arithmetic, and against the form with absolute pixel coordinates.

use crate::common;

use common::{Exact, Random, Spec, UHD, int, q, ray_coordinate, reach, single_splat, to_f64};
use glam::DVec3;
use num_traits::Signed;
use surfel_math::mapping::Footprint;
use surfel_math::project::{EDGE_ON, Projected, ViewSplat};
use surfel_math::projection::Projection;
use surfel_math::{V2, V3};

/// The steepest slope of exp(−2ρ²).
const STEEPEST: f64 = 1.213;

fn weight(rho_squared: f64) -> f64 {
    if rho_squared <= 1.0 { (-2.0 * rho_squared).exp() } else { (-2.0f64).exp() }
}

/// Returns the exact kernel weight at a pixel centre, and beyond the rim the weight at the rim.
fn exact_weight(exact: &Exact, pixel: [i64; 2]) -> f64 {
    let center = |axis: usize| ray_coordinate(&(int(pixel[axis]) + q(0.5)), axis, &UHD);
    let [u, v, w] = exact.at(&center(0), &center(1));
    let square = &w * &w;
    let rho_squared = (&u * &u + &v * &v) / square;
    weight(if w.is_positive() { to_f64(&rho_squared) } else { f64::INFINITY })
}

/// Computes the weight by adj[s t p] applied to absolute pixel coordinates, all in f32.
fn naive_weight(splat: &ViewSplat<f32>, pixel: [i64; 2]) -> f64 {
    let ViewSplat { p, s, t, .. } = *splat;
    let (fx, fy) = (UHD.focal_px[0] as f32, UHD.focal_px[1] as f32);
    let (cx, cy) = (UHD.principal_px[0] as f32, UHD.principal_px[1] as f32);
    let row = |r: V3<f32>| {
        let (x, y) = (r.x / fx, r.y / fy);
        let constant = r.z - x * cx - y * cy;
        x * (pixel[0] as f32 + 0.5) + y * (pixel[1] as f32 + 0.5) + constant
    };
    let (u, v, w) = (row(t.cross(p)), row(p.cross(s)), row(s.cross(t)));
    weight(f64::from((u * u + v * v) / (w * w)))
}

fn our_weight(splat: &ViewSplat<f32>, pixel: [i64; 2]) -> f64 {
    let base = V2::new(pixel[0] as f32 + 0.5, pixel[1] as f32 + 0.5);
    let d = -UHD.offset_from(splat.p, base);
    let (u, v, w) = Footprint::unfiltered(&Projected::new(splat, &UHD), true).at(d);
    let (u, v, w) = (f64::from(u), f64::from(v), f64::from(w));
    weight(if w > 0.0 { (u * u + v * v) / (w * w) } else { f64::INFINITY })
}

/// The error of a weight is |Δw| ≤ 1.213·δ/r_minor, with δ the error of a pixel offset and r_minor the projected minor
/// radius. δ therefore measures how coordinates are formed. In f32 at 4K, δ of absolute coordinates is 2.4e-4 px.
#[test]
fn mapping_error_is_that_of_an_offset_not_of_a_coordinate() {
    let mut random = Random(7);
    let (mut ours, mut naive) = (0.0f64, 0.0f64);
    for _ in 0..3000 {
        let spec = Spec { radius_px: random.log_range(0.5, 300.0), ..Spec::random(&mut random, 1e-2) };
        let splat = spec.splat(&UHD);
        if reach(&splat) > 0.4 {
            continue;
        }
        let (exact, single) = (Exact::new(&splat), single_splat(&splat));
        let minor = surfel_math::svd::Svd2::of_columns(
            Projected::new(&splat, &UHD).j_s,
            Projected::new(&splat, &UHD).j_t,
            Projected::new(&splat, &UHD).det_j,
        );
        let spread = (0.7 * spec.radius_px).max(1.0);
        for _ in 0..4 {
            let along = random.range(-1.0, 1.0) * spread;
            let axis = minor.major_axis * along;
            let pixel = [(spec.pixel[0] + axis.x).floor() as i64, (spec.pixel[1] + axis.y).floor() as i64];
            let want = exact_weight(&exact, pixel);
            // An offset's own rounding is proportional to its length.
            let scale = STEEPEST / minor.minor * (1.0 + along.abs());
            ours = ours.max((our_weight(&single, pixel) - want).abs() / scale);
            naive = naive.max((naive_weight(&single, pixel) - want).abs() / STEEPEST * minor.minor);
        }
    }
    println!("δ of ours {ours:.2e} px a pixel of offset, of absolute coordinates {naive:.2e} px");
    // A few roundings of 2^-24 of the offset; slope terms of near edge-on splats multiply them.
    assert!(ours < 4e-6, "{ours}");
    assert!(naive > 1e-4 && naive > 30.0 * ours, "{naive} {ours}");
}

fn scaled(splat: &ViewSplat<f64>, k: f64) -> ViewSplat<f64> {
    ViewSplat { p: splat.p * k, s: splat.s * k, t: splat.t * k, n: splat.n }
}

fn numbers(p: &Projected<f32>) -> [f32; 11] {
    let Projected { j_s, j_t, det_j, slope, depth_gradient, facing, facing_cosine, .. } = *p;
    let g = depth_gradient;
    [j_s.x, j_s.y, j_t.x, j_t.y, det_j, slope.x, slope.y, g.x, g.y, facing, facing_cosine]
}

#[test]
fn mapping_is_the_same_at_every_scale() {
    let mut random = Random(9);
    for _ in 0..500 {
        let splat = Spec::random(&mut random, 1e-3).splat(&UHD);
        let base = Projected::new(&single_splat(&splat), &UHD);
        // Powers of two near 1e±15 scale every f32 exactly.
        for k in [50f64.exp2(), (-50f64).exp2()] {
            let got = Projected::new(&single_splat(&scaled(&splat, k)), &UHD);
            assert_eq!(numbers(&got), numbers(&base), "{k:e} {splat:?}");
        }
    }
}

/// Needles of aspect 1e4 … 1e8: their minor half-length comes from the determinant, which must not cancel.
#[test]
fn mapping_determinant_of_needles_is_good_in_f32() {
    let mut random = Random(11);
    let mut worst = 0.0f64;
    for _ in 0..3000 {
        let aspect = random.log_range(1e4, 1e8);
        let spec = Spec { aspect, radius_px: random.log_range(1.0, 300.0), ..Spec::random(&mut random, 0.05) };
        // The needle's half-axes are s and t themselves. Of a turned pair, both vectors are long, and their rounding
        // alone would change the needle's width.
        let splat = spec.splat(&UHD);
        if reach(&splat) > 0.4 {
            continue;
        }
        let want = Projected::new(&splat, &UHD).det_j;
        let got = f64::from(Projected::new(&single_splat(&splat), &UHD).det_j);
        // n·p relative to |p| at an elevation of 0.05 loses a factor of 20.
        worst = worst.max((got / want - 1.0).abs());
    }
    println!("relative error of det J: {worst:.2e}");
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn mapping_survives_elevations_down_to_edge_on() {
    let mut random = Random(13);
    for i in 0..2000 {
        // 90° … 1e-3°.
        let elevation = 10f64.powf(-5.0 * f64::from(i) / 1999.0) * 90f64.to_radians();
        let spec = Spec { elevation, radius_px: random.log_range(0.5, 100.0), ..Spec::random(&mut random, 0.5) };
        let splat = spec.splat(&UHD);
        let wide = Projected::new(&splat, &UHD);
        let single = Projected::new(&single_splat(&splat), &UHD);
        // The f32 rounding of the normal turns it by up to 6e-8, and that of p does too.
        let error = (f64::from(single.facing_cosine) - wide.facing_cosine).abs();
        assert!(error < 2.5e-7, "{elevation}: {error}");
        if (wide.facing_cosine / EDGE_ON - 1.0).abs() > 0.025 {
            assert_eq!(single.is_edge_on(), wide.is_edge_on(), "{elevation}");
        }
        assert!(numbers(&single).iter().all(|v| v.is_finite()), "{elevation}: {single:?}");
    }
}

/// (U, V, W) of the projective footprint are the exact forms divided by W at the centre.
#[test]
fn mapping_in_f64_is_the_exact_one() {
    let mut random = Random(17);
    for _ in 0..300 {
        let spec = Spec::random(&mut random, 1e-2);
        let splat = spec.splat(&UHD);
        let exact = Exact::new(&splat);
        let center = UHD.pixel(splat.p);
        let footprint = Footprint::unfiltered(&Projected::new(&splat, &UHD), true);
        let to_ray = |v: f64, axis: usize| ray_coordinate(&q(v), axis, &UHD);
        let at_center = to_f64(&exact.at(&to_ray(center.x, 0), &to_ray(center.y, 1))[2]);
        for (dx, dy) in [(0.25, 0.5), (-3.0, 1.0), (0.7 * spec.radius_px, -0.4 * spec.radius_px)] {
            let pixel = V2::new(center.x + dx, center.y + dy);
            let want = exact.at(&to_ray(pixel.x, 0), &to_ray(pixel.y, 1)).map(|v| to_f64(&v) / at_center);
            let (u, v, w) = footprint.at(pixel - center);
            let scale = want.iter().fold(1.0f64, |a, b| a.max(b.abs())) / Projected::new(&splat, &UHD).facing_cosine;
            for (g, t) in [u, v, w].into_iter().zip(want) {
                // Pixel coordinates near 4096 are rounded by 4.5e-13, over r_minor ≥ 0.05·1e-2/10 px.
                assert!((g - t).abs() < 1e-8 * scale, "{splat:?} {dx} {dy}: {g} {t}");
            }
        }
    }
}

#[test]
fn mapping_orthographic_has_constant_depth_rows() {
    let kind = surfel_math::projection::ProjectionKind::Orthographic { height: 2.0, far: 9.0 };
    let view = Projection { kind, ..UHD };
    let (s, t) = (DVec3::new(0.1, 0.02, 0.05), DVec3::new(-0.03, 0.2, 0.1));
    let n = common::v3(s.cross(t).normalize());
    let splat = ViewSplat { p: V3::new(0.3, 0.2, 2.0), s: common::v3(s), t: common::v3(t), n };
    let projected = Projected::new(&splat, &view);
    let footprint = Footprint::unfiltered(&projected, false);
    for (a, b) in [(0.5, 0.25), (-0.7, 0.1)] {
        let at = DVec3::new(0.3, 0.2, 2.0) + s * a + t * b;
        let d = view.pixel(common::v3(at)) - view.pixel(splat.p);
        let (u, v, w) = footprint.at(d);
        assert!((u - a).abs() < 1e-12 && (v - b).abs() < 1e-12 && w == 1.0);
        let depth = 2.0 + projected.depth_gradient.x * d.x + projected.depth_gradient.y * d.y;
        assert!((depth - at.z).abs() < 1e-12);
    }
}
