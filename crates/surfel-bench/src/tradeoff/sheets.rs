//! Cost of the rule for thin sheets (rendering model, §5), which blends the two sides of oriented clouds separately.
//! Time and error are also measured for the same clouds without their back sides.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use surfel_model::{Camera, Material, Scene, Settings, SplatCloud};
use surfel_model::{Column3, Cull, Geometry, Mesh, Object};
use surfel_sample::NoProgress;
use surfel_sample::{MeshMethod, MeshOptions, splats_from_mesh};

use super::figures::Figures;
use super::measure::{self, Backends};
use super::subjects::{self, IdealImage, Subject};
use super::truth::{self, SurfaceHit};
use super::variants::{DEFAULT, Variant};
use crate::{Failure, clouds};

/// Name in the tables of the compared setting: how both sides of thin sheets are drawn.
const KNOB: &str = "sheets";
/// Number of splats of the roof and the walls.
const SPLATS: usize = 30_000;
/// Elevation of the camera above the roof, in degrees.
const ELEVATION_DEG: f64 = 25.0;
/// Boxes of a thin roof and of the walls that end at its underside: middle, half size and colour.
const BOXES: [(DVec3, DVec3, [f64; 3]); 5] = {
    const fn wall(x: f64, z: f64, half_x: f64, half_z: f64, color: [f64; 3]) -> (DVec3, DVec3, [f64; 3]) {
        (DVec3::new(x, -0.215, z), DVec3::new(half_x, 0.2, half_z), color)
    }
    [
        (DVec3::ZERO, DVec3::new(0.9, 0.015, 0.7), [0.7, 0.3, 0.2]),
        wall(0.0, 0.4, 0.7, 0.05, [0.9, 0.9, 0.8]),
        wall(0.0, -0.4, 0.7, 0.05, [0.2, 0.4, 0.7]),
        wall(0.4, 0.0, 0.05, 0.3, [0.3, 0.7, 0.3]),
        wall(-0.4, 0.0, 0.05, 0.3, [0.1, 0.1, 0.1]),
    ]
};

/// Measures time and error of a thin roof over walls, and of a bumpy ball without thin sheets, each in the three
/// variants of [`measure_sides`].
pub(crate) fn all(
    size: u32,
    quick: bool,
    backends: &mut Backends,
    runs: usize,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let (sine, cosine) = ELEVATION_DEG.to_radians().sin_cos();
    let turned = DVec3::new(0.4f64.sin(), 0.0, 0.4f64.cos()) * cosine + DVec3::Y * sine;
    let camera = subjects::camera((turned * 3.0).to_array(), [0.0, -0.1, 0.0], 40.0, size);
    let options = MeshOptions::new(MeshMethod::Count(SPLATS));
    let house = splats_from_mesh(&house(), &options, &NoProgress)?.0;
    let truth = truth::cast(&camera, &seen, false)?;
    let about =
        "a roof, 0.03 thick, over walls that end at its underside, seen from 25°: what grazing disks let through";
    measure_sides(("thin roof", about), house, &camera, IdealImage::Surface(truth), backends, runs, figures)?;
    let camera = subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size);
    let mut ball = clouds::ball(if quick { 60_000 } else { 154_000 })?;
    ball.set_oriented(true);
    let about =
        "a bumpy closed surface with its back, which nothing shows: what the rule costs where there is no sheet";
    let samples = IdealImage::Samples(if quick { 4 } else { 8 });
    measure_sides(("ball with back", about), ball, &camera, samples, backends, runs, figures)
}

/// Measures an oriented cloud in three variants: with both sides (the default), with back-face culling, and with sides
/// that aren't separated. An ideal image made by supersampling is drawn with back-face culling.
fn measure_sides(
    (name, about): (&'static str, &'static str),
    cloud: SplatCloud,
    camera: &Camera,
    truth: IdealImage,
    backends: &mut Backends,
    runs: usize,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let geometry = Geometry::Splats(Arc::new(cloud));
    let subject = |oriented, cull, truth| Subject {
        name,
        about,
        scene: Scene {
            objects: vec![Object {
                geometry: geometry.clone(),
                world_from_object: DAffine3::IDENTITY,
                material: Material { oriented: Some(oriented), cull, ..Material::default() },
            }],
            ..Scene::default()
        },
        camera: camera.clone(),
        settings: Settings::default(),
        truth,
        clips: false,
        transparent: false,
        is_generated: true,
    };
    let level = |knob, value: &str, oriented, cull| {
        (Variant::of_scene(knob, value.to_owned()), subject(oriented, cull, IdealImage::Samples(1)))
    };
    let levels = [
        level(DEFAULT, DEFAULT, true, Cull::None),
        level(KNOB, "back faces culled", true, Cull::Back),
        level(KNOB, "sides not kept apart", false, Cull::None),
    ];
    measure::details(&subject(true, Cull::Back, truth), &levels, backends, runs, figures)
}

/// Returns the boxes of the roof and the walls as one mesh.
fn house() -> Mesh {
    let (mut positions, mut triangles, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for (middle, half, color) in BOXES {
        let first = positions.len() as u32;
        for corner in 0..8u32 {
            let sign = DVec3::from([0, 1, 2].map(|axis| f64::from(corner >> axis & 1) * 2.0 - 1.0));
            positions.push((middle + half * sign).as_vec3());
            colors.push(color.map(|c| c as f32));
        }
        for axis in 0..3 {
            let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
            for (side, [b, c]) in [(0, [v, u]), (1 << axis, [u, v])] {
                let at = |corner: u32| first + side + corner;
                triangles.extend([[at(0), at(b), at(u + v)], [at(0), at(u + v), at(c)]]);
            }
        }
    }
    Mesh { positions: Column3::from_f32(positions as Vec<Vec3>), triangles, colors: Some(colors), ..Mesh::default() }
}

/// Returns the nearest intersection of a ray with the boxes; `None` if there is none.
fn seen(eye: DVec3, ray: DVec3) -> Option<SurfaceHit> {
    let met = |(middle, half, color): &(DVec3, DVec3, [f64; 3])| {
        let (a, b) = ((*middle - *half - eye) / ray, (*middle + *half - eye) / ray);
        let (enter, leave) = (a.min(b), a.max(b).min_element());
        let first = enter.max_element();
        let axis = enter.max_position();
        let mut normal = DVec3::ZERO;
        normal[axis] = -ray[axis].signum();
        (first > 0.0 && first < leave).then(|| (first, SurfaceHit { albedo: *color, point: eye + ray * first, normal }))
    };
    BOXES.iter().filter_map(met).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, met)| met)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_sample::is_closed;

    #[test]
    fn mesh_and_truth_are_of_the_same_boxes() {
        let mesh = house();
        assert!(mesh.triangles.len() == 60 && is_closed(&mesh));
        // From above the roof is seen everywhere, from below the walls' feet too.
        let above = seen(DVec3::new(0.4, 3.0, 0.4), DVec3::NEG_Y).unwrap();
        assert!(above.albedo == BOXES[0].2 && (above.point.y - 0.015).abs() < 1e-12 && above.normal == DVec3::Y);
        let below = seen(DVec3::new(0.4, -3.0, 0.0), DVec3::Y).unwrap();
        assert!(below.albedo == BOXES[3].2 && (below.point.y + 0.415).abs() < 1e-12 && below.normal == DVec3::NEG_Y);
        assert!(seen(DVec3::new(1.0, 3.0, 0.0), DVec3::NEG_Y).is_none());
    }
}
