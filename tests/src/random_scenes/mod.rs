//! Random scenes: each seed gives a scene that combines features of the rendering model (§1 to §8) and of the scene
//! file.
//!
//! A scene is built around the unit ball. Then it is placed somewhere in the world at some scale, together with the
//! camera and the lights. [`against`] compares a backend with the reference, [`shrink`] reduces a failing scene to the
//! smallest that fails, and [`store`] writes it as a scene file.

pub mod against;
mod cameras;
mod clouds;
mod looks;
mod meshes;
pub mod shrink;
pub mod store;

use crate::random::Random;
use crate::scenes::{Case, placed};
use glam::{DAffine3, DQuat, DVec3};
use surfel_model::{DepthTolerance, Light, Projection, Scene};
use surfel_render::Region;

/// Maximum number of splats in a scene, over all objects.
pub const MAX_SPLATS: usize = 200;
/// Maximum side of an image, in pixels.
pub const MAX_SIDE_PX: u32 = 96;

/// Returns the scene of a seed, the same on every call.
pub fn case(seed: u64) -> Case {
    let mut random = Random::new(seed);
    let camera = cameras::camera(&mut random);
    let eye = DVec3::from(camera.eye);
    let count = random.pick([1, 1, 1, 2, 2, 3]);
    let mut objects: Vec<_> =
        (0..count).map(|_| clouds::object(&mut random, eye, 1 + random_count(seed, count))).collect();
    if random.chance(0.25) {
        objects.push(meshes::object(&mut random));
        // Polygons may come first or last, since the order of objects decides ties.
        if random.chance(0.3) {
            objects.rotate_right(1);
        }
    }
    looks::materials(&mut random, &mut objects);
    looks::facings(seed, &mut objects);
    let settings = looks::settings(&mut random);
    let scene = Scene {
        up: None,
        background: looks::background(&mut random),
        ambient: looks::light_color(&mut random),
        lights: looks::lights(&mut random, settings.shader),
        sky: None,
        ground: None,
        matcap: looks::matcap(seed, settings.shader),
        objects,
    };
    let mut case = Case { settings, ..Case::new(&format!("random-{seed}"), scene, camera) };
    if random.chance(0.4) {
        case = somewhere(&mut random, case);
    }
    if random.chance(0.15) {
        case.region = Some(region(&mut random, case.camera.size));
    }
    case
}

/// Returns the random number of splats of each of `objects` objects, log-uniform.
fn random_count(seed: u64, objects: usize) -> usize {
    let mut random = Random::new(!seed);
    random.factor(1.0, MAX_SPLATS as f64 / objects as f64) as usize
}

/// Returns the case rotated, scaled and moved, together with the camera, the lights and absolute lengths.
fn somewhere(random: &mut Random, case: Case) -> Case {
    let scale = if random.chance(0.5) { random.factor(1e-3, 1e3) } else { 1.0 };
    // Distance from the world's origin, as in georeferenced data, in units of the scene's size.
    let offset = if random.chance(0.5) { random.direction() * scale * random.factor(1.0, 1e6) } else { DVec3::ZERO };
    let turn = DQuat::from_axis_angle(random.direction(), random.range(-3.0, 3.0));
    let world = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, offset);
    let name = case.name.clone();
    let mut case = Case { name, ..placed(&case, &world, "") };
    case.camera.near *= scale;
    case.camera.far = case.camera.far.map(|far| far * scale);
    if let Projection::Orthographic { height } = &mut case.camera.projection {
        *height *= scale;
    }
    if let DepthTolerance::Absolute(length) = &mut case.settings.depth_tolerance {
        *length *= scale;
    }
    for light in case.scene.lights.iter_mut().flatten() {
        let point = |p: &mut [f64; 3]| *p = world.transform_point3((*p).into()).to_array();
        let vector = |v: &mut [f64; 3]| *v = world.transform_vector3((*v).into()).to_array();
        match light {
            Light::Directional { direction, .. } => vector(direction),
            Light::Point { position, .. } => point(position),
            Light::Spot { position, direction, .. } => {
                point(position);
                vector(direction);
            }
            _ => {}
        }
    }
    case
}

fn region(random: &mut Random, [width, height]: [u32; 2]) -> Region {
    let mut part = |whole: u32| {
        let start = random.below(whole as usize) as u32;
        (start, 1 + random.below((whole - start) as usize) as u32)
    };
    let ((x, width), (y, height)) = (part(width), part(height));
    Region { x, y, width, height }
}
