//! The level of detail of octrees: splats of at most so many pixels, polygons where even the finest are larger.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use surfel::model::{Cull, Geometry, Object, Shader};
use surfel::sample::{HybridOptions, hybrid_from_mesh};
use surfel::{Camera, HybridObject, Material, NoProgress, Scene, Settings, View};

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
    let hybrid = Arc::new(hybrid_from_mesh(&mesh, &HybridOptions::default(), &NoProgress)?);
    let whole = subject(Geometry::Mesh(Arc::new(mesh)), &camera, if quick { 3 } else { 8 });
    // Until a view is chosen it has the octree's own splats, all of them.
    let all_splats = subject(Geometry::Splats(Arc::new(hybrid.cloud().clone())), &camera, 1);
    let view = View::new(&camera)?;
    let octree = [HybridObject { object: 0, hybrid }];
    let mut levels = Vec::new();
    for error_px in ERRORS_PX {
        let scene = surfel::at_detail(&all_splats.scene, &octree, &view, error_px)?;
        let variant = if error_px == ERRORS_PX[0] {
            Variant::of_scene(DEFAULT, DEFAULT.to_owned())
        } else {
            Variant::of_scene("level of detail", format!("{error_px} px"))
        };
        levels.push((variant, Subject { scene, ..subject(whole.scene.objects[0].geometry.clone(), &camera, 1) }));
    }
    measure::details(&whole, &levels, backends, runs, figures)
}

fn subject(geometry: Geometry, camera: &Camera, samples: u32) -> Subject {
    let material = Material { cull: Cull::Back, ..Material::default() };
    let object = Object { geometry, world_from_object: DAffine3::from_translation(DVec3::ZERO), material };
    let lights = Some(surfel::studio_lights(camera));
    Subject {
        name: "octree",
        about: "a bumpy ball as an octree of splats and polygons, by the size of the splats that may stand for them",
        scene: Scene { objects: vec![object], lights, ..Scene::default() },
        camera: camera.clone(),
        settings: Settings { shader: Shader::Phong, ..Settings::default() },
        truth: Approximates::Samples(samples),
        clips: false,
        transparent: false,
        is_made: true,
    }
}
