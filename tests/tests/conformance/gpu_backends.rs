//! Tests that the GPU backends draw the reference's image on any adapter without a message of the validation layers,
//! and each other's image if both have the same driver.

use crate::drawing::{counter, drawn_once};
use crate::validated_gpu;
use glam::DVec3;
use std::sync::OnceLock;
use surfel_ash::Limits;
use surfel_conformance::build::{Splat, camera, cloud, object, with_alpha};
use surfel_conformance::harness::{ABSOLUTE, RELATIVE, Truth, Verdict, check, compare_frames, reference_frame, render};
use surfel_conformance::polygons::{mesh_object, quad};
use surfel_conformance::scenes::{self, Case};
use surfel_model::Storage;
use surfel_model::{Accumulate, DepthTolerance, EdgeAa, Light, Projection, Scene, Transparency};
use surfel_render::{Frame, Planes, Region, Renderer, View};

/// Runs the same tests on each backend.
macro_rules! on_each_backend {
    ($($name:ident),+) => {
        mod wgpu {
            $(#[test] fn $name() {
                if let Some(renderer) = crate::validated_gpu::wgpu() {
                    super::$name(renderer);
                    crate::validated_gpu::no_messages();
                }
            })+
        }
        mod ash {
            $(#[test] fn $name() {
                // A message of the layer is an error of the call.
                if let Some(renderer) = crate::validated_gpu::ash() {
                    super::$name(renderer);
                }
            })+
        }
    };
}

#[test]
fn ash_agrees_with_the_reference_on_every_scene() {
    if let Some(renderer) = validated_gpu::ash() {
        agrees_with_the_reference_on_every_scene(renderer);
    }
}

#[test]
#[ignore = "79 s on lavapipe with two cores: cargo xtask test --full"]
fn wgpu_agrees_with_the_reference_on_every_scene() {
    if let Some(renderer) = validated_gpu::wgpu() {
        agrees_with_the_reference_on_every_scene(renderer);
        validated_gpu::no_messages();
    }
}

on_each_backend!(
    region_is_that_part_of_the_whole,
    fragment_is_kept_by_its_own_splat_without_tolerance,
    fragments_are_counted_as_the_cpu_does,
    layers_end_where_nothing_remains,
    abuffer_has_every_surface_or_is_refused,
    sums_in_f16_are_close,
    empty_scene_is_background,
    scene_of_any_size_agrees_with_the_reference
);

/// Returns the scenes that a backend reports it draws.
fn drawn(renderer: &impl Renderer) -> Vec<Case> {
    let capabilities = renderer.info().capabilities;
    let cases: Vec<Case> = scenes::all().into_iter().filter(|c| c.is_drawn_by(&capabilities)).collect();
    // At least as many as there are scenes with opaque splats alone.
    assert!(cases.len() > 50, "{}", cases.len());
    cases
}

fn agrees_with_the_reference_on_every_scene(mut renderer: impl Renderer) {
    let checked = validated_gpu::every_scene(&mut renderer);
    let reports = || checked.iter().map(|c| &c.report);
    let failed: Vec<String> = reports().filter(|r| !r.is_ok()).map(ToString::to_string).collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    let kept: Vec<&String> = reports().filter(|r| !matches!(r.verdict, Verdict::Skipped(_))).map(|r| &r.name).collect();
    let cases = drawn(&renderer);
    assert_eq!(kept, cases.iter().map(|c| &c.name).collect::<Vec<_>>(), "refused, but said to be drawn");
}

fn region_is_that_part_of_the_whole(renderer: impl Renderer) {
    // A software driver takes minutes for all of them.
    regions_are_parts_of_the_whole(renderer, 3);
}

#[test]
#[ignore = "180 s on lavapipe with two cores: cargo xtask test --full"]
fn more_regions_are_parts_of_the_whole() {
    if let Some(renderer) = validated_gpu::wgpu() {
        regions_are_parts_of_the_whole(renderer, 1);
        validated_gpu::no_messages();
    }
    if let Some(renderer) = validated_gpu::ash() {
        regions_are_parts_of_the_whole(renderer, 1);
    }
}

/// Compares a region with that part of the whole image. A selection of scenes contains every kind; every `step`-th of
/// it is drawn.
fn regions_are_parts_of_the_whole(mut renderer: impl Renderer, step: usize) {
    let cases = drawn(&renderer);
    // Some of each kind, and all whose edges need neighbours beyond the region, or which read shadow maps.
    let casts = |c: &Case| c.scene.lights.iter().flatten().any(Light::casts_shadow);
    let by = |edge_aa| cases.iter().filter(move |c| c.settings.edge_aa == edge_aa);
    let others = cases.iter().filter(|c| c.settings.edge_aa == EdgeAa::Off);
    let some = others.enumerate().filter(|(i, c)| i % 5 == 0 || casts(c)).map(|(_, case)| case);
    // Some by samples: a software driver needs memory for each of a frame's sixteen parts.
    let some = some.chain(by(EdgeAa::Coverage)).chain(by(EdgeAa::Samples).step_by(6));
    // Without shadows and with.
    let mut worst = [0.0f32; 2];
    let mut failed = Vec::new();
    for case in some.step_by(step) {
        // The anchor of near splats' and polygons' forms is in the middle of their visible part, so their last bits
        // differ. Across a penumbra, with a third of the light per texel, the last bits of a position are 1e-4 of a
        // texel.
        let tolerance = if casts(case) { 1e-4 } else { 1e-5 };
        let [width, height] = case.camera.size;
        let region = Region { x: width / 3, y: height / 4, width: width.div_ceil(2), height: height.div_ceil(2) };
        let whole = render(&mut renderer, case, Planes::COLOR).unwrap();
        let view = View::of_region(&case.camera, Some(region)).unwrap();
        let resident = renderer.upload(&case.scene).unwrap();
        let mut part = Frame::default();
        renderer.render_into(&resident, &view, &case.settings, Planes::COLOR, &mut part).unwrap();
        for (i, pixel) in part.color().iter().enumerate() {
            let (x, y) = (region.x + i as u32 % region.width, region.y + i as u32 / region.width);
            let same = whole.color()[(y * width + x) as usize];
            let error = pixel.iter().zip(same).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            let worst = &mut worst[usize::from(casts(case))];
            *worst = worst.max(error);
            if error > tolerance {
                failed.push(format!("{} at {x},{y}: {pixel:?} {same:?}", case.name));
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    println!("worst difference {worst:?}");
}

/// Tests that a dropped renderer frees its device. The renderers of other tests are pooled and never dropped.
#[test]
fn dropped_wgpu_renderer_leaves_nothing_behind() {
    let Some(mut renderer) = validated_gpu::unpooled_wgpu() else { return };
    // One scene for each path.
    for case in [scenes::closed_sphere(), scenes::panes()] {
        render(&mut renderer, &case, Planes::COLOR).unwrap();
    }
    drop(renderer);
    validated_gpu::no_messages();
}

fn fragment_is_kept_by_its_own_splat_without_tolerance(mut renderer: impl Renderer) {
    // z ≤ z decides, so the passes must compute bit-identical depths.
    let planes = Planes::COLOR.with_weight(true);
    for tolerance in [DepthTolerance::Relative(0.0), DepthTolerance::Absolute(0.0)] {
        let case = scenes::facing_splat().with("no tolerance", |s| s.depth_tolerance = tolerance);
        let ours = render(&mut renderer, &case, planes).unwrap();
        let theirs = render(
            &mut surfel_cpu::Renderer::new(surfel_cpu::Options::default().with_threads(1)).unwrap(),
            &case,
            planes,
        )
        .unwrap();
        for (&a, &b) in ours.weight().iter().zip(theirs.weight()) {
            assert!(f64::from(a - b).abs() <= ABSOLUTE + RELATIVE * f64::from(b), "{a} {b}");
        }
    }
}

fn abuffer_has_every_surface_or_is_refused(renderer: impl Renderer) {
    // Fewer surfaces than the first layers, as many, and more that need further rounds; with samples, too.
    let off = [3, 16, 40].map(|count| (count, EdgeAa::Off));
    abuffer_has_every_surface(renderer, &[off[0], off[1], off[2], (20, EdgeAa::Samples)]);
}

#[test]
#[ignore = "55 s on lavapipe with two cores: cargo xtask test --full"]
fn abuffer_has_every_one_of_many_surfaces() {
    let counts = [(40, EdgeAa::Samples), (130, EdgeAa::Off)];
    if let Some(renderer) = validated_gpu::wgpu() {
        abuffer_has_every_surface(renderer, &counts);
        validated_gpu::no_messages();
    }
    if let Some(renderer) = validated_gpu::ash() {
        abuffer_has_every_surface(renderer, &counts);
    }
}

/// Compares A-buffers of stacks of surfaces, given by number and edges, with the reference. Checks that a stack of more
/// surfaces than a GPU's A-buffer has is refused.
fn abuffer_has_every_surface(mut renderer: impl Renderer, stacks: &[(usize, EdgeAa)]) {
    let stack = |count: usize, edge_aa| {
        let disks: Vec<Splat> = (0..count)
            .map(|i| {
                let color = [0.1 + 0.8 * (i % 7) as f32 / 7.0, 0.5, 0.9 - 0.8 * (i % 3) as f32 / 3.0];
                Splat::disk(DVec3::Z * (1.0 - 0.01 * i as f64), DVec3::Z, 0.8, color)
            })
            .collect();
        let mut glass = object(with_alpha(cloud(&disks), |i| 0.01 + 0.05 * (i % 5) as f32));
        glass.material.interior_weight = Some(1.0);
        let scene = Scene { objects: vec![glass], ..surfel_conformance::build::scene(&disks) };
        // Mesa's lavapipe compiles a shader of 15 ms for each layer, and samples are drawn in many parts.
        let size_px = if edge_aa == EdgeAa::Samples { [3, 3] } else { [12, 10] };
        Case::new("stack", scene, camera(4.0, 30.0, size_px)).with("abuffer", |s| {
            s.transparency = Transparency::ABuffer { layers: 3 };
            s.depth_tolerance = DepthTolerance::Absolute(0.001);
            s.edge_aa = edge_aa;
        })
    };
    let mut reference = surfel_reference::Renderer::new(Default::default()).unwrap();
    for &(count, edge_aa) in stacks {
        let case = stack(count, edge_aa);
        let want = reference_frame(&mut reference, &case).unwrap();
        let (frame, stats) = drawn_once(&mut renderer, &case, Planes::ALL.with_fragments(true));
        let report = compare_frames(&case.name, &frame, &want, want.margin());
        assert_eq!(report.verdict, Verdict::Passed, "{count} {edge_aa:?}: {report}");
        assert_eq!(stats.drawn, count as u64);
        assert_eq!(frame.fragments().iter().max(), Some(&(count as u32)));
    }
    let case = stack(300, EdgeAa::Off);
    let resident = renderer.upload(&case.scene).unwrap();
    let mut frame = Frame::default();
    let refused = renderer.render_into(&resident, &case.view(), &case.settings, Planes::COLOR, &mut frame);
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("255") && message.contains("`backend=cpu`"), "{message}");
}

fn fragments_are_counted_as_the_cpu_does(mut renderer: impl Renderer) {
    let case = scenes::closed_sphere();
    let planes = Planes::COLOR.with_fragments(true);
    let ours = render(&mut renderer, &case, planes).unwrap();
    let theirs =
        render(&mut surfel_cpu::Renderer::new(surfel_cpu::Options::default().with_threads(1)).unwrap(), &case, planes)
            .unwrap();
    let differ = ours.fragments().iter().zip(theirs.fragments()).filter(|(a, b)| a != b).count();
    // Rounding may add or remove a fragment on a rim.
    assert!(differ * 100 < ours.fragments().len(), "{differ} of {}", ours.fragments().len());
    let (_, stats) = drawn_once(&mut renderer, &case, planes);
    assert_eq!(stats.fragments, ours.fragments().iter().map(|&n| u64::from(n)).sum::<u64>());
    assert!(stats.drawn > 0 && stats.drawn <= stats.splats);
}

fn layers_end_where_nothing_remains(mut renderer: impl Renderer) {
    let mut drawn = |case: &Case, layers: &str| {
        let case = case.with(layers, |s| s.transparency = layers.parse().unwrap());
        let (frame, stats) = drawn_once(&mut renderer, &case, Planes::ALL);
        (frame, ["layers_drawn", "vertex_invocations"].map(|name| counter(&stats, name)))
    };
    for case in [scenes::panes(), scenes::glass_spheres()] {
        let (few, all_of_few) = drawn(&case, "peel:2");
        assert_eq!(all_of_few[0], Some(2.0), "{}", case.name);
        let (many, some_of_many) = drawn(&case, "peel:40");
        // The real layers, some layers of rims, and the one that finds nothing.
        let count = some_of_many[0].unwrap();
        assert!((4.0..20.0).contains(&count), "{}: {count}", case.name);
        // Layers that aren't drawn have no vertices.
        let (more, as_many) = drawn(&case, "peel:64");
        assert_eq!((&many, some_of_many), (&more, as_many), "{}", case.name);
        assert!(few != many, "{}", case.name);
        // With one more layer, the last drawn one is peeled instead of blended with the remaining fragments.
        let (enough, _) = drawn(&case, &format!("peel:{}:drop", count + 1.0));
        assert_eq!(many, enough, "{}", case.name);
    }
    // A pane is one layer, and the second finds nothing.
    assert_eq!(drawn(&scenes::pane_through_sphere(), "peel:40").1[0], Some(2.0));
    assert_eq!(drawn(&scenes::closed_sphere(), "peel:4").1[0], None);
}

fn sums_in_f16_are_close(mut renderer: impl Renderer) {
    let mut case = scenes::closed_sphere();
    // Only raster hardware sums in f16, and it draws scenes with polygons; this one lies far behind the eye.
    case.scene.objects.push(mesh_object(quad(DVec3::Z * 1e4, [DVec3::X, DVec3::Y], 1.0)));
    let halves = case.with("f16", |s| s.accumulate = Accumulate::F16);
    let [full, half] = [&case, &halves].map(|case| render(&mut renderer, case, Planes::COLOR).unwrap());
    let worst = full.color().as_flattened().iter().zip(half.color().as_flattened()).map(|(a, b)| (a - b).abs());
    let worst = worst.fold(0.0, f32::max);
    // Ten fragments of 2⁻¹¹ each; identical images would mean that f16 wasn't used.
    assert!(worst > 1e-5 && worst < 5e-3, "{worst}");
    // Depths beyond f16's largest number, and below its least normal one.
    for scale in [1e-5, 1e5] {
        let case = scenes::scaled(&halves, scale);
        let depth = |case: &Case, renderer: &mut _| render(renderer, case, Planes::ALL).unwrap().depth().to_vec();
        let exact = depth(&case.with("f32", |s| s.accumulate = Accumulate::F32), &mut renderer);
        for (a, b) in depth(&case, &mut renderer).iter().zip(&exact) {
            assert!(a == b || (a - b).abs() <= 5e-3 * b, "{a} {b}");
        }
    }
}

fn empty_scene_is_background(mut renderer: impl Renderer) {
    let case = scenes::facing_splat();
    let mut scene = case.scene.clone();
    scene.objects.clear();
    let frame = render(&mut renderer, &Case { scene, ..case }, Planes::ALL).unwrap();
    assert!(frame.color().iter().all(|c| *c == [0.01, 0.015, 0.025, 0.5]));
    assert!(frame.depth().iter().all(|z| *z == f32::INFINITY) && frame.weight().iter().all(|w| *w == 0.0));
}

/// Returns every `step`-th scene, scaled to be very small and very large.
fn scenes_of_any_size(step: usize) -> Vec<Truth> {
    let mut reference = surfel_reference::Renderer::new(Default::default()).unwrap();
    let mut truths = Vec::new();
    for case in scenes::all().iter().step_by(step) {
        for scale in [1e-15, 1e15] {
            let mut case = scenes::scaled(case, scale);
            for light in case.scene.lights.iter_mut().flatten() {
                if let Light::Point { position, .. } | Light::Spot { position, .. } = light {
                    position.iter_mut().for_each(|p| *p *= scale);
                }
            }
            if let Projection::Orthographic { height } = &mut case.camera.projection {
                *height *= scale;
            }
            if let DepthTolerance::Absolute(distance) = &mut case.settings.depth_tolerance {
                *distance *= scale;
            }
            truths.push(Truth::of(&mut reference, case));
        }
    }
    truths
}

fn scene_of_any_size_agrees_with_the_reference(renderer: impl Renderer) {
    static TRUTHS: OnceLock<Vec<Truth>> = OnceLock::new();
    agrees_with(renderer, TRUTHS.get_or_init(|| scenes_of_any_size(12)), 12);
}

#[test]
#[ignore = "200 s on lavapipe with two cores: cargo xtask test --full"]
fn more_scenes_of_any_size_agree_with_the_reference() {
    let truths = scenes_of_any_size(3);
    if let Some(renderer) = validated_gpu::wgpu() {
        agrees_with(renderer, &truths, 3);
        validated_gpu::no_messages();
    }
    if let Some(renderer) = validated_gpu::ash() {
        agrees_with(renderer, &truths, 3);
    }
}

/// Compares a backend with the images of every `step`-th scene.
fn agrees_with(mut renderer: impl Renderer, truths: &[Truth], step: usize) {
    let capabilities = renderer.info().capabilities;
    let truths: Vec<&Truth> = truths.iter().filter(|t| t.case.is_drawn_by(&capabilities)).collect();
    assert!(truths.len() * step > 300, "{}", truths.len());
    for truth in truths {
        let report = check(&mut renderer, truth).report;
        assert!(report.is_ok(), "{report}");
    }
}

#[test]
#[ignore = "131 s on lavapipe with two cores: cargo xtask test --full"]
fn ash_and_wgpu_draw_the_same_image_on_one_driver() {
    let (Some(mut ash), Some(mut wgpu)) = (validated_gpu::ash(), validated_gpu::wgpu()) else { return };
    if ash.info().adapter != wgpu.info().adapter {
        println!("skipped: adapters differ: {} and {}", ash.info().adapter, wgpu.info().adapter);
        return;
    }
    let (mut worst, mut compared) = (0.0f32, 0);
    let [ours, theirs] = [validated_gpu::every_scene(&mut ash), validated_gpu::every_scene(&mut wgpu)];
    for (ours, theirs) in ours.iter().zip(theirs) {
        let name = &ours.report.name;
        assert_eq!(name, &theirs.report.name);
        let (Some(ours), Some(theirs)) = (&ours.got, &theirs.got) else { continue };
        compared += 1;
        let planes = [
            (ours.color().as_flattened(), theirs.color().as_flattened()),
            (ours.normal().as_flattened(), theirs.normal().as_flattened()),
            (ours.depth(), theirs.depth()),
            (ours.weight(), theirs.weight()),
        ];
        for (a, b) in planes.iter().flat_map(|(a, b)| a.iter().zip(b.iter())).filter(|(a, b)| a != b) {
            // Relative above 1, so that scenes of 1e4 units count the same.
            let error = (a - b).abs() / b.abs().max(1.0);
            assert!(error <= 1e-5, "{name}: {a} and {b}");
            worst = worst.max(error);
        }
    }
    println!("worst difference {worst:e}");
    assert_eq!(compared, drawn(&ash).len());
    validated_gpu::no_messages();
}

/// Asserts that two frames of a case agree within the rounding of a driver's code.
fn are_alike(a: &Frame, b: &Frame, case: &Case) {
    let values = |f: &Frame| -> Vec<f32> {
        [f.color().as_flattened(), f.normal().as_flattened(), f.depth(), f.weight()].concat()
    };
    for (a, b) in values(a).iter().zip(values(b)).filter(|(a, b)| **a != *b) {
        assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{}: {a} {b}", case.name);
    }
    assert_eq!(a.fragments(), b.fragments(), "{}", case.name);
}

/// Compares the two kinds of shaders of `wgpu`: SPIR-V that the driver gets as it was built, and WGSL that wgpu
/// translates.
#[test]
fn wgpu_draws_the_same_by_wgsl() {
    let (Some(mut spirv), Some(mut wgsl)) = (validated_gpu::wgpu(), validated_gpu::wgpu_by_wgsl()) else { return };
    let planes = Planes::ALL.with_fragments(true);
    // Translating and compiling all shaders takes minutes on a software driver.
    for case in drawn(&spirv).iter().step_by(36) {
        let [ours, theirs] = [render(&mut spirv, case, planes), render(&mut wgsl, case, planes)].map(Result::unwrap);
        are_alike(&ours, &theirs, case);
    }
    validated_gpu::no_messages();
}

/// Limits of 256 clipped splats per buffer, a seventh of an image per tile, and no record beyond the next pass.
const LITTLE: Limits =
    Limits { buffer_bytes: 256 * 184, texture_side: 30, record_bytes: 0, cell_bytes: u64::MAX, memory_bytes: u64::MAX };

/// Compares drawing in parts with drawing as a whole, in scenes without shadows. Of scenes without edges by samples,
/// every `step`-th is drawn, and all with edges by coverage. Of those by samples, every 14th is drawn.
fn draws_the_same_in_parts(whole: &mut impl Renderer, parts: &mut impl Renderer, step: usize) {
    let planes = Planes::ALL.with_fragments(true);
    // A shadow map isn't drawn in parts, since its size is fixed by the model.
    let casts = |c: &Case| c.scene.lights.iter().flatten().any(Light::casts_shadow);
    let cases: Vec<Case> = drawn(whole).into_iter().filter(|c| !casts(c)).collect();
    // Some of each kind, all whose edges need neighbours, and some by samples, with sixteen parts per tile.
    let by = |edge_aa| cases.iter().filter(move |c| c.settings.edge_aa == edge_aa);
    let others = cases.iter().filter(|c| c.settings.edge_aa != EdgeAa::Samples).step_by(step);
    for case in others.chain(by(EdgeAa::Coverage)).chain(by(EdgeAa::Samples).step_by(14)) {
        let [a, b] = [render(whole, case, planes).unwrap(), render(parts, case, planes).unwrap()];
        let values =
            |f: &Frame| -> Vec<f32> { [f.color().as_flattened(), f.normal().as_flattened(), f.weight()].concat() };
        for (a, b) in values(&a).iter().zip(values(&b)) {
            // A different order of sums, and forms of near splats with another anchor.
            assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{}: {a} {b}", case.name);
        }
        assert_eq!(a.fragments(), b.fragments(), "{}", case.name);
    }
}

#[test]
#[ignore = "134 s on lavapipe with two cores: cargo xtask test --full"]
fn scenes_and_images_too_large_for_the_device_are_drawn_in_parts() {
    let all = Limits::default();
    for storage in [Storage::F32, Storage::Quantised] {
        if let (Some(mut whole), Some(mut parts)) =
            (validated_gpu::ash_with(all, storage), validated_gpu::ash_with(LITTLE, storage))
        {
            draws_the_same_in_parts(&mut whole, &mut parts, 6);
        }
    }
    // The code that divides is the same; `gpu_scene_storage` draws the other storage.
    let storage = Storage::F32;
    if let (Some(mut whole), Some(mut parts)) =
        (validated_gpu::wgpu_with(all, storage), validated_gpu::wgpu_with(LITTLE, storage))
    {
        draws_the_same_in_parts(&mut whole, &mut parts, 12);
        validated_gpu::no_messages();
    }
}
