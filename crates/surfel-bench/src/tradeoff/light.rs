//! Cost and error of the stored light of a sky, by its number of directions and the size of its maps.

use std::f64::consts::TAU;
use std::time::Instant;

use crate::Failure;
use crate::page::Table;
use glam::{DVec3, Vec3};
use surfel_light::{LightOptions, light_scene};
use surfel_model::{Geometry, Object, Sky};
use surfel_model::{Scene, SplatCloud};

/// Measured numbers of directions and sides of the maps; the first pair is the default.
const LEVELS: [(u32, u32); 10] = [
    (128, 384),
    (16, 384),
    (32, 384),
    (64, 384),
    (256, 384),
    (512, 384),
    (128, 128),
    (128, 256),
    (128, 512),
    (128, 1024),
];
/// Half-width of the floor, and distance between its neighbouring splats, both in radii of the ball.
const FLOOR: (f32, f32) = (3.0, 0.05);
/// Number of splats of the ball.
const BALL: u32 = 6000;
/// Distance from the point where the ball touches the floor, in radii of the ball, within which the floor's light isn't
/// compared. Near that point, the gap becomes narrower than the offset from the floor at which its light is looked up.
const CONTACT: f64 = 0.5;

/// Measures the stored light on a floor below a ball of disks, against the closed form: the form factor of a sphere.
pub(crate) fn table() -> Result<Table, Failure> {
    let scene = scene()?;
    let mut table = Table::new(&["directions", "texels of a map", "time", "error, RMSE", "largest error"]);
    let mut default_seconds = 0.0;
    for (directions, map_side) in LEVELS {
        let sky = Sky { directions, ..Sky::new([0.0, 0.0, 1.0]) };
        let scene = Scene { sky: Some(sky), ..scene.clone() };
        let options = LightOptions::default().with_map_side(map_side);
        let start = Instant::now();
        let lit = light_scene(&scene, &options)?;
        let seconds = start.elapsed().as_secs_f64();
        if table.rows.is_empty() {
            default_seconds = seconds;
        }
        let (rmse, worst) = errors(&lit.scene.objects[0]);
        let ratio = format!("{:.2}×", seconds / default_seconds);
        let row = [directions.to_string(), format!("{map_side}²"), ratio, format!("{rmse:.4}"), format!("{worst:.3}")];
        table.rows.push(row.to_vec());
    }
    Ok(table)
}

/// Returns a floor, and a ball of radius 1 that rests on it.
fn scene() -> Result<Scene, Failure> {
    let (half, step) = FLOOR;
    let count = (half / step) as i32;
    let at = |i: i32| i as f32 * step;
    let floor: Vec<Vec3> =
        (-count..=count).flat_map(|y| (-count..=count).map(move |x| Vec3::new(at(x), at(y), 0.0))).collect();
    let normals: Vec<Vec3> = (0..BALL)
        .map(|i| {
            let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(BALL);
            let (sine, turn) = ((1.0 - z * z).sqrt(), TAU * 0.618_033_988_749_895 * f64::from(i));
            DVec3::new(sine * turn.cos(), sine * turn.sin(), z).as_vec3()
        })
        .collect();
    let mut floor = SplatCloud::disks(&floor, &vec![Vec3::Z; floor.len()], &vec![step; floor.len()])?;
    let centers: Vec<Vec3> = normals.iter().map(|normal| *normal + Vec3::Z).collect();
    let mut ball = SplatCloud::disks(&centers, &normals, &vec![0.05; centers.len()])?;
    [&mut floor, &mut ball].into_iter().for_each(|cloud| cloud.set_oriented(true));
    Ok(Scene { objects: vec![Object::from(floor), Object::from(ball)], ..Scene::default() })
}

/// Returns the root mean square and the largest difference of the light stored on a floor from the closed form. Splats
/// within [`CONTACT`] of the ball's point of contact don't count.
fn errors(floor: &Object) -> (f64, f64) {
    let Geometry::Splats(cloud) = &floor.geometry else { return (f64::NAN, f64::NAN) };
    let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0u32);
    for i in 0..cloud.len() {
        let p = cloud.center(i);
        if p.x.hypot(p.y) < CONTACT {
            continue;
        }
        let distance = (p.x * p.x + p.y * p.y + 1.0).sqrt();
        let error = f64::from(cloud.color(i)[0]) - (1.0 - distance.powi(-3));
        (sum, worst, count) = (sum + error * error, worst.max(error.abs()), count + 1);
    }
    ((sum / f64::from(count.max(1))).sqrt(), worst)
}
