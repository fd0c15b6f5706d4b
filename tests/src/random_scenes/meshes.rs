//! Random polygons.

use crate::polygons::{checkers, mesh, mesh_object, mesh_sphere, quad};
use crate::random::Random;
use glam::{DAffine3, DQuat, DVec3};
use surfel_model::{Mesh, Object};

/// Creates a random object of polygons: a wall, a ball or separate triangles, some with colours, normals or a texture.
pub(super) fn object(random: &mut Random) -> Object {
    let mut mesh = match random.below(3) {
        0 => quad(random.direction() * random.range(0.0, 0.8), [random.direction(), random.direction()], 4.0),
        1 => mesh_sphere(random.below(3)),
        _ => loose(random),
    };
    let vertices = mesh.positions.len();
    if random.chance(0.3) {
        mesh.normals = None;
    }
    if random.chance(0.6) {
        mesh.colors = Some((0..vertices).map(|_| random.color()).collect());
    }
    if random.chance(0.3) {
        // Multiples of 1/64 are stored exactly in a file.
        let coordinate = |random: &mut Random| random.below(257) as f32 / 64.0 - 1.0;
        mesh.uvs.get_or_insert_with(|| (0..vertices).map(|_| [coordinate(random), coordinate(random)]).collect());
        mesh.texture = Some(checkers(2 + random.below(5) as u32));
    }
    let mut object = mesh_object(mesh);
    if random.chance(0.6) {
        let turn = DQuat::from_axis_angle(random.direction(), random.range(-3.0, 3.0));
        let mut scale = || random.range(0.3, 1.5);
        let scale = DVec3::new(scale(), scale(), scale());
        let mirror = if random.chance(0.4) { DVec3::new(1.0, -1.0, 1.0) } else { DVec3::ONE };
        let offset = random.direction() * random.range(0.0, 0.5);
        object.world_from_object = DAffine3::from_scale_rotation_translation(scale * mirror, turn, offset);
    }
    object
}

/// Creates triangles of random sizes without shared vertices.
fn loose(random: &mut Random) -> Mesh {
    let count = 1 + random.below(12);
    let mut vertices = Vec::new();
    for _ in 0..count {
        let (center, size) = (random.direction() * random.range(0.0, 1.0), random.factor(0.05, 3.0));
        vertices.extend((0..3).map(|_| center + random.direction() * size));
    }
    let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let normals = vertices.iter().map(|_| random.direction().as_vec3().to_array()).collect();
    Mesh { normals: Some(normals), ..mesh(&vertices, triangles) }
}
