//! Tests of boxes against exact arithmetic: no covered pixel outside, no waste; and a failure of the published form.

use crate::common;

use common::{Exact, Q, Random, Spec, UHD, q, ray_coordinate, reach, single_splat};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use surfel_math::bounds::{self, Extent};
use surfel_math::filter;
use surfel_math::mapping::Footprint;
use surfel_math::project::{Projected, ViewSplat};
use surfel_math::{Real, V2};

/// Margin by which a backend grows an f32 box, in px: projecting s and t to 900 px rounds by a few times 900·2^-23.
const SLACK_F32: f64 = 2e-3;
/// Largest distance, in px, by which a box may exceed its ellipse on each side.
const EXCESS: f64 = 0.01;

/// Returns the corners of a box as exact pixel coordinates: [min, max] by axis.
fn corners<R: Real + Into<f64>>(extent: Extent<R>, anchor: [&Q; 2]) -> [[Q; 2]; 2] {
    let at = |v: R, axis: usize| q(v.into()) + anchor[axis];
    [[at(extent.min.x, 0), at(extent.max.x, 0)], [at(extent.min.y, 1), at(extent.max.y, 1)]]
}

/// Asserts that the ellipse ends at most `slack` outside and `EXCESS` inside each side of its box.
fn assert_tight(exact: &Exact, sides: &[[Q; 2]; 2], slack: f64) -> Result<(), TestCaseError> {
    for (axis, [min, max]) in sides.iter().enumerate() {
        let meets = |pixel: Q| exact.meets(axis, &ray_coordinate(&pixel, axis, &UHD));
        prop_assert!(!meets(max + q(slack)) && !meets(min - q(slack)), "a covered pixel is outside, axis {axis}");
        let inset = q(EXCESS + slack);
        if max - min > &inset + &inset {
            prop_assert!(meets(max - &inset) && meets(min + &inset), "more than {EXCESS} px wasted, axis {axis}");
        }
    }
    Ok(())
}

/// Returns the exact projected centre.
fn exact_center(splat: &ViewSplat<f64>) -> [Q; 2] {
    let at = |v: f64, axis: usize| q(v) / q(splat.p.z) * q(UHD.focal_px[axis]) + q(UHD.principal_px[axis]);
    [at(splat.p.x, 0), at(splat.p.y, 1)]
}

fn spec() -> impl Strategy<Value = Spec> {
    any::<u64>().prop_map(|seed| Spec::random(&mut Random(seed), 1e-4))
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 400,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(1),
        ..ProptestConfig::default()
    })]

    #[test]
    fn bounds_of_the_unfiltered_splat_hold_it_tightly(spec in spec()) {
        let splat = spec.splat(&UHD);
        prop_assume!(reach(&splat) < 0.5);
        let exact = Exact::new(&splat);
        let center = exact_center(&splat);
        let in_f64 = bounds::unfiltered(&Projected::new(&splat, &UHD), true);
        assert_tight(&exact, &corners(in_f64, [&center[0], &center[1]]), 1e-9)?;
        let single = single_splat(&splat);
        let base = V2::new(spec.pixel[0].floor() as f32, spec.pixel[1].floor() as f32);
        let offset = UHD.offset_from(single.p, base);
        let in_f32 = bounds::unfiltered(&Projected::new(&single, &UHD), true);
        let anchor = [q(f64::from(base.x)) + q(f64::from(offset.x)), q(f64::from(base.y)) + q(f64::from(offset.y))];
        assert_tight(&exact, &corners(in_f32, [&anchor[0], &anchor[1]]), SLACK_F32)?;
    }

    /// Tests the box of the f32 forms themselves, against which fragments are tested: the exact conic of those f32
    /// numbers.
    #[test]
    fn bounds_of_a_filtered_footprint_hold_its_own_forms(spec in spec(), h in 0.3..2.0f64) {
        let splat = spec.splat(&UHD);
        prop_assume!(reach(&splat) < 0.5);
        let projected = Projected::new(&single_splat(&splat), &UHD);
        for f in [filter::principal(&projected, h as f32, true), filter::ewa(&projected, h as f32)] {
            let extent = bounds::footprint(&f.footprint);
            let sides = [[extent.min.x, extent.max.x], [extent.min.y, extent.max.y]];
            for (axis, [min, max]) in sides.into_iter().enumerate() {
                let (min, max) = (f64::from(min), f64::from(max));
                // A few roundings of the longer side, twice as large with a perspective slope of ½.
                let slack = 2e-6 * (max - min) + 1e-6;
                prop_assert!(!form_meets(&f.footprint, axis, max + slack), "covered beyond {max}");
                prop_assert!(!form_meets(&f.footprint, axis, min - slack), "covered before {min}");
                let inset = slack + 1e-5 * (max - min);
                prop_assert!(form_meets(&f.footprint, axis, max - inset));
                prop_assert!(form_meets(&f.footprint, axis, min + inset));
            }
        }
    }
}

/// True if the conic of f32 forms meets the line at pixel offset `value` along `axis`, exactly.
fn form_meets(f: &Footprint<f32>, axis: usize, value: f64) -> bool {
    let forms = [f.u, f.v, f.w].map(|l| [l.x, l.y, l.c].map(|v| q(f64::from(v))));
    let value = q(value);
    let along = forms.each_ref().map(|l| l[1 - axis].clone());
    let constant = forms.each_ref().map(|l| &l[axis] * &value + &l[2]);
    let form = |a: &[Q; 3], b: &[Q; 3]| &a[0] * &b[0] + &a[1] * &b[1] - &a[2] * &b[2];
    let (a, b, c) = (form(&along, &along), form(&along, &constant), form(&constant, &constant));
    &b * &b >= a * c
}

/// Computes Sigg 2006's dual conic in pixel coordinates, as published and as 2DGS and gsplat compute it, in f32.
fn naive(splat: &ViewSplat<f32>) -> Option<[[f32; 2]; 2]> {
    let row = |focal: f64, center: f64, axis: fn(&surfel_math::V3<f32>) -> f32| {
        let at = |v: &surfel_math::V3<f32>| focal as f32 * axis(v) + center as f32 * v.z;
        [at(&splat.s), at(&splat.t), at(&splat.p)]
    };
    let tx = row(UHD.focal_px[0], UHD.principal_px[0], |v| v.x);
    let ty = row(UHD.focal_px[1], UHD.principal_px[1], |v| v.y);
    let tw = [splat.s.z, splat.t.z, splat.p.z];
    let form = |a: &[f32; 3], b: &[f32; 3]| a[0] * b[0] + a[1] * b[1] - a[2] * b[2];
    let d = form(&tw, &tw);
    let side = |t: &[f32; 3]| {
        let center = form(t, &tw) / d;
        let square = center * center - form(t, t) / d;
        (square > 0.0).then(|| [center - square.sqrt(), center + square.sqrt()])
    };
    Some([side(&tx)?, side(&ty)?])
}

#[test]
fn bounds_published_form_breaks_where_ours_does_not() {
    let mut random = Random(2006);
    println!("radius px: published form fails, worst error px | ours worst error px");
    for (radius_px, least_failures, least_error) in
        [(0.1, 0.3, 0.5), (0.5, 0.15, 0.5), (2.0, 0.0, 0.3), (10.0, 0.0, 0.1), (100.0, 0.0, 0.01)]
    {
        let (mut failures, mut worst, mut ours, count) = (0, 0.0f64, 0.0f64, 4000);
        for _ in 0..count {
            let spec = Spec { radius_px, aspect: 1.0, ..Spec::random(&mut random, 0.5) };
            let splat = spec.splat(&UHD);
            let single = single_splat(&splat);
            let truth = bounds::unfiltered(&Projected::new(&splat, &UHD), true);
            let center = UHD.pixel(splat.p);
            let base = V2::new(spec.pixel[0].floor() as f32, spec.pixel[1].floor() as f32);
            let offset = common::wide(UHD.offset_from(single.p, base));
            let got = bounds::unfiltered(&Projected::new(&single, &UHD), true);
            let anchor = [f64::from(base.x) + offset.x, f64::from(base.y) + offset.y];
            let truths =
                [truth.min.x + center.x, truth.max.x + center.x, truth.min.y + center.y, truth.max.y + center.y];
            let gots = [got.min.x, got.max.x, got.min.y, got.max.y].map(f64::from);
            for (i, (g, t)) in gots.iter().zip(truths).enumerate() {
                ours = ours.max((g + anchor[i / 2] - t).abs());
            }
            match naive(&single) {
                Some(sides) => {
                    for (g, t) in sides.as_flattened().iter().zip(truths) {
                        worst = worst.max((f64::from(*g) - t).abs());
                    }
                }
                None => failures += 1,
            }
        }
        let rate = f64::from(failures) / f64::from(count);
        println!("{radius_px}: {:.1} %, {worst:.3} | {ours:.2e}", 100.0 * rate);
        assert!(rate >= least_failures && worst > least_error, "{radius_px}: {rate} {worst}");
        assert!(ours < SLACK_F32, "{radius_px}: {ours}");
    }
}
