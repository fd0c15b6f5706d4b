//! Every filter and every shader draws an image of its own. `Filter` and `Shader` are `#[non_exhaustive]`, so that
//! backends have an arm for what they don't know: what reaches it would pass for the default.

use crate::validated_gpu;
use surfel_conformance::build::{camera, confetti, scene};
use surfel_conformance::harness::render;
use surfel_conformance::scenes::{Case, three_materials};
use surfel_model::{Filter, Shader};
use surfel_render::{Frame, Planes, Renderer};

/// By this much some number of a pixel's colour differs between two settings: 100 times what backends may be off by.
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
