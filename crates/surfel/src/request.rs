//! From inputs and options to one scene: option > scene-file key > preset > default.

pub use crate::camera::Turntable;
pub use crate::render_options::{RenderOptions, SplatOptions};

use crate::camera::CameraSource;
use crate::coloring::together::Tallies;
use crate::coloring::{ColorScale, Coloring};
use crate::framing::{self, ChosenView, NamedView, Upright, ViewChoice};
use crate::labels::DEFAULT_LABEL;
use crate::levels::{Levels, Seen};
use crate::lights::lights_of;
use crate::load::check_size;
use crate::paths::{self, absolute, display, is_stdin};
use crate::scene::{
    AutoOptions, DEFAULT_SIZE, LoadedObjects, ObjectNote, assemble, auto_composite, auto_depth_tolerance, auto_scene,
    auto_transparency, auto_up, bare_object, is_scene_file, load_bare_objects, load_matcap, load_objects,
    parse_scene_file, read_scene_file, refine_objects,
};
use crate::{Error, LevelStore, LoadOptions, camera, splats};
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::ShowPath as _;
use surfel_math::gaussian;
use surfel_model::{
    Camera, Composite, Geometry, Light, MOST_LOD_ERROR_PX, Matcap, ModelError, ObjectFile, Scene, SceneFile, Settings,
    Shader, Up,
};
use surfel_render::{Preset, Sight, View};
use surfel_sample::Progress;

/// What an image is of.
pub enum Source {
    /// A scene file.
    Scene(Box<SceneSource>),
    /// Files that make one scene.
    Geometry(Vec<PathBuf>),
}

/// A scene file that has been read.
pub struct SceneSource {
    /// What it says.
    pub file: SceneFile,
    /// Which keys its `settings` have.
    pub keys: BTreeSet<String>,
    /// What messages call it.
    pub name: PathBuf,
    /// What its paths are relative to.
    pub base: PathBuf,
}

impl Source {
    /// What these inputs are.
    ///
    /// `stdin` is what the name `-` stands for, where it is among them.
    ///
    /// # Errors
    /// [`Error::Io`] for a scene file that can't be read, [`Error::Usage`] for one that isn't alone.
    pub fn of(inputs: &[PathBuf], stdin: Option<&[u8]>) -> Result<Self, Error> {
        for path in inputs {
            let scene = if is_stdin(path) {
                let (bytes, name) = (stdin.unwrap_or_default(), Path::new("stdin"));
                looks_like_scene(bytes).then(|| parse_scene_file(bytes, name)).transpose()?
            } else if is_scene_file(path) && inputs.len() == 1 {
                Some(read_scene_file(path)?)
            } else {
                None
            };
            if inputs.len() > 1 && (scene.is_some() || is_scene_file(path)) {
                return Err(Error::Usage(format!(
                    "{}: a scene file goes alone, expected one scene file or any number of splat, point and mesh files",
                    display(path)
                )));
            }
            if let Some((file, keys)) = scene {
                let name = if is_stdin(path) { PathBuf::from("stdin") } else { path.clone() };
                let base = path.parent().unwrap_or(Path::new("")).to_path_buf();
                return Ok(Self::Scene(Box::new(SceneSource { file, keys, name, base })));
            }
        }
        Ok(Self::Geometry(inputs.to_vec()))
    }
}

/// True for JSON with the keys of a scene file, which glTF hasn't.
fn looks_like_scene(bytes: &[u8]) -> bool {
    let json = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if !json.trim_ascii_start().starts_with(b"{") {
        return false;
    }
    let json: serde_json::Value = serde_json::from_slice(json).unwrap_or_default();
    json.get("asset").is_none() && (json.get("camera").is_some() || json.get("objects").is_some())
}

/// A scene, and the scene file that gives the same image. Its paths are absolute, or `-` for stdin.
#[derive(Clone, Debug)]
pub struct Resolved {
    /// The scene file.
    pub file: SceneFile,
    /// The scene, with everything loaded.
    pub scene: Scene,
    /// What it turns about.
    pub turntable: Turntable,
    /// The scene's up axis: as the options, the file or its objects say.
    pub up: Up,
    /// True if a scene file or a file of a camera gave the camera, and not the scene's shape.
    pub has_own_camera: bool,
    /// Files that the objects' files refer to, found or not; absolute.
    pub beside: BTreeSet<PathBuf>,
}

impl Resolved {
    /// The camera that these options ask for, which start from `given` or else the scene's own camera.
    pub fn seen(&self, given: Option<&Camera>, options: &RenderOptions) -> Camera {
        let given = given.unwrap_or(&self.file.camera);
        let reframed = camera::reframe(given, &self.scene, self.up, options);
        let mut camera = reframed.unwrap_or_else(|| given.clone());
        camera::apply_flags(&mut camera, &self.scene, self.up, false, options);
        camera
    }

    /// Camera of a frame of a turn in so many, and the scene with its lights moved where they have to.
    pub fn turned(&self, index: u32, frames: u32) -> (Camera, Option<Scene>) {
        if index == 0 {
            return (self.file.camera.clone(), None);
        }
        let lights = self.scene.lights.clone().unwrap_or_default();
        let turn = f64::from(index) / f64::from(frames);
        let (camera, lights) = self.turntable.at(turn, &self.file.camera, &lights);
        let moved = (!lights.is_empty()).then(|| Scene { lights: Some(lights), ..self.scene.clone() });
        (camera, moved)
    }
}

/// Which pictures are drawn of a scene. Of large files of levels ([`crate::levels`]) as much is read as all of them
/// need.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Pictures {
    /// One, from the scene's camera.
    #[default]
    One,
    /// One from each of another program's cameras.
    Cameras(Vec<Camera>),
    /// So many of a turn about the scene.
    Turn(u32),
    /// Any, not known yet: all is read. Of what was read for others the coarsest levels stay.
    Any,
}

impl Pictures {
    fn first_camera(&self) -> Option<&Camera> {
        if let Self::Cameras(cameras) = self { cameras.first() } else { None }
    }

    /// The views of all pictures, by the scene's camera.
    fn views(&self, camera: &Camera, turntable: &Turntable, options: &RenderOptions) -> Result<Vec<View>, Error> {
        let turned = |i: u32, frames: u32| turntable.at(f64::from(i) / f64::from(frames), camera, &[]).0;
        match self {
            Self::Cameras(cameras) if !cameras.is_empty() => cameras.iter().map(|c| camera::view(c, options)).collect(),
            Self::Turn(n @ 2..) => (0..*n).map(|i| camera::view(&turned(i, *n), options)).collect(),
            _ => Ok(vec![camera::view(camera, options)?]),
        }
    }
}

/// Images that are asked for, their options applied, before anything is loaded.
///
/// ```no_run
/// # fn main() -> Result<(), surfel::Error> {
/// use surfel::request::{Pictures, Request, Source};
/// let mut options = surfel::request::RenderOptions::default();
/// options.set("view", "front").map_err(surfel::Error::Usage)?;
/// let request = Request::new(Source::of(&["scan.ply".into()], None)?, &Pictures::One, &options)?;
/// let loaded = request.load(None, &surfel::NoProgress)?;
/// let resolved = request.resolve(loaded, &surfel::NoProgress, &mut |note| eprintln!("{note}"))?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct Request {
    options: RenderOptions,
    pictures: Pictures,
    camera: Option<Camera>,
    settings: Settings,
    objects: Vec<ObjectFile>,
    /// What the objects' paths are relative to.
    base: PathBuf,
    /// The scene file, if there is one, and its name.
    scene: Option<(SceneFile, PathBuf)>,
    /// True if the scene file has lights, and nothing chooses a shader.
    has_unused_lights: bool,
    level_store: Arc<LevelStore>,
}

impl Request {
    /// Applies options.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that contradict each other, [`Error::Unsuitable`] for numbers of a scene file that
    /// are out of range, [`Error::Io`] for a file of a camera that can't be read.
    pub fn new(source: Source, pictures: &Pictures, options: &RenderOptions) -> Result<Self, Error> {
        options.check()?;
        let given = pictures.first_camera().cloned();
        let camera = given.map_or_else(|| camera_file(options), |camera| Ok(Some(camera)))?;
        match source {
            Source::Scene(scene) => Self::of_scene_file(*scene, pictures, camera, options),
            Source::Geometry(inputs) => {
                let preset = options.preset.unwrap_or_default();
                let settings = settings(preset.apply(Settings::default().with_shader(Shader::Phong)), options);
                let mut objects: Vec<ObjectFile> = inputs.iter().map(|path| bare_object(path)).collect();
                objects.iter_mut().try_for_each(|object| apply(options, object))?;
                let (options, pictures, base) = (options.clone(), pictures.clone(), PathBuf::new());
                let level_store = Arc::default();
                let (scene, has_unused_lights) = (None, false);
                Ok(Self { options, pictures, camera, settings, objects, base, scene, has_unused_lights, level_store })
            }
        }
    }

    fn of_scene_file(
        source: SceneSource,
        pictures: &Pictures,
        given: Option<Camera>,
        options: &RenderOptions,
    ) -> Result<Self, Error> {
        let SceneSource { mut file, keys, name, base } = source;
        file.settings = settings(preset_under(options.preset, file.settings, &keys), options);
        if let Some(given) = &given {
            file.camera = given.clone();
        }
        // Numbers out of range are told before minutes go into loading.
        let out_of_range = |e: ModelError| out_of_range(&name, &e);
        file.settings.validate().map_err(out_of_range)?;
        if options.view.is_none() {
            file.camera.validate().map_err(out_of_range)?;
        }
        for (i, object) in file.objects.iter_mut().enumerate() {
            object.world_from_object().map_err(out_of_range)?;
            apply(options, object)?;
            object.convert.validate(i).map_err(out_of_range)?;
        }
        let (settings, objects) = (file.settings, file.objects.clone());
        let chooses_shader = keys.contains("shader") || options.shader.is_some() || options.matcap.is_some();
        let has_unused_lights = !chooses_shader && file.lights.as_ref().is_some_and(|lights| !lights.is_empty());
        let (options, pictures, scene) = (options.clone(), pictures.clone(), Some((file, name)));
        let level_store = Arc::default();
        let camera = given;
        Ok(Self { options, pictures, camera, settings, objects, base, scene, has_unused_lights, level_store })
    }

    /// With what stays of files by levels from one picture to the next, for requests that follow one another.
    #[must_use]
    pub fn with_level_store(self, level_store: Arc<LevelStore>) -> Self {
        Self { level_store, ..self }
    }

    /// The same for other pictures.
    #[must_use]
    pub fn with_pictures(mut self, pictures: Pictures) -> Self {
        if let Some(camera) = pictures.first_camera() {
            self.camera = Some(camera.clone());
            self.scene.iter_mut().for_each(|(file, _)| file.camera = camera.clone());
        }
        Self { pictures, ..self }
    }

    /// Whether the points of a file don't fit into memory all at once, so that each picture needs its own choice of
    /// levels.
    pub fn exceeds_memory(&self) -> bool {
        let options = self.load_options(None);
        let exceeds = |object: &ObjectFile| {
            let path = self.base.join(object.splats.as_ref()?);
            check_size(&path, &options.clone().with_convert(&object.convert, &self.base)).err()
        };
        self.objects.iter().any(|object| exceeds(object).is_some())
    }

    /// The objects, whose paths are relative to the scene file's folder.
    pub fn objects(&self) -> &[ObjectFile] {
        &self.objects
    }

    /// Files of points and splats.
    pub(crate) fn files(&self) -> impl Iterator<Item = PathBuf> {
        let named = self.objects.iter().filter_map(|object| object.splats.as_ref());
        named.filter(|path| !is_stdin(path)).map(|path| self.base.join(path))
    }

    /// The same of fewer points, as `most` makes of how many there are at most, and of levels whose splats are so many
    /// times as large.
    pub(crate) fn coarser(&self, most: impl Fn(Option<u32>) -> u32, times: f64) -> Self {
        let mut coarse = self.clone();
        coarse.objects.iter_mut().filter(|object| object.splats.is_some()).for_each(|object| {
            object.convert.max_points = Some(most(object.convert.max_points));
            object.convert.all_levels = false;
        });
        let scene = coarse.scene.as_mut().map(|(file, _)| &mut file.settings);
        let coarsen = |settings: &mut Settings| {
            settings.lod_error_px = (settings.lod_error_px * times).min(MOST_LOD_ERROR_PX);
        };
        std::iter::once(&mut coarse.settings).chain(scene).for_each(coarsen);
        // The full scene's is written.
        coarse.options.splats.colorbar = None;
        coarse
    }

    /// How the objects are loaded, large files of levels as far as placing a camera takes it; `stdin` is what the name
    /// `-` stands for.
    pub fn load_options(&self, stdin: Option<Arc<[u8]>>) -> LoadOptions {
        // The preset that an image is verified against antialiases edges.
        let options = LoadOptions::default().with_interior_weight(self.options.verify).for_settings(&self.settings);
        let up = self.scene.as_ref().and_then(|(file, _)| file.up);
        let label = self.options.label.clone().unwrap_or_else(|| DEFAULT_LABEL.to_owned());
        let options = options.with_label(self.options.wants_label().then_some(label));
        let options = options.with_rows(self.options.wants_rows());
        let gaussians = options.gaussians || self.tells_composite();
        options
            .with_gaussians(gaussians)
            .with_stdin(stdin)
            .with_memory(self.options.splats.memory)
            .with_up(self.options.up.flatten().or(up))
            .with_level_store(Some(self.level_store.clone()))
            .with_levels((self.pictures != Pictures::Any).then_some(Levels::Overview))
    }

    /// Loads the objects.
    ///
    /// # Errors
    /// As [`load_objects`].
    pub fn load(&self, stdin: Option<Arc<[u8]>>, progress: &dyn Progress) -> Result<LoadedObjects, Error> {
        let options = self.load_options(stdin);
        let bare = self.tells_composite();
        let load = if bare { load_bare_objects } else { load_objects };
        let loaded = load(&self.objects, &self.base, &options, progress)?;
        let flag = if self.options.sort.is_some() { "--sort" } else { "--composite over" };
        if (options.gaussians && !bare || self.options.sort.is_some()) && !loaded.has_gaussians() {
            let first = self.objects.iter().find_map(|object| object.splats.clone().or(object.mesh.clone()));
            let problem = format!(
                "holds no trained Gaussians that are drawn over one another, which {flag} is for: expected a PLY of \
                 2DGS or 3DGS, SPLAT, SPZ, SOG or glTF with KHR_gaussian_splatting; leave out {flag}"
            );
            return Err(Error::Unsuitable { path: first.unwrap_or_default(), problem });
        }
        Ok(loaded)
    }

    /// Whether the files themselves say how Gaussians are drawn.
    fn tells_composite(&self) -> bool {
        self.scene.is_none() && self.options.composite.is_none() && self.options.of_surfaces().is_none()
    }

    /// The scene of these objects, framed and lit where no scene file does, with the levels of large files that its
    /// pictures need. `note` is told what the user should know, as sentences without a full stop.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that nothing has a use for or that make a camera that can't be, [`Error::Model`]
    /// and [`Error::Unsuitable`] for objects that can't be framed and numbers out of range, [`Error::Io`] for a matcap
    /// that can't be read; as [`load_objects`].
    pub fn resolve(
        mut self,
        loaded: LoadedObjects,
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<Resolved, Error> {
        if !is_partial(&loaded) {
            tell(&loaded, &self.options, note)?;
        }
        match self.scene.take() {
            Some(scene) => self.scene_of_file(scene, loaded, progress, note),
            None => self.scene_of_geometry(loaded, progress, note),
        }
    }

    /// Reads what the pictures need of files of levels.
    fn refine(
        &self,
        mut loaded: LoadedObjects,
        (file, turntable): (&SceneFile, &Turntable),
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<LoadedObjects, Error> {
        if is_partial(&loaded) && self.pictures != Pictures::Any {
            let views = self.pictures.views(&file.camera, turntable, &self.options)?;
            // What is out of sight may cast a shadow into it.
            let casts_shadows = file.lights.iter().flatten().any(Light::casts_shadow);
            let sight_px = (!casts_shadows).then(|| Sight::margin_px(&file.settings));
            let seen = Seen { views: &views, error_px: file.settings.lod_error_px, sight_px };
            refine_objects(&mut loaded, &self.objects, &self.base, &self.load_options(None), &seen, progress)?;
            tell(&loaded, &self.options, note)?;
        }
        Ok(loaded)
    }

    fn scene_of_file(
        self,
        (mut file, name): (SceneFile, PathBuf),
        loaded: LoadedObjects,
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<Resolved, Error> {
        let options = &self.options;
        if self.has_unused_lights && file.settings.shader == Shader::Unlit {
            note(format!(
                "{}: has lights, but settings.shader is not given, so that it is drawn unlit: \"shader\": \"phong\" in \
                 its settings lights it, and so does --shader phong",
                name.display()
            ));
        }
        if let Some(choice) = options.up {
            file.up = choice.or(file.up);
        }
        if let Some(background) = options.background {
            file.background = background;
        }
        if let Some(lights) = &options.lights {
            file.lights = Some(lights.clone());
        }
        if options.shadows {
            // Nobody sees the shadows of the default headlight.
            file.lights = file.lights.take().map(with_shadows);
        }
        let up = file.up.or_else(|| loaded.facts.first().map(|f| f.up)).unwrap_or(Up::PlusY);
        let objects_only = Scene { objects: loaded.framed().objects, ..Scene::default() };
        if let Some(framed) = camera::reframe(&file.camera, &objects_only, up, options) {
            file.camera = framed;
        }
        file.camera.validate().map_err(|e| out_of_range(&name, &e))?;
        camera::apply_flags(&mut file.camera, &objects_only, up, false, options);
        cull(&mut file, options);
        // A scene file's camera turns about what it looks at, about the scene's up axis or else its own.
        let axis = file.up.map_or(DVec3::from(file.camera.up).normalize_or(DVec3::Y), Up::vector);
        let turntable = Turntable { center: file.camera.target.into(), axis };
        let loaded = self.refine(loaded, (&file, &turntable), progress, note)?;
        let beside = beside(&loaded)?;
        let in_file = |e: Error| Error::Unsuitable { path: name.clone(), problem: e.to_string() };
        let mut scene = assemble(&file, loaded.objects).map_err(in_file)?;
        absolute_paths(&mut file, &self.base)?;
        scene.matcap = matcap(&mut file, options)?;
        note_near(&scene, &file.camera, note);
        let has_own_camera = self.options.view.is_none();
        Ok(Resolved { file, scene, turntable, up, has_own_camera, beside })
    }

    fn scene_of_geometry(
        mut self,
        loaded: LoadedObjects,
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<Resolved, Error> {
        let (mut settings, given_camera, objects) = (self.settings, self.camera.take(), self.objects.clone());
        let options = &self.options;
        let paths: Vec<&Path> = objects.iter().filter_map(|object| object.splats.as_deref()).collect();
        if let Some((over, about)) = auto_composite(&loaded, &paths, settings) {
            settings = of_gaussians(over, options);
            if options.composite.is_none() {
                note(format!("{}: {}", about.path.shown(), about.text));
            }
        }
        if options.transparency.is_none()
            && let Some((transparency, about)) = auto_transparency(&loaded, &paths)
        {
            settings.transparency = transparency;
            note(format!("{}: {}", about.path.shown(), about.text));
        }
        if options.depth_tolerance.is_none()
            && let Some(tolerance) = auto_depth_tolerance(&loaded)
        {
            settings.depth_tolerance = tolerance;
        }
        let framed = loaded.framed();
        let up = options.up.flatten().unwrap_or_else(|| note_up(&framed, note));
        let view = match options.view.unwrap_or_default() {
            ViewChoice::Auto if given_camera.is_none() && options.eye.is_none() && options.target.is_none() => {
                let ChosenView { angles, reason } = framing::choose_view(&framed.objects, up);
                note(format!("seen from --view {angles} (azimuth and elevation; {reason})"));
                ViewChoice::From(angles)
            }
            // Where options say the eye or the target, the other is that of the usual view.
            ViewChoice::Auto => ViewChoice::Named(NamedView::Iso),
            given => given,
        };
        let own_near = given_camera.is_none();
        let auto = AutoOptions::default()
            .with_up(Some(up))
            .with_view(view)
            .with_projection(camera::projection(options))
            .with_size(options.size.unwrap_or(DEFAULT_SIZE))
            .with_camera(given_camera)
            .with_background(options.background)
            .with_settings(settings)
            .with_turning(options.turntable);
        let mut file = auto_scene(objects, &framed, &auto)?;
        let objects_only = Scene { objects: framed.objects.clone(), ..Scene::default() };
        let center = framing::scene_center(&objects_only).unwrap_or_default();
        if options.eye.is_some() && options.target.is_none() && own_near {
            file.camera.target = center.into();
        }
        camera::apply_flags(&mut file.camera, &objects_only, up, own_near, options);
        camera::view(&file.camera, options)?;
        // The lights belong to the camera, wherever the options have put it.
        let lights = match (&options.lights, options.cameras) {
            (Some(lights), _) => Some(lights.clone()),
            // One for all cameras, so that the scene stays as it is: the light along the view.
            (None, true) => None,
            (None, false) => Some(lights_of(&file.camera, &framed, up)),
        };
        drop((framed, objects_only));
        file.lights = if options.shadows { lights.map(with_shadows) } else { lights };
        cull(&mut file, options);
        let turntable = Turntable { center, axis: up.vector() };
        let loaded = self.refine(loaded, (&file, &turntable), progress, note)?;
        let beside = beside(&loaded)?;
        let mut scene = assemble(&file, loaded.objects)?;
        absolute_paths(&mut file, Path::new(""))?;
        scene.matcap = matcap(&mut file, options)?;
        note_near(&scene, &file.camera, note);
        Ok(Resolved { file, scene, turntable, up, has_own_camera: !own_near, beside })
    }
}

/// Finds one colouring for the values of all sources, of which each is drawn by itself; `None` if they are coloured by
/// no numbers. The sources are loaded one after another.
///
/// # Errors
/// [`Error::Usage`] if the options name no attribute; as [`Request::new`] and [`Request::load`].
pub fn shared_coloring(
    sources: impl IntoIterator<Item = Result<Source, Error>>,
    options: &RenderOptions,
    stdin: Option<Arc<[u8]>>,
    progress: &dyn Progress,
) -> Result<Option<Coloring>, Error> {
    let Some(attribute) = &options.splats.convert.color_by else {
        return Err(Error::Usage("--range is for values: give --color-by ATTRIBUTE with it".to_owned()));
    };
    let mut tallies = Tallies::default();
    for source in sources {
        let request = Request::new(source?, &Pictures::One, options)?;
        request.load(stdin.clone(), progress)?.tally(&mut tallies);
    }
    let found = tallies.coloring(attribute).map(|(coloring, _)| coloring);
    Ok(found.filter(|coloring| coloring.scale != ColorScale::Direct))
}

/// What the options say on how an object's file becomes splats.
fn apply(options: &RenderOptions, object: &mut ObjectFile) -> Result<(), Error> {
    splats::apply(&options.splats, &mut object.convert)?;
    object.convert.all_levels |= options.all_levels;
    Ok(())
}

fn is_partial(loaded: &LoadedObjects) -> bool {
    loaded.facts.iter().any(|facts| facts.partial)
}

/// Says what was found in files.
fn tell(loaded: &LoadedObjects, options: &RenderOptions, note: &mut dyn FnMut(String)) -> Result<(), Error> {
    for ObjectNote { path, text } in &loaded.notes {
        note(format!("{}: {text}", display(path)));
    }
    splats::check_used(&options.splats, &loaded.unused, note)?;
    splats::write_color_bar(&options.splats, loaded.colorings.iter(), note)
}

/// Says it where most trained Gaussians before the camera are nearer than such are drawn.
fn note_near(scene: &Scene, camera: &Camera, note: &mut dyn FnMut(String)) {
    let Some(view) = View::new(camera).ok().filter(|view| view.projection.is_perspective()) else { return };
    let (near, forward) = (gaussian::near(&view.projection), view.forward());
    let (mut before, mut too_near) = (0, 0);
    for object in &scene.objects {
        let Geometry::Gaussians(cloud) = &object.geometry else { continue };
        for i in 0..cloud.len() {
            let depth = forward.dot(object.world_from_object.transform_point3(cloud.center(i)) - view.eye);
            before += u64::from(depth > 0.0);
            too_near += u64::from(depth > 0.0 && depth <= near);
        }
    }
    if 2 * too_near > before {
        note(format!(
            "{too_near} of {before} Gaussians before the camera are nearer than {near} units, and such aren't drawn: \
             --ortho shows them, and so does a scene file whose \"matrix\" makes them larger"
        ));
    }
}

fn beside(loaded: &LoadedObjects) -> Result<BTreeSet<PathBuf>, Error> {
    loaded.beside.iter().map(|path| absolute(path)).collect()
}

fn out_of_range(name: &Path, e: &ModelError) -> Error {
    Error::Unsuitable { path: name.to_path_buf(), problem: e.to_string() }
}

/// The up axis that the files or their shape say, and what to do if it is wrong.
fn note_up(loaded: &LoadedObjects, note: &mut dyn FnMut(String)) -> Up {
    let Upright { up, reason } = auto_up(loaded);
    let other = if up == Up::PlusZ { Up::PlusY } else { Up::PlusZ };
    note(format!("up is {up} ({reason}); if that is wrong: --up {other}"));
    up
}

fn camera_file(options: &RenderOptions) -> Result<Option<Camera>, Error> {
    let path = match &options.camera {
        Some(CameraSource::File(path)) => path,
        Some(CameraSource::Given { camera, .. }) => return Ok(Some((**camera).clone())),
        None => return Ok(None),
    };
    let camera = surfel_io::scene_file::read_camera(path)?;
    camera.validate().map_err(|e| out_of_range(path, &e))?;
    Ok(Some(camera))
}

/// The preset's choices, but what the file says itself stays.
fn preset_under(preset: Option<Preset>, file: Settings, keys: &BTreeSet<String>) -> Settings {
    let Some(preset) = preset else { return file };
    let mut settings = preset.apply(file);
    let says = |key: &str| keys.contains(key);
    if says("filter") {
        settings.filter = file.filter;
    }
    if says("cutoff") {
        settings.cutoff = file.cutoff;
    }
    if says("prefilter_radius_px") {
        settings.prefilter_radius_px = file.prefilter_radius_px;
    }
    if says("mapping") {
        settings.mapping = file.mapping;
    }
    if says("edge_aa") {
        settings.edge_aa = file.edge_aa;
    }
    settings
}

/// Settings of Gaussians drawn over one another: `--filter` is theirs, then.
fn of_gaussians(settings: Settings, options: &RenderOptions) -> Settings {
    let over = options.filter.filter(|_| settings.composite == Composite::Over);
    settings.with_gaussian_filter(over.unwrap_or(settings.gaussian_filter))
}

fn settings(base: Settings, options: &RenderOptions) -> Settings {
    let settings = base
        .with_filter(options.filter.unwrap_or(base.filter))
        .with_cutoff(options.cutoff.unwrap_or(base.cutoff))
        .with_prefilter_radius_px(options.prefilter.unwrap_or(base.prefilter_radius_px))
        .with_mapping(options.mapping.unwrap_or(base.mapping))
        .with_depth_tolerance(options.depth_tolerance.unwrap_or(base.depth_tolerance))
        .with_shader(options.shader.or(options.matcap.as_ref().map(|_| Shader::Matcap)).unwrap_or(base.shader))
        .with_edge_aa(options.edge_aa.unwrap_or(base.edge_aa))
        .with_transparency(options.transparency.unwrap_or(base.transparency))
        .with_clip(options.clip.unwrap_or(base.clip))
        .with_accumulate(options.accumulate.unwrap_or(base.accumulate))
        .with_composite(options.composite.unwrap_or(base.composite))
        .with_sort(options.sort.unwrap_or(base.sort))
        .with_lod_error_px(options.lod_error.unwrap_or(base.lod_error_px));
    of_gaussians(settings, options)
}

fn with_shadows(mut lights: Vec<Light>) -> Vec<Light> {
    for light in &mut lights {
        if let Light::Directional { shadow, .. } | Light::Spot { shadow, .. } = light {
            *shadow = true;
        }
    }
    lights
}

/// What `cull` says, which decides for all objects.
fn cull(file: &mut SceneFile, options: &RenderOptions) {
    if let Some(cull) = options.splats.cull {
        file.objects.iter_mut().for_each(|object| object.material.cull = cull);
    }
}

/// Makes all paths of a scene file absolute, but the name of stdin.
fn absolute_paths(file: &mut SceneFile, base: &Path) -> Result<(), Error> {
    paths::for_each(file, |path| {
        *path = absolute(&base.join(&*path))?;
        Ok(())
    })
}

/// The matcap that the flag or else the file names, whose paths are absolute; `None` for the built-in one, and where
/// none is asked for.
fn matcap(file: &mut SceneFile, options: &RenderOptions) -> Result<Option<Arc<Matcap>>, Error> {
    if let Some(given) = &options.matcap {
        file.matcap = if given.as_os_str() == "builtin" { None } else { Some(absolute(given)?) };
    }
    load_matcap(file, Path::new(""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Filter, Mapping};

    #[test]
    fn preset_changes_only_what_the_file_leaves_open() {
        let file = Settings::default().with_filter(Filter::Ewa);
        let keys = BTreeSet::from(["filter".to_owned()]);
        let settings = preset_under(Some(Preset::Fastest), file, &keys);
        assert_eq!((settings.filter, settings.mapping, settings.cutoff), (Filter::Ewa, Mapping::Affine, 2.0));
        assert_eq!(preset_under(None, file, &keys), file);
    }
}
