//! Helpers of several tests: images of the reference, and frames with a backend's statistics.

use surfel_conformance::harness::render;
use surfel_conformance::scenes::Case;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Renderer, Stats};

/// Relative error of storing an f64 result in f32: 6e-8, and as much again for the rounding of a closed form itself.
pub(crate) const F32: f64 = 2e-7;

/// Returns the reference's image with all planes and the decision margin.
pub(crate) fn reference_image(case: &Case) -> Frame {
    let planes = Planes::ALL.with_margin(true);
    render(&mut Reference::new(Default::default()).unwrap(), case, planes).unwrap()
}

/// Draws a frame of a resident scene, and returns it with the backend's statistics.
pub(crate) fn frame_and_stats<R: Renderer>(
    renderer: &mut R,
    scene: &R::Scene,
    case: &Case,
    planes: Planes,
) -> (Frame, Stats) {
    let mut frame = Frame::default();
    let stats = renderer.render_into(scene, &case.view(), &case.settings, planes, &mut frame).unwrap();
    (frame, stats)
}

/// Uploads a scene, draws it, and returns the frame with the backend's statistics.
pub(crate) fn drawn_once<R: Renderer>(renderer: &mut R, case: &Case, planes: Planes) -> (Frame, Stats) {
    let scene = renderer.upload(&case.scene).unwrap();
    frame_and_stats(renderer, &scene, case, planes)
}

/// Returns a counter of a frame, if the backend has it.
pub(crate) fn counter(stats: &Stats, name: &str) -> Option<f64> {
    stats.counters.iter().find(|counter| counter.0 == name).map(|counter| counter.1)
}
