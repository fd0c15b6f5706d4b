//! Meshes that scenes are built from.

use crate::random::Random;
use glam::DVec3;
use std::sync::Arc;
use surfel_model::{Column3, Geometry, Mesh, Object, PointCloud, Texture};

/// Creates an object drawn as polygons, with the default material.
///
/// # Panics
/// If the mesh is invalid: scenes are written in code, not read.
pub fn mesh_object(mesh: Mesh) -> Object {
    mesh.validate().expect("scenes hold valid meshes");
    Object { geometry: Geometry::Mesh(Arc::new(mesh)), ..crate::build::object(crate::build::cloud(&[])) }
}

/// Creates a mesh of vertices and triangles. The outer side of a triangle is that from which its corners are
/// counter-clockwise.
pub fn mesh(vertices: &[DVec3], triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { positions: Column3::from_f64(vertices), triangles, ..Mesh::default() }
}

/// Creates a parallelogram of two triangles, with the centre `center` and the half-sides `across` and `along`. The
/// outward normal is across × along; texture coordinates run from 0 to `repeats`.
pub fn quad(center: DVec3, [across, along]: [DVec3; 2], repeats: f32) -> Mesh {
    let corner = |x: f64, y: f64| center + across * x + along * y;
    let vertices = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let uvs = [[0.0, repeats], [repeats; 2], [repeats, 0.0], [0.0; 2]];
    Mesh { uvs: Some(uvs.to_vec()), ..mesh(&vertices, vec![[0, 1, 2], [0, 2, 3]]) }
}

/// Creates the unit sphere with vertex normals: an octahedron whose faces are subdivided `times` times.
pub fn mesh_sphere(times: usize) -> Mesh {
    let axes = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
    let mut faces: Vec<[DVec3; 3]> = Vec::new();
    for i in 0..4 {
        let (a, b) = (axes[i], axes[(i + 1) % 4]);
        faces.extend([[a, b, DVec3::Z], [b, a, DVec3::NEG_Z]]);
    }
    for _ in 0..times {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let middle = |a: DVec3, b: DVec3| (a + b).normalize();
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    // Each position has one vertex, so that adjacent triangles share the ends of their edges to the bit.
    let mut vertices: Vec<DVec3> = Vec::new();
    let mut index = std::collections::BTreeMap::new();
    let triangles = faces
        .iter()
        .map(|face| {
            face.map(|p| {
                let key = p.to_array().map(|c| (c + 0.0).to_bits());
                *index.entry(key).or_insert_with(|| {
                    vertices.push(p);
                    vertices.len() as u32 - 1
                })
            })
        })
        .collect();
    let normals = vertices.iter().map(|v| v.as_vec3().to_array()).collect();
    Mesh { normals: Some(normals), ..mesh(&vertices, triangles) }
}

/// Creates a texture of `side`×`side` texels, alternating black and white. Right of the diagonal, blue replaces black,
/// so that swapped u and v are visible.
pub fn checkers(side: u32) -> Arc<Texture> {
    let texel = |i: u32| match (i % side, i / side) {
        (x, y) if (x + y).is_multiple_of(2) => [255; 4],
        (x, y) => [0, 0, if x > y { 200 } else { 0 }, 255],
    };
    Arc::new(Texture { width: side, height: side, srgba8: (0..side * side).map(texel).collect() })
}

/// Creates the cube from −1 to 1, with outward faces.
pub fn cube() -> Mesh {
    let corner = |i: u32| DVec3::from([0, 1, 2].map(|k| f64::from(i >> k & 1) * 2.0 - 1.0));
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    mesh(&(0..8).map(corner).collect::<Vec<_>>(), triangles)
}

/// Returns `count` random points on a mesh, uniform by area. Each point is displaced along each axis by up to `noise`
/// times the largest side of the mesh's bounds.
pub fn sampled(mesh: &Mesh, count: usize, noise: f64, seed: u64) -> PointCloud {
    let mut random = Random::new(seed);
    let corners = |t: &[u32; 3]| t.map(|i| mesh.origin + mesh.positions.get(i as usize));
    let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
    let mut sums: Vec<f64> = Vec::with_capacity(mesh.triangles.len());
    for triangle in &mesh.triangles {
        sums.push(sums.last().copied().unwrap_or(0.0) + area(corners(triangle)));
    }
    let total = sums.last().copied().unwrap_or(0.0);
    let all = || mesh.triangles.iter().flat_map(corners);
    let extent = all().fold(DVec3::NEG_INFINITY, DVec3::max) - all().fold(DVec3::INFINITY, DVec3::min);
    let noise = noise * extent.max_element();
    let point = |i: usize| {
        let at = total * (i as f64 + random.range(0.0, 1.0)) / count as f64;
        let triangle = sums.partition_point(|sum| *sum <= at).min(mesh.triangles.len() - 1);
        let [a, b, c] = corners(&mesh.triangles[triangle]);
        let (along, across) = (random.range(0.0, 1.0).sqrt(), random.range(0.0, 1.0));
        let moved = DVec3::from([0; 3].map(|_: i32| random.range(-noise, noise)));
        a + (b - a) * (along * (1.0 - across)) + (c - a) * (along * across) + moved
    };
    let points: Vec<DVec3> = (0..count).map(point).collect();
    PointCloud { positions: Column3::from_f64(&points), ..PointCloud::default() }
}
