//! The real scans, where they are: `../shared/models` beside the workspace.

mod common;

use common::{Lcg, coverage};
use glam::{DVec3, Vec3};
use std::path::PathBuf;
use surfel_model::{Column3, Mesh, PointCloud, Shape};
use surfel_sample::{MeshMethod, MeshOptions, NoProgress, PointOptions, splats_from_mesh, splats_from_points};

/// The file's bytes behind its header, or `None` with a printed line.
fn body(name: &str) -> Option<Vec<u8>> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/models").join(name);
    let Ok(bytes) = std::fs::read(&path) else {
        println!("skipped: {} isn't there", path.display());
        return None;
    };
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    Some(bytes[end..].to_vec())
}

fn vector(bytes: &[u8]) -> Vec3 {
    let at = |k: usize| f32::from_le_bytes(bytes[4 * k..4 * k + 4].try_into().unwrap());
    Vec3::new(at(0), at(1), at(2))
}

#[test]
fn igea_per_vertex_covers_its_mesh() {
    const VERTICES: usize = 134_345;
    let Some(bytes) = body("igea.ply") else { return };
    let positions: Vec<Vec3> = bytes.chunks(12).take(VERTICES).map(vector).collect();
    let strips: Vec<i32> =
        bytes[12 * VERTICES + 4..].chunks_exact(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect();
    let mut triangles = Vec::new();
    for strip in strips.split(|i| *i < 0) {
        for (k, w) in strip.windows(3).enumerate() {
            let [a, b, c] = [w[0] as u32, w[1] as u32, w[2] as u32];
            triangles.push(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
        }
    }
    let mesh = Mesh { positions: Column3::from_f32(positions), triangles, ..Mesh::default() };
    assert_eq!(MeshOptions::auto(&mesh).method, MeshMethod::PerVertex);
    let (cloud, report) = splats_from_mesh(&mesh, &MeshOptions::auto(&mesh), &NoProgress).unwrap();
    let mut random = Lcg(3);
    let places: Vec<(DVec3, DVec3)> = mesh
        .triangles
        .iter()
        .filter_map(|t| {
            let [a, b, c] = t.map(|i| mesh.positions.get(i as usize));
            let n = (b - a).cross(c - a).try_normalize()?;
            let (u, v) = (random.unit(), random.unit());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            Some((a + (b - a) * u + (c - a) * v, n))
        })
        .collect();
    let c = coverage(&cloud, &places);
    println!("igea: {c:?}, {report:?}");
    assert!(c.holes == 0 && c.twice > 0.999, "{c:?}");
    assert!((3.0..6.0).contains(&report.interior_weight.unwrap()));
}

#[test]
fn lion_with_given_normals() {
    const POINTS: usize = 272_768;
    let Some(bytes) = body("lion_takanawa.ply") else { return };
    let rows = || bytes.chunks_exact(27).take(POINTS);
    let points = PointCloud {
        positions: Column3::from_f32(rows().map(vector).collect()),
        normals: Some(Column3::from_f32(rows().map(|r| vector(&r[12..])).collect())),
        ..PointCloud::default()
    };
    let (cloud, report) = splats_from_points(&points, &PointOptions::default(), &NoProgress).unwrap();
    println!("lion: {report:?}");
    assert!(matches!(cloud.data().shape, Shape::Disks { .. }));
    assert_eq!(report.normals_given, POINTS);
    assert!((3.0..6.0).contains(&report.interior_weight.unwrap()));
    // Above the points themselves, and halfway to the nearest of the next hundred: nothing bare but stray points.
    let places: Vec<(DVec3, DVec3)> = (0..POINTS - 100)
        .step_by(50)
        .filter_map(|i| {
            let p = cloud.center(i);
            let near = (i + 1..i + 100)
                .map(|j| cloud.center(j))
                .filter(|q| q.distance(p) < 3.0 * report.median_radius)
                .max_by(|a, b| a.distance(p).total_cmp(&b.distance(p)))?;
            Some((0.5 * (p + near), cloud.normal(i)))
        })
        .collect();
    let c = coverage(&cloud, &places);
    println!("lion: {c:?} of {}", places.len());
    // Midpoints of chords across edges of the statue lie beside it.
    assert!((c.holes as f64) < 0.01 * places.len() as f64, "{c:?} of {}", places.len());
}
