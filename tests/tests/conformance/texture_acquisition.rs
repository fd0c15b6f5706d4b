//! Figure 6 of Z01: a texture sampled by irregular splats, minified, magnified and extremely magnified.

use glam::{DVec3, Vec3};
use std::sync::Arc;
use surfel_conformance::build::object;
use surfel_conformance::polygons::{mesh_object, quad};
use surfel_model::{Camera, Mesh, Object, Projection, Scene, Settings, Texture, TextureSampling};
use surfel_render::{Renderer, View};
use surfel_sample::{MeshMethod, MeshOptions, NoProgress, fit_to_mesh, splats_from_mesh};

const SIZE: u32 = 160;
/// Number of splats along a side of the square; a black or white field has four per side.
const SPLATS: usize = 60;
/// Number of texels along a side.
const TEXELS: u32 = 360;
/// Number of samples along a side of a pixel, for polygons.
const SAMPLES: u32 = 4;
/// Heights of the view of the square of side 2: 2/3 splat per pixel, 10 and 40 pixels per splat.
const HEIGHTS: [f64; 3] = [3.6, 0.53, 0.13];

/// Returns the square from −1 to 1 with a texture of linear values at (0, 0) to (1, 1).
fn painted(value: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let texel = |i: u32| {
        let at = |k: u32| (k as f32 + 0.5) / TEXELS as f32;
        let linear = value(at(i % TEXELS), at(i / TEXELS));
        let [r, g, b] = linear.to_array().map(|c| (surfel_math::srgb::encode(f64::from(c)) * 255.0).round() as u8);
        [r, g, b, 255]
    };
    let srgba8 = (0..TEXELS * TEXELS).map(texel).collect();
    let texture = Some(Arc::new(Texture { width: TEXELS, height: TEXELS, srgba8 }));
    Mesh { texture, ..quad(DVec3::ZERO, [DVec3::X, DVec3::Y], 1.0) }
}

fn checkerboard(u: f32, v: f32) -> Vec3 {
    let square = |t: f32| (t * SPLATS as f32 / 4.0).floor() as i32;
    Vec3::splat((square(u) + square(v)).rem_euclid(2) as f32)
}

/// Returns soft shapes of many sizes, like those of photographs, none finer than six splats.
fn photograph(u: f32, v: f32) -> Vec3 {
    let wave = |i: i32| {
        let frequency = 5.0 * 1.5f32.powi(i);
        let (turn, phase) = ((i as f32 * 2.4).sin_cos(), Vec3::new(0.0, 0.9, 1.7) + Vec3::splat(i as f32));
        (Vec3::splat(frequency * (u * turn.0 + v * turn.1)) + phase).map(f32::sin) * 0.7f32.powi(i)
    };
    Vec3::splat(0.5) + 0.15 * (0..7).map(wave).sum::<Vec3>()
}

fn camera(height: f64, size: u32) -> Camera {
    Camera {
        eye: [0.05, 0.05, 2.0],
        target: [0.05, 0.05, 0.0],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Orthographic { height },
        near: 0.1,
        far: Some(10.0),
        size: [size; 2],
    }
}

/// Draws the colours of a single object, with `samples`² samples per pixel.
fn draw(object: Object, height: f64, samples: u32) -> Vec<Vec3> {
    let mut cpu = surfel_cpu::Renderer::new(surfel_cpu::Options::default()).unwrap();
    let scene = Scene { objects: vec![object], ..Scene::default() };
    let resident = cpu.upload(&scene).unwrap();
    let view = View::new(&camera(height, SIZE * samples)).unwrap();
    let mut frame = surfel_render::Frame::default();
    let planes = surfel_render::Planes::COLOR;
    cpu.render_into(&resident, &view, &Settings::default(), planes, &mut frame).unwrap();
    let fine = |x: u32, y: u32| Vec3::from_slice(&frame.color()[(y * SIZE * samples + x) as usize][..3]);
    let pixel = |i: u32| {
        let (x, y) = (i % SIZE * samples, i / SIZE * samples);
        let sum: Vec3 = (0..samples * samples).map(|k| fine(x + k % samples, y + k / samples)).sum();
        sum / (samples * samples) as f32
    };
    (0..SIZE * SIZE).map(pixel).collect()
}

fn rmse(a: &[Vec3], b: &[Vec3]) -> f64 {
    let squared = |(a, b): (&Vec3, &Vec3)| f64::from(a.distance_squared(*b)) / 3.0;
    (a.iter().zip(b).map(squared).sum::<f64>() / a.len() as f64).sqrt()
}

/// Returns the RMSE to the polygons of point samples, view-independent EWA and the fit, at each height.
fn errors(mesh: &Mesh) -> [[f64; 3]; 3] {
    let options = MeshOptions::new(MeshMethod::Count(SPLATS * SPLATS));
    let (cloud, _) = splats_from_mesh(mesh, &options, &NoProgress).unwrap();
    let clouds =
        TextureSampling::ALL.map(|sampling| fit_to_mesh(cloud.clone(), mesh, sampling, &NoProgress).unwrap().0);
    HEIGHTS.map(|height| {
        let truth = draw(mesh_object(mesh.clone()), height, SAMPLES);
        let found = clouds.clone().map(|cloud| rmse(&draw(object(cloud), height, 1), &truth));
        println!("{height}: point {:.4}, ewa {:.4}, fit {:.4}", found[0], found[1], found[2]);
        found
    })
}

#[test]
fn figure_6_a_fit_is_sharper_close_up_and_the_same_from_afar() {
    let [minified, magnified, extreme] = errors(&painted(checkerboard));
    // "Minification … does not reveal the difference": a few hundredths of the difference between white and black.
    assert!((minified[2] - minified[1]).abs() < 0.04, "{minified:?}");
    for [point, ewa, fit] in [magnified, extreme] {
        assert!(fit < 0.9 * ewa, "{magnified:?} {extreme:?}");
        // Black and white leave no room within the bounds: 2 % for the visible part of the square.
        assert!(fit < 1.02 * point, "{magnified:?} {extreme:?}");
    }
}

#[test]
fn a_photograph_gains_most() {
    let [minified, magnified, extreme] = errors(&painted(photograph));
    assert!(minified[2] <= minified[0], "{minified:?}");
    for [point, ewa, fit] in [magnified, extreme] {
        assert!(fit < point / 2.0 && fit < ewa / 3.0, "{magnified:?} {extreme:?}");
    }
}
