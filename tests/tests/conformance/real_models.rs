//! Tests of scanned and modelled surfaces that aren't shipped: files are read completely, and splats cover the surface.

use glam::DVec3;
use std::path::PathBuf;
use surfel_conformance::test_data;
use surfel_io::{Content, LoadOptions, load};
use surfel_model::{Mesh, PointCloud, Shape};
use surfel_sample::{MeshMethod, MeshOptions, NoProgress, PointOptions, splats_from_mesh, splats_from_points};

#[path = "../../../crates/surfel-sample/tests/common/mod.rs"]
mod sampling;

use sampling::{Lcg, coverage};

/// Returns a model's path; if it doesn't exist, prints a note and returns `None`.
fn model(name: &str) -> Option<PathBuf> {
    let path = test_data::folder("models")?.join(name);
    if !path.is_file() {
        println!("skipped: {} isn't there", path.display());
        return None;
    }
    Some(path)
}

fn mesh(name: &str) -> Option<Mesh> {
    match load(&model(name)?, &LoadOptions::default()).unwrap().content {
        Content::Mesh(mesh) => Some(mesh),
        _ => panic!("{name} is a mesh"),
    }
}

fn points(name: &str) -> Option<PointCloud> {
    match load(&model(name)?, &LoadOptions::default()).unwrap().content {
        Content::Points(points) => Some(points),
        _ => panic!("{name} is a point cloud"),
    }
}

#[test]
fn models_have_the_documented_sizes() {
    for (name, vertices, triangles) in [
        ("igea.ply", 134_345, 268_686),
        ("lion_takanawa.ply", 272_768, 0),
        ("fandisk.obj", 6_475, 12_946),
        ("rocker-arm.obj", 10_044, 20_088),
        ("stanford-bunny.obj", 35_947, 69_451),
        ("teapot.obj", 3_644, 6_320),
        // 2,930 positions, more with the texture's seams.
        ("spot/spot.obj", 3_225, 5_856),
    ] {
        let Some(path) = model(name) else { continue };
        let loaded = load(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        let found = match &loaded.content {
            Content::Splats(s) => (s.len(), usize::MAX),
            Content::Points(p) => (p.len(), 0),
            Content::Mesh(m) => (m.positions.len(), m.triangles.len()),
            Content::Gaussians(g) => (g.len(), 0),
            Content::Octree(h) => (h.cloud().len(), h.mesh().triangles.len()),
        };
        assert_eq!(found, (vertices, triangles), "{name}");
        assert!(loaded.notes.is_empty(), "{name}: {:?}", loaded.notes);
    }
}

#[test]
fn triangle_strips_make_a_closed_oriented_surface() {
    let Some(mesh) = mesh("igea.ply") else { return };
    // The divergence theorem: a strip whose winding doesn't alternate would cancel most of the volume.
    let corner = |i: u32| mesh.positions.get(i as usize);
    let signed = |t: &[u32; 3]| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0;
    let face = |t: &[u32; 3]| (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).length() / 2.0;
    let volume: f64 = mesh.triangles.iter().map(signed).sum();
    let area: f64 = mesh.triangles.iter().map(face).sum();
    // A head has at least a quarter of the volume of a sphere of the same area; inconsistent winding yields almost
    // nothing.
    let sphere = (area / (4.0 * std::f64::consts::PI)).powf(1.5) * 4.0 / 3.0 * std::f64::consts::PI;
    assert!(volume > 0.25 * sphere, "{volume} {sphere}");
}

#[test]
fn splats_of_a_scanned_mesh_cover_it() {
    let Some(mesh) = mesh("igea.ply") else { return };
    assert_eq!(MeshOptions::auto(&mesh).method, MeshMethod::PerVertex);
    let (cloud, report) = splats_from_mesh(&mesh, &MeshOptions::auto(&mesh), &NoProgress).unwrap();
    let mut random = Lcg(3);
    let mut place = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions.get(i as usize));
        let n = (b - a).cross(c - a).try_normalize()?;
        let (u, v) = (random.unit(), random.unit());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        Some((a + (b - a) * u + (c - a) * v, n))
    };
    let places: Vec<(DVec3, DVec3)> = mesh.triangles.iter().filter_map(&mut place).collect();
    let c = coverage(&cloud, &places);
    println!("igea: {c:?}, {report:?}");
    assert!(c.holes == 0 && c.twice > 0.999, "{c:?}");
    assert!((3.0..6.0).contains(&report.interior_weight.unwrap()));
}

#[test]
fn splats_of_a_scan_with_normals_leave_no_holes() {
    const POINTS: usize = 272_768;
    let Some(PointCloud { origin, positions, normals, .. }) = points("lion_takanawa.ply") else { return };
    let points = PointCloud { origin, positions, normals, ..PointCloud::default() };
    let (cloud, report) = splats_from_points(&points, &PointOptions::default(), &NoProgress).unwrap();
    println!("lion: {report:?}");
    assert!(matches!(cloud.data().shape, Shape::Disks { .. }));
    assert_eq!(report.normals_given, POINTS);
    assert!((3.0..6.0).contains(&report.interior_weight.unwrap()));
    // Places at the points themselves, and halfway to the farthest near one among the next hundred: only stray points
    // may be uncovered.
    let place = |i: usize| {
        let p = cloud.center(i);
        let near = (i + 1..i + 100)
            .map(|j| cloud.center(j))
            .filter(|q| q.distance(p) < 3.0 * report.median_radius)
            .max_by(|a, b| a.distance(p).total_cmp(&b.distance(p)))?;
        Some((0.5 * (p + near), cloud.normal(i)))
    };
    let places: Vec<(DVec3, DVec3)> = (0..POINTS - 100).step_by(50).filter_map(place).collect();
    let c = coverage(&cloud, &places);
    println!("lion: {c:?} of {}", places.len());
    // Midpoints of chords across edges of the statue are beside the surface.
    assert!((c.holes as f64) < 0.01 * places.len() as f64, "{c:?} of {}", places.len());
}
