//! Scenes with sizes, distances and shapes at which rounding errors are large.

use super::Case;
use crate::build::{Splat, camera, confetti, scene, sphere};
use crate::random::Random;
use glam::{DAffine3, DVec3};
use surfel_math::basis::orthonormal;
use surfel_model::{Camera, Filter, Mapping, Projection};

pub(super) fn numeric_cases() -> Vec<Case> {
    let base = confetti_ball();
    let mut cases = vec![
        base.clone(),
        edge_on(),
        near_crossing(),
        near_crossing().with("affine", |s| s.mapping = Mapping::Affine),
        scaled(&base, 1e-4),
        scaled(&base, 1e4),
        moved(&base, DVec3::new(1e6, -1e6, 5e5)),
        huge_splats(),
        vast_disks(),
        vast_disks().with("affine", |s| (s.filter, s.mapping) = (Filter::Ewa, Mapping::Affine)),
        skewed_outside(),
        adjusted_outside(),
        lengthened_outside(),
        greatest_cutoff(),
    ];
    // Without a filter, no needle hits the centre of a pixel.
    for filter in Filter::ALL.into_iter().filter(|f| *f != Filter::None) {
        cases.push(needles().with(filter.name(), |s| s.filter = filter));
    }
    cases
}

/// Returns splats of all sizes and tilts in a ball. [`scaled`] and [`moved`] don't change its image.
pub fn confetti_ball() -> Case {
    Case::new("confetti", scene(&confetti(400, 0.05, 3.0, 43)), camera(3.0, 45.0, [56, 56]))
}

/// Returns the case with all lengths multiplied by `factor`, z_near included. The image is the same except for Z.
/// Catches absolute epsilons, which scenes of ordinary size hide.
pub fn scaled(case: &Case, factor: f64) -> Case {
    let mut case = placed(case, &DAffine3::from_scale(DVec3::splat(factor)), &format!("scaled-{factor:e}"));
    case.camera.near *= factor;
    case.camera.far = case.camera.far.map(|far| far * factor);
    case
}

/// Returns the case with the scene and the camera moved by the same vector. The image is the same. Catches world
/// coordinates in f32, which scenes near the origin hide.
pub fn moved(case: &Case, by: DVec3) -> Case {
    placed(case, &DAffine3::from_translation(by), "moved")
}

/// Returns the case with objects and camera transformed by `world`; lights are unchanged.
pub fn placed(case: &Case, world: &DAffine3, variant: &str) -> Case {
    let mut case = case.with(variant, |_| ());
    for object in &mut case.scene.objects {
        object.world_from_object = *world * object.world_from_object;
    }
    let point = |p: [f64; 3]| world.transform_point3(p.into()).to_array();
    let Camera { eye, target, up, .. } = case.camera;
    case.camera.eye = point(eye);
    case.camera.target = point(target);
    case.camera.up = world.transform_vector3(up.into()).to_array();
    case
}

/// Returns ellipses with nearly parallel half-axes, centred outside of the image. They reach up to √2 times the longer
/// half-axis. Catches bounds by the longer half-axis, which cull them.
pub fn skewed_outside() -> Case {
    // The sides of the image are at ±1; the ellipses reach 1.41 from their centres.
    let toward = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
    let splats: Vec<Splat> = toward
        .into_iter()
        .zip([[0.9, 0.2, 0.1], [0.2, 0.9, 0.1], [0.1, 0.2, 0.9], [0.9, 0.9, 0.2]])
        .map(|(x, color)| {
            let y = DVec3::Z.cross(x);
            Splat { p: x * -2.2, s: x + y * 0.1, t: x - y * 0.1, color }
        })
        .collect();
    Case::new("skewed-outside", scene(&splats), camera(10.0, 2.0 * 0.1f64.atan().to_degrees(), [48, 48]))
}

/// Returns a narrow ellipse outside of the image. `adjust` lengthens its nearly parallel half-axes to 10 pixels, so
/// that it reaches 14 pixels. Catches bounds by the filter's radius, which cull it.
pub fn adjusted_outside() -> Case {
    let splat = Splat {
        p: DVec3::new(-36.5, -0.1, 0.0),
        s: DVec3::new(0.1, -0.005, -0.1),
        t: DVec3::new(0.05, 0.0, 0.05),
        color: [0.9, 0.5, 0.1],
    };
    let mut camera = camera(2.0, 45.0, [48, 48]);
    camera.projection = Projection::Orthographic { height: 48.0 };
    camera.far = Some(10.0);
    // A disk inside the image, which shows the overlap.
    let inside = Splat::disk(DVec3::new(-12.0, 3.0, -1.0), DVec3::Z, 12.0, [0.2, 0.3, 0.8]);
    Case::new("adjusted-outside", scene(&[splat, inside]), camera).with("adjust", |s| {
        (s.filter, s.prefilter_radius_px) = (Filter::Adjust, 10.0);
    })
}

/// Returns a needle above the image. `principal` lengthens it to 100 pixels at its centre, and its slope makes it even
/// longer on the screen. Catches bounds that ignore the slope.
pub fn lengthened_outside() -> Case {
    let splat = Splat {
        p: DVec3::ZERO,
        s: DVec3::new(10.0, 0.0, -0.24),
        t: DVec3::new(0.0, 0.001, 0.0),
        color: [0.2, 0.8, 0.4],
    };
    let mut camera = camera(1.0, 45.0, [48, 48]);
    camera.projection = Projection::Intrinsics { fx: 24.0, fy: 24.0, cx: 85.0, cy: -101.5 };
    Case::new("lengthened-outside", scene(&[splat]), camera).with("principal", |s| s.prefilter_radius_px = 100.0)
}

/// Returns one splat with the largest cutoff, 50. Weights at its rim are 2e-22.
pub fn greatest_cutoff() -> Case {
    super::facing_splat().with("cutoff-50", |s| s.cutoff = 50.0)
}

/// Returns ellipses of aspect ratio 1e4 at any angle. Catches covariances that lose their smaller eigenvalue.
pub fn needles() -> Case {
    let mut random = Random::new(47);
    let splats: Vec<Splat> = (0..120)
        .map(|_| {
            let (s, t) = orthonormal(random.direction());
            let long = random.range(0.1, 0.5);
            let p = random.direction() * 0.7;
            Splat { p, s: s * long, t: t * (long * 1e-4), color: random.color() }
        })
        .collect();
    Case::new("needles", scene(&splats), camera(3.0, 45.0, [56, 56]))
}

/// Returns splats at angles from 1° to 1e-6° from edge-on. Catches errors in the division by n·p and in the edge-on
/// rule.
pub fn edge_on() -> Case {
    let mut random = Random::new(53);
    let eye = DVec3::Z * 3.0;
    let splats: Vec<Splat> = (0..160)
        .map(|i| {
            let p = DVec3::new(random.range(-0.9, 0.9), random.range(-0.9, 0.9), random.range(-0.5, 0.5));
            let (a, b) = orthonormal(p - eye);
            let (sin, cos) = random.range(0.0, std::f64::consts::TAU).sin_cos();
            // Angles from 10^0 to 10^-6 degrees.
            let elevation = 10f64.powf(-6.0 * f64::from(i) / 159.0).to_radians();
            let across = a * cos + b * sin;
            let normal = across * elevation.cos() + (p - eye).normalize() * elevation.sin();
            Splat::disk(p, normal, random.range(0.03, 0.15), random.color())
        })
        .collect();
    Case::new("edge-on", scene(&splats), camera(3.0, 45.0, [56, 56]))
}

/// Returns splats around the eye, across z_near and behind it. Catches mirror images from behind the eye, and truncated
/// boxes.
pub fn near_crossing() -> Case {
    let mut random = Random::new(59);
    let eye = DVec3::Z * 2.0;
    let splats: Vec<Splat> = (0..60)
        .map(|_| {
            let p = eye + random.direction() * random.range(0.05, 0.8);
            Splat::disk(p, random.direction(), random.range(0.05, 0.9), random.color())
        })
        .collect();
    let mut camera = camera(2.0, 70.0, [64, 48]);
    camera.near = 0.1;
    Case::new("near-crossing", scene(&splats), camera)
}

/// Returns splats many times larger than the image, behind small ones. Catches boxes that overflow integers.
pub fn huge_splats() -> Case {
    let mut splats = sphere(200, 1.0, 61);
    splats.push(Splat::disk(DVec3::new(0.0, 0.0, -3e4), DVec3::Z, 1e9, [0.4, 0.5, 0.6]));
    splats.push(Splat::disk(DVec3::new(0.0, -1.5, -1e3), DVec3::new(0.0, 1.0, 0.3), 1e3, [0.7, 0.5, 0.2]));
    Case::new("huge-splats", scene(&splats), camera(3.0, 45.0, [56, 48]))
}

/// Returns disks so large that they look like planes: facing the eye, tilted about one of the image's axes, and about
/// both. Squares of their half-axes exceed the range of f32, and rounding dominates their outlines even in f64.
pub fn vast_disks() -> Case {
    let disk = |z: f64, n: [f64; 3], radius: f64, color| Splat::disk(DVec3::new(0.0, 0.0, z), n.into(), radius, color);
    let mut splats = sphere(120, 1.2, 67);
    splats.push(disk(-40.0, [0.0, 0.0, 1.0], 1e25, [0.2, 0.3, 0.6]));
    splats.push(disk(-6.0, [2.5, 0.0, 1.0], 1e12, [0.7, 0.5, 0.2]));
    splats.push(disk(-7.0, [0.0, -2.5, 1.0], 1e18, [0.3, 0.7, 0.2]));
    splats.push(disk(-9.0, [-2.0, 1.5, 1.0], 1e30, [0.6, 0.2, 0.7]));
    Case::new("vast-disks", scene(&splats), camera(3.0, 60.0, [48, 40]))
}
