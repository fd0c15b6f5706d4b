//! Tests of splats around the eye and through z_near: boxes and the exact mapping against sampled rays.

use crate::common;

use common::{Random, dvec, v3};
use glam::DVec3;
use surfel_math::V2;
use surfel_math::basis::orthonormal;
use surfel_math::bounds::through_near;
use surfel_math::mapping;
use surfel_math::project::ViewSplat;
use surfel_math::projection::{Projection, ProjectionKind};

const VIEW: Projection =
    Projection { kind: ProjectionKind::Perspective, focal_px: [500.0, 450.0], principal_px: [320.0, 200.0], near: 0.1 };

fn splat(random: &mut Random) -> ViewSplat<f64> {
    let mut direction = || {
        let (z, a) = (random.range(-1.0, 1.0), random.range(0.0, std::f64::consts::TAU));
        DVec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z)
    };
    let (place, normal) = (direction(), direction());
    let p = place * random.range(0.0, 2.0);
    let (s, t) = orthonormal(normal);
    let (a, b) = (random.log_range(0.05, 3.0), random.log_range(0.05, 3.0));
    ViewSplat { p: v3(p), s: v3(s * a), t: v3((t + s * 0.3) * b), n: v3(normal) }
}

fn point(splat: &ViewSplat<f64>, u: f64, v: f64) -> DVec3 {
    dvec(splat.p) + dvec(splat.s) * u + dvec(splat.t) * v
}

#[test]
fn near_plane_box_holds_every_hit_beyond_it_and_no_more() {
    let mut random = Random(1);
    let (mut empty, mut behind, mut inside, mut crossing) = (0, 0, 0, 0);
    for _ in 0..3000 {
        let splat = splat(&mut random);
        let e = splat.s.z.hypot(splat.t.z);
        behind += u32::from(splat.p.z <= 0.0);
        inside += u32::from(dvec(splat.p).length() < 0.3);
        // Hits beyond the near plane: rim points, and the points at which z_near cuts between two of them.
        let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut hit = |at: DVec3| {
            let pixel = VIEW.pixel(v3(at));
            for (i, c) in [pixel.x, pixel.y].into_iter().enumerate() {
                (min[i], max[i]) = (min[i].min(c), max[i].max(c));
            }
        };
        let steps = 2000;
        let mut last = point(&splat, 1.0, 0.0);
        let (mut any, mut any_behind) = (false, false);
        for i in 1..=steps {
            let (v, u) = (std::f64::consts::TAU * f64::from(i) / f64::from(steps)).sin_cos();
            let next = point(&splat, u, v);
            if (next.z >= VIEW.near) != (last.z >= VIEW.near) {
                // The chord of the disk through the cut is in the near plane.
                let cut = last.lerp(next, (VIEW.near - last.z) / (next.z - last.z));
                hit(cut.with_z(VIEW.near));
            }
            if next.z >= VIEW.near {
                hit(next);
                any = true;
            } else {
                any_behind = true;
            }
            last = next;
        }
        crossing += u32::from(any && any_behind);
        let Some(extent) = through_near(&splat, &VIEW) else {
            empty += 1;
            assert!(!any, "{splat:?} is in front");
            continue;
        };
        let sides = [[extent.min.x, extent.max.x], [extent.min.y, extent.max.y]];
        for (axis, [lo, hi]) in sides.into_iter().enumerate() {
            assert!(lo.is_finite() && hi.is_finite() && lo <= hi, "{splat:?}: {extent:?}");
            if !any {
                continue;
            }
            // Sampled cut points may be inside the exact chord's ends by the error of a step, but outside only by
            // rounding.
            let slack = 1e-9 * (1.0 + lo.abs() + hi.abs());
            assert!(min[axis] >= lo - slack && max[axis] <= hi + slack, "{splat:?}: {extent:?} {min:?} {max:?}");
            // A cap narrower than a step is sampled badly.
            if splat.p.z + e > VIEW.near + 1e-3 * e {
                let waste = (min[axis] - lo).max(hi - max[axis]);
                assert!(waste <= 0.01 * (hi - lo) + 1e-6, "{splat:?}: {extent:?} {min:?} {max:?}");
            }
        }
    }
    assert!(empty > 100 && behind > 500 && inside > 200 && crossing > 500, "{empty} {behind} {inside} {crossing}");
}

#[test]
fn near_plane_mapping_gives_back_the_point_and_nothing_behind_the_eye() {
    let mut random = Random(2);
    let (mut front, mut back) = (0, 0);
    for _ in 0..20_000 {
        let splat = splat(&mut random);
        let (u, v) = (random.range(-1.0, 1.0), random.range(-1.0, 1.0));
        let at = point(&splat, u, v);
        let distance = dvec(splat.n).dot(dvec(splat.p)).abs();
        if distance < 1e-3 || at.z.abs() < 1e-2 {
            continue;
        }
        let mapped = mapping::through_near(&splat, &VIEW);
        let d = VIEW.pixel(v3(at)) - mapped.anchor_px;
        let (got_u, got_v, w) = mapped.footprint.at(d);
        assert_eq!(w > 0.0, at.z > 0.0, "{splat:?} at {u}, {v}: W = {w}, z = {}", at.z);
        if at.z < 0.0 {
            back += 1;
            assert!(!mapped.footprint.contains(d));
            continue;
        }
        front += 1;
        // f64 rounding over the plane's distance from the eye, at least 1e-3.
        let error = (got_u / w - u).abs().max((got_v / w - v).abs()).max((mapped.depth_scale / w - at.z).abs());
        assert!(error < 1e-9, "{splat:?} at {u}, {v}: {error}");
    }
    assert!(front > 5000 && back > 5000, "{front} {back}");
}

#[test]
fn near_plane_splats_behind_or_of_no_extent_are_safe() {
    let disk = |z: f64, r: f64| ViewSplat {
        p: v3(DVec3::new(0.1, 0.0, z)),
        s: v3(DVec3::X * r),
        t: v3(DVec3::Y * r),
        n: v3(DVec3::Z),
    };
    assert_eq!(through_near(&disk(0.05, 1.0), &VIEW), None);
    assert_eq!(through_near(&disk(-5.0, 1.0), &VIEW), None);
    // Parallel to the screen, exactly at z_near: the whole disk counts.
    let extent = through_near(&disk(0.1, 0.1), &VIEW).unwrap();
    assert!((extent.min.x - 320.0).abs() < 1e-9 && (extent.max.x - 1320.0).abs() < 1e-9, "{extent:?}");
    // The eye in the disk's plane, or at its centre: no NaN.
    for p in [DVec3::ZERO, DVec3::new(0.0, 0.2, 0.0), DVec3::new(0.0, 0.0, 0.5)] {
        let splat = ViewSplat { p: v3(p), s: v3(DVec3::Z), t: v3(DVec3::Y), n: v3(DVec3::X) };
        let mapped = mapping::through_near(&splat, &VIEW);
        let (u, v, w) = mapped.footprint.at(V2::new(3.0, 4.0));
        assert!(u.is_finite() && v.is_finite() && w.is_finite());
        if let Some(b) = through_near(&splat, &VIEW) {
            assert!([b.min.x, b.max.x, b.min.y, b.max.y].iter().all(|c| c.is_finite()), "{b:?}");
        }
    }
}
