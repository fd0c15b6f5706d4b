//! White objects keep their shape in automatic scenes, and coloured ones their brightness.

use std::path::Path;
use std::sync::Arc;
use surfel_backend::Backend;
use surfel_framing::{FrameProjection, NamedView, ViewChoice};
use surfel_load::{
    LoadedObjects, ObjectFacts,
    scene::{assemble, bare_object},
};
use surfel_model::glam::{DAffine3, DVec3};
use surfel_model::{Geometry, Material, Object, Up};
use surfel_model::{Settings, Shader, SplatCloud};
use surfel_stage::{AutoOptions, auto_scene};

/// Returns a sphere of splats, with this linear colour or none.
fn ball(color: Option<[f32; 3]>) -> LoadedObjects {
    let count = 6000;
    let at = |i: u32| {
        // A Fibonacci lattice has even spacing everywhere.
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let ((sin, cos), r) = ((2.399_963_229_728_653 * f64::from(i)).sin_cos(), (1.0 - z * z).sqrt());
        DVec3::new(r * cos, r * sin, z).as_vec3().to_array()
    };
    let centers: Vec<[f32; 3]> = (0..count).map(at).collect();
    let mut cloud = SplatCloud::disks(&centers, &centers, &vec![0.05; centers.len()]).unwrap();
    if let Some(color) = color {
        cloud = cloud.with_colors(&vec![color; centers.len()]).unwrap();
    }
    loaded(cloud, color.is_some())
}

fn loaded(cloud: SplatCloud, colored: bool) -> LoadedObjects {
    let object = Object {
        geometry: Geometry::Splats(Arc::new(cloud)),
        world_from_object: DAffine3::IDENTITY,
        material: Material::default(),
    };
    let facts = ObjectFacts { colored, is_watertight: true, ..ObjectFacts::default() };
    LoadedObjects { objects: vec![object], facts: vec![facts], ..LoadedObjects::default() }
}

/// Returns the linear luminance of an automatic image, row by row, and that of the background.
fn image(loaded: LoadedObjects, shader: Shader) -> (Vec<Vec<f32>>, f32) {
    image_by(loaded, AutoOptions::default().with_settings(Settings::default().with_shader(shader)))
}

fn image_by(loaded: LoadedObjects, options: AutoOptions) -> (Vec<Vec<f32>>, f32) {
    let options = options.with_size([96, 96]);
    let file = auto_scene(vec![bare_object(Path::new("ball.ply"))], &loaded, &options).unwrap();
    let scene = assemble(&file, loaded.objects).unwrap();
    let mut backend = Backend::auto().unwrap();
    let resident = backend.upload(&scene).unwrap();
    let frame = backend.render(&resident, &file.camera, &file.settings).unwrap();
    let luminance: Vec<f32> = frame.color().iter().map(|c| c[0].max(c[1]).max(c[2])).collect();
    (luminance.chunks_exact(96).map(<[f32]>::to_vec).collect(), file.background[0] as f32)
}

/// Returns the object's pixels of a row, from the first to the last that differs from the background.
fn object_of(row: &[f32], background: f32) -> &[f32] {
    let differs = |v: &f32| (v - background).abs() > 0.01;
    match (row.iter().position(differs), row.iter().rposition(differs)) {
        (Some(first), Some(last)) => &row[first..=last],
        _ => &[],
    }
}

#[test]
fn lit_white_objects_are_darker_than_white_and_darkest_at_their_outline() {
    for color in [None, Some([1.0; 3]), Some([3.0; 3])] {
        let (rows, background) = image(ball(color), Shader::Phong);
        assert_eq!(background, 1.0);
        let shown: Vec<&[f32]> = rows.iter().map(|row| object_of(row, background)).collect();
        let brightest = shown.iter().flat_map(|row| row.iter()).copied().fold(0.0, f32::max);
        let darkest = shown.iter().flat_map(|row| row.iter()).copied().fold(1.0, f32::min);
        assert!((0.6..=0.92).contains(&brightest), "{color:?}: {brightest}");
        assert!(brightest - darkest > 0.4, "{color:?}: from {darkest} to {brightest}");
        for row in shown.iter().filter(|row| row.len() > 20) {
            let rim = [row[1], row[row.len() - 2]];
            assert!(rim.iter().all(|v| *v < 0.8), "{color:?}: {rim:?}");
        }
    }
}

#[test]
fn unlit_white_objects_stand_before_grey() {
    for color in [None, Some([0.95; 3])] {
        let (rows, background) = image(ball(color), Shader::Unlit);
        let center = rows[48][48];
        // Unlit objects are drawn with their albedo, scene-linear.
        assert!((center - color.map_or(1.0, |c| c[0])).abs() < 1e-3);
        assert!(background < 0.3, "{background}");
    }
    let (rows, background) = image(ball(Some([0.5, 0.2, 0.1])), Shader::Unlit);
    assert_eq!(background, 1.0);
    assert!((rows[48][48] - 0.5).abs() < 1e-3);
}

#[test]
fn white_ground_is_seen_from_above() {
    let centers: Vec<[f32; 3]> = (0..2500).map(|i| [(i % 50) as f32, (i / 50) as f32, 0.0]).collect();
    let ground = SplatCloud::disks(&centers, &vec![[0.0, 0.0, 1.0]; 2500], &vec![1.5; 2500]).unwrap();
    let view = AutoOptions::default()
        .with_up(Some(Up::PlusZ))
        .with_view(ViewChoice::Named(NamedView::Top))
        .with_projection(FrameProjection::Orthographic);
    for shader in [Shader::Unlit, Shader::Phong, Shader::Toon, Shader::Matcap, Shader::Edl] {
        let settings = Settings::default().with_shader(shader);
        let (rows, background) = image_by(loaded(ground.clone(), false), view.clone().with_settings(settings));
        let seen = rows.iter().flatten().filter(|v| (*v - background).abs() > 0.05).count();
        assert!(seen > 5000, "{shader:?}: {seen} pixels");
    }
}

#[test]
fn coloured_objects_are_as_bright_as_they_are() {
    let material = |color| {
        let loaded = ball(Some(color));
        let file = auto_scene(vec![bare_object(Path::new("ball.ply"))], &loaded, &AutoOptions::default()).unwrap();
        file.objects[0].material
    };
    let [dark, bright] = [[0.1, 0.2, 0.3], [0.8, 0.3, 0.2]].map(material);
    assert_eq!((dark.ambient, dark.diffuse), (1.3, 0.95));
    assert_eq!(dark, bright);
    assert!(material([1.0; 3]).diffuse < 0.9);
}
