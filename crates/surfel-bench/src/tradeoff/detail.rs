//! The level of detail of octrees: splats of at most so many pixels, polygons where even the finest are larger.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use surfel::model::{Cull, Geometry, Object, Shader};
use surfel::sample::{OctreeOptions, octree_from_mesh};
use surfel::{Camera, Material, NoProgress, Scene, Settings};

use super::figures::Figures;
use super::measure::{self, Backends};
use super::subjects;
use super::subjects::{Approximates, Subject};
use super::variants::{DEFAULT, Variant};
use crate::{Failure, clouds};

/// What `--lod-error` may be, pixels; the first is its default.
const ERRORS_PX: [f64; 6] = [1.0, 0.5, 1.5, 2.0, 4.0, 8.0];

/// A bumpy ball of polygons and its octree.
pub(crate) fn all(
    size: u32,
    quick: bool,
    backends: &mut Backends,
    runs: usize,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let mesh = clouds::bumpy_mesh(if quick { 96 } else { 256 });
    let camera = subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size);
    let octree = Arc::new(octree_from_mesh(&mesh, &OctreeOptions::default(), &NoProgress)?);
    let whole = subject(Geometry::Mesh(Arc::new(mesh)), &camera, if quick { 3 } else { 8 });
    let mut levels = Vec::new();
    for error_px in ERRORS_PX {
        let variant = if error_px == ERRORS_PX[0] {
            Variant::of_scene(DEFAULT, DEFAULT.to_owned())
        } else {
            Variant::of_scene("level of detail", format!("{error_px} px"))
        };
        let chosen = subject(Geometry::Octree(octree.clone()), &camera, 1);
        let settings = chosen.settings.with_lod_error_px(error_px);
        levels.push((variant, Subject { settings, ..chosen }));
    }
    measure::details(&whole, &levels, backends, runs, figures)
}

fn subject(geometry: Geometry, camera: &Camera, samples: u32) -> Subject {
    let material = Material { cull: Cull::Back, ..Material::default() };
    let object = Object { geometry, world_from_object: DAffine3::from_translation(DVec3::ZERO), material };
    let lights = Some(surfel::scene::studio_lights(camera));
    Subject {
        name: "octree",
        about: "a bumpy ball as an octree of splats and polygons, by the size of the splats that may stand for them",
        scene: Scene { objects: vec![object], lights, ..Scene::default() },
        camera: camera.clone(),
        settings: Settings::default().with_shader(Shader::Phong),
        truth: Approximates::Samples(samples),
        clips: false,
        transparent: false,
        is_made: true,
    }
}
