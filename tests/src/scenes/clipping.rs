//! Scenes of clipped splats.

use super::Case;
use crate::build::{Clipped, Splat, camera, clipped_cloud, confetti, object, scene, with_alpha};
use crate::random::Random;
use glam::{DAffine3, DVec3};
use surfel_model::{ClipCurve, ClipLine, ClipMode, ClipPolicy, Cull, EdgeAa, Filter, Mapping, Scene, Transparency};

pub(super) fn clipping_cases() -> Vec<Case> {
    let curves = clip_curves();
    let mut cases = vec![
        curves.with("paper", |s| s.clip = ClipPolicy::Paper),
        curves.with("line", |s| s.clip = ClipPolicy::Line),
        curves.with("affine", |s| s.mapping = Mapping::Affine),
        clip_lines(),
        clip_lines_mirrored(),
        clipped_cube(),
        clipped_confetti().with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        clipped_glass().with("peel", |s| s.transparency = Transparency::Peel { layers: 3, drop_last: false }),
        clipped_glass().with("abuffer", |s| s.transparency = Transparency::ABuffer { layers: 4 }),
        clipped_near(),
        clipped_near().with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        constant_lines(),
        constant_lines().with("ewa", |s| (s.filter, s.prefilter_radius_px) = (Filter::Ewa, 2.5)),
    ];
    for filter in Filter::ALL {
        cases.push(clip_grazing().with(filter.name(), |s| s.filter = filter));
        // The filters are wide, so that most of a footprint is due to the filter.
        cases.push(curves.with(filter.name(), |s| s.filter = filter));
        cases.push(clipped_confetti().with(filter.name(), |s| (s.filter, s.prefilter_radius_px) = (filter, 2.5)));
    }
    cases
}

fn random_curve(random: &mut Random) -> ClipCurve {
    let theta1 = random.range(-7.0, 7.0);
    let w = [0.0, 0.3, 1.0, 4.0, 1e9][random.range(0.0, 5.0) as usize];
    let [u, v] = [random.range(-1.3, 1.3), random.range(-1.3, 1.3)].map(|x| x as f32);
    ClipCurve { theta1: theta1 as f32, theta3: (theta1 + random.range(0.2, 6.0)) as f32, u, v, w }
}

fn random_line(random: &mut Random) -> ClipLine {
    let (sin, cos) = random.range(0.0, std::f64::consts::TAU).sin_cos();
    ClipLine { a: cos as f32, b: sin as f32, c: random.range(-0.2, 0.7) as f32 }
}

/// Returns a grid of large, tilted ellipses, each clipped by another curve; every ninth has no curve. Catches confused
/// angles, sides, rotations and weights.
pub fn clip_curves() -> Case {
    let mut random = Random::new(83);
    let splats: Vec<Clipped> = (0..36)
        .map(|i| {
            let at = |k: i32| f64::from(k) * 0.38 - 0.95;
            let p = DVec3::new(at(i % 6), at(i / 6), random.range(-0.1, 0.1));
            let s = DVec3::new(0.24, random.range(-0.1, 0.1), random.range(-0.2, 0.2));
            let t = DVec3::new(random.range(-0.1, 0.1), 0.2, random.range(-0.2, 0.2));
            let splat = Splat { p, s, t, color: random.color() };
            Clipped {
                splat,
                curve: (i % 9 != 0).then(|| random_curve(&mut random)),
                lines: Vec::new(),
                mode: ClipMode::And,
            }
        })
        .collect();
    Case::new(
        "clip-curves",
        Scene { objects: vec![object(clipped_cloud(&splats))], ..scene(&[]) },
        camera(3.2, 45.0, [96, 96]),
    )
}

/// Returns splats that point at the eye and are clipped except for their far ends, in front of a large wall. A filter
/// widens them and moves their clips. Catches empty pixels, where the unfiltered part hides the wall but no filtered
/// fragment remains.
pub fn clip_grazing() -> Case {
    let mut random = Random::new(127);
    let camera = camera(3.2, 45.0, [96, 96]);
    let eye = DVec3::from(camera.eye);
    let mut splats: Vec<Clipped> = (0..36)
        .map(|i| {
            let at = |k: i32| f64::from(k) * 0.38 - 0.95;
            let p = DVec3::new(at(i % 6), at(i / 6) + random.range(-0.1, 0.1), 0.0);
            let (s, up) = (DVec3::X * 0.16, DVec3::Y * random.range(0.008, 0.014));
            let splat = Splat { p, s, t: (p - eye).normalize() * 0.2 + up, color: random.color() };
            let lines = vec![ClipLine { a: 0.0, b: 1.0, c: -0.5 }];
            Clipped { splat, curve: None, lines, mode: ClipMode::And }
        })
        .collect();
    let wall = Splat { p: DVec3::Z * -1.0, s: DVec3::X * 4.0, t: DVec3::Y * 4.0, color: [0.5; 3] };
    splats.push(Clipped { splat: wall, curve: None, lines: Vec::new(), mode: ClipMode::And });
    let mut object = object(clipped_cloud(&splats));
    object.material.oriented = Some(true);
    Case::new("clip-grazing", Scene { objects: vec![object], ..scene(&[]) }, camera)
}

/// Returns splats with up to four lines each, joined by `and` or `or`, some with a curve as well. Catches an absent
/// line that counts under `or`.
pub fn clip_lines() -> Case {
    let mut random = Random::new(89);
    let splats: Vec<Clipped> = (0..36)
        .map(|i| {
            let at = |k: i32| f64::from(k) * 0.38 - 0.95;
            let p = DVec3::new(at(i % 6), at(i / 6), 0.0);
            let s = DVec3::new(0.22, 0.0, random.range(-0.1, 0.1));
            let splat = Splat { p, s, t: DVec3::new(0.05, 0.2, 0.0), color: random.color() };
            let lines = (0..i % 5).map(|_| random_line(&mut random)).collect();
            let mode = if i % 2 == 0 { ClipMode::And } else { ClipMode::Or };
            Clipped { splat, curve: (i % 7 == 0).then(|| random_curve(&mut random)), lines, mode }
        })
        .collect();
    Case::new(
        "clip-lines",
        Scene { objects: vec![object(clipped_cloud(&splats))], ..scene(&[]) },
        camera(3.2, 45.0, [96, 96]),
    )
}

/// Returns splats with clip lines without a gradient, which leave either the whole splat or nothing visible. They are
/// alone and among other lines. The upper row joins lines by `and`, the lower by `or`. Catches a constant line that is
/// treated as absent, or as always inside.
pub fn constant_lines() -> Case {
    let line = |a: f32, b: f32, c: f32| ClipLine { a, b, c };
    let (never, always, level) = (line(0.0, 0.0, -0.25), line(0.0, 0.0, 2.0), line(0.0, 0.0, 0.0));
    let half = line(1.0, 0.5, -0.1);
    let curve = ClipCurve { theta1: 0.3, theta3: 2.5, u: 0.3, v: 0.4, w: 0.7 };
    let columns: [(&[ClipLine], Option<ClipCurve>); 10] = [
        (&[never], None),
        (&[never; 2], None),
        (&[never; 4], None),
        (&[never], Some(curve)),
        (&[never, half], None),
        (&[half, never], None),
        (&[always, half], None),
        (&[level], None),
        (&[level, half], None),
        (&[level, never], None),
    ];
    let mut random = Random::new(109);
    let mut splats = Vec::new();
    for (mode, y) in [(ClipMode::And, 0.3), (ClipMode::Or, -0.3)] {
        for (k, (lines, curve)) in (0..).zip(columns) {
            let p = DVec3::new(0.26 * f64::from(k) - 1.17, y, 0.0);
            let s = DVec3::new(0.15, 0.0, random.range(-0.05, 0.05));
            let splat = Splat { p, s, t: DVec3::new(0.03, 0.25, 0.0), color: random.color() };
            splats.push(Clipped { splat, curve, lines: lines.to_vec(), mode });
        }
    }
    Case::new(
        "constant-lines",
        Scene { objects: vec![object(clipped_cloud(&splats))], ..scene(&[]) },
        camera(3.2, 45.0, [96, 64]),
    )
}

/// Returns the scene [`clip_lines`] as a mirrored, sheared object. Catches a clip that turns the wrong way with its
/// axes.
pub fn clip_lines_mirrored() -> Case {
    let mut case = clip_lines().with("mirrored", |s| s.prefilter_radius_px = 4.0);
    let place = DAffine3::from_cols(DVec3::new(-0.8, 0.3, 0.0), DVec3::new(0.0, 0.6, 0.4), DVec3::Z, DVec3::ZERO);
    case.scene.objects[0].world_from_object = place;
    case
}

/// Half of the edge length of [`clipped_cube`].
pub const CUBE_HALF: f64 = 0.5;

/// Returns a perfect cube of six splats, each clipped by the four lines of its face. Back faces are culled.
pub fn clipped_cube() -> Case {
    // Radius above √2, so that the corners are well inside the disk.
    let reach = 1.6;
    let faces = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|n| [n, -n]);
    let splats: Vec<Clipped> = faces
        .map(|n| {
            let t = n.any_orthonormal_vector();
            let (s, t) = (t.cross(n), t);
            let radius = CUBE_HALF * reach;
            let splat =
                Splat { p: n * CUBE_HALF, s: s * radius, t: t * radius, color: (n * 0.4 + 0.5).as_vec3().to_array() };
            let c = (1.0 / reach) as f32;
            let lines = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].map(|(a, b)| ClipLine { a, b, c }).to_vec();
            Clipped { splat, curve: None, lines, mode: ClipMode::And }
        })
        .collect();
    let mut cube = object(clipped_cloud(&splats));
    cube.material.cull = Cull::Back;
    let mut camera = camera(2.6, 45.0, [96, 96]);
    camera.eye = [1.4, 1.1, 1.9];
    Case::new("clipped-cube", Scene { objects: vec![cube], ..scene(&[]) }, camera)
}

/// Returns a ball of confetti with a clip on every splat, many smaller than pixels. Catches filters that transform the
/// clip wrongly.
pub fn clipped_confetti() -> Case {
    let mut scene = Scene { objects: vec![object(clipped_cloud(&confetti_with_clips()))], ..scene(&[]) };
    scene.objects[0].material.interior_weight = Some(1.5);
    Case::new("clipped-confetti", scene, camera(3.0, 45.0, [64, 64]))
}

/// Returns the splats of [`clipped_confetti`] as glass. Catches layers in which splats are clipped differently than in
/// the opaque image.
pub fn clipped_glass() -> Case {
    let mut case = clipped_confetti();
    case.name = "clipped-glass".to_owned();
    case.scene.objects =
        vec![object(with_alpha(clipped_cloud(&confetti_with_clips()), |i| 0.3 + 0.1 * (i % 6) as f32))];
    // The A-buffer needs the interior weight W0.
    case.scene.objects[0].material.interior_weight = Some(1.5);
    case
}

fn confetti_with_clips() -> Vec<Clipped> {
    let mut random = Random::new(97);
    confetti(300, 0.04, 4.0, 101)
        .into_iter()
        .enumerate()
        .map(|(i, splat)| {
            let curve = (i % 3 != 0).then(|| random_curve(&mut random));
            let lines = if i % 3 == 1 { Vec::new() } else { vec![random_line(&mut random), random_line(&mut random)] };
            Clipped { splat, curve, lines, mode: ClipMode::And }
        })
        .collect()
}

/// Returns clipped splats across z_near and behind the eye.
pub fn clipped_near() -> Case {
    let mut random = Random::new(103);
    let eye = DVec3::Z * 2.0;
    let splats: Vec<Clipped> = (0..40)
        .map(|i| {
            let p = eye + random.direction() * random.range(0.05, 0.8);
            let splat = Splat::disk(p, random.direction(), random.range(0.05, 0.9), random.color());
            let curve = (i % 2 == 0).then(|| random_curve(&mut random));
            Clipped { splat, curve, lines: vec![random_line(&mut random)], mode: ClipMode::And }
        })
        .collect();
    let mut camera = camera(2.0, 70.0, [64, 48]);
    camera.near = 0.1;
    let mut object = object(clipped_cloud(&splats));
    object.material.interior_weight = Some(2.0);
    Case::new("clipped-near", Scene { objects: vec![object], ..scene(&[]) }, camera)
}
