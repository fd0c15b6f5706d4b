//! A scene for files that come without one: camera, lights and settings that show any data well.

use crate::closed;
use crate::framing::{DEFAULT_FOV_Y_DEG, FrameOptions, FrameProjection, ViewAxes, ViewChoice, frame_camera};
use crate::framing::{UpConvention, UpReason, Upright, upright};
use crate::lights::lights_of;
use crate::patches::Patches;
use crate::scene::ObjectFacts;
use crate::scene::{LoadedObjects, ObjectNote, assemble, load_bare_objects, load_scene, read_scene_file};
use crate::{Error, LoadOptions, sheets};
use std::path::Path;
use surfel_model::{
    Camera, Composite, ConvertOptions, Cull, DepthTolerance, Geometry, Material, Object, ObjectFile, Scene, SceneFile,
    Settings, Shader, Transparency, Up,
};
use surfel_render::{Preset, View};
use surfel_sample::Progress;

/// Size of an automatic image, in pixels.
pub const DEFAULT_SIZE: [u32; 2] = [1024, 1024];
/// Share of an automatic image's width or height that the scene takes.
const FILL: f64 = 0.9;
/// Layers of transparent splats in automatic images: two panes of glass have four surfaces, and all behind the third
/// are blended as one.
const LAYERS: u32 = 4;
/// Depth tolerance of flat parts and sharp splats, in radii: those lie in the surface, and need next to none to blend.
const FLAT_TOLERANCE: f64 = 0.1;
/// Depth tolerance of splats as fine as their mesh, in radii: what lies closer behind a surface shines through it.
const FINE_TOLERANCE: f64 = 0.3;
/// Ambient light of automatic scenes, linear RGB: shadows stay readable.
const AMBIENT: [f64; 3] = [0.13, 0.135, 0.145];

/// What may be said about an automatic scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct AutoOptions {
    /// Which axis is up; `None`: as a file or its format says, or else the objects' shape ([`auto_up`]).
    pub up: Option<Up>,
    /// Where to look from.
    pub view: ViewChoice,
    /// Projection.
    pub projection: FrameProjection,
    /// Image width and height in pixels.
    pub size: [u32; 2],
    /// A camera to use instead of a framed one.
    pub camera: Option<Camera>,
    /// Linear RGB and straight alpha; `None`: white, or grey behind what is mostly white itself and drawn by `unlit`
    /// or `edl`.
    pub background: Option<[f64; 4]>,
    /// Settings.
    pub settings: Settings,
    /// The framed camera leaves room for the scene to turn about its up axis.
    pub turning: bool,
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
        }
    }
}

/// How the transparent splats of files that came without a scene are drawn, and a note that says so; `None` where there
/// are none, and for Gaussians, which [`ObjectFacts::transparent`] leaves out. `paths` are those of the objects.
pub fn auto_transparency(loaded: &LoadedObjects, paths: &[&Path]) -> Option<(Transparency, ObjectNote)> {
    let (_, path) = loaded.facts.iter().zip(paths).find(|(facts, _)| facts.transparent)?;
    let transparency = Transparency::Peel { layers: LAYERS, drop_last: false };
    let text = format!("some splats are transparent: drawn as --transparency {transparency} (off draws them opaque)");
    Some((transparency, ObjectNote { path: path.to_path_buf(), text }))
}

/// The settings for files of trained Gaussians that came without a scene, and a note that says so; `None` for surfaces.
/// `paths` are those of the objects.
pub fn auto_composite(loaded: &LoadedObjects, paths: &[&Path], settings: Settings) -> Option<(Settings, ObjectNote)> {
    let path = paths.first().filter(|_| loaded.all_gaussians())?.to_path_buf();
    let text = "drawn as trained, Gaussian over Gaussian (--composite over; surface draws them as opaque surfaces)";
    let settings = settings.with_composite(Composite::Over).with_shader(Shader::Unlit);
    Some((settings, ObjectNote { path, text: text.to_owned() }))
}

/// The depth tolerance for files that came without a scene, where it isn't the default: objects of flat parts, as
/// buildings are, and sharp splats need next to none, splats as fine as their mesh little. The default would let a
/// floor shine through the wall that it ends at, and skin through eyebrows.
pub fn auto_depth_tolerance(loaded: &LoadedObjects) -> Option<DepthTolerance> {
    let needed = loaded.facts.iter().map(|facts| match facts {
        ObjectFacts { flat: true, .. } => Some(FLAT_TOLERANCE),
        ObjectFacts { fine: true, .. } => Some(FINE_TOLERANCE),
        _ => None,
    });
    let largest = needed.reduce(|a, b| Some(a?.max(b?)));
    largest.flatten().map(DepthTolerance::Relative)
}

/// Which axis is up in objects that came without a scene file, and why: the first file that says it or whose format
/// does decides, or else the objects' shape ([`upright`]).
pub fn auto_up(loaded: &LoadedObjects) -> Upright {
    let known = loaded.facts.iter().find_map(|facts| Some(Upright { up: facts.up, reason: facts.up_reason? }));
    known.unwrap_or_else(|| match loaded.facts.first() {
        Some(first) => upright(&loaded.objects, UpConvention::of(first.points, first.up)),
        None => Upright { up: Up::PlusY, reason: UpReason::Convention },
    })
}

/// The scene file of objects that came without one: camera, lights and materials made to suit them.
///
/// # Errors
/// [`Error::Model`] for objects without extent that can be framed, and for options out of range.
pub fn auto_scene(objects: Vec<ObjectFile>, loaded: &LoadedObjects, options: &AutoOptions) -> Result<SceneFile, Error> {
    let up = options.up.unwrap_or_else(|| auto_up(loaded).up);
    let scene = Scene { objects: loaded.objects.clone(), ..Scene::default() };
    let camera = match &options.camera {
        Some(camera) => camera.clone(),
        None => {
            let framing = FrameOptions {
                axes: ViewAxes::of_choice(options.view, &loaded.objects, up),
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
    let (whites, view) = (Whites::of(loaded), View::new(&camera)?);
    for ((object, facts), drawn) in objects.iter_mut().zip(&loaded.facts).zip(&loaded.objects) {
        let is_culled = hides_its_back(facts, drawn) && !sheets::covers_other_surfaces(drawn, &view);
        object.material = material(facts, is_culled, whites.exposure());
    }
    Ok(SceneFile {
        up: Some(up),
        lights: Some(lights_of(&camera, loaded, up)),
        camera,
        background: options.background.unwrap_or_else(|| whites.background(options.settings.shader)),
        ambient: AMBIENT,
        matcap: None,
        objects,
        settings: options.settings,
    })
}

/// Linear light that the lights of an automatic scene return at most from a white surface of [`material`]'s factors,
/// before it is made darker: where it faces between the key light and the fill, with the highlight.
const BRIGHTEST: f64 = 1.04;
/// Linear light that the brightest surfaces are brought down to: white objects keep their shape.
const HEADROOM: f64 = 0.9;
/// Share of the surface that is taken for stray highlights, not for its colour.
const HIGHLIGHTS: f64 = 0.02;
/// Linear albedo from which a surface can't be told from a white background, and the share of such surface from which
/// the background is grey.
const WHITE: (f64, f64) = (0.75, 1.0 / 3.0);
/// Linear grey: as far from white as from black, to the eye.
const GREY: f64 = 0.18;

/// How white objects are.
struct Whites {
    /// Albedo that all but few coloured surfaces are darker than, in their largest channel.
    brightest: f64,
    /// Share of all surface that is white; what has no colours is.
    share: f64,
}

impl Whites {
    fn of(loaded: &LoadedObjects) -> Self {
        let Some(patches) = Patches::of(&loaded.objects) else {
            return Self { brightest: 1.0, share: 0.0 };
        };
        let max = |c: [f32; 3]| c.into_iter().map(f64::from).fold(0.0, f64::max);
        let min = |c: [f32; 3]| c.into_iter().map(f64::from).fold(f64::INFINITY, f64::min);
        let white = patches.all.iter().filter(|p| min(p.color) >= WHITE.0).map(|p| p.area).sum::<f64>();
        let mut albedos: Vec<(f64, f64)> = patches.all.iter().map(|p| (max(p.color), p.area)).collect();
        albedos.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        let mut left = HIGHLIGHTS * patches.area;
        let brightest = albedos.into_iter().find(|(_, area)| {
            left -= area;
            left < 0.0
        });
        Self { brightest: brightest.map_or(1.0, |(albedo, _)| albedo), share: white / patches.area }
    }

    /// Factor for the materials of coloured objects, at most 1: the same for all, so that their colours compare.
    fn exposure(&self) -> f64 {
        (HEADROOM / (BRIGHTEST * self.brightest.max(f64::MIN_POSITIVE))).min(1.0)
    }

    /// The background for a shader. Lit white surfaces are darker than a white background all along their outline,
    /// which faces past the lights; unlit ones are not, and those of `edl` only beside what is nearer.
    fn background(&self, shader: Shader) -> [f64; 4] {
        let grey = matches!(shader, Shader::Unlit | Shader::Edl) && self.share > WHITE.1;
        if grey { [GREY, GREY, GREY, 1.0] } else { [1.0; 4] }
    }
}

/// True of splats that cover a closed surface from outside: as their file or mesh says, or as clouds look.
fn hides_its_back(facts: &ObjectFacts, object: &Object) -> bool {
    let is_cloud = matches!(object.geometry, Geometry::Splats(_));
    let is_judged = is_cloud && !facts.sides_known && !facts.partial && !facts.transparent;
    let looks_closed = || Patches::of(std::slice::from_ref(object)).is_some_and(|patches| closed::is_closed(&patches));
    facts.closed || is_judged && looks_closed()
}

/// Colours are shown as bright as they are, and white ones a little darker; what has none is white by definition, and
/// shown as light grey clay, which leaves room for highlights.
///
/// The back of what closes is left out: its splats reach a little past the silhouette and would fringe it. Only where
/// thin sheets lie over other surfaces it is drawn, and keeps these from shining through.
fn material(facts: &ObjectFacts, hides_its_back: bool, exposure: f64) -> Material {
    let cull = if hides_its_back { Cull::Back } else { Cull::None };
    if facts.colored {
        let (ambient, diffuse) = (1.3 * exposure, 0.95 * exposure);
        Material { ambient, diffuse, specular: 0.06 * exposure, shininess: 24.0, cull, ..Material::default() }
    } else {
        Material { ambient: 0.55, diffuse: 0.66, specular: 0.14, shininess: 32.0, cull, ..Material::default() }
    }
}

/// A scene and the file that describes it.
#[derive(Clone, Debug)]
pub struct LoadedScene {
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
            let objects = paths.iter().map(|path| bare_object(path)).collect::<Vec<_>>();
            let mut loaded = load_bare_objects(&objects, Path::new(""), &options, progress)?;
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
            let scene = assemble(&file, loaded.objects)?;
            Ok(LoadedScene { file, scene, notes: loaded.notes })
        }
    }
}

/// True for a name that ends in `.json`, unless it is that of a tileset of 3D Tiles or of SOG.
pub fn is_scene_file(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) && !surfel_io::names_geometry(path)
}

/// An object of the file at `path`, drawn as splats where it lies.
pub fn bare_object(path: &Path) -> ObjectFile {
    ObjectFile {
        splats: Some(path.to_path_buf()),
        mesh: None,
        matrix: glam::DMat4::IDENTITY.to_cols_array(),
        material: Material::default(),
        convert: ConvertOptions::default(),
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
        assert!(note.text.contains("--transparency peel:4"), "{}", note.text);
    }
}
