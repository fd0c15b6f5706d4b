//! Random clouds of splats.

use crate::build::{self, Clipped, Splat, clipped_cloud, cloud, confetti, object as placed, sheet, sphere};
use crate::random::Random;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::f64::consts::{PI, TAU};
use surfel_math::basis::{orthonormal, principal_axes};
use surfel_model::{
    ClipCurve, ClipLine, ClipMode, CloudData, Column3, Geometry, NO_LINE, Object, OnInvalid, Shape, SplatCloud,
};

/// Creates a random object of about `count` splats (a few for some shapes), with a random affine placement and interior
/// weight ([`CloudData::interior_weight`]). Some shapes are placed relative to `eye`.
pub(super) fn object(random: &mut Random, eye: DVec3, count: usize) -> Object {
    let (mut splats, are_coplanar) = shapes(random, eye, count);
    let matrix = matrix(random);
    // Splats are converted to the object's own coordinates, so that the placement restores their world positions.
    let object_from_world = matrix.inverse();
    splats.iter_mut().for_each(|s| *s = s.transformed(&object_from_world));
    let clipped = random.chance(0.3);
    if clipped {
        // Clips are relative to the half-axes as given. f32 loses precision between nearly parallel half-axes.
        for splat in splats.iter_mut().filter(|s| s.s.cross(s.t).length() < 0.01 * s.s.length() * s.t.length()) {
            (splat.s, splat.t) = principal_axes(splat.s, splat.t);
        }
    }
    let cloud = if !clipped && random.chance(0.25) {
        disks(&splats, random)
    } else if clipped {
        let share = random.pick([1.0, 0.5]);
        let clip = |random: &mut Random, splat: &Splat| clip(random, splat, share);
        clipped_cloud(&splats.iter().map(|s| clip(random, s)).collect::<Vec<_>>())
    } else {
        cloud(&splats)
    };
    let mut data = cloud.into_data();
    attributes(random, &mut data, are_coplanar);
    // Invalid splats are dropped; none is created on purpose.
    let cloud = SplatCloud::new(data, OnInvalid::Drop).map_or_else(|_| build::cloud(&[]), |(cloud, _)| cloud);
    let mut object = placed(cloud);
    object.world_from_object = matrix;
    if random.chance(0.5)
        && let Geometry::Splats(cloud) = &mut object.geometry
    {
        std::sync::Arc::make_mut(cloud).set_interior_weight(random.factor(0.5, 6.0));
    } else {
        object.material.interior_weight = Some(random.factor(0.5, 6.0));
    }
    object
}

/// Returns splats in world space, and true if they are coplanar.
fn shapes(random: &mut Random, eye: DVec3, count: usize) -> (Vec<Splat>, bool) {
    let seed = random.bits();
    let kind = random.below(10);
    let mut splats = match kind {
        0..=2 => {
            let aspect = if random.chance(0.2) { 1e4 } else { random.factor(1.0, 30.0) };
            confetti(count, random.factor(0.003, 0.4), aspect, seed)
        }
        3 => {
            // The shape is rotated, so that small spheres of two objects don't have the same splats.
            let turn = DQuat::from_axis_angle(random.direction(), random.range(-PI, PI));
            let place = DAffine3::from_scale_rotation_translation(
                DVec3::splat(random.range(0.3, 1.0)),
                turn,
                random.direction() * random.range(0.0, 0.5),
            );
            sphere(count, random.range(0.8, 1.8), seed).iter().map(|s| s.transformed(&place)).collect()
        }
        4 | 5 => {
            let columns = (count as f64).sqrt().ceil() as usize;
            let (across, along) = (random.direction(), random.direction() * random.range(0.3, 2.0));
            let radius = random.range(0.8, 2.0) * across.length() / columns as f64;
            let center = random.direction() * random.range(0.0, 0.8);
            sheet(center, [across, along], [columns, count.div_ceil(columns)], radius, |_, _| random.color())
        }
        6 => few(random, count.min(5)),
        7 => around_the_eye(random, eye, count.min(60)),
        8 => edge_on(random, eye, count),
        _ => (0..count).map(|_| at_the_eye_s_needle(random, eye)).collect(),
    };
    if random.chance(0.3) {
        // The half-axes become conjugate ones that aren't perpendicular. The half-axes of needles become nearly
        // parallel.
        let shear = random.range(-1.5, 1.5);
        splats.iter_mut().for_each(|splat| splat.t += splat.s * shear);
    }
    (splats, matches!(kind, 4 | 5))
}

/// Returns a few large splats.
fn few(random: &mut Random, count: usize) -> Vec<Splat> {
    let largest = if random.chance(0.2) { 1e4 } else { 3.0 };
    let one = |random: &mut Random| {
        let p = random.direction() * random.range(0.0, 1.0);
        let (s, t) = orthonormal(random.direction());
        let radius = random.factor(0.1, largest);
        Splat { p, s: s * radius, t: t * radius * random.factor(0.1, 1.0), color: random.color() }
    };
    (0..count).map(|_| one(random)).collect()
}

/// Returns splats before, behind and across the near plane.
fn around_the_eye(random: &mut Random, eye: DVec3, count: usize) -> Vec<Splat> {
    let one = |random: &mut Random| {
        let p = eye + random.direction() * random.factor(0.02, 1.5);
        Splat::disk(p, random.direction(), random.factor(0.01, 1.0), random.color())
    };
    (0..count).map(|_| one(random)).collect()
}

/// Returns splats at angles from 0.2 to 1e-8 rad from edge-on, facing the eye or turned away.
///
/// Angles from 1e-5 to 2e-4 rad are excluded. The weight of such a splat is a difference of terms with f32 errors of
/// 6e-8, so that a tolerance of 1e-3 would require other splats that contribute, too.
fn edge_on(random: &mut Random, eye: DVec3, count: usize) -> Vec<Splat> {
    let one = |random: &mut Random| {
        let p = random.direction() * random.range(0.0, 1.0);
        let toward = (p - eye).normalize_or(DVec3::Z);
        let (a, b) = orthonormal(toward);
        let (sin, cos) = random.range(0.0, TAU).sin_cos();
        let dropped = random.chance(0.15);
        let elevation = if dropped { random.factor(1e-8, 9e-6) } else { random.factor(2e-4, 0.2) };
        let elevation = elevation * random.pick([1.0, -1.0]);
        let normal = (a * cos + b * sin) * elevation.cos() + toward * elevation.sin();
        Splat::disk(p, normal, random.factor(0.02, 0.4), random.color())
    };
    (0..count).map(|_| one(random)).collect()
}

/// Returns a long, thin splat that points approximately at the eye.
fn at_the_eye_s_needle(random: &mut Random, eye: DVec3) -> Splat {
    let p = random.direction() * random.range(0.0, 1.0);
    let along = ((p - eye).normalize_or(DVec3::Z) + random.direction() * random.factor(0.01, 1.0)).normalize();
    let (a, b) = orthonormal(along);
    let angle = random.range(0.0, TAU);
    let across = a * angle.cos() + b * angle.sin();
    let long = random.factor(0.02, 1.0);
    Splat { p, s: along * long, t: across * long * random.factor(1e-3, 0.3), color: random.color() }
}

/// Returns a placement from object to world space, of a random kind.
fn matrix(random: &mut Random) -> DAffine3 {
    let turn = DQuat::from_axis_angle(random.direction(), random.range(-PI, PI));
    let offset = random.direction() * random.range(0.0, 2.0);
    match random.below(8) {
        0..=2 => DAffine3::IDENTITY,
        3 => DAffine3::from_rotation_translation(turn, offset),
        4 => DAffine3::from_scale_rotation_translation(DVec3::splat(random.factor(1e-2, 1e2)), turn, offset),
        // Mirrored placement.
        5 => DAffine3::from_scale_rotation_translation(DVec3::new(-1.0, 1.0, 1.0), turn, offset),
        // Sheared placement, mirrored or not.
        6 => loop {
            let columns = [random.direction(), random.direction(), random.direction()];
            let matrix = DMat3::from_cols_array_2d(&columns.map(|c| (c * random.range(0.4, 2.0)).to_array()));
            if matrix.determinant().abs() > 0.2 {
                break DAffine3::from_mat3_translation(matrix, offset);
            }
        },
        // Placement of a cloud that is far from its own origin.
        _ => DAffine3::from_translation(random.direction() * random.factor(1e2, 1e6)),
    }
}

/// Returns disks with the centres and normals of `splats`, whose normals have random lengths.
fn disks(splats: &[Splat], random: &mut Random) -> SplatCloud {
    let (origin, centers) = Column3::with_origin(&splats.iter().map(|s| s.p).collect::<Vec<_>>());
    let normal = |random: &mut Random, s: &Splat| s.s.cross(s.t).normalize_or(DVec3::Z) * random.factor(0.1, 10.0);
    let normals: Vec<DVec3> = splats.iter().map(|s| normal(random, s)).collect();
    let radii = splats.iter().map(|s| s.s.length() as f32).collect();
    let shape = Shape::Disks { normals: Column3::from_f64(&normals), radii };
    let mut data = CloudData::new(origin, centers, shape);
    data.colors = Some(splats.iter().map(|s| s.color).collect());
    SplatCloud::new(data, OnInvalid::Drop).map_or_else(|_| cloud(&[]), |(cloud, _)| cloud)
}

/// Removes or changes colours, and adds alphas and shading normals. Splats that `are_coplanar` are all opaque or all
/// transparent, because rounding would decide which of two kinds is in front.
fn attributes(random: &mut Random, data: &mut CloudData, are_coplanar: bool) {
    let count = data.centers.len();
    match random.below(8) {
        0 => data.colors = None,
        // Colours brighter than white, and black.
        1 => data.colors.iter_mut().flatten().for_each(|c| *c = c.map(|c| (c - 0.3).max(0.0) * 4.0)),
        _ => {}
    }
    let alpha = random.range(0.05, 1.0) as f32;
    let alphas = |random: &mut Random| match random.below(4) {
        0 => vec![alpha; count],
        1 if !are_coplanar => (0..count).map(|_| random.pick([0.0, 1.0, alpha])).collect(),
        _ => (0..count).map(|_| random.range(0.0, 1.0) as f32).collect(),
    };
    data.alphas = random.chance(0.35).then(|| alphas(random));
    if random.chance(0.2) && matches!(data.shape, Shape::Ellipses { .. }) {
        let normal = |random: &mut Random| random.direction() * random.factor(0.1, 10.0);
        data.shading_normals = Some(Column3::from_f64(&(0..count).map(|_| normal(random)).collect::<Vec<_>>()));
    }
}

/// Returns the splat, with a probability of at most `share` clipped by a curve, by up to four lines or by both.
fn clip(random: &mut Random, splat: &Splat, share: f64) -> Clipped {
    let is_clipped = random.chance(share);
    let curve = (is_clipped && random.chance(0.6)).then(|| curve(random));
    let lines = if is_clipped && random.chance(0.6) { 1 + random.below(4) } else { 0 };
    let lines = (0..lines).map(|_| if random.chance(0.1) { NO_LINE } else { line(random) }).collect();
    Clipped { splat: *splat, curve, lines, mode: random.pick([ClipMode::And, ClipMode::Or]) }
}

fn curve(random: &mut Random) -> ClipCurve {
    let theta1 = random.range(-7.0, 7.0);
    let theta3 = match random.below(8) {
        0 => theta1,
        1 => theta1 + random.factor(1e-3, 0.1),
        _ => theta1 + random.range(0.1, 6.2),
    };
    let w = match random.below(4) {
        0 => 0.0,
        1 => 1.0,
        2 => random.factor(1e-3, 1e9),
        _ => random.range(0.0, 5.0),
    };
    let far = random.pick([1.0, 1.4, 1.4, 30.0]);
    let [theta1, theta3, u, v, w] =
        [theta1, theta3, random.range(-far, far), random.range(-far, far), w].map(|x| x as f32);
    ClipCurve { theta1, theta3, u, v, w }
}

fn line(random: &mut Random) -> ClipLine {
    let (sin, cos) = random.range(0.0, TAU).sin_cos();
    let length = random.factor(1e-2, 1e2);
    let [a, b, c] = [cos, sin, random.range(-0.5, 0.9)].map(|x| (x * length) as f32);
    ClipLine { a, b, c }
}
