//! Each splat goes to the cheapest evaluator that is right for it: which one, at the limits, and that its error is bound.

use glam::DVec3;
use surfel_conformance::build::{Splat, camera, scene};
use surfel_conformance::harness::reference_frame;
use surfel_conformance::scenes::Case;
use surfel_cpu::{Evaluation, Options, Renderer as Cpu, Work};
use surfel_model::{Camera, Filter, Projection};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Preset, Renderer, Stats};

/// Largest share of its distance by which the depth of a splat may vary that has a reciprocal by three terms.
const DEPTH_LIMIT: f64 = 1.0 / 64.0;
/// The same a pixel.
const STEEPNESS_LIMIT: f64 = 1.0 / 200.0;
/// What three terms are off by, relative, with the reach of a filter: docs/accuracy.md. Of a disk alone it is (1/63)⁴ = 6.4e-8.
const RECIPROCAL: f64 = 5e-7;
/// Steepest change of a weight by the relative change of w: of e^(−2ρ²), ρ² ∝ w⁻².
const PER_RECIPROCAL: f64 = 0.736;

const FOCAL_PX: f64 = 300.0;
const Z: f64 = 4.0;

/// A splat in the middle of the picture whose depth varies by `extent` of its distance and by `steepness` a pixel along its slope, and whose axis
/// across that is `across_px`, or the same as the other one.
fn tilted(extent: f64, steepness: f64, across_px: Option<f64>) -> Case {
    let tilt = (steepness * FOCAL_PX).atan();
    let radius = extent * Z / tilt.sin();
    // A little turned, so that nothing is zero.
    let turn = |v: DVec3| DVec3::new(v.x * 0.8 - v.y * 0.6, v.x * 0.6 + v.y * 0.8, v.z);
    let splat = Splat {
        p: DVec3::new(0.003, -0.002, 0.0),
        s: turn(DVec3::new(tilt.cos(), 0.0, tilt.sin()) * radius),
        t: turn(DVec3::Y * across_px.map_or(radius, |px| px * Z / FOCAL_PX)),
        color: [0.7, 0.4, 0.2],
    };
    let projection = Projection::Intrinsics { fx: FOCAL_PX, fy: FOCAL_PX, cx: 80.0, cy: 80.0 };
    let camera = Camera { projection, ..camera(Z, 45.0, [160, 160]) };
    Case::new("tilted", scene(&[splat]), camera)
}

/// The steepness along the slope whose gradients along both coordinates add up to this: that sum is what is limited, and turned as
/// the splat is, it is more than along the slope alone.
fn along(steepness: f64) -> f64 {
    steepness / (0.8 + 0.6)
}

fn cpu(evaluation: Evaluation) -> Cpu {
    let work = Work { evaluation, counts_evaluators: true, ..Work::default() };
    Cpu::with_options(&Options { threads: 1, work, ..Options::default() }).unwrap()
}

fn draw(cpu: &mut Cpu, case: &Case) -> (Frame, Stats) {
    let (resident, mut frame) = (cpu.upload(&case.scene).unwrap(), Frame::default());
    let stats = cpu.render(&resident, &case.view(), &case.settings, Planes::ALL, &mut frame).unwrap();
    (frame, stats)
}

/// The evaluators that have a record.
fn evaluators(stats: &Stats) -> Vec<&'static str> {
    let counters = stats.counters.iter().filter(|(name, count)| name.starts_with("records_") && *count > 0.0);
    counters.map(|(name, _)| name.trim_start_matches("records_")).collect()
}

#[test]
fn evaluator_is_the_cheapest_one_up_to_its_limits_and_another_beyond() {
    let mut cpu = cpu(Evaluation::Cheapest);
    let gentle = along(STEEPNESS_LIMIT / 10.0);
    for (case, wanted) in [
        (tilted(0.98 * DEPTH_LIMIT, gentle, None), "shallow"),
        (tilted(1.02 * DEPTH_LIMIT, gentle, None), "plain"),
        (tilted(0.7 * DEPTH_LIMIT, along(0.98 * STEEPNESS_LIMIT), None), "shallow"),
        (tilted(0.7 * DEPTH_LIMIT, along(1.02 * STEEPNESS_LIMIT), None), "plain"),
        // Thinner than h: filtered.
        (tilted(0.98 * DEPTH_LIMIT, gentle, Some(0.3)), "soft"),
        (tilted(1.02 * DEPTH_LIMIT, gentle, Some(0.3)), "general"),
        // From half of its distance on.
        (tilted(0.51, along(0.02), None), "near"),
    ] {
        let (_, stats) = draw(&mut cpu, &case);
        assert_eq!(evaluators(&stats), [wanted]);
    }
    let plain = tilted(0.5 * DEPTH_LIMIT, gentle, None);
    let (_, stats) = draw(&mut self::cpu(Evaluation::General), &plain);
    assert_eq!(evaluators(&stats), ["general"]);
}

#[test]
fn evaluators_err_by_no_more_than_their_bound_at_their_limits() {
    let (mut cheapest, mut general) = (cpu(Evaluation::Cheapest), cpu(Evaluation::General));
    let mut reference = Reference::new(0).unwrap();
    let mut compared = 0;
    for steepness in [0.1, 0.4, 0.98].map(|share| along(share * STEEPNESS_LIMIT)) {
        for share in [0.5, 0.98] {
            for across_px in [None, Some(0.3), Some(1.2)] {
                for filter in [Filter::Principal, Filter::None, Filter::Adjust, Filter::Ewa] {
                    let case = tilted(share * DEPTH_LIMIT, steepness, across_px).with("limit", |s| s.filter = filter);
                    let want = reference_frame(&mut reference, &case).unwrap();
                    for cpu in [&mut cheapest, &mut general] {
                        let (got, stats) = draw(cpu, &case);
                        let drawn_by = evaluators(&stats);
                        let major_px = share * DEPTH_LIMIT / steepness;
                        let minor_px = across_px.unwrap_or(major_px).min(major_px).max(0.3);
                        // The law of `cargo xtask stability`, and the kernel polynomial's and the planes' own 2e-6.
                        let major_px = major_px.max(across_px.unwrap_or(0.0));
                        let rounding = 2.213 * 16.0 * (major_px + 1.0) / minor_px / f64::from(1u32 << 24) + 2e-6;
                        for i in 0..want.weight.len() {
                            if want.margin[i] != 0.0 || want.weight[i] == 0.0 {
                                continue;
                            }
                            let at = format!("{drawn_by:?} {filter:?} {share} {steepness} {across_px:?}, pixel {i}");
                            let weight = f64::from(got.weight[i] - want.weight[i]).abs();
                            let bound = PER_RECIPROCAL * RECIPROCAL + rounding;
                            assert!(weight <= bound, "{at}: weight off by {weight:e}, bound {bound:e}");
                            let depth = f64::from((got.depth[i] - want.depth[i]) / want.depth[i]).abs();
                            let bound = RECIPROCAL + 16.0 / f64::from(1u32 << 24);
                            assert!(depth <= bound, "{at}: depth off by {depth:e}, bound {bound:e}");
                            compared += 1;
                        }
                    }
                }
            }
        }
    }
    assert!(compared > 10_000, "{compared} pixels compared");
    // So no preset asks for more than that.
    let db = -20.0 * (PER_RECIPROCAL * RECIPROCAL).log10();
    assert!(Preset::ALL.iter().all(|preset| preset.promise().fidelity_db < db - 30.0), "{db} dB");
}
