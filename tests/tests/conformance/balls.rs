//! Tests of balls (rendering model §11): closed forms of coverage, depth and area, and agreement of the backends.

use crate::drawing::drawn_once;
use glam::{DAffine3, DVec3};
use surfel_conformance::build::{camera, object, ray};
use surfel_conformance::harness::check_case;
use surfel_conformance::scenes::{self, Case, ball_cloud};
use surfel_model::{Camera, Scene, Settings, Shader};
use surfel_render::{Frame, Planes, Renderer, View};

/// Returns an image of unlit balls by a backend.
fn drawn<R: Renderer>(backend: &mut R, scene: &Scene, camera: &Camera) -> Frame {
    let resident = backend.upload(scene).unwrap();
    let (mut frame, settings) = (Frame::default(), Settings::default().with_shader(Shader::Unlit));
    let planes = Planes::ALL.with_index(true);
    backend.render_into(&resident, &View::new(camera).unwrap(), &settings, planes, &mut frame).unwrap();
    frame
}

fn both() -> (surfel_reference::Renderer, surfel_cpu::Renderer) {
    (
        surfel_reference::Renderer::new(Default::default()).unwrap(),
        surfel_cpu::Renderer::new(Default::default()).unwrap(),
    )
}

/// Returns white balls, given by centres and radii, on transparent black, so that alpha is coverage.
fn white(balls: &[(DVec3, f64)]) -> Scene {
    let mut data = ball_cloud(balls, false, false).into_data();
    data.colors = None;
    let (cloud, _) = surfel_model::SplatCloud::new(data, surfel_model::OnInvalid::Refuse).unwrap();
    Scene { objects: vec![object(cloud)], ..Scene::default() }
}

/// Returns the planar depth at which the ray through the pixel position (x, y) meets a ball; `None` if it misses the
/// ball.
fn depth_on(camera: &Camera, (center, radius): (DVec3, f64), x: f64, y: f64) -> Option<f64> {
    // Rays are linear in the position.
    let [a, b, c] = [(0, 0), (1, 0), (0, 1)].map(|(x, y)| ray(camera, x, y));
    let direction = a + (b - a) * (x - 0.5) + (c - a) * (y - 0.5);
    let to = center - DVec3::from(camera.eye);
    let (along, square) = (to.dot(direction), direction.length_squared());
    let rest = to.cross(direction).length_squared();
    let root = square * radius * radius - rest;
    (root >= 0.0).then(|| (along - root.sqrt()) / square)
}

#[test]
fn every_ball_scene_is_drawn_by_the_cpu_as_by_the_reference() {
    let (mut reference, mut cpu) = both();
    let cases: Vec<Case> = scenes::all().into_iter().filter(|case| !case.scene.objects.is_empty()).collect();
    let is_of_balls = |case: &&Case| surfel_render::SceneSummary::of(&case.scene).balls > 0;
    let reports: Vec<_> =
        cases.iter().filter(is_of_balls).map(|case| check_case(&mut cpu, &mut reference, case)).collect();
    let failed: Vec<String> = reports.iter().filter(|r| !r.is_ok()).map(ToString::to_string).collect();
    assert!(reports.len() > 30 && failed.is_empty(), "{} failed:\n{}", failed.len(), failed.join("\n"));
}

#[test]
fn outlines_are_antialiased_as_by_8x8_samples() {
    let balls =
        [(DVec3::new(0.2, -0.1, 0.0), 0.9), (DVec3::new(-1.6, 0.9, 0.3), 0.31), (DVec3::new(1.5, 1.0, -0.2), 0.1)];
    let camera = camera(3.2, 60.0, [200, 160]);
    let (mut reference, mut cpu) = both();
    for frame in [drawn(&mut reference, &white(&balls), &camera), drawn(&mut cpu, &white(&balls), &camera)] {
        // The samples' own noise on a rim is about 0.012: 64 samples, of which a rim crosses about ten.
        let (mut fine, mut coarse, mut rims) = (0.0, 0.0, 0);
        for (i, color) in frame.color().iter().enumerate() {
            let (x, y) = ((i % 200) as f64, (i / 200) as f64);
            let sampled = |side: usize| {
                let at = |k: usize| (k as f64 + 0.5) / side as f64;
                let hit = |k: &usize| {
                    balls.iter().any(|b| depth_on(&camera, *b, x + at(k % side), y + at(k / side)).is_some())
                };
                (0..side * side).filter(hit).count() as f64 / (side * side) as f64
            };
            let by_64 = sampled(8);
            coarse += (f64::from(color[3]) - by_64).powi(2);
            if by_64 > 0.0 && by_64 < 1.0 {
                fine += (f64::from(color[3]) - sampled(40)).powi(2);
                rims += 1;
            }
        }
        let whole = (coarse / frame.color().len() as f64).sqrt();
        let on_rims = (fine / f64::from(rims)).sqrt();
        assert!(rims > 250 && whole <= 1.0 / 255.0 && on_rims <= 1.0 / 255.0, "{whole} {on_rims} {rims}");
    }
}

#[test]
fn depths_and_normals_are_those_of_the_sphere() {
    let balls = [(DVec3::new(0.2, -0.1, 0.0), 0.9), (DVec3::new(-1.6, 0.9, 0.3), 0.31)];
    let camera = camera(3.2, 60.0, [200, 160]);
    let (mut reference, mut cpu) = both();
    for (frame, limit) in
        [(drawn(&mut reference, &white(&balls), &camera), 1e-7), (drawn(&mut cpu, &white(&balls), &camera), 1e-6)]
    {
        let (mut worst, mut count) = (0.0f64, 0);
        for (i, (color, z)) in frame.color().iter().zip(frame.depth()).enumerate() {
            let (x, y) = ((i % 200) as f64 + 0.5, (i / 200) as f64 + 0.5);
            let Some((truth, ball)) = balls.iter().find_map(|b| Some((depth_on(&camera, *b, x, y)?, b))) else {
                assert!(color[3] < 1.0);
                continue;
            };
            // The slope of a sphere is infinite at its outline.
            let at = DVec3::from(camera.eye) + ray(&camera, (i % 200) as u32, (i / 200) as u32) * truth;
            let normal = (at - ball.0) / ball.1;
            if color[3] >= 1.0 {
                let found = DVec3::from(frame.normal()[i].map(f64::from));
                worst = worst.max((f64::from(*z) / truth - 1.0).abs());
                assert!((found - normal).length() < 2e-3, "{found} {normal}");
                count += 1;
            }
        }
        assert!(count > 5000 && worst < limit, "{worst} of {count}");
    }
}

#[test]
fn the_area_of_balls_smaller_than_a_pixel_is_exact() {
    // 400 balls that don't hide each other, of 0.02 to 0.4 pixels.
    let focal = 160.0 / (2.0 * (30.0f64).to_radians().tan());
    let at = |i: usize| DVec3::new((i % 20) as f64 * 0.11 - 1.04, (i / 20) as f64 * 0.11 - 1.03, 0.0);
    let radius = |i: usize| (0.02 + 0.38 * i as f64 / 399.0) * 3.2 / focal;
    let balls: Vec<_> = (0..400).map(|i| (at(i), radius(i))).collect();
    let camera = camera(3.2, 60.0, [160, 160]);
    // The ellipse of a ball far off the axis is larger than the ball's circle: cos⁻³ of its angle.
    let truth: f64 = balls
        .iter()
        .map(|(p, r)| {
            let to = DVec3::from(camera.eye) - *p;
            std::f64::consts::PI * (focal * r / to.z).powi(2) * (to.length() / to.z).powi(1)
        })
        .sum();
    let (mut reference, mut cpu) = both();
    for frame in [drawn(&mut reference, &white(&balls), &camera), drawn(&mut cpu, &white(&balls), &camera)] {
        let area: f64 = frame.color().iter().map(|c| f64::from(c[3])).sum();
        assert!((area / truth - 1.0).abs() < 1e-3, "{area} of {truth}");
        let found: std::collections::HashSet<u32> = frame.index().iter().copied().collect();
        assert!(found.len() > 400, "each ball is in the plane of the nearest: {}", found.len() - 1);
    }
}

#[test]
fn a_ball_is_lit_on_its_whole_front_and_shades_what_is_behind() {
    use surfel_model::Light;
    let down = Light::Directional { direction: [0.0, 0.0, -1.0], color: [1.0; 3], shadow: true };
    let balls = [(DVec3::new(0.0, 0.0, 1.0), 0.5), (DVec3::new(0.0, 0.0, -1.0), 1.5)];
    let mut scene = white(&balls);
    (scene.lights, scene.ambient) = (Some(vec![down]), [0.0; 3]);
    scene.objects[0].material.specular = 0.0;
    let mut case = Case::new("ball_over_ball", scene, camera(6.0, 40.0, [256, 256]));
    case.settings.shader = Shader::Phong;
    // Seen along the light, every visible point of either ball is lit by the cosine of its normal.
    case.camera.eye = [0.0, 0.02, 6.0];
    let (mut reference, mut cpu) = both();
    for (frame, _) in [drawn_once(&mut reference, &case, Planes::ALL), drawn_once(&mut cpu, &case, Planes::ALL)] {
        let mut lit = 0;
        for ((color, normal), weight) in frame.color().iter().zip(frame.normal()).zip(frame.weight()) {
            let cosine = normal[2].max(0.0);
            // Only pixels that one fragment covers completely are counted.
            if *weight >= 1.0 && cosine > 0.2 {
                let shaded = (color[0] - cosine).abs() > 0.02;
                lit += usize::from(!shaded);
                assert!(!shaded || color[0] <= cosine, "{color:?} {normal:?}");
            }
        }
        assert!(lit > 2000, "{lit}");
    }
    // From the side, the lower ball's top is dark.
    case.camera.eye = [6.0, 0.0, 0.0];
    case.camera.up = [0.0, 0.0, 1.0];
    for (frame, _) in [drawn_once(&mut reference, &case, Planes::ALL), drawn_once(&mut cpu, &case, Planes::ALL)] {
        let dark = frame.color().iter().zip(frame.normal()).filter(|(c, n)| c[3] >= 1.0 && n[2] > 0.955 && c[0] < 1e-3);
        assert!(dark.count() > 10);
    }
}

#[test]
fn a_scaled_ball_stays_a_ball() {
    let mut scene = white(&[(DVec3::ZERO, 0.5)]);
    scene.objects[0].world_from_object = DAffine3::from_scale(DVec3::new(4.0, 1.0, 0.25));
    let plain = white(&[(DVec3::ZERO, 0.5)]);
    let camera = camera(3.0, 45.0, [64, 64]);
    let (mut reference, mut cpu) = both();
    let truth = drawn(&mut reference, &plain, &camera);
    for frame in [drawn(&mut reference, &scene, &camera), drawn(&mut cpu, &scene, &camera)] {
        let pairs = frame.color().iter().zip(truth.color());
        assert!(pairs.clone().all(|(a, b)| (a[3] - b[3]).abs() < 1e-3));
    }
}
