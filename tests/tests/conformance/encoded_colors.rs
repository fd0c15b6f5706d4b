//! Tests that 8-bit colours are bit-identical to those of a PNG of the colours, on every backend.

use surfel_conformance::scenes::{self, Case};
use surfel_math::srgb::encode_rgba8;
use surfel_model::{EdgeAa, Shader};
use surfel_render::{Frame, Planes, Region, Renderer, View};

/// Returns all scenes, and three with passes that read neighbouring pixels.
fn cases() -> Vec<Case> {
    let mut cases = scenes::all();
    cases.push(scenes::thin_shell().with("samples", |s| s.edge_aa = EdgeAa::Samples));
    cases.push(scenes::thin_shell().with("edl", |s| s.shader = Shader::Edl));
    cases.push(scenes::thin_shell().with("toon", |s| s.shader = Shader::Toon));
    cases
}

/// Compares 8-bit colours with a backend's own colours, in every `step`th scene that it draws.
fn agrees(renderer: &mut impl Renderer, step: usize) {
    let capabilities = renderer.info().capabilities;
    let mut frame = Frame::default();
    let (mut count, mut pixels) = (0, 0);
    for case in cases().iter().filter(|case| case.is_drawn_by(&capabilities)).step_by(step) {
        let resident = renderer.upload(&case.scene).unwrap();
        let whole = case.view();
        let Region { x, y, width, height } = whole.region;
        let part = Region { x: x + width / 3, y: y + height / 4, width: width / 2, height: height / 2 };
        for view in [whole.clone(), View { region: part, ..whole }] {
            let mut draw = |planes: Planes, frame: &mut Frame| {
                renderer.render_into(&resident, &view, &case.settings, planes, frame).unwrap();
            };
            let mut plain = Frame::default();
            draw(Planes::COLOR, &mut plain);
            assert!(plain.rgba8().is_empty(), "{}: drawn though nobody asks", case.name);
            let want: Vec<_> = plain.color().iter().copied().map(encode_rgba8).collect();
            // Twice: over another image, and over the same image.
            for _ in 0..2 {
                draw(Planes::RGBA8, &mut frame);
                assert!(frame.color().is_empty(), "{}: colours are kept though nobody asks", case.name);
                let wrong = frame.rgba8().iter().zip(&want).position(|(got, want)| got != want);
                assert_eq!((wrong, frame.rgba8().len()), (None, want.len()), "{}", case.name);
            }
            draw(Planes::RGBA8.with_color(true).with_depth(true), &mut frame);
            assert!(frame.rgba8() == want && frame.color() == plain.color(), "{}: beside others", case.name);
            pixels += want.len();
        }
        count += 1;
    }
    println!("{count} scenes, {pixels} pixels");
    assert!(count * step >= 40);
}

#[test]
fn cpu_encodes_its_colors() {
    agrees(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), 1);
}

#[test]
fn reference_encodes_its_colors() {
    agrees(&mut surfel_reference::Renderer::new(Default::default()).unwrap(), 20);
}

#[test]
fn wgpu_encodes_its_colors() {
    if let Some(mut renderer) = crate::validated_gpu::wgpu() {
        agrees(&mut renderer, 40);
        crate::validated_gpu::no_messages();
    }
}

#[test]
fn ash_encodes_its_colors() {
    if let Some(mut renderer) = crate::validated_gpu::ash() {
        agrees(&mut renderer, 40);
    }
}

#[test]
fn averaged_samples_are_encoded_after_they_are_averaged() {
    let case = scenes::thin_shell();
    let mut renderer = surfel_reference::Renderer::new(Default::default()).unwrap();
    let resident = renderer.upload(&case.scene).unwrap();
    let mut draw = |planes| {
        let mut frame = Frame::default();
        renderer.render_supersampled(&resident, &case.view(), &case.settings, planes, 2, &mut frame).unwrap();
        frame
    };
    let (plain, encoded) = (draw(Planes::COLOR), draw(Planes::RGBA8));
    let want: Vec<_> = plain.color().iter().copied().map(encode_rgba8).collect();
    assert!(encoded.rgba8() == want && encoded.color().is_empty());
}

#[test]
fn planes_without_a_mean_are_refused_of_averaged_samples() {
    let case = scenes::thin_shell();
    let mut renderer = surfel_reference::Renderer::new(Default::default()).unwrap();
    let resident = renderer.upload(&case.scene).unwrap();
    for planes in [
        Planes::COLOR.with_index(true),
        Planes::COLOR.with_label(true),
        Planes::COLOR.with_position(true),
        Planes::COLOR.with_alpha(true),
        Planes::COLOR.with_median_depth(true),
        Planes::COLOR.with_distortion(true),
    ] {
        let mut frame = Frame::default();
        let refused =
            renderer.render_supersampled(&resident, &case.view(), &case.settings, planes, 2, &mut frame).unwrap_err();
        assert!(refused.to_string().contains("averaged from samples"), "{planes:?}: {refused}");
    }
}
