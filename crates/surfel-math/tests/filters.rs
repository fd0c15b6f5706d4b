//! Tests of the filters against their definitions: pixels are covered, results are continuous, footprints are centred.

use crate::common;

use common::{Random, Spec, UHD, dvec, reach, single_splat, v3};
use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use surfel_math::filter::{self, Filtered};
use surfel_math::mapping::Footprint;
use surfel_math::project::{Projected, ViewSplat};
use surfel_math::{V2, V3};

const H: f64 = std::f64::consts::FRAC_1_SQRT_2;

fn spec(least_elevation: f64, radius: std::ops::Range<f64>) -> impl Strategy<Value = Spec> {
    (any::<u64>(), radius.start.ln()..radius.end.ln()).prop_map(move |(seed, log_radius)| Spec {
        radius_px: log_radius.exp(),
        ..Spec::random(&mut Random(seed), least_elevation)
    })
}

/// Returns the disk with the parameters of a spec: an ellipse whose half-axes are equally long.
fn disk(spec: &Spec) -> ViewSplat<f64> {
    Spec { aspect: 1.0, ..*spec }.splat(&UHD)
}

fn turned(splat: &ViewSplat<f64>, angle: f64) -> ViewSplat<f64> {
    let (sin, cos) = angle.sin_cos();
    ViewSplat { s: splat.s * cos + splat.t * sin, t: splat.t * cos - splat.s * sin, ..*splat }
}

fn rho(f: &Footprint<f64>, d: V2<f64>) -> f64 {
    let (u, v, w) = f.at(d);
    if w > 0.0 { u.hypot(v) / w } else { f64::INFINITY }
}

/// Returns offsets all around the centre, at distance `radius`.
fn ring(radius: f64) -> impl Iterator<Item = V2<f64>> {
    (0..24).map(move |i| {
        let (sin, cos) = (f64::from(i) * 0.2618).sin_cos();
        V2::new(cos * radius, sin * radius)
    })
}

/// Returns the singular values of J from the trace and determinant of JJᵀ, in f64.
fn semi_axes(p: &Projected<f64>) -> (f64, f64) {
    let trace = p.j_s.dot(p.j_s) + p.j_t.dot(p.j_t);
    let determinant = p.j_s.cross(p.j_t).powi(2);
    let major = (0.5 * (trace + (trace * trace - 4.0 * determinant).max(0.0).sqrt())).sqrt();
    (major, determinant.sqrt() / major)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 500,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(1),
        ..ProptestConfig::default()
    })]

    /// h = √½ reaches a pixel centre from anywhere: the disk of radius h around the centre is covered. Perspective
    /// shortens an axis that kept its length by a factor 1 + |a|.
    #[test]
    fn filters_cover_a_pixel_centre(spec in spec(1e-4, 0.05..3.0)) {
        let splat = spec.splat(&UHD);
        prop_assume!(reach(&splat) < 0.5);
        let p = Projected::new(&splat, &UHD);
        let lean = 1.0 + p.slope.length();
        for d in ring(H * (1.0 - 1e-9) / lean) {
            prop_assert!(filter::principal(&p, H, true).footprint.contains(d));
            prop_assert!(filter::ewa(&p, H).footprint.contains(d));
        }
        // `adjust` is made for disks (rendering model §4: slivers remain). Its axes are perpendicular on the screen
        // except for perspective, here up to 47° off.
        let mut round = disk(&spec);
        (round.s, round.t) = filter::adjust_axes(&round, true);
        let p = Projected::new(&round, &UHD);
        prop_assume!(p.slope.length() < 0.5);
        let adjusted = filter::adjust(&p, H, true).footprint;
        for d in ring(0.7 * H / (1.0 + p.slope.length())) {
            prop_assert!(adjusted.contains(d), "{p:?}");
        }
    }

    #[test]
    fn filter_principal_does_not_depend_on_the_pair_of_axes(spec in spec(1e-3, 0.05..30.0), angle in 0.0..7.0f64) {
        let splat = spec.splat(&UHD);
        let (a, b) = (Projected::new(&splat, &UHD), Projected::new(&turned(&splat, angle), &UHD));
        let (major, minor) = semi_axes(&a);
        // If one axis is lengthened and the other not, equal axes don't determine which.
        prop_assume!(reach(&splat) < 0.5 && major - minor > 1e-2 * major);
        prop_assume!((major / H - 1.0).abs() > 1e-6 && (minor / H - 1.0).abs() > 1e-6);
        for projective in [true, false] {
            let (fa, fb) = (filter::principal(&a, H, projective), filter::principal(&b, H, projective));
            prop_assert!((fa.weight_scale / fb.weight_scale - 1.0).abs() < 1e-8);
            for d in ring(major.max(H)) {
                let (ra, rb) = (rho(&fa.footprint, d), rho(&fb.footprint, d));
                prop_assert!(ra == rb || (ra / rb - 1.0).abs() < 1e-7, "{ra} {rb}");
            }
        }
    }

    #[test]
    fn filter_principal_of_a_large_splat_is_none(spec in spec(0.2, 20.0..300.0)) {
        let splat = spec.splat(&UHD);
        let p = Projected::new(&splat, &UHD);
        let (major, minor) = semi_axes(&p);
        prop_assume!(reach(&splat) < 0.5 && minor > H * 1.001 && major - minor > 1e-6 * major);
        let f = filter::principal(&p, H, true);
        let none = Footprint::unfiltered(&p, true);
        prop_assert_eq!(f.weight_scale, 1.0);
        for d in ring(0.7 * minor) {
            prop_assert!((rho(&f.footprint, d) - rho(&none, d)).abs() < 1e-9);
            prop_assert!((f.footprint.w.at(d) - none.w.at(d)).abs() < 1e-9);
        }
    }

    /// Compares the results for an axis just below and just above the filter radius, h·(1 ± 1e-9). None is
    /// discontinuous except the depth slope of the footprint, which a lengthened axis loses.
    #[test]
    fn filters_are_continuous_at_their_threshold(angle in 0.0..7.0f64, turn in 0.0..7.0f64, long in 0.9..30.0f64) {
        let at = |minor: f64| {
            let (u, v) = (V2::new(angle.cos(), angle.sin()), V2::new(-angle.sin(), angle.cos()));
            let s = u * (long * turn.cos()) + v * (minor * turn.sin());
            let t = v * (minor * turn.cos()) - u * (long * turn.sin());
            let zero = V2::new(0.0, 0.0);
            Projected {
                j_s: s, j_t: t, det_j: long * minor, slope: zero, depth_gradient: zero,
                depth_extent: 0.0, facing: -1.0, facing_cosine: 1.0,
            }
        };
        let (below, above) = (at(H * (1.0 - 1e-9)), at(H * (1.0 + 1e-9)));
        let pairs: [(Filtered<f64>, Filtered<f64>); 2] = [
            (filter::principal(&below, H, false), filter::principal(&above, H, false)),
            (filter::ewa(&below, H), filter::ewa(&above, H)),
        ];
        for (a, b) in pairs {
            prop_assert!((a.weight_scale - b.weight_scale).abs() < 1e-8);
            for d in ring(H) {
                prop_assert!((rho(&a.footprint, d) - rho(&b.footprint, d)).abs() < 1e-7);
            }
        }
        prop_assert!((filter::area_ratio(&below, H) - filter::area_ratio(&above, H)).abs() < 1e-8);
    }

    /// Compares with Z01 eq. 6–9 with matrices, at any cutoff.
    #[test]
    fn filter_ewa_is_the_matrix_formula(spec in spec(1e-3, 0.05..50.0), c in 0.5..4.5f64, h in 0.3..2.0f64) {
        let p = Projected::new(&spec.splat(&UHD), &UHD);
        let got = filter::ewa(&p, h);
        let k = 1.0 / (2.0 * c);
        let sigma = h / (2.0 * c).sqrt();
        let (s, t) = (p.j_s, p.j_t);
        let (a, b, d) = (k * (s.x * s.x + t.x * t.x), k * (s.x * s.y + t.x * t.y), k * (s.y * s.y + t.y * t.y));
        let (va, vd) = (a + sigma * sigma, d + sigma * sigma);
        let determinant = va * vd - b * b;
        let weight = (k * k * p.det_j * p.det_j / determinant).sqrt();
        prop_assert!((got.weight_scale / weight - 1.0).abs() < 1e-7);
        for x in ring(0.8 * h) {
            let beta = 0.5 * (vd * x.x * x.x - 2.0 * b * x.x * x.y + va * x.y * x.y) / determinant;
            let rho_squared = rho(&got.footprint, x).powi(2);
            prop_assert!((rho_squared * c - beta).abs() < 1e-7 * beta.max(1e-3), "{} {beta}", rho_squared * c);
        }
    }

    /// Compares with G06 eq. 8 and 9 as printed, with vectors, on disks in front of the eye.
    #[test]
    fn filter_adjust_is_equations_8_and_9(spec in spec(1e-2, 0.1..10.0)) {
        let mut splat = disk(&spec);
        prop_assume!(reach(&splat) < 0.4);
        (splat.s, splat.t) = filter::adjust_axes(&splat, true);
        let lengthened = |a: V3<f64>| {
            let p = splat.p;
            let below = p.z * p.z - a.z * a.z;
            let projected = V2::new(2000.0 * (a.x * p.z - a.z * p.x) / below, 2000.0 * (a.y * p.z - a.z * p.y) / below);
            let length = projected.x.hypot(projected.y);
            if length >= H {
                return (a, (length / H - 1.0).abs());
            }
            let along = projected * (H * p.z / 2000.0 / length);
            (V3::new(along.x, along.y, 0.0), (length / H - 1.0).abs())
        };
        let ((s, near_s), (t, near_t)) = (lengthened(splat.s), lengthened(splat.t));
        prop_assume!(near_s > 1e-9 && near_t > 1e-9);
        let got = filter::adjust(&Projected::new(&splat, &UHD), H, true);
        let center = UHD.pixel(splat.p);
        for (u, v) in [(0.5, 0.0), (0.0, 0.5), (0.4, -0.6), (-0.3, -0.3)] {
            let at = dvec(splat.p) + dvec(s) * u + dvec(t) * v;
            let (gu, gv, w) = got.footprint.at(UHD.pixel(v3(at)) - center);
            prop_assert!((gu / w - u).abs() < 1e-6 && (gv / w - v).abs() < 1e-6, "{u} {v}: {} {}", gu / w, gv / w);
            prop_assert!((w - splat.p.z / at.z).abs() < 1e-6);
        }
    }

    #[test]
    fn filter_area_ratio_is_of_areas(spec in spec(1e-3, 0.05..50.0)) {
        let p = Projected::new(&spec.splat(&UHD), &UHD);
        let (major, minor) = semi_axes(&p);
        let want = (major / H).min(1.0) * (minor / H).min(1.0);
        prop_assert!((filter::area_ratio(&p, H) / want - 1.0).abs() < 1e-6);
        let scale = filter::principal(&p, H, true).weight_scale;
        prop_assert!((scale / want - 1.0).abs() < 1e-6);
    }
}

/// The half-axes of G06 eq. 10 span the same disk, with s across the view direction. Disks with p ∥ n and slivers are
/// valid inputs.
#[test]
fn filter_adjust_axes_span_the_same_disk() {
    let mut random = Random(23);
    for i in 0..3000 {
        let spec = Spec { aspect: if i % 2 == 0 { 1.0 } else { 3.0 }, ..Spec::random(&mut random, 1e-3) };
        let splat = spec.splat(&UHD);
        let (s, t) = filter::adjust_axes(&splat, true);
        let form = |s: V3<f64>, t: V3<f64>| [s.x * s.x + t.x * t.x, s.x * s.y + t.x * t.y, s.z * s.z + t.z * t.z];
        let scale = form(splat.s, splat.t).iter().fold(0.0f64, |a, b| a.max(b.abs()));
        for (a, b) in form(s, t).iter().zip(form(splat.s, splat.t)) {
            assert!((a - b).abs() < 1e-13 * scale.max(1e-30), "{splat:?}");
        }
        assert!(
            (dvec(s.cross(t)) - dvec(splat.s.cross(splat.t))).length() < 1e-12 * dvec(splat.s.cross(splat.t)).length()
        );
        if i % 2 == 0 {
            // An f32 disk is round to 1e-7; for an edge-on disk p × n has that error over the sine of the angle.
            let across = dvec(s).normalize().dot(dvec(splat.p).normalize()).abs();
            assert!(across < 1e-5, "{across}: {splat:?}");
        }
    }
    // A disk that faces the eye exactly: any pair of axes is valid.
    let facing = ViewSplat { p: V3::new(0.0, 0.0, 2.0), s: v3(DVec3::X), t: v3(DVec3::NEG_Y), n: v3(DVec3::NEG_Z) };
    let (s, t) = filter::adjust_axes(&facing, true);
    assert!((dvec(s).length() - 1.0).abs() < 1e-15 && dvec(s).dot(dvec(t)).abs() < 1e-15);
}

/// |t_z| → p_z: the denominator of G06 eq. 8 vanishes and changes sign; ours stays finite and doesn't change such an
/// axis.
#[test]
fn filter_adjust_where_equation_8_divides_by_zero() {
    for tz in [0.999, 1.0 - 1e-12, 1.0, 1.0 + 1e-12] {
        let t = DVec3::new(0.1, 0.0, tz);
        let s = DVec3::new(0.0, 1e-5, 0.0);
        let n = v3(s.cross(t).normalize());
        let splat = ViewSplat { p: V3::new(0.3, 0.2, 1.0), s: v3(s), t: v3(t), n };
        let p = Projected::new(&splat, &UHD);
        let f = filter::adjust(&p, H, true).footprint;
        assert!([f.u.x, f.u.y, f.v.x, f.v.y, f.w.x, f.w.y].iter().all(|c| c.is_finite()), "{tz}: {f:?}");
        // s is lengthened, t isn't: V increases from 0 to 1 along J's second column.
        let (.., w) = f.at(p.j_t);
        assert!((f.v.at(p.j_t) - 1.0).abs() < 1e-9 && (w - (1.0 - tz)).abs() < 1e-9, "{tz}");
    }
    // J's column is 0.6 px long, half the projected diameter 0.6/(1 − ½²) = 0.8 px: long enough.
    let t = DVec3::new(0.6 / 2000.0, 0.0, 0.5);
    let s = DVec3::new(0.0, 0.01, 0.0);
    let splat = ViewSplat { p: V3::new(0.0, 0.0, 1.0), s: v3(s), t: v3(t), n: v3(s.cross(t).normalize()) };
    let p = Projected::new(&splat, &UHD);
    assert_eq!(filter::adjust(&p, H, true).footprint.v, Footprint::unfiltered(&p, true).v);
    // t' = 0, t towards the eye: lengthened perpendicular to s'.
    let p = DVec3::new(0.3, 0.2, 1.0);
    let (s, t) = (DVec3::new(1e-4, 0.0, 0.0), p * 1e-4);
    let splat = ViewSplat { p: v3(p), s: v3(s), t: v3(t), n: v3(s.cross(t).normalize()) };
    let mut projected = Projected::new(&splat, &UHD);
    projected.j_t = V2::new(0.0, 0.0);
    let f = filter::adjust(&projected, H, true).footprint;
    assert!(ring(H * 0.999_999).all(|d| f.contains(d)), "{f:?}");
}

/// Compares filters in f32 with those in f64. Pixel offsets are given, so the differences are the projection's and the
/// filter's own rounding.
#[test]
fn filters_in_f32_agree_with_f64() {
    let mut random = Random(29);
    let mut worst = [0.0f64; 3];
    for _ in 0..4000 {
        let spec = Spec { radius_px: random.log_range(0.05, 100.0), ..Spec::random(&mut random, 1e-2) };
        let splat = spec.splat(&UHD);
        let wide = Projected::new(&splat, &UHD);
        let (major, minor) = semi_axes(&wide);
        // At a threshold, f32 and f64 may decide differently, and for equal axes may lengthen different ones.
        let near = |l: f64| (l / H - 1.0).abs() < 1e-3;
        if reach(&splat) > 0.4 || near(major) || near(minor) || (minor < H && major > H && major < 1.1 * minor) {
            continue;
        }
        let single = Projected::new(&single_splat(&splat), &UHD);
        let pairs = [
            (filter::principal(&wide, H, true), filter::principal(&single, H as f32, true)),
            (filter::ewa(&wide, H), filter::ewa(&single, H as f32)),
        ];
        for (i, (want, got)) in pairs.into_iter().enumerate() {
            for d in ring(0.9 * H).chain(ring(0.5 * minor)) {
                let single_d = V2::new(d.x as f32, d.y as f32);
                let d = common::wide(single_d);
                let (u, v, w) = got.footprint.at(single_d);
                let got_rho = f64::from(u.hypot(v) / w);
                let (a, b) = ((-2.0 * got_rho * got_rho).exp(), (-2.0 * rho(&want.footprint, d).powi(2)).exp());
                worst[i] = worst[i].max((a - b).abs());
            }
            worst[2] = worst[2].max((f64::from(got.weight_scale) / want.weight_scale - 1.0).abs());
        }
    }
    println!("Δw principal {:.1e}, ewa {:.1e}; weight scale {:.1e} relative", worst[0], worst[1], worst[2]);
    // 24 bits minus the loss from an elevation of 1e-2 and an aspect of 10: a weight is precise to 3e-5, far below
    // 1/1024.
    assert!(worst[0] < 5e-5 && worst[1] < 5e-5 && worst[2] < 1e-4, "{worst:?}");
}
