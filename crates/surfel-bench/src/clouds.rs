//! Generated surfaces. Formulas and fixed seeds give the same splats on every machine.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use surfel_model::SplatCloud;
use surfel_model::{CloudData, Column3, Mesh, ModelError, OnInvalid, Shape};

/// Mean number of splats over each point of a surface. On a hexagonal lattice, 1.06 would suffice to cover the plane;
/// the rest is the overlap that blending needs.
pub(crate) const LAYERS: f64 = 3.8;

/// Waves of bumps on the ball, from coarse to fine: number of cycles around the ball, and height relative to the
/// radius.
const OCTAVES: [(f64, f64); 4] = [(1.5, 0.12), (3.0, 0.06), (7.0, 0.02), (15.0, 0.006)];

/// Number of waves per octave, each with another direction.
const WAVES_PER_OCTAVE: usize = 3;

/// Returns a watertight, bumpy surface of genus 0 about the origin with a radius of about 1, similar to a scanned head.
/// It consists of `count` coloured disks on a Fibonacci lattice.
pub(crate) fn ball(count: usize) -> Result<SplatCloud, ModelError> {
    let waves = waves();
    let golden = PI * (3.0 - 5f64.sqrt());
    let solid_angle = 4.0 * PI / count as f64;
    build(count, LAYERS, |i| {
        let y = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let (sine, cosine) = (golden * i as f64 % TAU).sin_cos();
        let across = (1.0 - y * y).sqrt();
        let direction = DVec3::new(across * cosine, y, across * sine);
        let (radius, normal) = bumpy(&waves, direction);
        let area = solid_angle * radius * radius / normal.dot(direction);
        (radius * direction, normal, area.sqrt())
    })
}

/// Returns the points of the [`ball`] as balls that touch their neighbours, which is how the program draws points by
/// default.
pub(crate) fn balls(count: usize) -> Result<SplatCloud, ModelError> {
    let disks = ball(count)?;
    let radius_per_disk = 0.5 / (LAYERS / PI).sqrt();
    let radii = (0..disks.len()).map(|i| (radius_per_disk * disks.radius_max(i)) as f32).collect();
    let data = CloudData { shape: Shape::Balls { radii, in_pixels: false, flat: false }, ..disks.data().clone() };
    Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
}

/// Returns the distance of the bumpy surface from the origin along a direction, and the normal there.
fn bumpy(waves: &[(DVec3, f64, f64)], direction: DVec3) -> (f64, DVec3) {
    let (mut radius, mut gradient) = (1.0, DVec3::ZERO);
    for (wave, phase, height) in waves {
        let (sine, cosine) = (wave.dot(direction) + phase).sin_cos();
        radius += height * sine;
        gradient += *wave * (height * cosine);
    }
    // Normal of the surface x = radius(direction)·direction.
    (radius, (radius * direction - (gradient - direction * gradient.dot(direction))).normalize())
}

/// Returns the surface of the [`ball`] as `4·rings·(rings − 1)` triangles between circles of latitude, with colours and
/// normals. `rings` is at least 2.
pub(crate) fn bumpy_mesh(rings: u32) -> Mesh {
    let waves = waves();
    let columns = 2 * rings;
    let (mut positions, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let mut vertex = |latitude: f64, longitude: f64| {
        let (y, across) = latitude.sin_cos();
        let (sine, cosine) = longitude.sin_cos();
        let direction = DVec3::new(across * cosine, y, across * sine);
        let (radius, normal) = bumpy(&waves, direction);
        positions.push((radius * direction).as_vec3());
        normals.push(normal.as_vec3().to_array());
        colors.push(color_at(radius * direction));
    };
    for ring in 1..rings {
        for column in 0..columns {
            vertex(PI * (f64::from(ring) / f64::from(rings) - 0.5), TAU * f64::from(column) / f64::from(columns));
        }
    }
    vertex(-0.5 * PI, 0.0);
    vertex(0.5 * PI, 0.0);
    let at = |ring: u32, column: u32| (ring - 1) * columns + column % columns;
    let (south, north) = ((rings - 1) * columns, (rings - 1) * columns + 1);
    let mut triangles = Vec::new();
    for column in 0..columns {
        triangles.push([south, at(1, column), at(1, column + 1)]);
        triangles.push([north, at(rings - 1, column + 1), at(rings - 1, column)]);
        for ring in 1..rings - 1 {
            let (a, b) = (at(ring, column), at(ring, column + 1));
            let (c, d) = (at(ring + 1, column), at(ring + 1, column + 1));
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    Mesh {
        positions: Column3::from_f32(positions),
        triangles,
        normals: Some(normals),
        colors: Some(colors),
        ..Mesh::default()
    }
}

/// Returns the linear albedo of a point on the surface.
fn color_at(point: DVec3) -> [f32; 3] {
    (Vec3::splat(0.6) + 0.3 * (4.0 * point).map(f64::sin).as_vec3()).to_array()
}

/// Returns a wavy sheet across the z axis, 2 wide and high. It faces +z with slopes up to about 60°, and every splat is
/// visible. Each point is covered by `layers` splats on average.
pub(crate) fn sheet(count: usize, layers: f64) -> Result<SplatCloud, ModelError> {
    build(count, layers, |i| wavy(i, count))
}

/// Returns twelve wavy sheets of `count` splats each, one behind another, the nearest first.
pub(crate) fn stack(count: usize) -> Result<SplatCloud, ModelError> {
    build(12 * count, LAYERS, |i| {
        let (center, normal, spacing) = wavy(i % count, count);
        (center - DVec3::Z * (0.1 * (i / count) as f64), normal, spacing)
    })
}

/// Returns centre, normal and spacing of splat `i` of a wavy sheet of `count` splats.
fn wavy(i: usize, count: usize) -> (DVec3, DVec3, f64) {
    let side = (count as f64).sqrt().ceil();
    let spacing = 2.0 / side;
    let waves = 9.0;
    let (row, column) = ((i as f64 / side).floor(), i as f64 % side);
    let x = -1.0 + (column + 0.5 * (row % 2.0)) * spacing;
    let y = -1.0 + (row + 0.5) * spacing;
    // Steepest slopes along x and y.
    let slopes = [1.5, 1.0];
    let [(sine_x, cosine_x), (sine_y, cosine_y)] = [x, y].map(|v| (waves * v * TAU).sin_cos());
    let (slope_x, slope_y) = (slopes[0] * cosine_x, slopes[1] * cosine_y);
    let z = (slopes[0] * sine_x + slopes[1] * sine_y) / (waves * TAU);
    let normal = DVec3::new(-slope_x, -slope_y, 1.0);
    (DVec3::new(x, y, z), normal.normalize(), spacing * normal.length().sqrt())
}

/// Creates a cloud of disks that cover each point `layers` times on average. `splat` returns the centre, the normal and
/// the distance to the neighbours of a splat.
fn build(
    count: usize,
    layers: f64,
    splat: impl Fn(usize) -> (DVec3, DVec3, f64) + Sync,
) -> Result<SplatCloud, ModelError> {
    // Radius of a disk with the area of a splat.
    let radius_per_spacing = (layers / PI).sqrt();
    let splats: Vec<(Vec3, Vec3, f32, [f32; 3])> = (0..count)
        .into_par_iter()
        .map(|i| {
            let (center, normal, spacing) = splat(i);
            (center.as_vec3(), normal.as_vec3(), (radius_per_spacing * spacing) as f32, color_at(center))
        })
        .collect();
    let centers: Vec<Vec3> = splats.iter().map(|splat| splat.0).collect();
    let normals: Vec<Vec3> = splats.iter().map(|splat| splat.1).collect();
    let radii = splats.iter().map(|splat| splat.2).collect();
    let colors = splats.iter().map(|splat| splat.3).collect();
    let shape = Shape::Disks { normals: Column3::from_f32(normals), radii };
    let data = CloudData { colors: Some(colors), ..CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape) };
    Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
}

/// Returns the wave vector, phase and height of each wave of bumps.
fn waves() -> Vec<(DVec3, f64, f64)> {
    let mut random = Random(7);
    let mut waves = Vec::new();
    for (cycles, height) in OCTAVES {
        for _ in 0..WAVES_PER_OCTAVE {
            let z = 2.0 * random.next() - 1.0;
            let (sine, cosine) = (TAU * random.next()).sin_cos();
            let across = (1.0 - z * z).sqrt();
            let direction = DVec3::new(across * cosine, across * sine, z);
            waves.push((cycles * direction, TAU * random.next(), height));
        }
    }
    waves
}

/// Generator of random numbers in [0, 1): a linear congruential generator with Knuth's MMIX constants.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ball_normals_point_out_and_agree_with_its_neighbours() {
        // Lattice neighbours are within 3 spacings, where the direction between them is nearly tangent.
        let cloud = ball(20_000).unwrap();
        for i in (100..19_900).step_by(97) {
            let (center, normal) = (cloud.center(i), cloud.normal(i));
            assert!(normal.dot(center) > 0.0, "splat {i} faces in");
            // Splats whose indices differ by a Fibonacci number are neighbours.
            let along = (cloud.center(i + 55) - center).normalize();
            // The bound is 0.1: over 3 % of the radius the finest octave rotates the surface by about that much.
            assert!(along.dot(normal).abs() < 0.1, "splat {i}: {}", along.dot(normal));
        }
    }

    #[test]
    fn mesh_of_the_ball_is_closed_and_faces_out() {
        let mesh = bumpy_mesh(8);
        mesh.validate().unwrap();
        assert!(surfel_sample::is_closed(&mesh));
        // Six times the volume, positive if triangles wind counter-clockwise as seen from outside. It is roughly that
        // of a ball.
        let corner = |i: u32| mesh.positions.get(i as usize);
        let volume: f64 = mesh.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2])))).sum();
        assert!((volume / (8.0 * PI) - 1.0).abs() < 0.2, "{volume}");
    }

    #[test]
    fn ball_is_the_same_every_time() {
        assert_eq!(ball(1000).unwrap(), ball(1000).unwrap());
    }
}
