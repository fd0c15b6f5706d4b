//! Sweeps of balls (rendering model, §11): sizes, distances and units.

use super::{Image, Measure, Naive, Probe, Sweep, Truth, powers};
use crate::build::{camera, object, scene};
use crate::scenes::ball_cloud;
use glam::DVec3;
use surfel_model::{Camera, Projection, Scene, Settings, Shader};

/// Largest error of a value of 1 that the conformance harness allows: 2e-4 + 1e-3 of the value.
const TOLERANCE: f64 = 1.2e-3;
/// Side of the images in pixels.
const SIDE: u32 = 24;

pub(super) fn sweeps() -> Vec<Sweep> {
    let sweep = |name, parameter, about, values, required, probes| Sweep {
        name,
        parameter,
        about,
        law: "the conformance tolerance, 1.2e-3 of a colour, outside of decision margins",
        naive: "",
        measure: Measure::Color,
        values,
        required,
        probes,
    };
    vec![
        sweep(
            "ball-radius-small",
            "radius of balls, in pixels",
            "Smaller and smaller balls: each keeps its area, as coverage, until f32 has no smaller number.",
            powers(1.0, -30.0, 1.0),
            1e-18,
            small as fn(f64) -> Vec<Probe>,
        ),
        sweep(
            "ball-radius-large",
            "radius of a ball over its distance",
            "A larger and larger ball whose nearest point stays where it is: in the end a plane.",
            powers(-1.0, 12.0, 0.5),
            1e6,
            large,
        ),
        sweep(
            "ball-distance",
            "distance over radius of a ball",
            "A ball at a larger and larger distance, through a longer and longer lens: its image is the same.",
            powers(0.5, 15.0, 0.5),
            1e15,
            far,
        ),
        sweep(
            "ball-unit",
            "unit of the coordinates of balls",
            "Balls, camera included, in larger or smaller units: the image has to stay the same.",
            powers(0.0, 38.0, 1.0),
            1e30,
            |unit| spread(unit, 1.0),
        ),
        sweep(
            "ball-unit-small",
            "unit of the coordinates of balls",
            "Balls, camera included, in larger or smaller units: the image has to stay the same.",
            powers(0.0, -38.0, 1.0),
            1e-30,
            |unit| spread(unit, 1.0),
        ),
    ]
}

/// Returns a probe of unlit balls, which is compared with the f64 reference.
fn probe(balls: &[(DVec3, f64)], camera: Camera) -> Vec<Probe> {
    let scene = Scene { objects: vec![object(ball_cloud(balls, false, false))], ..scene(&[]) };
    let image = Image { scene, camera, region: None, settings: Settings::default().with_shader(Shader::Unlit) };
    vec![Probe {
        image,
        truth: Truth::Reference,
        amplification: 0.0,
        floor: TOLERANCE,
        scale: 1.0,
        naive: Naive::Nothing,
    }]
}

/// Returns a probe of balls all over the view. `unit` scales all lengths, `factor` only the radii.
fn spread(unit: f64, factor: f64) -> Vec<Probe> {
    let place = |i: u32| {
        let fraction = |step: f64| (f64::from(i) * step).fract() - 0.5;
        DVec3::new(fraction(0.754_877_666), fraction(0.569_840_291), fraction(0.414_213_562))
    };
    let ball = |i: u32| ((place(i) * (2.0 * unit)).as_vec3().as_dvec3(), factor * unit * (0.05 + 0.002 * f64::from(i)));
    let balls: Vec<_> = (0..60).map(ball).collect();
    let view = camera(3.0, 45.0, [SIDE; 2]);
    probe(&balls, Camera { eye: view.eye.map(|x| x * unit), near: 0.01 * unit, ..view })
}

/// Returns a probe of balls whose mean radius is given in pixels.
fn small(radius_px: f64) -> Vec<Probe> {
    // A pixel is 0.1 wide at the distance of the middle, and the mean radius is 0.11.
    spread(1.0, radius_px * 0.1 / 0.11)
}

/// Returns a probe of a ball at distance 1 with the given radius.
fn large(radius: f64) -> Vec<Probe> {
    let view = camera(0.0, 60.0, [SIDE; 2]);
    probe(&[(DVec3::NEG_Z * (1.0 + radius), radius)], Camera { target: [0.0, 0.0, -1.0], ..view })
}

/// Returns a probe of a ball of radius 1 at a distance. It fills two thirds of the view.
fn far(distance: f64) -> Vec<Probe> {
    let focal = f64::from(SIDE) / 3.0 * distance;
    let middle = f64::from(SIDE) / 2.0;
    let projection = Projection::Intrinsics { fx: focal, fy: focal, cx: middle, cy: middle };
    let eye = [0.0, 0.0, distance];
    probe(&[(DVec3::ZERO, 1.0)], Camera { eye, projection, near: 0.5 * distance, ..camera(0.0, 45.0, [SIDE; 2]) })
}
