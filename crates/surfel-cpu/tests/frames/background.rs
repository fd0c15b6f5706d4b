//! Tests that tiles with the background alone aren't written again, and that images are the same nevertheless.

use crate::scenes::{specks, view, walls};
use surfel_cpu::{Options, Renderer};
use surfel_model::{EdgeAa, Scene, Settings, Shader};
use surfel_render::{Frame, Planes, Renderer as _};

const MARK: [f32; 4] = [7.0; 4];

fn renderer() -> Renderer {
    Renderer::new(Options::default().with_threads(2)).unwrap()
}

#[test]
fn frames_drawn_over_others_are_those_drawn_afresh() {
    let mut renderer = renderer();
    let mut frame = Frame::default();
    let small = specks(0.02);
    let colored = Scene { background: [0.1, 0.2, 0.3, 1.0], ..small.clone() };
    let scenes = [small, walls(), colored].map(|scene| renderer.upload(&scene).unwrap());
    let plain = Settings::default();
    let edges = Settings::default().with_shader(Shader::Toon).with_edge_aa(EdgeAa::Coverage);
    for (settings, planes) in [(&plain, Planes::COLOR), (&edges, Planes::COLOR), (&plain, Planes::ALL)] {
        for (size, near) in [([150, 100], 0.1), ([150, 100], 3.2), ([100, 150], 0.1)] {
            let view = view(size, near);
            // Each scene after each other one, and after itself.
            for i in [0, 0, 1, 0, 2, 2, 1, 2, 0] {
                let mut fresh = Frame::default();
                renderer.render_into(&scenes[i], &view, settings, planes, &mut fresh).unwrap();
                renderer.render_into(&scenes[i], &view, settings, planes, &mut frame).unwrap();
                assert!(frame == fresh, "{size:?}, {near}, {settings:?}, {planes:?}, {i}");
            }
            frame.color_mut().fill(MARK);
        }
    }
}

#[test]
fn tiles_of_background_are_not_written_again() {
    let (mut renderer, view) = (renderer(), view([150, 100], 0.1));
    let resident = renderer.upload(&specks(0.02)).unwrap();
    let mut frame = Frame::default();
    let settings = Settings::default();
    renderer.render_into(&resident, &view, &settings, Planes::COLOR, &mut frame).unwrap();
    // A change that the frame doesn't notice.
    frame.planes_and_background().0.color[0] = MARK;
    renderer.render_into(&resident, &view, &settings, Planes::COLOR, &mut frame).unwrap();
    assert_eq!(frame.color()[0], MARK);
    // A method that resets the flags of background tiles.
    frame.color_mut()[1] = MARK;
    renderer.render_into(&resident, &view, &settings, Planes::COLOR, &mut frame).unwrap();
    assert!(frame.color()[..2].iter().all(|color| *color != MARK));
}
