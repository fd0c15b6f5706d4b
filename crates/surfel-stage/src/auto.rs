//! Automatic scenes for files without a scene file: camera, lights, materials and settings that suit their data.

use crate::estimates::Estimates;
use crate::sheets;
use crate::watertight;
use std::borrow::Cow;
use std::path::Path;
use surfel_framing::patches::Patches;
use surfel_framing::{DEFAULT_FOV_Y_DEG, FrameOptions, FrameProjection, ViewAxes, ViewChoice};
use surfel_framing::{Samples, UpConvention, UpReason, Upright, upright_of};
use surfel_load::SparseReason;
use surfel_load::scene::{assemble, bare_object, is_scene_file, load_bare_objects, load_scene, read_scene_file};
use surfel_load::{Error, LoadOptions};
use surfel_load::{LoadedObjects, ObjectFacts, ObjectNote};
use surfel_model::{
    Camera, Composite, Cull, DepthTolerance, Geometry, Light, Material, Object, ObjectFile, PointsAs, Scene, SceneFile,
    Settings, Shader, Transparency, Up,
};
use surfel_render::{Preset, View};
use surfel_sample::Progress;

/// Default size of an automatic image: width and height in pixels.
pub const DEFAULT_SIZE: [u32; 2] = [1024, 1024];
/// Fraction of an automatic image's width or height that the scene fills.
const FILL: f64 = 0.9;
/// Fraction of an automatic image's width or height that the scene fills if it has a ground. Shadows on the ground need
/// space around the scene.
const FILL_ABOVE_GROUND: f64 = 0.8;
/// Largest number of layers of transparent splats that a pixel of an automatic image shows. Two panes of glass have
/// four surfaces. Surfaces behind the third are blended as one layer.
const LAYERS: u32 = 4;
/// Depth tolerance, in splat radii, for objects of flat parts and for sharp splats. Their splats lie exactly in the
/// surface, so that a small tolerance suffices.
const FLAT_TOLERANCE: f64 = 0.1;
/// Depth tolerance, in splat radii, for splats of a mesh that are as small as its triangles. With a larger tolerance,
/// surfaces close behind would shine through.
const FINE_TOLERANCE: f64 = 0.3;
/// Ambient light of automatic scenes in linear RGB, bright enough that details in shadow are visible.
const AMBIENT: [f64; 3] = [0.13, 0.135, 0.145];

/// Options for an automatic scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct AutoOptions {
    /// Up axis. `None` uses the axis that a file or its format states, or else an estimate from the shape
    /// ([`auto_up`]).
    pub up: Option<Up>,
    /// Direction from which the scene is viewed.
    pub view: ViewChoice,
    /// Projection of the camera.
    pub projection: FrameProjection,
    /// Image width and height in pixels, used by the framed camera.
    pub size: [u32; 2],
    /// Camera that is used as it is; `None` places one so that the scene fills the image.
    pub camera: Option<Camera>,
    /// Background in linear RGB and straight alpha in [0, 1]. `None` uses white, or grey if most of the scene is white
    /// and the shader is `unlit` or `edl`.
    pub background: Option<[f64; 4]>,
    /// Settings of the renderer, which the scene file contains unchanged.
    pub settings: Settings,
    /// True if the framed camera leaves enough space for the scene to turn once about its up axis without leaving the
    /// image.
    pub turning: bool,
    /// True if the framed camera leaves enough space for shadows on the ground.
    pub ground: bool,
}

impl AutoOptions {
    surfel_model::setters! {
        with_up up: Option<Up>,
        with_view view: ViewChoice,
        with_projection projection: FrameProjection,
        with_size size: [u32; 2],
        with_camera camera: Option<Camera>,
        with_background background: Option<[f64; 4]>,
        with_settings settings: Settings,
        with_turning turning: bool,
        with_ground ground: bool,
    }
}

impl Default for AutoOptions {
    fn default() -> Self {
        Self {
            up: None,
            view: ViewChoice::Auto,
            projection: FrameProjection::Perspective(DEFAULT_FOV_Y_DEG),
            size: DEFAULT_SIZE,
            camera: None,
            background: None,
            settings: Preset::Balanced.apply(Settings::default().with_shader(Shader::Phong)),
            turning: false,
            ground: false,
        }
    }
}

/// Returns the transparency method for files without a scene file, and a note about it. Returns `None` if no splat is
/// transparent, and for trained Gaussians ([`ObjectFacts::transparent`]). `paths` are the paths of the objects.
pub fn auto_transparency(loaded: &LoadedObjects, paths: &[&Path]) -> Option<(Transparency, ObjectNote)> {
    let (_, path) = loaded.facts.iter().zip(paths).find(|(facts, _)| facts.transparent)?;
    let transparency = Transparency::Peel { layers: LAYERS, drop_last: false };
    let text = format!("some splats are transparent: drawn as `transparency={transparency}` (off draws them opaque)");
    Some((transparency, ObjectNote { path: path.to_path_buf(), text }))
}

/// Returns the settings for files of trained Gaussians without a scene file, and a note about them. Returns `None`
/// unless all objects are trained Gaussians. `paths` are the paths of the objects.
pub fn auto_composite(loaded: &LoadedObjects, paths: &[&Path], settings: Settings) -> Option<(Settings, ObjectNote)> {
    let path = paths.first().filter(|_| loaded.all_gaussians())?.to_path_buf();
    let text = "drawn as trained, Gaussian over Gaussian (`composite=over`; surface draws them as opaque surfaces)";
    let settings = settings.with_composite(Composite::Over).with_shader(Shader::Unlit);
    Some((settings, ObjectNote { path, text: text.to_owned() }))
}

/// Returns the depth tolerance for files without a scene file: the largest that an object needs. `None` stands for the
/// default, which is used if at least one object needs it. The tolerance is small for objects of flat parts, such as
/// buildings, for sharp splats, and for splats as fine as their mesh. With the default, a floor would shine through the
/// wall at its end, and skin through eyebrows.
pub fn auto_depth_tolerance(loaded: &LoadedObjects) -> Option<DepthTolerance> {
    let needed = loaded.facts.iter().map(|facts| match facts {
        ObjectFacts { flat: true, .. } => Some(FLAT_TOLERANCE),
        ObjectFacts { fine: true, .. } => Some(FINE_TOLERANCE),
        _ => None,
    });
    let largest = needed.reduce(|a, b| Some(a?.max(b?)));
    largest.flatten().map(DepthTolerance::Relative)
}

/// Selects balls for objects whose points aren't sufficient to estimate a surface ([`ObjectFacts::sparse`]), unless
/// their options state a kind of splat. If one object gets balls because its points are few and rough, all objects with
/// few points get balls, so that compared files look alike. `objects` has the same order as `loaded`. Returns a note
/// for each changed file.
pub fn auto_points_as(loaded: &LoadedObjects, objects: &mut [ObjectFile]) -> Vec<ObjectNote> {
    let any_few = loaded.facts.iter().any(|facts| facts.sparse == Some(SparseReason::Few));
    let mut notes = Vec::new();
    for (object, facts) in objects.iter_mut().zip(&loaded.facts) {
        let reason = facts.sparse.or((any_few && facts.few).then_some(SparseReason::Others));
        let Some(reason) = reason.filter(|_| object.convert.points_as.is_none()) else { continue };
        object.convert.points_as = Some(PointsAs::Balls(None));
        let path = object.splats.clone().unwrap_or_default();
        let text =
            format!("its points are drawn as balls, because {} (`points_as=surface` draws a surface)", reason.words());
        if !notes.iter().any(|note: &ObjectNote| note.path == path) {
            notes.push(ObjectNote { path, text });
        }
    }
    notes
}

/// Determines the up axis of objects without a scene file, and the reason for it. The axis is that of the first file
/// whose content or format states one; otherwise it is estimated from the objects' shape ([`upright_of`]). Without
/// objects, it is +y.
pub fn auto_up(loaded: &LoadedObjects, samples: &Samples) -> Upright {
    let known = loaded.facts.iter().find_map(|facts| Some(Upright { up: facts.up, reason: facts.up_reason? }));
    known.unwrap_or_else(|| match loaded.facts.first() {
        Some(first) => upright_of(samples, UpConvention::of(first.points, first.up)),
        None => Upright { up: Up::PlusY, reason: UpReason::Convention },
    })
}

/// Creates a scene file for loaded objects, with camera, lights and materials that suit them.
///
/// # Errors
/// [`Error::Model`] for objects without a finite extent, which can't be framed. The camera and settings in the options
/// are validated when they are used, not here.
pub fn auto_scene(objects: Vec<ObjectFile>, loaded: &LoadedObjects, options: &AutoOptions) -> Result<SceneFile, Error> {
    let estimates = Estimates::default();
    let up = options.up.unwrap_or_else(|| auto_up(loaded, estimates.samples(loaded)).up);
    let staged = stage(&estimates, objects, loaded, up, options)?;
    let lights = estimates.lighting(loaded, up).lights(&staged.camera);
    Ok(staged.into_scene(up, Some(lights), options.settings))
}

/// Camera, background and objects with materials of an automatic scene, as [`stage`] chooses them.
#[derive(Clone, Debug)]
pub struct Staged {
    /// Camera of the options, or one that frames the scene.
    pub camera: Camera,
    /// Background, linear RGB and straight alpha in [0, 1].
    pub background: [f64; 4],
    /// Objects with their materials.
    pub objects: Vec<ObjectFile>,
}

impl Staged {
    /// Returns the scene file with the up axis `up`, these lights and settings.
    pub fn into_scene(self, up: Up, lights: Option<Vec<Light>>, settings: Settings) -> SceneFile {
        let Self { camera, background, objects } = self;
        let (sky, ground, matcap) = (None, None, None);
        let up = Some(up);
        SceneFile { up, camera, background, ambient: AMBIENT, lights, sky, ground, matcap, objects, settings }
    }
}

/// Chooses camera, background and materials like [`auto_scene`], and reuses cached estimates of the loaded objects.
///
/// # Errors
/// Errors of [`auto_scene`].
pub fn stage(
    estimates: &Estimates,
    mut objects: Vec<ObjectFile>,
    loaded: &LoadedObjects,
    up: Up,
    options: &AutoOptions,
) -> Result<Staged, Error> {
    let samples = estimates.samples(loaded);
    let scene = Scene { objects: loaded.objects.clone(), ..Scene::default() };
    let camera = match &options.camera {
        Some(camera) => camera.clone(),
        None => {
            let framing = FrameOptions {
                axes: ViewAxes::of_choice(options.view, &loaded.objects, up),
                projection: options.projection,
                size: options.size,
                fill: if options.ground { FILL_ABOVE_GROUND } else { FILL },
                turning: options.turning.then(|| up.vector()),
            };
            let nothing = || {
                let problem = "the objects have no finite extent to look at: give a camera (`camera`, `eye`)";
                Error::Model(surfel_model::ModelError::Conflict(problem.to_owned()))
            };
            estimates.camera(loaded, &scene, framing).ok_or_else(nothing)?
        }
    };
    // With an invalid camera, `view` is `None`; the camera is reported when the scene is drawn.
    let (brightness, view) = (estimates.brightness(loaded), View::new(&camera).ok());
    let all = || loaded.facts.iter().zip(&loaded.objects).enumerate();
    let hides_back_faces = |(i, (facts, drawn))| hides_back_faces(facts, drawn, || samples.of_object(i));
    let watertight = estimates.watertight(|| all().map(hides_back_faces).collect());
    for ((object, (i, (facts, drawn))), is_watertight) in objects.iter_mut().zip(all()).zip(watertight) {
        let covers = |view| samples.of_object(i).is_some_and(|patches| sheets::has_thin_sheets(drawn, &patches, view));
        let is_culled = *is_watertight && (facts.each_side || !view.as_ref().is_some_and(covers));
        let color = object.material.color;
        object.material = Material { color, ..material(facts, is_culled, brightness.exposure()) };
    }
    let background = options.background.unwrap_or_else(|| brightness.background(options.settings.shader));
    Ok(Staged { camera, background, objects })
}

/// True if an object's splats cover a watertight surface from outside, so that its back faces may be culled. This is
/// stated by the file, derived from the mesh, or estimated from the cloud ([`watertight::is_watertight`]). The estimate
/// is made only for complete, opaque clouds for which neither file nor mesh determines the answer.
fn hides_back_faces<'s>(
    facts: &ObjectFacts,
    object: &Object,
    sample: impl FnOnce() -> Option<Cow<'s, Patches>>,
) -> bool {
    let is_cloud = matches!(object.geometry, Geometry::Splats(_));
    let is_judged = is_cloud && !facts.sides_known && !facts.partial && !facts.transparent;
    facts.is_watertight || is_judged && sample().is_some_and(|patches| watertight::is_watertight(&patches))
}

/// Returns an object's material for an automatic scene. Objects with colours are shown at their brightness times
/// `exposure`. Objects without colours appear as light grey clay, which leaves a range for highlights.
///
/// If `hides_back_faces`, back faces are culled: splats of a watertight object extend slightly beyond its silhouette,
/// and their back faces would form a fringe. The caller passes false for watertight objects that have thin sheets over
/// other surfaces, because these surfaces would otherwise shine through the sheets.
fn material(facts: &ObjectFacts, hides_back_faces: bool, exposure: f64) -> Material {
    let cull = if hides_back_faces { Cull::Back } else { Cull::None };
    if facts.colored {
        let (ambient, diffuse) = (1.3 * exposure, 0.95 * exposure);
        Material { ambient, diffuse, specular: 0.06 * exposure, shininess: 24.0, cull, ..Material::default() }
    } else {
        Material { ambient: 0.55, diffuse: 0.66, specular: 0.14, shininess: 32.0, cull, ..Material::default() }
    }
}

/// Scene, and the scene file that describes it.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    /// Scene file as read, or as created for geometry files. Its paths are unchanged.
    pub file: SceneFile,
    /// Scene with all files loaded.
    pub scene: Scene,
    /// Notes for the user, each about one file: data that was dropped, assumed or estimated.
    pub notes: Vec<ObjectNote>,
}

/// Opens a scene file (`.json`), or any number of geometry files as one scene that is framed and lit automatically.
///
/// # Errors
/// - [`Error::Io`] for a file that can't be read or is damaged;
/// - [`Error::Sample`] and [`Error::Unsuitable`] for content that can't be converted to splats, and if no path is
///   given;
/// - [`Error::Model`] for numbers of a scene file that are out of range, and for geometry without a finite extent.
pub fn open(paths: &[&Path], progress: &dyn Progress) -> Result<LoadedScene, Error> {
    let options = LoadOptions::default();
    match paths {
        [] => Err(Error::Unsuitable { path: "".into(), problem: "no file is given, expected at least one".into() }),
        [path] if is_scene_file(path) => {
            let (file, _) = read_scene_file(path)?;
            let base = path.parent().unwrap_or(Path::new(""));
            let (scene, notes) = load_scene(&file, base, &options, progress)?;
            Ok(LoadedScene { file, scene, notes })
        }
        paths => {
            let mut objects = paths.iter().map(|path| bare_object(path)).collect::<Vec<_>>();
            let mut loaded = load_bare_objects(&objects, Path::new(""), &options, progress)?;
            let about_points = auto_points_as(&loaded, &mut objects);
            loaded.notes.extend(about_points);
            let mut auto = AutoOptions::default();
            if let Some((settings, note)) = auto_composite(&loaded, paths, auto.settings) {
                auto.settings = settings;
                loaded.notes.push(note);
            }
            if let Some((transparency, note)) = auto_transparency(&loaded, paths) {
                auto.settings.transparency = transparency;
                loaded.notes.push(note);
            }
            if let Some(tolerance) = auto_depth_tolerance(&loaded) {
                auto.settings.depth_tolerance = tolerance;
            }
            let file = auto_scene(objects, &loaded.framed(), &auto)?;
            loaded.draw_points(&file.objects)?;
            let scene = assemble(&file, loaded.objects)?;
            Ok(LoadedScene { file, scene, notes: loaded.notes })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_object_that_needs_most_depth_tolerance_decides() {
        let any = ObjectFacts::default();
        let [flat, fine] = [ObjectFacts { flat: true, ..any }, ObjectFacts { fine: true, ..any }];
        let of = |all: &[ObjectFacts]| {
            auto_depth_tolerance(&LoadedObjects { facts: all.to_vec(), ..LoadedObjects::default() })
        };
        assert_eq!((of(&[]), of(&[flat, any]), of(&[any, fine])), (None, None, None));
        assert_eq!(of(&[flat, flat]), Some(DepthTolerance::Relative(0.1)));
        assert_eq!(of(&[flat, fine]), Some(DepthTolerance::Relative(0.3)));
    }

    #[test]
    fn transparency_is_chosen_for_the_first_file_that_has_some() {
        let facts = |transparent| ObjectFacts { colored: true, transparent, ..ObjectFacts::default() };
        let loaded = |all: &[bool]| LoadedObjects {
            facts: all.iter().map(|&transparent| facts(transparent)).collect(),
            ..LoadedObjects::default()
        };
        let paths = [Path::new("wall.ply"), Path::new("glass.glb")];
        assert_eq!(auto_transparency(&loaded(&[false, false]), &paths), None);
        let (transparency, note) = auto_transparency(&loaded(&[false, true]), &paths).unwrap();
        assert_eq!((transparency.to_string().as_str(), note.path.as_path()), ("peel:4", paths[1]));
        assert!(note.text.contains("`transparency=peel:4`"), "{}", note.text);
    }
}
