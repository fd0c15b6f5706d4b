//! Tests of the costs of a frame that GPU backends report, and of work that they don't repeat.

use crate::drawing::{counter, frame_and_stats};
use crate::validated_gpu;
use surfel_conformance::scenes::{self, Case};
use surfel_gpu::GpuPath;
use surfel_model::{Camera, EdgeAa, Light, Settings, Shader};
use surfel_render::{Frame, Planes, Renderer, Stats, View};

fn ms(stats: &Stats, name: &str) -> Option<f64> {
    stats.passes.iter().find(|pass| pass.name == name).map(|pass| pass.ms)
}

fn draws_shadow_maps_once(renderer: &mut impl Renderer) {
    let casts = |case: &Case| case.scene.lights.iter().flatten().any(Light::casts_shadow);
    let case = scenes::all().into_iter().find(|case| casts(case)).unwrap();
    let scene = renderer.upload(&case.scene).unwrap();
    let (first, first_stats) = frame_and_stats(renderer, &scene, &case, Planes::COLOR);
    assert!(ms(&first_stats, "shadow maps").is_some_and(|ms| ms > 0.0), "{first_stats:?}");
    let (again, stats) = frame_and_stats(renderer, &scene, &case, Planes::COLOR);
    assert_eq!(again, first);
    assert_eq!(ms(&stats, "shadow maps"), None);
    assert!(ms(&stats, "visibility").is_some(), "{stats:?}");
    // Another eye uses the same maps.
    let mut moved = case.clone();
    moved.camera.eye[0] += 0.3;
    let (from_there, stats) = frame_and_stats(renderer, &scene, &moved, Planes::COLOR);
    assert_eq!(ms(&stats, "shadow maps"), None);
    assert!(from_there != first);
    // The same scene uploaded again is another scene, and gets its own maps.
    let same = renderer.upload(&case.scene).unwrap();
    assert!(ms(&frame_and_stats(renderer, &same, &case, Planes::COLOR).1, "shadow maps").is_some());
    // Another light needs other maps, which replace the maps of the first.
    let mut turned = case.clone();
    for light in turned.scene.lights.iter_mut().flatten() {
        if let Light::Directional { direction, .. } | Light::Spot { direction, .. } = light {
            direction[0] += 0.4;
        }
    }
    let other = renderer.upload(&turned.scene).unwrap();
    let (shadowed, stats) = frame_and_stats(renderer, &other, &turned, Planes::COLOR);
    assert!(ms(&stats, "shadow maps").is_some() && shadowed != first);
    let (back, stats) = frame_and_stats(renderer, &scene, &case, Planes::COLOR);
    assert!(ms(&stats, "shadow maps").is_some() && back == first);
    // Maps depend on settings too: here, whether there are any.
    let flat = case.with("unlit", |settings| settings.shader = Shader::Unlit);
    assert_eq!(ms(&frame_and_stats(renderer, &scene, &flat, Planes::COLOR).1, "shadow maps"), None);
    assert_eq!(frame_and_stats(renderer, &scene, &case, Planes::COLOR).0, first);
}

fn counts_invocations(renderer: &mut impl Renderer) {
    let case = scenes::closed_sphere();
    let scene = renderer.upload(&case.scene).unwrap();
    let (_, stats) = frame_and_stats(renderer, &scene, &case, Planes::COLOR);
    let counter = |name: &str| counter(&stats, name).unwrap_or(0.0);
    // Two passes draw every splat, and an implementation may run the two vertices that a quad's triangles share once.
    let splats = stats.splats as f64;
    assert!(counter("vertex_invocations") >= 8.0 * splats, "{stats:?}");
    assert!(counter("fragment_invocations") >= stats.drawn as f64, "{stats:?}");
    assert!(counter("compute_invocations") >= splats, "{stats:?}");
}

/// Samples are drawn around sampled pixels only: a small part of an image four times as wide and high.
fn draws_samples_about_edges_alone(renderer: &mut impl Renderer) {
    let case = scenes::closed_sphere().with("larger", |_| ());
    let case = Case { camera: Camera { size: [192, 192], ..case.camera }, ..case };
    let scene = renderer.upload(&case.scene).unwrap();
    let mut drawn = |view: &View, settings: &Settings| {
        let mut frame = Frame::default();
        let stats = renderer.render_into(&scene, view, settings, Planes::COLOR, &mut frame).unwrap();
        let names = ["vertex_invocations", "fragment_invocations", "target_bytes"];
        (names.map(|name| counter(&stats, name).unwrap_or(0.0)), ms(&stats, "edge samples").is_some())
    };
    let (view, plain) = (case.view(), case.settings.with_edge_aa(EdgeAa::Off));
    let (without, is_timed) = drawn(&view, &plain);
    assert!(!is_timed);
    let (with, is_timed) = drawn(&view, &plain.with_edge_aa(EdgeAa::Samples));
    let (fine, _) = drawn(&view.of_samples(), &plain);
    println!("vertices, fragments, bytes: {without:?} without, {with:?} with samples, {fine:?} of a fine image");
    assert!(is_timed && with[1] > without[1]);
    // The outline is a twentieth of the ball, and splats there reach into its neighbours.
    assert!(with[1] - without[1] < 0.3 * fine[1]);
}

/// Runs a test on the available backends, by raster hardware.
macro_rules! on_both {
    ($($test:ident: $run:ident;)+) => {
        $(#[test] fn $test() {
            if let Some(mut ash) = validated_gpu::ash_by(GpuPath::Raster) {
                $run(&mut ash);
            }
            if let Some(mut wgpu) = validated_gpu::wgpu_by(GpuPath::Raster) {
                $run(&mut wgpu);
                validated_gpu::no_messages();
            }
        })+
    };
}

on_both! {
    shadow_maps_of_an_unchanged_scene_are_drawn_once: draws_shadow_maps_once;
    invocations_of_shaders_are_counted: counts_invocations;
    samples_are_drawn_about_edges_alone: draws_samples_about_edges_alone;
}

#[test]
fn fill_rates_are_measured_by_every_probe() {
    let check = |rates: Vec<surfel_ash::FillRate>| {
        let names: Vec<_> = rates.iter().map(|rate| rate.probe).collect();
        assert_eq!(names, surfel_ash::FillRateProbe::ALL);
        assert!(rates.iter().all(|rate| rate.fragments_per_s > 1e6), "{rates:?}");
    };
    if let Some(mut ash) = validated_gpu::ash() {
        check(ash.fill_rates(64).unwrap());
    }
    if let Some(mut wgpu) = validated_gpu::wgpu() {
        check(wgpu.fill_rates(64).unwrap());
        validated_gpu::no_messages();
    }
}
