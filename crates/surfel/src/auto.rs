//! A scene for files that come without one: camera, lights and settings that show any data well.

use crate::framing::{DEFAULT_FOV_Y_DEG, FrameOptions, FrameProjection, NamedView, ViewAxes, frame_camera};
use crate::scene::ObjectFacts;
use crate::scene::{LoadedObjects, ObjectNote, assemble, load_objects, load_scene, read_scene_file};
use crate::{Error, LoadOptions};
use glam::DVec3;
use std::path::Path;
use surfel_model::{Camera, Cull, Light, Material, ObjectFile, Scene, SceneFile, Settings, Shader, Up};
use surfel_render::Preset;
use surfel_sample::Progress;

/// Size of an automatic picture, in pixels.
pub const DEFAULT_SIZE: [u32; 2] = [1024, 1024];
/// Share of an automatic picture's width or height that the scene takes.
const FILL: f64 = 0.9;
/// Ambient light of automatic scenes, linear RGB: shadows stay readable.
const AMBIENT: [f64; 3] = [0.13, 0.135, 0.145];

/// What may be said about an automatic scene.
#[derive(Clone, Debug, PartialEq)]
pub struct AutoOptions {
    /// Which axis is up; `None`: as the first file or its format says.
    pub up: Option<Up>,
    /// Where to look from.
    pub view: NamedView,
    /// Projection.
    pub projection: FrameProjection,
    /// Image width and height in pixels.
    pub size: [u32; 2],
    /// A camera to use instead of a framed one.
    pub camera: Option<Camera>,
    /// Linear RGB and straight alpha.
    pub background: [f64; 4],
    /// Settings.
    pub settings: Settings,
    /// The framed camera leaves room for the scene to turn about its up axis.
    pub turning: bool,
}

impl Default for AutoOptions {
    fn default() -> Self {
        Self {
            up: None,
            view: NamedView::Iso,
            projection: FrameProjection::Perspective(DEFAULT_FOV_Y_DEG),
            size: DEFAULT_SIZE,
            camera: None,
            background: [1.0; 4],
            settings: Preset::Balanced.apply(Settings { shader: Shader::Phong, ..Settings::default() }),
            turning: false,
        }
    }
}

/// Three lights that stay with the camera: a key light from the upper left in front, a soft fill from the right, and
/// a rim light from behind that lifts the outline off the background.
pub fn studio_lights(camera: &Camera) -> Vec<Light> {
    let ViewAxes { right, up, forward } = ViewAxes::of(camera);
    let light = |toward: DVec3, color: [f64; 3]| {
        let travels = -(right * toward.x + up * toward.y - forward * toward.z).normalize();
        Light::Directional { direction: travels.into(), color, shadow: false }
    };
    vec![
        light(DVec3::new(-0.55, 0.7, 0.9), [0.82, 0.81, 0.79]),
        light(DVec3::new(0.9, 0.1, 0.7), [0.15, 0.16, 0.17]),
        light(DVec3::new(0.5, 0.6, -0.8), [0.22, 0.22, 0.24]),
    ]
}

/// The scene file of objects that came without one: camera, lights and materials made to suit them.
///
/// # Errors
/// [`Error::Model`] for objects without extent that can be framed, and for options out of range.
pub fn auto_scene(objects: Vec<ObjectFile>, loaded: &LoadedObjects, options: &AutoOptions) -> Result<SceneFile, Error> {
    let up = options.up.or_else(|| loaded.facts.first().map(|f| f.up)).unwrap_or(Up::PlusY);
    let scene = Scene { objects: loaded.objects.clone(), ..Scene::default() };
    let camera = match &options.camera {
        Some(camera) => camera.clone(),
        None => {
            let framing = FrameOptions {
                axes: ViewAxes::named(options.view, up),
                projection: options.projection,
                size: options.size,
                fill: FILL,
                turning: options.turning.then(|| up.vector()),
            };
            let nothing = || {
                let problem = "the objects have no finite extent to look at: give a camera (--camera, --eye)";
                Error::Model(surfel_model::ModelError::Conflict(problem.to_owned()))
            };
            frame_camera(&scene, &framing).ok_or_else(nothing)?
        }
    };
    let mut objects = objects;
    for (object, facts) in objects.iter_mut().zip(&loaded.facts) {
        object.material = material(facts);
    }
    Ok(SceneFile {
        up: Some(up),
        lights: Some(studio_lights(&camera)),
        camera,
        background: options.background,
        ambient: AMBIENT,
        matcap: None,
        objects,
        settings: options.settings,
    })
}

/// Colours are shown as bright as they are; what has none is white by definition, and shown as light grey clay,
/// which leaves room for highlights.
///
/// The hidden side of a closed mesh is left out: its splats reach a little past the silhouette and would fringe it.
fn material(facts: &ObjectFacts) -> Material {
    let cull = if facts.closed { Cull::Back } else { Cull::None };
    if facts.colored {
        Material { ambient: 1.3, diffuse: 0.95, specular: 0.06, shininess: 24.0, cull, ..Material::default() }
    } else {
        Material { ambient: 0.55, diffuse: 0.66, specular: 0.14, shininess: 32.0, cull, ..Material::default() }
    }
}

/// A scene and the file that describes it.
#[derive(Clone, Debug)]
pub struct Opened {
    /// The scene file: as it was read, or as it was made up for bare geometry. Paths are as they were given.
    pub file: SceneFile,
    /// The scene, with everything loaded.
    pub scene: Scene,
    /// What was dropped, assumed or estimated, file by file.
    pub notes: Vec<ObjectNote>,
}

/// Opens one scene file (`.json`), or any number of geometry files as one scene that is framed and lit automatically.
///
/// # Errors
/// As [`load_scene`]; [`Error::Unsuitable`] if there is no path.
pub fn open(paths: &[&Path], progress: &dyn Progress) -> Result<Opened, Error> {
    let options = LoadOptions::default();
    match paths {
        [] => Err(Error::Unsuitable { path: "".into(), problem: "no file is given, expected at least one".into() }),
        [path] if is_scene_file(path) => {
            let (file, _) = read_scene_file(path)?;
            let base = path.parent().unwrap_or(Path::new(""));
            let (scene, notes) = load_scene(&file, base, &options, progress)?;
            Ok(Opened { file, scene, notes })
        }
        paths => {
            let objects = paths.iter().map(|path| bare_object(path)).collect::<Vec<_>>();
            let loaded = load_objects(&objects, Path::new(""), &options, progress)?;
            let file = auto_scene(objects, &loaded, &AutoOptions::default())?;
            let scene = assemble(&file, loaded.objects)?;
            Ok(Opened { file, scene, notes: loaded.notes })
        }
    }
}

/// True for a name that ends in `.json`.
pub fn is_scene_file(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

/// An object of the file at `path`, drawn as splats where it lies.
pub fn bare_object(path: &Path) -> ObjectFile {
    ObjectFile {
        splats: Some(path.to_path_buf()),
        mesh: None,
        matrix: glam::DMat4::IDENTITY.to_cols_array(),
        material: Material::default(),
    }
}
