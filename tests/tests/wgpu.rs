//! The wgpu backend: the reference's picture on whatever adapter there is, without a word from the validation layers.

mod common;

use surfel_conformance::harness::{ABSOLUTE, RELATIVE, Verdict, check_backend, render};
use surfel_conformance::scenes;
use surfel_model::{Accumulate, DepthTolerance};
use surfel_render::{Frame, Planes, Region, Renderer, View};

#[test]
fn wgpu_agrees_with_the_reference_on_every_scene() {
    let Some(mut renderer) = common::wgpu() else { return };
    let reports = check_backend(&mut renderer);
    let failed: Vec<String> = reports.iter().filter(|r| !r.is_ok()).map(ToString::to_string).collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    // What is refused is edge antialiasing, in four scenes, and nothing else.
    let skipped = |r: &&surfel_conformance::harness::Report| matches!(r.verdict, Verdict::Skipped(_));
    assert!(reports.iter().filter(skipped).all(|r| r.name.ends_with("edge-aa")));
    common::no_messages();
}

#[test]
fn wgpu_region_is_that_part_of_the_whole() {
    let Some(mut renderer) = common::wgpu() else { return };
    for case in scenes::all().iter().filter(|c| !c.settings.edge_aa).step_by(5) {
        let [width, height] = case.camera.size;
        let region = Region { x: width / 3, y: height / 4, width: width.div_ceil(2), height: height.div_ceil(2) };
        let whole = render(&mut renderer, case, Planes::COLOR).unwrap();
        let view = View::of_region(&case.camera, Some(region)).unwrap();
        let resident = renderer.upload(&case.scene).unwrap();
        let mut part = Frame::default();
        renderer.render(&resident, &view, &case.settings, Planes::COLOR, &mut part).unwrap();
        for (i, pixel) in part.color.iter().enumerate() {
            let (x, y) = (region.x + i as u32 % region.width, region.y + i as u32 / region.width);
            let same = whole.color[(y * width + x) as usize];
            // Forms of near splats have their anchor in the middle of what is seen of them, so last bits differ there.
            let close = pixel.iter().zip(same).all(|(a, b)| (a - b).abs() <= 1e-5);
            assert!(close, "{} at {x},{y}: {pixel:?} {same:?}", case.name);
        }
    }
    common::no_messages();
}

#[test]
fn wgpu_keeps_a_fragment_that_its_own_splat_wrote() {
    // Without any tolerance z ≤ z decides: the passes must come to the same depth, to the bit.
    let Some(mut renderer) = common::wgpu() else { return };
    for tolerance in [DepthTolerance::Relative(0.0), DepthTolerance::Absolute(0.0)] {
        let case = scenes::facing_splat().with("no tolerance", |s| s.depth_tolerance = tolerance);
        let frame = render(&mut renderer, &case, Planes { weight: true, ..Planes::COLOR }).unwrap();
        let resident =
            render(&mut surfel_cpu::Renderer::new(1).unwrap(), &case, Planes { weight: true, ..Planes::COLOR });
        for (a, b) in frame.weight.iter().zip(resident.unwrap().weight) {
            assert!(f64::from(a - b).abs() <= ABSOLUTE + RELATIVE * f64::from(b), "{a} {b}");
        }
    }
    common::no_messages();
}

#[test]
fn wgpu_counts_fragments_as_the_cpu_does() {
    let Some(mut renderer) = common::wgpu() else { return };
    let case = scenes::closed_sphere();
    let planes = Planes { fragments: true, ..Planes::COLOR };
    let ours = render(&mut renderer, &case, planes).unwrap();
    let theirs = render(&mut surfel_cpu::Renderer::new(1).unwrap(), &case, planes).unwrap();
    let differ = ours.fragments.iter().zip(&theirs.fragments).filter(|(a, b)| a != b).count();
    // A fragment on a rim may come or go by rounding.
    assert!(differ * 100 < ours.fragments.len(), "{differ} of {}", ours.fragments.len());
    common::no_messages();
}

#[test]
fn wgpu_sums_in_f16_are_close() {
    let Some(mut renderer) = common::wgpu() else { return };
    let case = scenes::closed_sphere();
    let halves = case.with("f16", |s| s.accumulate = Accumulate::F16);
    let [full, half] = [&case, &halves].map(|case| render(&mut renderer, case, Planes::COLOR).unwrap());
    let worst = full.color.as_flattened().iter().zip(half.color.as_flattened()).map(|(a, b)| (a - b).abs());
    let worst = worst.fold(0.0, f32::max);
    // Ten fragments of 2⁻¹¹ each; identical pictures would mean that nothing was done in f16.
    assert!(worst > 1e-5 && worst < 5e-3, "{worst}");
    common::no_messages();
}
