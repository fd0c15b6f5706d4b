//! What several topics draw with: images of the reference, and frames with what a backend says of them.

use surfel_conformance::harness::render;
use surfel_conformance::scenes::Case;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Renderer, Stats};

/// What storing an f64 result in f32 costs, relative: 6e-8, and as much again for what a closed form itself rounds.
pub(crate) const F32: f64 = 2e-7;

/// The reference's image, all planes and the decision margin.
pub(crate) fn reference_image(case: &Case) -> Frame {
    let planes = Planes::ALL.with_margin(true);
    render(&mut Reference::new(Default::default()).unwrap(), case, planes).unwrap()
}

/// A frame of a resident scene, and what the backend says of it.
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

/// The same of a scene that is uploaded for it.
pub(crate) fn drawn_once<R: Renderer>(renderer: &mut R, case: &Case, planes: Planes) -> (Frame, Stats) {
    let scene = renderer.upload(&case.scene).unwrap();
    frame_and_stats(renderer, &scene, case, planes)
}

/// A counter of a frame, where the backend has it.
pub(crate) fn counter(stats: &Stats, name: &str) -> Option<f64> {
    stats.counters.iter().find(|counter| counter.0 == name).map(|counter| counter.1)
}
