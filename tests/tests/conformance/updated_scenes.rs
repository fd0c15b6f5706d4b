//! Updates of resident scenes: matrices, materials and lights change, and images are those of a new upload.

use crate::validated_gpu;
use glam::{DAffine3, DVec3};
use std::collections::BTreeSet;
use surfel_conformance::harness::render;
use surfel_conformance::scenes::{self, Case};
use surfel_model::{Cull, Geometry, Light, Material, Scene};
use surfel_render::{Frame, Planes, Renderer};

/// Parts of names. Of each, GPUs draw the first scene whose name contains it: both facings, polygons among splats, an
/// octree, shadows, balls, dots, and transparency.
const OF_GPUS: [&str; 7] =
    ["oriented-cube", "mesh-through-sphere", "octree", "shadow", "ball-over-floor", "dots", "glass"];

/// Returns the scene of a case with its objects elsewhere, of other materials, and in other light.
fn elsewhere(case: &Case) -> Scene {
    let mut scene = case.scene.clone();
    for (i, object) in scene.objects.iter_mut().enumerate() {
        let turn = DAffine3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7 + i as f64);
        object.world_from_object = turn * object.world_from_object * DAffine3::from_scale(DVec3::splat(1.25));
        object.world_from_object.translation += DVec3::new(0.3, -0.2, 0.1);
        let own = object.material;
        object.material = Material { diffuse: 0.3, shininess: 3.0, cull: Cull::None, ..own };
    }
    scene.lights = Some(vec![Light::Directional { direction: [0.3, -1.0, 0.2], color: [0.5; 3], shadow: false }]);
    (scene.ambient, scene.background) = ([0.4, 0.0, 0.1], [0.2, 0.3, 0.4, 1.0]);
    scene
}

/// Updates resident scenes to those of cases, and compares each image with that of a new upload. Cases that the backend
/// can't draw are skipped. Returns how many were compared.
fn draws_what_a_new_upload_does(renderer: &mut impl Renderer, is_wanted: impl Fn(&str) -> bool) -> usize {
    let mut compared = 0;
    for case in scenes::all().iter().filter(|case| is_wanted(&case.name)) {
        let Ok(want) = render(renderer, case, Planes::ALL) else { continue };
        let before = elsewhere(case);
        let Ok(mut resident) = renderer.upload(&before) else { continue };
        let (view, mut frame) = (case.view(), Frame::default());
        // Fills what a backend stores from frame to frame, such as shadow maps.
        let _ = renderer.render_into(&resident, &view, &case.settings, Planes::ALL, &mut frame);
        assert!(renderer.update(&mut resident, &case.scene).unwrap(), "{}", case.name);
        renderer.render_into(&resident, &view, &case.settings, Planes::ALL, &mut frame).unwrap();
        assert!(frame == want, "{}: the image after an update differs", case.name);

        let mut other = case.scene.clone();
        other.objects.extend(before.objects.first().cloned());
        assert!(!renderer.update(&mut resident, &other).unwrap(), "{}: another object", case.name);
        renderer.render_into(&resident, &view, &case.settings, Planes::ALL, &mut frame).unwrap();
        assert!(frame == want, "{}: a refused update changes nothing", case.name);
        compared += 1;
    }
    compared
}

#[test]
fn cpu_draws_updated_scenes_as_new_ones() {
    let mut cpu = surfel_cpu::Renderer::new(surfel_cpu::Options::default()).unwrap();
    assert!(draws_what_a_new_upload_does(&mut cpu, |_| true) > 100);
}

#[test]
fn gpus_draw_updated_scenes_as_new_ones() {
    let all = scenes::all();
    let names: BTreeSet<&str> = OF_GPUS
        .iter()
        .filter_map(|part| all.iter().map(|case| case.name.as_str()).find(|name| name.contains(part)))
        .collect();
    assert_eq!(names.len(), OF_GPUS.len(), "{names:?}");
    if let Some(mut ash) = validated_gpu::ash() {
        assert!(draws_what_a_new_upload_does(&mut ash, |name| names.contains(name)) >= OF_GPUS.len() - 1);
    }
    if let Some(mut wgpu) = validated_gpu::wgpu() {
        assert!(draws_what_a_new_upload_does(&mut wgpu, |name| names.contains(name)) >= OF_GPUS.len() - 1);
        validated_gpu::no_messages();
    }
}

#[test]
fn geometry_that_was_copied_is_another() {
    let mut cpu = surfel_cpu::Renderer::new(surfel_cpu::Options::default()).unwrap();
    let case = scenes::facing_splat();
    let mut resident = cpu.upload(&case.scene).unwrap();
    let mut copied = case.scene.clone();
    let Geometry::Splats(cloud) = &copied.objects[0].geometry else { panic!() };
    copied.objects[0].geometry = surfel_model::SplatCloud::clone(cloud).into();
    assert!(cpu.update(&mut resident, &case.scene).unwrap() && !cpu.update(&mut resident, &copied).unwrap());
}
