//! Measurements of level of detail. An octree is drawn as splats up to a size in pixels, and as polygons where even the
//! finest splats are larger. Point clouds are measured, too.

use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use surfel_load::{LoadOptions, levels};
use surfel_model::{Camera, Material, Scene, Settings};
use surfel_model::{Cull, Geometry, Object, Shader, SplatCloud};
use surfel_render::View;
use surfel_sample::NoProgress;
use surfel_sample::{OctreeOptions, octree_from_mesh};

use super::figures::Figures;
use super::measure::{self, Backends};
use super::subjects;
use super::subjects::{IdealImage, Subject};
use super::variants::{DEFAULT, Variant};
use crate::{Failure, clouds};

/// Measured values of `--lod-error` for the octree, in pixels; the first is the default.
const ERRORS_PX: [f64; 6] = [1.0, 0.5, 1.5, 2.0, 4.0, 8.0];
/// Measured values of `--lod-error` for the point cloud, in pixels; the first is the default.
const POINT_ERRORS_PX: [f64; 4] = [1.0, 0.5, 2.0, 4.0];

/// Measures a bumpy ball as polygons and as an octree.
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
    let whole = subject(OCTREE, Geometry::Mesh(Arc::new(mesh)), &camera, if quick { 3 } else { 8 });
    let mut levels = Vec::new();
    for error_px in ERRORS_PX {
        let chosen = subject(OCTREE, Geometry::Octree(octree.clone()), &camera, 1);
        let settings = chosen.settings.with_lod_error_px(error_px);
        levels.push((variant("level of detail", error_px), Subject { settings, ..chosen }));
    }
    measure::details(&whole, &levels, backends, runs, figures)
}

/// Measures the points of a bumpy ball at each level of detail, and all points for comparison.
pub(crate) fn points(
    size: u32,
    quick: bool,
    backends: &mut Backends,
    runs: usize,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("surfel-tradeoff-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let measured = points_in(&folder, (size, quick), backends, runs, figures);
    std::fs::remove_dir_all(&folder)?;
    measured
}

fn points_in(
    folder: &Path,
    (size, quick): (u32, bool),
    backends: &mut Backends,
    runs: usize,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let (input, path) = (folder.join("in.las"), folder.join("out.copc.laz"));
    std::fs::write(&input, las(&clouds::ball(if quick { 300_000 } else { 1_000_000 })?))?;
    levels::save_copc(&[input], &path, &levels::CopcRequest::default(), &NoProgress)?;
    let camera = subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size);
    let load = |options: &LoadOptions| -> Result<Geometry, Failure> {
        let options = options.clone().with_interior_weight(true);
        Ok(Geometry::Splats(Arc::new(surfel_load::load(&path, &options, &NoProgress)?.cloud)))
    };
    let whole = subject(POINTS, load(&LoadOptions::default())?, &camera, if quick { 3 } else { 8 });
    let views = [View::new(&camera)?];
    let mut chosen = Vec::new();
    for error_px in POINT_ERRORS_PX {
        let levels = levels::views_of(&views, DAffine3::IDENTITY, error_px);
        let geometry = load(&LoadOptions::default().with_levels(Some(levels)))?;
        chosen.push((variant("levels of points", error_px), subject(POINTS, geometry, &camera, 1)));
    }
    measure::details(&whole, &chosen, backends, runs, figures)
}

/// Returns a cloud's centres and colours as a LAS file of point format 2, with a coordinate resolution of 1e-5.
fn las(cloud: &SplatCloud) -> Vec<u8> {
    const STEP: f64 = 1e-5;
    let (header, record) = (227_u16, 26_u16);
    let mut bytes = vec![0; usize::from(header)];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 2]);
    bytes[94..96].copy_from_slice(&header.to_le_bytes());
    bytes[96..100].copy_from_slice(&u32::from(header).to_le_bytes());
    bytes[104] = 2;
    bytes[105..107].copy_from_slice(&record.to_le_bytes());
    bytes[107..111].copy_from_slice(&(cloud.len() as u32).to_le_bytes());
    let steps = |i: usize| (cloud.center(i) / STEP).round();
    let [low, high] = [DVec3::min, DVec3::max].map(|of| (1..cloud.len()).map(steps).fold(steps(0), of) * STEP);
    for k in 0..3 {
        let mut put = |at: usize, v: f64| bytes[at..at + 8].copy_from_slice(&v.to_le_bytes());
        put(131 + 8 * k, STEP);
        put(179 + 16 * k, high[k]);
        put(187 + 16 * k, low[k]);
    }
    for i in 0..cloud.len() {
        steps(i).to_array().iter().for_each(|v| bytes.extend_from_slice(&(*v as i32).to_le_bytes()));
        bytes.extend_from_slice(&[0; 8]);
        let color = cloud.data().colors.as_ref().map_or([1.0; 3], |colors| colors[i]);
        let encoded = color.map(|v| (surfel_math::srgb::encode(f64::from(v)) * 65_535.0).round() as u16);
        encoded.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    bytes
}

fn variant(knob: &'static str, error_px: f64) -> Variant {
    match error_px == ERRORS_PX[0] {
        true => Variant::of_scene(DEFAULT, DEFAULT.to_owned()),
        false => Variant::of_scene(knob, format!("{error_px} px")),
    }
}

/// Name and description of the subject that is drawn as an octree.
const OCTREE: (&str, &str) =
    ("octree", "a bumpy ball as an octree of splats and polygons, by the size of the splats that may stand for them");
/// Name and description of the subject that is drawn as points with levels of detail.
const POINTS: (&str, &str) =
    ("points by levels", "points of a bumpy ball as a COPC file, by the size of the splats that may stand for them");

fn subject((name, about): (&'static str, &'static str), geometry: Geometry, camera: &Camera, samples: u32) -> Subject {
    let material = Material { cull: Cull::Back, ..Material::default() };
    let object = Object { geometry, world_from_object: DAffine3::from_translation(DVec3::ZERO), material };
    let lights = Some(surfel_stage::studio_lights(camera));
    Subject {
        name,
        about,
        scene: Scene { objects: vec![object], lights, ..Scene::default() },
        camera: camera.clone(),
        settings: Settings::default().with_shader(Shader::Phong),
        truth: IdealImage::Samples(samples),
        clips: false,
        transparent: false,
        is_generated: true,
    }
}
