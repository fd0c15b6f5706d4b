//! Tests of shadow maps against ray-cast truth.

use crate::validated_gpu;
use glam::DVec3;
use surfel_conformance::build::axes;
use surfel_conformance::harness::render;
use surfel_conformance::scenes::{self, BALL_CENTER, BALL_RADIUS, Case, FLOOR_HEIGHT, Parts};
use surfel_model::Light;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Renderer};

/// Errors of a shadow map, over all pixels whose truth is clear.
#[derive(Debug, Default)]
struct Errors {
    /// Mean of light missing in lit pixels that are farther from any shadow than the filter is wide.
    acne: f64,
    /// Largest fraction of light missing in one of these pixels.
    worst_acne: f64,
    /// Mean of light in pixels that are farther inside the shadow than the filter's width and a splat's reach.
    leak: f64,
    /// Number of pixels that were compared: lit and dark.
    counts: [usize; 2],
}

fn image(backend: &mut impl Renderer, case: &Case) -> Frame {
    let mut case = case.clone();
    case.scene.ambient = [0.0; 3];
    render(backend, &case, Planes::ALL).unwrap()
}

/// Returns the distance by which the ray from `point` to the light misses the ball; negative inside its shadow. +∞ if
/// the ball is behind the point or behind the light. `distance` is that of the light.
fn miss(point: DVec3, to_light: DVec3, distance: f64) -> f64 {
    let along = (BALL_CENTER - point).dot(to_light);
    if along < 0.0 || along > distance + BALL_RADIUS {
        return f64::INFINITY;
    }
    (BALL_CENTER - point).cross(to_light).length() - BALL_RADIUS
}

fn errors(backend: &mut impl Renderer, case: &Case, guard: f64, floor: f64) -> Errors {
    let shadowed = image(backend, case);
    let mut open = case.clone();
    for light in open.scene.lights.iter_mut().flatten() {
        if let Light::Directional { shadow, .. } | Light::Spot { shadow, .. } = light {
            *shadow = false;
        }
    }
    let open = image(backend, &open);
    let [right, down, forward] = axes(&case.camera);
    let surfel_model::Projection::Perspective { fov_y_deg } = case.camera.projection else { panic!("perspective") };
    let [w, h] = case.camera.size.map(f64::from);
    let f = h / (2.0 * (0.5 * fov_y_deg.to_radians()).tan());
    let (mut result, mut lit, mut dark) = (Errors::default(), 0.0, 0.0);
    for at in 0..shadowed.color().len() {
        let z = f64::from(shadowed.depth()[at]);
        let full = f64::from(open.color()[at][0]);
        if !z.is_finite() || full < 0.02 {
            continue;
        }
        let (x, y) = ((at % w as usize) as f64 + 0.5 - 0.5 * w, (at / w as usize) as f64 + 0.5 - 0.5 * h);
        let point = DVec3::from(case.camera.eye) + (forward + right * (x / f) + down * (y / f)) * z;
        let (to_light, distance) = match case.scene.lights.as_ref().unwrap()[0] {
            Light::Directional { direction, .. } => (-DVec3::from(direction).normalize(), f64::INFINITY),
            Light::Spot { position, .. } | Light::Point { position, .. } => {
                let to = DVec3::from(position) - point;
                (to.normalize(), to.length())
            }
            _ => panic!("a light of another kind"),
        };
        let share = f64::from(shadowed.color()[at][0]) / full;
        let on_floor = (point.y - floor).abs() < 0.02;
        let miss = if on_floor { miss(point, to_light, distance) } else { f64::INFINITY };
        // On the ball, every point that clearly faces the light is lit.
        let normal = if on_floor { DVec3::Y } else { (point - BALL_CENTER).normalize() };
        if miss > guard && normal.dot(to_light) > 0.15 {
            lit += 1.0 - share;
            result.worst_acne = result.worst_acne.max(1.0 - share);
            result.counts[0] += 1;
        } else if miss < -guard {
            dark += share;
            result.counts[1] += 1;
        }
    }
    result.acne = lit / result.counts[0] as f64;
    result.leak = dark / result.counts[1] as f64;
    result
}

const PARTS: [Parts; 4] = [Parts::Splats, Parts::Meshes, Parts::MeshOverSplats, Parts::SplatsOverMesh];

/// Tests every kind of caster and receiver under every kind of light; with `few`, each under one light only.
fn is_the_ray_cast_one(backend: &mut impl Renderer, few: bool) {
    let lights = [scenes::sun(), scenes::spot(40.0), scenes::spot(85.0)];
    for (i, parts) in PARTS.into_iter().enumerate() {
        for (_, light) in lights.iter().enumerate().filter(|(k, _)| !few || *k == i % 3) {
            let mut case = scenes::ball_over_floor(parts, light.clone());
            case.camera.size = [160, 160];
            // The filter is 3 texels wide, of at most 0.007. A splat of the ball has r = 0.07, so it reaches 0.0035
            // beyond the ball. Points within ε = r behind it are lit: at the ball's rim that is √(2·0.7·0.0035) along
            // the light.
            let errors = errors(backend, &case, 0.06, FLOOR_HEIGHT);
            println!("{} {parts:?} {light:?}: {errors:?}", backend.info().backend);
            assert!(errors.counts[0] > 3000 && errors.counts[1] > 700, "{errors:?}");
            // Measured: mean 8e-5; largest 0.36, near the terminator, where a facet's or a splat's plane deviates from
            // the curve.
            assert!(errors.acne < 2e-4 && errors.worst_acne < 0.5, "{errors:?}");
            assert!(errors.leak < 1e-4, "{errors:?}");
        }
    }
}

/// Tests that the bias of the maps lets no light in under a ball that touches the floor.
fn is_dark_at_a_contact(backend: &mut impl Renderer) {
    for parts in [Parts::Splats, Parts::Meshes] {
        let mut case = scenes::ball_over_floor(parts, scenes::sun());
        case.camera.size = [240, 240];
        case.camera.eye = [2.0, 1.2, 2.6];
        // The floor is raised to the ball.
        let up = BALL_CENTER.y - BALL_RADIUS - FLOOR_HEIGHT;
        case.scene.objects[1].world_from_object = glam::DAffine3::from_translation(DVec3::Y * up);
        let errors = errors(backend, &case, 0.05, FLOOR_HEIGHT + up);
        println!("{} {parts:?}: {errors:?}", backend.info().backend);
        assert!(errors.counts[1] > 1000 && errors.leak < 1e-4 && errors.acne < 2e-4, "{errors:?}");
    }
}

#[test]
fn shadow_of_a_ball_on_a_floor_is_the_ray_cast_one() {
    is_the_ray_cast_one(&mut Reference::new(Default::default()).unwrap(), false);
    is_the_ray_cast_one(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), false);
}

#[test]
fn shadow_at_a_contact_is_dark() {
    is_dark_at_a_contact(&mut Reference::new(Default::default()).unwrap());
    is_dark_at_a_contact(&mut surfel_cpu::Renderer::new(Default::default()).unwrap());
}

#[test]
fn shadow_on_gpus_is_the_ray_cast_one_too() {
    if let Some(mut ash) = validated_gpu::ash() {
        is_the_ray_cast_one(&mut ash, true);
        is_dark_at_a_contact(&mut ash);
    }
    if let Some(mut wgpu) = validated_gpu::wgpu() {
        is_the_ray_cast_one(&mut wgpu, true);
        is_dark_at_a_contact(&mut wgpu);
        validated_gpu::no_messages();
    }
}
