//! Points of COPC files outside the view frustum: skipped if no image changes, read if their shadows are visible.
#![cfg(feature = "cpu")]

use crate::level_pops::{Colors, hills};
use std::path::Path;
use surfel_app::request::{Pictures, RenderOptions, Request, Resolved, Source};
use surfel_backend::{Backend, BackendOptions};
use surfel_model::{Geometry, Scene, SplatCloud};
use surfel_render::{Frame, Planes, Renderer};
use surfel_sample::NoProgress;

/// Resolves a scene of the hills in low light, viewed down into a valley. `folder` holds their file.
fn resolved(folder: &Path, projection: &str, shadow: bool) -> Resolved {
    let scene = format!(
        r#"{{
            "up": "+z",
            "camera": {{ "eye": [36, 11, 5], "target": [39.3, 18.5, -3], "up": [0, 0, 1],
                         "projection": {projection}, "near": 0.1, "far": 100, "size": [96, 64] }},
            "background": [1, 1, 1, 1],
            "ambient": [0, 0, 0],
            "lights": [{{ "directional": {{ "direction": [1, 0.1, -0.15], "color": [1, 1, 1], "shadow": {shadow} }} }}],
            "objects": [{{ "splats": "out.copc.laz" }}],
            "settings": {{ "shader": "phong" }}
        }}"#
    );
    let path = folder.join("scene.json");
    std::fs::write(&path, scene).unwrap();
    let source = Source::of(&[path], None).unwrap();
    let request = Request::new(source, &Pictures::One, &RenderOptions::default()).unwrap();
    let loaded = request.load(&NoProgress).unwrap();
    request.resolve(loaded, &NoProgress, &mut |_| ()).unwrap()
}

fn cloud(scene: &Scene) -> &SplatCloud {
    match &scene.objects[0].geometry {
        Geometry::Splats(cloud) => cloud,
        _ => panic!("no splats"),
    }
}

/// Returns the scene with the splats of another one.
fn with_splats_of(scene: &Scene, other: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.objects[0].geometry = other.objects[0].geometry.clone();
    scene
}

fn drawn(backend: &str, scene: &Scene, resolved: &Resolved) -> Frame {
    let mut backend = Backend::by_name(backend, &BackendOptions::default()).unwrap();
    let resident = backend.upload(scene).unwrap();
    let (camera, settings) = (&resolved.file.camera, &resolved.file.settings);
    let view = surfel_render::View::new(camera).unwrap();
    let mut frame = Frame::default();
    backend.render_into(&resident, &view, settings, Planes::ALL, &mut frame).unwrap();
    frame
}

/// Returns the largest difference of two images' planes, relative for numbers greater than 1.
fn difference(a: &Frame, b: &Frame) -> f32 {
    let planes = |frame: &Frame| {
        let (color, normal) = (frame.color().as_flattened().to_vec(), frame.normal().as_flattened().to_vec());
        [color, normal, frame.depth().to_vec(), frame.weight().to_vec()].concat()
    };
    let apart = |(a, b): (f32, f32)| if a == b { 0.0 } else { (a - b).abs() / a.abs().max(1.0) };
    planes(a).into_iter().zip(planes(b)).map(apart).fold(0.0, f32::max)
}

const PERSPECTIVE: &str = r#"{ "perspective": { "fov_y_deg": 40 } }"#;
const ORTHOGRAPHIC: &str = r#"{ "orthographic": { "height": 7 } }"#;

#[test]
fn points_out_of_sight_are_dropped_and_no_picture_shows_it() {
    let (folder, _) = hills(Colors::Fields, true);
    for projection in [PERSPECTIVE, ORTHOGRAPHIC] {
        // If lights cast shadows, all points are read.
        let [shown, all] = [false, true].map(|shadow| resolved(&folder.0, projection, shadow));
        let whole = with_splats_of(&shown.scene, &all.scene);
        let [few, many] = [&shown.scene, &whole].map(|scene| cloud(scene).len());
        assert!(few > 1000 && 2 * few < many, "{few} of {many}");
        // The remaining points are unchanged, to the bit.
        let splat = |cloud: &SplatCloud, i: usize| {
            let number = |v: f64| v.to_bits();
            let color = cloud.data().colors.as_ref().unwrap()[i].map(f32::to_bits);
            (cloud.center(i).to_array().map(number), cloud.normal(i).to_array().map(number), color)
        };
        let (kept, every) = (cloud(&shown.scene), cloud(&whole));
        let places = |cloud: &SplatCloud| -> std::collections::BTreeMap<_, _> {
            (0..cloud.len()).map(|i| (splat(cloud, i).0.map(|v| (f64::from_bits(v) * 1e4).round() as i64), i)).collect()
        };
        let (of_kept, of_every) = (places(kept), places(every));
        for (place, i) in of_kept {
            let j = of_every[&place];
            assert_eq!((splat(kept, i).1, splat(kept, i).2), (splat(every, j).1, splat(every, j).2));
            assert_eq!(kept.radius_max(i).to_bits(), every.radius_max(j).to_bits());
        }
        // Sums follow the order of splats, which depends on the bounds of all splats.
        let apart = difference(&drawn("cpu", &shown.scene, &shown), &drawn("cpu", &whole, &shown));
        assert!(apart < 2e-4, "{projection}: {apart}");
        #[cfg(feature = "reference")]
        {
            let apart = difference(&drawn("reference", &shown.scene, &shown), &drawn("reference", &whole, &shown));
            assert_eq!(apart, 0.0, "{projection}");
        }
    }
}

#[test]
fn points_out_of_sight_that_cast_shadows_into_it_are_kept() {
    let (folder, _) = hills(Colors::Fields, true);
    let [shown, all] = [false, true].map(|shadow| resolved(&folder.0, ORTHOGRAPHIC, shadow));
    let without = with_splats_of(&all.scene, &shown.scene);
    let [with, without] = [&all.scene, &without].map(|scene| drawn("cpu", scene, &all));
    let light = |frame: &Frame| frame.color().iter().map(|c| f64::from(c[1])).sum::<f64>();
    assert!(light(&with) < 0.5 * light(&without), "{} {}", light(&with), light(&without));
}
