//! Every backend against planes that an independent f64 program computed from the rendering model.
//!
//! The samples are outside the project; without them the test prints that it is skipped.

use crate::{scene_files, validated_gpu};
use std::path::PathBuf;
use surfel_conformance::test_data;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, RenderError, Renderer, View};

/// Tolerance |a − b| ≤ absolute + relative·|b|; for depth the absolute part is in median depths.
#[derive(Clone, Copy)]
struct Tolerance {
    absolute: f64,
    relative: f64,
}

/// Compares one plane outside the mask; equal infinities are equal. Returns the largest error as a fraction of the
/// tolerance, and its pixel.
fn worst(got: &[f32], want: &[f32], mask: &[f32], channels: usize, scale: f64, tolerance: Tolerance) -> (f64, usize) {
    let mut result = (0.0, 0);
    for (i, (a, b)) in got.iter().zip(want).enumerate() {
        if mask[i / channels] != 0.0 || a == b {
            continue;
        }
        let (a, b) = (f64::from(*a), f64::from(*b));
        let error = (a - b).abs() / (tolerance.absolute * scale + tolerance.relative * b.abs());
        if error.is_nan() || error > result.0 {
            result = (if error.is_nan() { f64::INFINITY } else { error }, i / channels);
        }
    }
    result
}

/// Renders every golden scene, except those that the renderer refuses. Fails if a plane is out of tolerance, or if
/// fewer than `least_compared` scenes were compared.
fn check<R: Renderer>(mut renderer: R, tolerance: Tolerance, least_compared: usize) {
    let Some(folder) = test_data::folder("golden") else { return };
    let mut names: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    names.retain(|p| p.extension().is_some_and(|e| e == "json"));
    names.sort();
    let (mut failures, mut compared) = (Vec::new(), 0);
    for path in names {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let file = surfel_io::scene_file::read(&path).unwrap();
        let resident = renderer.upload(&scene_files::scene(&file, &folder)).unwrap();
        let view = View::new(&file.camera).unwrap();
        let mut frame = Frame::default();
        match renderer.render_into(&resident, &view, &file.settings, Planes::ALL, &mut frame) {
            Ok(_) => {}
            Err(RenderError::Unsupported { feature, .. }) => {
                println!("{name}: refused, {feature}");
                continue;
            }
            Err(error) => panic!("{name}: {error}"),
        }
        let want = surfel_io::read_image(&path.with_extension("exr")).unwrap();
        let mask = &want.other.iter().find(|(n, _)| n == "mask").unwrap().1;
        let (color, depth) = (want.color.as_ref().unwrap(), want.depth.as_ref().unwrap());
        let mut finite: Vec<f32> = depth.iter().copied().filter(|z| z.is_finite()).map(f32::abs).collect();
        finite.sort_by(f32::total_cmp);
        let median = f64::from(finite.get(finite.len() / 2).copied().unwrap_or(1.0));
        let normal = want.normal.as_ref().unwrap();
        let planes = [
            ("color", worst(frame.color().as_flattened(), color.as_flattened(), mask, 4, 1.0, tolerance)),
            ("Z", worst(frame.depth(), depth, mask, 1, median, tolerance)),
            ("normal", worst(frame.normal().as_flattened(), normal.as_flattened(), mask, 3, 1.0, tolerance)),
            ("weight", worst(frame.weight(), want.weight.as_ref().unwrap(), mask, 1, 1.0, tolerance)),
        ];
        println!("{name}: {planes:?} (share of the tolerance, pixel)");
        failures.extend(planes.iter().filter(|p| p.1.0 > 1.0).map(|p| format!("{name} {}: {:?}", p.0, p.1)));
        compared += 1;
    }
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(compared >= least_compared, "only {compared} scenes were compared");
}

#[test]
fn golden_scenes_reference_agrees_to_f32_storage() {
    // The tolerance stated by the samples: both sides are stored as f32.
    check(Reference::new(Default::default()).unwrap(), Tolerance { absolute: 1e-6, relative: 1e-6 }, 21);
}

/// The tolerance stated by the samples for backends other than the reference.
const OTHERS: Tolerance = Tolerance { absolute: 2e-4, relative: 1e-3 };

#[test]
fn golden_scenes_cpu_agrees() {
    check(surfel_cpu::Renderer::new(Default::default()).unwrap(), OTHERS, 21);
}

#[test]
fn golden_scenes_wgpu_agrees() {
    if let Some(wgpu) = validated_gpu::wgpu() {
        check(wgpu, OTHERS, 21);
    }
}

#[test]
fn golden_scenes_ash_agrees() {
    if let Some(ash) = validated_gpu::ash() {
        check(ash, OTHERS, 21);
    }
}

#[test]
fn golden_scenes_and_their_images_are_read_with_all_planes() {
    let Some(folder) = test_data::folder("golden") else { return };
    let mut images = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.extension().and_then(|e| e.to_str()) {
            Some("exr") => {
                let planes = surfel_io::read_image(&path).unwrap_or_else(|e| panic!("{e}"));
                let pixels = (planes.width * planes.height) as usize;
                assert_eq!(planes.color.as_ref().map(Vec::len), Some(pixels), "{}", path.display());
                assert_eq!(planes.normal.as_ref().map(Vec::len), Some(pixels));
                assert_eq!(planes.weight.as_ref().map(Vec::len), Some(pixels));
                let depth = planes.depth.unwrap();
                assert!(depth.iter().all(|z| *z > 0.0) && depth.iter().any(|z| z.is_finite()));
                let [(name, mask)] = &planes.other[..] else { panic!("{}: one other plane", path.display()) };
                assert_eq!(name, "mask");
                assert!(mask.iter().all(|m| *m == 0.0 || *m == 1.0));
                images += 1;
            }
            Some("json") => {
                let scene = surfel_io::scene_file::read(&path).unwrap_or_else(|e| panic!("{e}"));
                assert!(!scene.objects.is_empty());
            }
            Some("ply" | "obj") => {
                surfel_io::load(&path, &surfel_io::LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
            }
            _ => {}
        }
    }
    assert!(images > 0);
}
