//! Tests that every filter and every shader draws its own image. `Filter` and `Shader` are `#[non_exhaustive]`, so that
//! backends have a match arm for unknown values. A value that reaches this arm would look like the default.

use crate::validated_gpu;
use surfel_conformance::build::{camera, confetti, scene};
use surfel_conformance::harness::render;
use surfel_conformance::scenes::{Case, three_materials};
use surfel_model::{Filter, Shader};
use surfel_render::{Frame, Planes, Renderer};

/// Minimum difference of some channel between two settings: 100 times the tolerance of backends.
const APART: f32 = 0.02;

fn all_differ(images: &[(&str, Frame)]) {
    for (i, (name, image)) in images.iter().enumerate() {
        for (other_name, other) in &images[..i] {
            let pairs = image.color().as_flattened().iter().zip(other.color().as_flattened());
            let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(apart > APART, "{name} draws what {other_name} does: {apart}");
        }
    }
}

fn draws_an_image_for_each(renderer: &mut impl Renderer) {
    let mut image = |case: &Case| render(renderer, case, Planes::COLOR).unwrap();
    // Splats of 1 to 4 px, long ones among them, at any angle.
    let small = Case::new("small", scene(&confetti(300, 0.02, 3.0, 307)), camera(3.0, 45.0, [64, 64]));
    let filters = Filter::ALL.map(|filter| (filter.name(), image(&small.with(filter.name(), |s| s.filter = filter))));
    all_differ(&filters);
    let lit = three_materials();
    let shaders = Shader::ALL.map(|shader| (shader.name(), image(&lit.with(shader.name(), |s| s.shader = shader))));
    all_differ(&shaders);
}

#[test]
fn every_filter_and_shader_has_an_image_of_its_own() {
    draws_an_image_for_each(&mut surfel_reference::Renderer::new(Default::default()).unwrap());
    draws_an_image_for_each(&mut surfel_cpu::Renderer::new(Default::default()).unwrap());
    if let Some(mut ash) = validated_gpu::ash() {
        draws_an_image_for_each(&mut ash);
    }
    if let Some(mut wgpu) = validated_gpu::wgpu() {
        draws_an_image_for_each(&mut wgpu);
        validated_gpu::no_messages();
    }
}
