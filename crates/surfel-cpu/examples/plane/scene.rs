//! A plane of equal disks that fills the image.

use glam::{DVec3, Vec3};
use surfel_model::{Camera, CloudData, Column3, ModelError, OnInvalid, Projection, Scene, Shape, SplatCloud};
use surfel_render::View;

const SIZE: u32 = 512;

/// Distance of the plane from the camera, in pixels. It is so large that most splats' depth ranges are as small,
/// relative to their distance, as in an ordinary image.
const DISTANCE: f64 = 1000.0;

/// Builds a plane of disks of this radius in pixels, spaced by radius / 1.1 and tilted by up to 60°. Also returns a
/// view whose pixels match the plane's units.
pub(crate) fn plane(radius_px: f64) -> Result<(Scene, View), ModelError> {
    let spacing_px = radius_px / 1.1;
    let side = (f64::from(SIZE) / spacing_px).ceil();
    let count = (side * side) as usize;
    let (mut centers, mut normals) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for i in 0..count {
        let (row, column) = ((i as f64 / side).floor(), i as f64 % side);
        let half = 0.5 * f64::from(SIZE);
        centers.push(DVec3::new(column * spacing_px - half, row * spacing_px - half, 0.0).as_vec3());
        // The golden angle and ratio cover all tilts and directions evenly for any count.
        let (sine, cosine) = (2.399_963 * i as f64).sin_cos();
        let tilt = (i as f64 * 0.618_034).fract().acos().min(std::f64::consts::FRAC_PI_3);
        normals.push(Vec3::new((tilt.sin() * cosine) as f32, (tilt.sin() * sine) as f32, tilt.cos() as f32));
    }
    let colors = centers.iter().map(|c| (0.5 + 0.001 * *c).to_array()).collect();
    let shape = Shape::Disks { normals: Column3::from_f32(normals), radii: vec![radius_px as f32; count] };
    let data = CloudData { colors: Some(colors), ..CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape) };
    let scene = Scene::from(SplatCloud::new(data, OnInvalid::Refuse)?.0);
    let camera = Camera {
        eye: [0.0, 0.0, DISTANCE],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 2.0 * (0.5 * f64::from(SIZE) / DISTANCE).atan().to_degrees() },
        near: 1.0,
        far: Some(2.0 * DISTANCE),
        size: [SIZE; 2],
    };
    Ok((scene, View::new(&camera)?))
}
