//! Tests that splats of models have no holes from any side, with any filter: no pixel without a splat inside the area
//! that the same mesh's polygons cover.

use crate::splats_of_meshes::{VIEWS, directions, hole_count};
use glam::DVec3;
use surfel_conformance::build::object;
use surfel_conformance::polygons::mesh_object;
use surfel_conformance::test_data;
use surfel_io::{Content, LoadOptions, load};
use surfel_model::{Camera, Cull, Filter, Mesh, Projection, Scene, Settings, Shader, SplatCloud};
use surfel_render::{Frame, Planes, Renderer, View};
use surfel_sample::{
    MeshMethod, MeshOptions, NoProgress, SharpOptions, is_closed, sharp_splats_from_mesh, splats_from_mesh,
};

const SIZE: u32 = 144;
/// Distance of the eye from the middle, over half the diagonal of the bounds.
const DISTANCE: f64 = 4.0;

fn model(name: &str) -> Option<Mesh> {
    let path = test_data::folder("models")?.join(name);
    match load(&path, &LoadOptions::default()).unwrap().content {
        Content::Mesh(mesh) => Some(mesh),
        _ => panic!("{name} is a mesh"),
    }
}

/// Returns cameras in 48 directions that see all of the mesh.
fn cameras(mesh: &Mesh) -> impl Iterator<Item = Camera> {
    let points = || mesh.triangles.iter().flatten().map(|i| mesh.positions.get(*i as usize));
    let (low, high) = (points().fold(DVec3::INFINITY, DVec3::min), points().fold(DVec3::NEG_INFINITY, DVec3::max));
    let (middle, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
    directions(VIEWS).map(move |direction| Camera {
        eye: (middle + direction * radius * DISTANCE).to_array(),
        target: middle.to_array(),
        up: if direction.z.abs() > 0.99 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] },
        projection: Projection::Perspective { fov_y_deg: 2.0 * (1.0 / DISTANCE).asin().to_degrees() },
        near: 0.01 * radius,
        far: None,
        size: [SIZE; 2],
    })
}

/// Returns the number of holes by filter, over all views, and the number of pixels searched.
fn holes(mesh: &Mesh, cloud: SplatCloud) -> ([usize; Filter::ALL.len()], usize) {
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let cull = if is_closed(mesh) { Cull::Back } else { Cull::None };
    let [of_splats, of_polygons] = [object(cloud), mesh_object(mesh.clone())].map(|mut object| {
        object.material.cull = cull;
        cpu.upload(&Scene { objects: vec![object], ..Scene::default() }).unwrap()
    });
    let (mut counts, mut all) = ([0; Filter::ALL.len()], 0);
    let (mut polygons, mut splats) = (Frame::default(), Frame::default());
    for camera in cameras(mesh) {
        let view = View::new(&camera).unwrap();
        let settings = Settings::default().with_shader(Shader::Unlit);
        cpu.render_into(&of_polygons, &view, &settings, Planes::ALL, &mut polygons).unwrap();
        for (filter, count) in Filter::ALL.into_iter().zip(&mut counts) {
            let settings = settings.with_filter(filter);
            cpu.render_into(&of_splats, &view, &settings, Planes::ALL, &mut splats).unwrap();
            let [holes, inside] = hole_count(&splats, &polygons);
            *count += holes;
            all += inside;
        }
    }
    (counts, all)
}

#[test]
fn splats_of_models_have_no_holes_from_any_side() {
    check_models(&["fandisk.obj"]);
}

#[test]
#[ignore = "61 s: cargo xtask test --full"]
fn splats_of_a_curved_part_and_a_scan_have_no_holes_from_any_side() {
    check_models(&["rocker-arm.obj", "igea.ply"]);
}

/// Checks that models have no holes if they are drawn like bare files, with splats two pixels apart. Where bare files
/// would get a number of splats, it is 20,000. Models that aren't there are skipped.
fn check_models(names: &[&str]) {
    for name in names {
        let Some(mesh) = model(name) else { continue };
        let options = match MeshOptions::auto(&mesh).method {
            MeshMethod::Count(_) => MeshOptions::new(MeshMethod::Count(20_000)),
            _ => MeshOptions::auto(&mesh),
        };
        let (counts, inside) = holes(&mesh, splats_from_mesh(&mesh, &options, &NoProgress).unwrap().0);
        println!("{name}: {counts:?} of {inside}");
        assert!(inside > 500_000 && counts == [0; 5], "{name}: {counts:?} of {inside}");
    }
}

/// No pixel is empty in which a large clipped splat, seen from the side, hides another surface.
#[test]
fn sharp_splats_have_no_holes_from_any_side() {
    check_sharp_models(&[("fandisk.obj", Some(2500))]);
}

#[test]
#[ignore = "20 s: cargo xtask test --full"]
fn sharp_splats_of_a_curved_part_have_no_holes_from_any_side() {
    check_sharp_models(&[("rocker-arm.obj", None)]);
}

/// Checks that models drawn as clipped splats have no holes. `models` are names with numbers of splats; `None` is the
/// default number.
fn check_sharp_models(models: &[(&str, Option<usize>)]) {
    for &(name, splats) in models {
        let Some(mesh) = model(name) else { continue };
        let options = SharpOptions { splats, ..SharpOptions::default() };
        let (counts, inside) = holes(&mesh, sharp_splats_from_mesh(&mesh, &options, &NoProgress).unwrap().0);
        println!("{name}: {counts:?} of {inside}");
        assert!(inside > 500_000 && counts == [0; 5], "{name}: {counts:?} of {inside}");
    }
}
