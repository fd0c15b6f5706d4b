//! Measurement of filters on a checkerboard that extends to the horizon: the detail that a filter preserves, and the
//! aliasing that remains (docs/decisions/017-principal-filter.md).
//!
//! The scene is a square of side 2 centred at (0, 0, 1.2) in view space, turned 80° about x, with 40×40 fields and
//! 400×400 disks of r = spacing = 0.005; fov_y 60°, 512². The truth is the exact pattern under a box filter of one
//! pixel, by 16×16 samples.

use crate::build::{Splat, camera, scene};
use crate::scenes::Case;
use glam::DVec3;
use surfel_model::{DepthTolerance, Filter, Scene, Settings};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, RenderError, Renderer, View};

/// Side of the image, in pixels.
pub const SIZE: u32 = 512;
/// Number of disks along a side of the square.
const DISKS: usize = 400;
/// Distance between neighbouring disks, which is also their radius, in world units.
const SPACING: f64 = 0.005;
/// Number of black and white fields along a side of the square.
const SQUARES: f64 = 40.0;
/// Depth of the square's centre, in world units.
const DISTANCE: f64 = 1.2;
/// Angle by which the square is turned about x from facing the eye, in degrees.
const TURN_DEG: f64 = 80.0;
/// Number of samples of the exact image along a side of a pixel.
const SAMPLES: u32 = 16;

/// RMSE in five bands of the image rows that show the square, from far to near. The bands have 1/16, 1/16, 1/8, 1/4 and
/// 1/2 of the rows.
pub type Bands = [f64; 5];

/// Returns the measured variants: names and settings.
pub fn variants() -> Vec<(&'static str, Settings)> {
    let filter = |filter| Settings::default().with_filter(filter);
    let papers = filter(Filter::Ewa)
        .with_cutoff(1.0)
        .with_prefilter_radius_px(std::f64::consts::SQRT_2)
        .with_depth_tolerance(DepthTolerance::Absolute(SPACING));
    vec![
        ("ewa, c 1, h sqrt 2, absolute r", papers),
        ("none", filter(Filter::None)),
        ("clamp", filter(Filter::Clamp)),
        ("ewa", filter(Filter::Ewa)),
        ("adjust", filter(Filter::Adjust)),
        ("principal", filter(Filter::Principal)),
    ]
}

/// Returns, in view space, the direction within the square away from the eye, and the square's normal.
fn directions() -> (DVec3, DVec3) {
    let (sin, cos) = TURN_DEG.to_radians().sin_cos();
    (DVec3::new(0.0, -cos, sin), DVec3::new(0.0, -sin, -cos))
}

fn is_white(a: f64, b: f64) -> bool {
    let index = |v: f64| ((v + 1.0) * 0.5 * SQUARES).floor() as i64;
    (index(a) + index(b)).rem_euclid(2) == 0
}

/// Returns the scene of the checkerboard with its camera and default settings.
pub fn case() -> Case {
    let (away, normal) = directions();
    // The camera at the origin looks along −z with +y up, so y and z of view space are negated.
    let world = |v: DVec3| DVec3::new(v.x, -v.y, -v.z);
    let at = |i: usize| (i as f64 + 0.5) * SPACING - 1.0;
    let mut splats = Vec::with_capacity(DISKS * DISKS);
    for j in 0..DISKS {
        for i in 0..DISKS {
            let (a, b) = (at(i), at(j));
            let p = DVec3::new(a, 0.0, DISTANCE) + away * b;
            let color = if is_white(a, b) { [1.0; 3] } else { [0.0; 3] };
            splats.push(Splat::disk(world(p), world(normal), SPACING, color));
        }
    }
    let mut camera = camera(0.0, 60.0, [SIZE, SIZE]);
    camera.target = [0.0, 0.0, -1.0];
    Case::new("checkerboard", Scene { background: [0.0; 4], ..scene(&splats) }, camera)
}

/// Returns the exact image: a brightness per pixel, or `None` for pixels that aren't wholly inside the square.
pub fn truth(view: &View) -> Vec<Option<f64>> {
    let (away, normal) = directions();
    let center = DVec3::new(0.0, 0.0, DISTANCE);
    let on_square = |x: f64, y: f64| {
        let (_, d) = view.projection.ray(surfel_math::V2::new(x, y));
        let d = DVec3::new(d.x, d.y, d.z);
        let distance = normal.dot(center) / normal.dot(d);
        let q = d * distance - center;
        let (a, b) = (q.x, q.dot(away));
        (distance > 0.0 && a.abs() <= 1.0 && b.abs() <= 1.0).then_some((a, b))
    };
    let mut image = Vec::with_capacity((SIZE * SIZE) as usize);
    for y in 0..SIZE {
        for x in 0..SIZE {
            let (x, y) = (f64::from(x), f64::from(y));
            // The projected square is convex, so a pixel is inside if its corners are.
            let inside = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
            if !inside.iter().all(|(dx, dy)| on_square(x + dx, y + dy).is_some()) {
                image.push(None);
                continue;
            }
            let offset = |i: u32| (f64::from(i) + 0.5) / f64::from(SAMPLES);
            let hits = (0..SAMPLES * SAMPLES)
                .filter_map(|i| on_square(x + offset(i % SAMPLES), y + offset(i / SAMPLES)))
                .filter(|&(a, b)| is_white(a, b))
                .count();
            image.push(Some(hits as f64 / f64::from(SAMPLES * SAMPLES)));
        }
    }
    image
}

/// Returns the RMSE of an image's red channel in each band.
pub fn errors(image: &[[f32; 4]], truth: &[Option<f64>]) -> Bands {
    let width = SIZE as usize;
    let rows: Vec<usize> =
        (0..width).filter(|y| truth[y * width..(y + 1) * width].iter().any(Option::is_some)).collect();
    let n = rows.len();
    let ends = [0, n / 16, n / 8, n / 4, n / 2, n];
    std::array::from_fn(|band| {
        let (mut sum, mut count) = (0.0, 0usize);
        // The upper rows are the far ones.
        for &y in &rows[ends[band]..ends[band + 1]] {
            for at in y * width..(y + 1) * width {
                if let Some(want) = truth[at] {
                    sum += (f64::from(image[at][0]) - want).powi(2);
                    count += 1;
                }
            }
        }
        (sum / count.max(1) as f64).sqrt()
    })
}

/// Measures the errors of these variants in images that the reference draws.
///
/// # Errors
/// [`RenderError`] if the reference can't draw them.
pub fn measure(variants: &[(&'static str, Settings)]) -> Result<Vec<(&'static str, Bands)>, RenderError> {
    let case = case();
    let view = case.view();
    let truth = truth(&view);
    let mut reference = Reference::new(Default::default())?;
    let resident = reference.upload(&case.scene)?;
    let mut frame = Frame::default();
    let mut table = Vec::new();
    for (name, settings) in variants {
        reference.render_into(&resident, &view, settings, Planes::COLOR, &mut frame)?;
        table.push((*name, errors(frame.color(), &truth)));
    }
    Ok(table)
}
