//! Automatic scenes cull the backs of watertight clouds and no others.

use std::path::Path;
use std::sync::Arc;
use surfel_backend::Backend;
use surfel_load::{
    LoadedObjects, ObjectFacts,
    scene::{assemble, bare_object},
};
use surfel_model::SplatCloud;
use surfel_model::glam::{DAffine3, DVec3};
use surfel_model::{Cull, Geometry, Material, Object};
use surfel_stage::{AutoOptions, auto_scene};

/// Returns splats of a sphere, evenly spaced, up to a height; no file states that they are watertight.
fn ball_up_to(height: f64) -> LoadedObjects {
    let count = 6000;
    let at = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let ((sin, cos), r) = ((2.399_963_229_728_653 * f64::from(i)).sin_cos(), (1.0 - z * z).sqrt());
        DVec3::new(r * cos, r * sin, z)
    };
    let centers: Vec<[f32; 3]> = (0..count).map(at).filter(|p| p.z < height).map(|p| p.as_vec3().to_array()).collect();
    let cloud = SplatCloud::disks(&centers, &centers, &vec![0.05; centers.len()]).unwrap();
    let object = Object {
        geometry: Geometry::Splats(Arc::new(cloud)),
        world_from_object: DAffine3::IDENTITY,
        material: Material::default(),
    };
    LoadedObjects { objects: vec![object], facts: vec![ObjectFacts::default()], ..LoadedObjects::default() }
}

/// Returns the culling of an automatic scene.
fn cull_of(loaded: &LoadedObjects) -> Cull {
    let options = AutoOptions::default().with_size([96, 96]);
    auto_scene(vec![bare_object(Path::new("ball.ply"))], loaded, &options).unwrap().objects[0].material.cull
}

#[test]
fn the_back_is_left_out_of_what_closes_alone() {
    assert_eq!(cull_of(&ball_up_to(2.0)), Cull::Back);
    assert_eq!(cull_of(&ball_up_to(0.0)), Cull::None);
}

#[test]
fn what_a_file_says_of_its_splats_decides() {
    let with = |facts: ObjectFacts| LoadedObjects { facts: vec![facts], ..ball_up_to(2.0) };
    let known = ObjectFacts { sides_known: true, ..ObjectFacts::default() };
    let partial = ObjectFacts { partial: true, ..ObjectFacts::default() };
    let transparent = ObjectFacts { transparent: true, ..ObjectFacts::default() };
    for facts in [known, partial, transparent] {
        assert_eq!(cull_of(&with(facts)), Cull::None);
    }
    let watertight = ObjectFacts { is_watertight: true, ..ObjectFacts::default() };
    assert_eq!(cull_of(&LoadedObjects { facts: vec![watertight], ..ball_up_to(0.0) }), Cull::Back);
}

#[test]
fn leaving_the_back_out_opens_no_hole() {
    let loaded = ball_up_to(2.0);
    let options = AutoOptions::default().with_size([96, 96]);
    let mut file = auto_scene(vec![bare_object(Path::new("ball.ply"))], &loaded, &options).unwrap();
    let mut backend = Backend::auto().unwrap();
    let mut draw = |cull: Cull| {
        file.objects[0].material.cull = cull;
        let scene = assemble(&file, loaded.objects.clone()).unwrap();
        let resident = backend.upload(&scene).unwrap();
        backend.render(&resident, &file.camera, &file.settings).unwrap()
    };
    let (culled, all) = (draw(Cull::Back), draw(Cull::None));
    let inside = |i: usize| (20..76).contains(&(i % 96)) && (20..76).contains(&(i / 96));
    for (i, (c, a)) in culled.color().iter().zip(all.color()).enumerate().filter(|(i, _)| inside(*i)) {
        let differs = (0..4).any(|k| (c[k] - a[k]).abs() > 1e-6);
        assert!(!differs, "pixel {i}: {c:?} {a:?}");
    }
}
