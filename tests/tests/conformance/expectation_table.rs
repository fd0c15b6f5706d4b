//! Tests of the table of expectations: an entry allows its limits only, and has to be needed.

use surfel_conformance::backends::Backend;
use surfel_conformance::expectations::{EXPECTATIONS, Expectation, Extent, apply};
use surfel_conformance::harness::{Plane, Report, Verdict, compare_frames};
use surfel_conformance::scenes;
use surfel_render::{Capabilities, Frame, Planes, RendererInfo};

const ENTRY: Expectation = Expectation {
    backend: Backend::Wgpu,
    adapter: "llvmpipe",
    scene: "scene",
    plane: Plane::Weight,
    factor: 3.0,
    because: "it rounds",
};

fn info(backend: &'static str, adapter: &str) -> RendererInfo {
    let capabilities = Capabilities::everything(backend);
    RendererInfo { backend, adapter: adapter.into(), driver: String::new(), threads: 0, capabilities }
}

/// Returns a report on `scene` with these errors of weight and colour, in tolerances, in one pixel each.
fn report(scene: &str, weight: f32, color: f32) -> Report {
    let mut want = Frame::default();
    want.reset(8, 8, Planes::COLOR.with_color(true).with_weight(true));
    let mut got = want.clone();
    // The reference is zero there, so that the tolerance is the absolute one.
    got.weight_mut()[9] = 2e-4 * weight;
    got.color_mut()[20][2] = 2e-4 * color;
    compare_frames(scene, &got, &want, &[0.0; 64])
}

/// Returns the verdict on a report under a table, and the messages about unused entries.
fn under(table: &[Expectation], info: &RendererInfo, mut report: Report) -> (Verdict, Vec<String>) {
    let unused = apply(table, info, Extent::EveryScene, [&mut report]);
    (report.verdict, unused.iter().map(ToString::to_string).collect())
}

fn is_failure(verdict: &Verdict) -> bool {
    matches!(verdict, Verdict::Failed(_))
}

#[test]
fn expectation_allows_its_plane_up_to_its_factor() {
    let llvmpipe = info("wgpu", "LLVMpipe (256 bits)");
    assert!(is_failure(&under(&[], &llvmpipe, report("scene", 2.5, 0.0)).0));
    let expected = Verdict::Expected("it rounds".into());
    assert_eq!(under(&[ENTRY], &llvmpipe, report("scene", 2.5, 0.5)), (expected.clone(), vec![]));
    assert!(is_failure(&under(&[ENTRY], &llvmpipe, report("scene", 3.5, 0.0)).0));
    assert!(is_failure(&under(&[ENTRY], &llvmpipe, report("scene", 2.5, 1.5)).0));
    let both = [ENTRY, Expectation { plane: Plane::Color, because: "it rounds colours", ..ENTRY }];
    let expected = Verdict::Expected("it rounds; it rounds colours".into());
    assert_eq!(under(&both, &llvmpipe, report("scene", 2.5, 1.5)), (expected, vec![]));
    let everywhere = [Expectation { adapter: "", ..ENTRY }];
    assert!(!is_failure(&under(&everywhere, &info("wgpu", "any"), report("scene", 2.5, 0.0)).0));
}

#[test]
fn expectation_is_of_one_backend_adapter_and_scene() {
    for (backend, adapter, scene) in
        [("ash", "llvmpipe", "scene"), ("wgpu", "SwiftShader", "scene"), ("wgpu", "llvmpipe", "scene/other")]
    {
        let (verdict, _) = under(&[ENTRY], &info(backend, adapter), report(scene, 2.5, 0.0));
        assert!(is_failure(&verdict), "{backend} {adapter} {scene}");
    }
}

#[test]
fn expectation_that_passes_unexpectedly_fails() {
    let (verdict, unused) = under(&[ENTRY], &info("wgpu", "llvmpipe"), report("scene", 0.5, 0.0));
    let Verdict::Failed(why) = verdict else { panic!("{verdict:?}") };
    assert!(why.contains("wgpu on 'llvmpipe', scene, plane weight") && why.contains("remove"), "{why}");
    assert!(unused.is_empty());
}

#[test]
fn expectation_that_nothing_uses_fails() {
    let llvmpipe = info("wgpu", "llvmpipe");
    let misspelt = [Expectation { scene: "scnee", ..ENTRY }];
    let (_, unused) = under(&misspelt, &llvmpipe, report("scene", 0.0, 0.0));
    assert!(unused.len() == 1 && unused[0].contains("scnee"), "{unused:?}");
    // A plane that wasn't drawn, and the second of two entries for the same place.
    let absent = [Expectation { plane: Plane::Normal, ..ENTRY }];
    assert_eq!(under(&absent, &llvmpipe, report("scene", 0.0, 0.0)).1.len(), 1);
    assert_eq!(under(&[ENTRY, ENTRY], &llvmpipe, report("scene", 2.5, 0.0)).1.len(), 1);
    // Nothing is known about other adapters, nor about scenes that weren't drawn.
    assert!(under(&misspelt, &info("wgpu", "other"), report("scene", 0.0, 0.0)).1.is_empty());
    assert!(apply(&misspelt, &llvmpipe, Extent::SomeScenes, [&mut report("scene", 0.0, 0.0)]).is_empty());
}

#[test]
fn expectation_excuses_no_nan_and_no_missing_plane() {
    let llvmpipe = info("wgpu", "llvmpipe");
    let generous = [Expectation { factor: f64::INFINITY, ..ENTRY }];
    assert!(is_failure(&under(&generous, &llvmpipe, report("scene", f32::NAN, 0.0)).0));
    assert!(!is_failure(&under(&generous, &llvmpipe, report("scene", f32::INFINITY, 0.0)).0));
}

#[test]
fn expectations_are_of_scenes_that_exist_and_say_why() {
    let scenes = scenes::all();
    for entry in EXPECTATIONS {
        assert!(scenes.iter().any(|case| case.name == entry.scene), "{entry:?}");
        assert!(entry.factor > 1.0 && entry.factor.is_finite() && !entry.because.is_empty(), "{entry:?}");
    }
}
