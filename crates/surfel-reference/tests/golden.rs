//! The reference against planes that an independent f64 program computed from the rendering model.
//!
//! The samples live outside the project; without them the test says that it was skipped.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::{Content, LoadOptions};
use surfel_model::{Geometry, Object, Scene, SceneFile};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, RenderError, Renderer, View};

fn golden_folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/golden");
    folder.is_dir().then_some(folder)
}

fn scene(file: &SceneFile, folder: &Path) -> Scene {
    let objects = file.objects.iter().map(|object| {
        let path = folder.join(object.splats.as_ref().or(object.mesh.as_ref()).unwrap());
        let geometry = match surfel_io::load(&path, &LoadOptions::default()).unwrap().content {
            Content::Splats(cloud) => Geometry::Splats(Arc::new(cloud)),
            Content::Mesh(mesh) => Geometry::Mesh(Arc::new(mesh)),
            Content::Points(_) => panic!("{} has no splats", path.display()),
        };
        Object { geometry, world_from_object: object.world_from_object().unwrap(), material: object.material }
    });
    Scene {
        up: file.up,
        background: file.background,
        ambient: file.ambient,
        lights: file.lights.clone(),
        objects: objects.collect(),
    }
}

/// Compares one plane outside the mask: |a − b| ≤ atol + 1e-6·|b|, equal infinities equal. Returns the worst excess.
fn worst(got: &[f32], want: &[f32], mask: &[f32], channels: usize, atol: f64) -> (f64, usize) {
    let mut result = (0.0, 0);
    for (i, (a, b)) in got.iter().zip(want).enumerate() {
        if mask[i / channels] != 0.0 || a == b {
            continue;
        }
        let (a, b) = (f64::from(*a), f64::from(*b));
        let error = (a - b).abs() / (atol + 1e-6 * b.abs());
        if error.is_nan() || error > result.0 {
            result = (if error.is_nan() { f64::INFINITY } else { error }, i / channels);
        }
    }
    result
}

#[test]
fn golden_scenes_agree_to_f32_storage() {
    let Some(folder) = golden_folder() else {
        println!("skipped: no golden scenes beside the project");
        return;
    };
    let mut names: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    names.retain(|p| p.extension().is_some_and(|e| e == "json"));
    names.sort();
    let (mut failures, mut compared) = (Vec::new(), 0);
    for path in names {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let file = surfel_io::scene_file::read(&path).unwrap();
        let mut renderer = Reference::new(0).unwrap();
        let resident = renderer.upload(&scene(&file, &folder)).unwrap();
        let view = View::new(&file.camera).unwrap();
        let mut frame = Frame::default();
        let planes = Planes { margin: true, ..Planes::ALL };
        match renderer.render(&resident, &view, &file.settings, planes, &mut frame) {
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
        let median = finite.get(finite.len() / 2).copied().unwrap_or(1.0);
        let planes = [
            ("color", worst(frame.color.as_flattened(), color.as_flattened(), mask, 4, 1e-6)),
            ("Z", worst(&frame.depth, depth, mask, 1, 1e-6 * f64::from(median))),
            ("normal", worst(frame.normal.as_flattened(), want.normal.unwrap().as_flattened(), mask, 3, 1e-6)),
            ("weight", worst(&frame.weight, want.weight.as_ref().unwrap(), mask, 1, 1e-6)),
        ];
        let share = |m: &[f32]| m.iter().sum::<f32>() / m.len() as f32;
        println!("{name}: {planes:?} (share of the tolerance, pixel), mask {} {}", share(mask), share(&frame.margin));
        failures.extend(planes.iter().filter(|p| p.1.0 > 1.0).map(|p| format!("{name} {}: {:?}", p.0, p.1)));
        compared += 1;
    }
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(compared >= 18, "only {compared} scenes were compared");
}
