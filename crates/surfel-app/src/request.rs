//! Resolution of inputs and options into one scene. Options take precedence over the keys of a scene file, keys over
//! the preset, and the preset over the defaults.

mod geometry;

pub use crate::camera::Turntable;
pub use crate::render_options::{RenderOptions, SplatOptions};

use crate::render_options::CameraSource;
use crate::sky::SkyAndGround;
use crate::{camera, splats};
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_framing::strays::Sphere;
use surfel_framing::{LeftOut, Upright};
use surfel_load::coloring::together::Tallies;
use surfel_load::coloring::{ColorScale, Coloring, Colorings};
use surfel_load::labels::DEFAULT_LABEL;
use surfel_load::levels::{Levels, ViewSelection};
use surfel_load::paths::{self, absolute, display, is_stdin};
use surfel_load::steps::check_size;
use surfel_load::{Error, LevelStore, LoadOptions};
use surfel_load::{
    LoadedObjects, ObjectNote,
    scene::{
        assemble, bare_object, is_scene_file, load_bare_objects, load_matcap, load_objects, parse_scene_file,
        read_scene_file, refine_objects,
    },
};
use surfel_math::gaussian;
use surfel_model::{
    Camera, Composite, Geometry, Light, MAX_LOD_ERROR_PX, Matcap, ModelError, ObjectFile, Scene, SceneFile, Settings,
    Shader, Up,
};
use surfel_render::{Preset, SplatVisibility, View};
use surfel_sample::Progress;
use surfel_stage::Estimates;
use surfel_stage::Lighting;

/// Input of an image, as the user names it.
pub enum Source {
    /// A scene file.
    Scene(Box<SceneSource>),
    /// Paths of geometry files, which form one scene.
    Geometry(Vec<PathBuf>),
}

/// Scene file that has been read but whose files aren't loaded yet.
pub struct SceneSource {
    /// Content of the scene file, parsed.
    pub file: SceneFile,
    /// Keys that are present in the file's `settings` object; presets don't override them.
    pub keys: BTreeSet<String>,
    /// Name of the scene file in messages.
    pub name: PathBuf,
    /// Folder that the scene file's paths are relative to.
    pub base: PathBuf,
}

impl Source {
    /// Reads a scene file, or collects the paths of geometry files.
    ///
    /// `stdin` is the content of the input named `-`, if it is among the inputs.
    ///
    /// # Errors
    /// [`Error::Io`] for a scene file that can't be read, [`Error::Usage`] for a scene file that isn't the only input.
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

/// True if the bytes are JSON with the keys of a scene file. Other JSON formats, such as glTF, have other keys.
fn looks_like_scene(bytes: &[u8]) -> bool {
    let json = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if !json.trim_ascii_start().starts_with(b"{") {
        return false;
    }
    let json: serde_json::Value = serde_json::from_slice(json).unwrap_or_default();
    json.get("asset").is_none() && (json.get("camera").is_some() || json.get("objects").is_some())
}

/// A loaded scene, and a scene file that reproduces the image. The file's paths are absolute, or `-` for stdin.
#[derive(Clone, Debug)]
pub struct Resolved {
    /// Scene file with all choices filled in.
    pub file: SceneFile,
    /// Scene with all files loaded.
    pub scene: Scene,
    /// Axis and centre of a turntable movie.
    pub turntable: Turntable,
    /// Up axis of the scene: from the options, the scene file or its objects.
    pub up: Up,
    /// True if the camera is given by a scene file, a camera file or a program, and doesn't come from framing the
    /// scene.
    pub has_own_camera: bool,
    /// Absolute paths of other files that the input files refer to, such as textures, whether they exist or not.
    pub beside: BTreeSet<PathBuf>,
    /// Colourings by attributes, for colour bars; empty unless the options or the scene file request some.
    pub colorings: Colorings,
    /// Properties from which default lights, which follow the camera, are derived. `None` for a scene file, a sky,
    /// lights in the options, and another program's cameras.
    pub(crate) lighting: Option<Lighting>,
    /// True if automatic framing includes stray points ([`LoadedObjects::frames_all`]).
    pub(crate) frames_all: bool,
}

impl Resolved {
    /// Returns the camera `given`, or the scene's own if it is `None`, with the camera options applied.
    pub fn seen(&self, given: Option<&Camera>, options: &RenderOptions) -> Camera {
        let given = given.unwrap_or(&self.file.camera);
        let leaves_strays = options.view.is_some() && !self.frames_all;
        let kept = if leaves_strays { surfel_framing::without_strays_of(&self.scene) } else { None };
        let reframed = camera::reframe(given, &self.scene, kept, self.up, options);
        let mut camera = reframed.unwrap_or_else(|| given.clone());
        camera::apply_flags(&mut camera, &self.scene, self.up, false, options);
        camera
    }

    /// Returns the camera of image `index` of `pictures`. Also returns a scene with other lights, if the image's lights
    /// differ from those of the first image; otherwise `None`.
    pub fn picture(&self, pictures: &Pictures, index: u32) -> (Camera, Option<Scene>) {
        let own = &self.file.camera;
        match pictures {
            Pictures::Turn(frames) => self.turned(index, *frames),
            Pictures::Cameras(cameras) => {
                let camera = cameras.get(index as usize).unwrap_or(own).clone();
                (camera::with_near(camera, &self.scene), None)
            }
            Pictures::Path(cameras) => {
                let camera = cameras.get(index as usize).unwrap_or(own).clone();
                let moved = self.lighting.filter(|_| index > 0).map(|lighting| self.lit(lighting.lights(&camera)));
                (camera, moved)
            }
            Pictures::One | Pictures::Any => (own.clone(), None),
        }
    }

    /// Returns the scene with other lights. They cast shadows if the scene's own lights do.
    pub(crate) fn lit(&self, lights: Vec<Light>) -> Scene {
        let has_shadows = self.scene.lights.iter().flatten().any(Light::casts_shadow);
        let lights = if has_shadows { with_shadows(lights) } else { lights };
        Scene { lights: Some(lights), ..self.scene.clone() }
    }

    /// Returns the camera of frame `index` (0 to `frames` − 1) of a turntable movie. Lights turn with the camera: also
    /// returns the scene with its lights turned, or `None` if the scene can be drawn unchanged.
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

/// Set of images that are drawn of one scene. From large COPC files ([`surfel_load::levels`]), only nodes that the
/// images need are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Pictures {
    /// One image, from the scene's camera.
    #[default]
    One,
    /// One image from each of a list of cameras, such as the cameras of another program.
    Cameras(Vec<Camera>),
    /// Turntable movie, of this number of frames.
    Turn(u32),
    /// Film from a camera that moves along a path, with one camera for each frame. Default lights follow the camera.
    Path(Vec<Camera>),
    /// Any number of images from cameras that are still to be chosen, so that all points are read. Objects that were
    /// loaded for other images before aren't refined, and have only their coarsest levels.
    Any,
}

impl Pictures {
    fn first_camera(&self) -> Option<&Camera> {
        if let Self::Cameras(cameras) | Self::Path(cameras) = self { cameras.first() } else { None }
    }

    /// Returns the views of all images. `camera` is the scene's camera.
    fn views(&self, camera: &Camera, turntable: &Turntable, options: &RenderOptions) -> Result<Vec<View>, Error> {
        let turned = |i: u32, frames: u32| turntable.at(f64::from(i) / f64::from(frames), camera, &[]).0;
        match self {
            Self::Cameras(cameras) | Self::Path(cameras) if !cameras.is_empty() => {
                cameras.iter().map(|c| camera::view(c, options)).collect()
            }
            Self::Turn(n @ 2..) => (0..*n).map(|i| camera::view(&turned(i, *n), options)).collect(),
            _ => Ok(vec![camera::view(camera, options)?]),
        }
    }
}

/// A request for images with its options applied, before files are loaded.
///
/// ```no_run
/// # fn main() -> Result<(), surfel_load::Error> {
/// use surfel_app::request::{Pictures, Request, Source};
/// let mut options = surfel_app::request::RenderOptions::default();
/// options.set("view", "front").map_err(surfel_load::Error::Usage)?;
/// let request = Request::new(Source::of(&["scan.ply".into()], None)?, &Pictures::One, &options)?;
/// let loaded = request.load(&surfel_sample::NoProgress)?;
/// let resolved = request.resolve(loaded, &surfel_sample::NoProgress, &mut |note| eprintln!("{note}"))?;
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
    /// Folder to which the paths of the objects' files are relative.
    base: PathBuf,
    /// Scene file and its name for messages, if the input is one.
    scene: Option<(SceneFile, PathBuf)>,
    /// True if the scene file has lights, but neither the file nor the options choose a shader. The lights then have no
    /// effect.
    has_unused_lights: bool,
    /// Content for the name `-`.
    stdin: Option<Arc<[u8]>>,
    level_store: Arc<LevelStore>,
    /// True if splats get the numbers of their rows in the file, even if no plane needs them, such as for picking.
    has_rows: bool,
    /// Cache of estimates about the loaded objects, such as their centre, shared with other requests for the same
    /// objects.
    estimates: Arc<Estimates>,
}

impl Request {
    /// Creates a request from a source and options.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that contradict each other, [`Error::Unsuitable`] for numbers of a scene file that
    /// are out of range, [`Error::Io`] for a camera file that can't be read.
    pub fn new(source: Source, pictures: &Pictures, options: &RenderOptions) -> Result<Self, Error> {
        options.check()?;
        let mut options = options.clone();
        options.apply_style();
        let given = pictures.first_camera().cloned();
        let camera = given.map_or_else(|| camera_file(&options), |camera| Ok(Some(camera)))?;
        let mut request = Self {
            options,
            pictures: pictures.clone(),
            camera,
            settings: Settings::default(),
            objects: Vec::new(),
            base: PathBuf::new(),
            scene: None,
            has_unused_lights: false,
            stdin: None,
            level_store: Arc::default(),
            has_rows: false,
            estimates: Arc::default(),
        };
        match source {
            Source::Scene(scene) => request.set_scene(*scene)?,
            Source::Geometry(inputs) => {
                let preset = request.options.preset.unwrap_or_default();
                let base = preset.apply(Settings::default().with_shader(Shader::Phong));
                request.settings = settings(base, &request.options);
                request.objects = inputs.iter().map(|path| bare_object(path)).collect();
                request.objects.iter_mut().try_for_each(|object| apply(&request.options, object))?;
            }
        }
        Ok(request)
    }

    /// Sets settings, objects and camera of the request from a scene file, with the options applied.
    fn set_scene(&mut self, source: SceneSource) -> Result<(), Error> {
        let SceneSource { mut file, keys, name, base } = source;
        let options = &self.options;
        file.settings = settings(preset_under(options.preset, file.settings, &keys), options);
        if let Some(given) = &self.camera {
            file.camera = given.clone();
        }
        // Numbers out of range are reported here, before minutes are spent on loading.
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
        let chooses_shader = keys.contains("shader") || options.shader.is_some() || options.matcap.is_some();
        self.has_unused_lights = !chooses_shader && file.lights.as_ref().is_some_and(|lights| !lights.is_empty());
        (self.settings, self.objects, self.base) = (file.settings, file.objects.clone(), base);
        self.scene = Some((file, name));
        Ok(())
    }

    /// Returns the request with the content for the name `-`.
    #[must_use]
    pub fn with_stdin(self, stdin: Option<Arc<[u8]>>) -> Self {
        Self { stdin, ..self }
    }

    /// Returns the request with a shared cache of files with levels of detail. Successive requests with the same cache
    /// read less.
    #[must_use]
    pub fn with_level_store(self, level_store: Arc<LevelStore>) -> Self {
        Self { level_store, ..self }
    }

    /// Returns the request with row numbers: splats get the numbers of their rows in the file, even if no plane needs
    /// them.
    #[must_use]
    pub fn with_rows(self) -> Self {
        Self { has_rows: true, ..self }
    }

    /// Returns the request for another set of images.
    #[must_use]
    pub fn with_pictures(mut self, pictures: Pictures) -> Self {
        if let Some(camera) = pictures.first_camera() {
            self.camera = Some(camera.clone());
            self.scene.iter_mut().for_each(|(file, _)| file.camera = camera.clone());
        }
        Self { pictures, ..self }
    }

    /// True if the points of some file don't fit into the memory budget at once. Each image then needs its own
    /// selection of LOD nodes.
    pub fn exceeds_memory(&self) -> bool {
        let options = self.load_options();
        let exceeds = |object: &ObjectFile| {
            let path = self.base.join(object.splats.as_ref()?);
            check_size(&path, &options.clone().with_convert(&object.convert, &self.base)).err()
        };
        self.objects.iter().any(|object| exceeds(object).is_some())
    }

    /// Returns the objects. Their paths are relative to the scene file's folder, or without a scene file to the current
    /// folder.
    pub fn objects(&self) -> &[ObjectFile] {
        &self.objects
    }

    /// Returns the request with a shared cache of estimates. Requests that share the cache must have the same loaded
    /// objects.
    pub(crate) fn with_estimates(self, estimates: Arc<Estimates>) -> Self {
        Self { estimates, ..self }
    }

    /// True if there is no scene file.
    pub(crate) fn is_bare(&self) -> bool {
        self.scene.is_none()
    }

    /// Returns the paths of the files that are drawn as splats, without stdin.
    pub(crate) fn files(&self) -> impl Iterator<Item = PathBuf> {
        let named = self.objects.iter().filter_map(|object| object.splats.as_ref());
        named.filter(|path| !is_stdin(path)).map(|path| self.base.join(path))
    }

    /// Returns a coarser version of the request, for quick previews. `most` maps the current point limit (`None` for no
    /// limit) to the coarser one. The largest projected radius of splats in levels of detail is multiplied by `times`,
    /// up to [`MAX_LOD_ERROR_PX`].
    pub(crate) fn coarser(&self, most: impl Fn(Option<u32>) -> u32, times: f64) -> Self {
        let mut coarse = self.clone();
        coarse.objects.iter_mut().filter(|object| object.splats.is_some()).for_each(|object| {
            object.convert.max_points = Some(most(object.convert.max_points));
            object.convert.all_levels = false;
        });
        let scene = coarse.scene.as_mut().map(|(file, _)| &mut file.settings);
        let coarsen = |settings: &mut Settings| {
            settings.lod_error_px = (settings.lod_error_px * times).min(MAX_LOD_ERROR_PX);
        };
        std::iter::once(&mut coarse.settings).chain(scene).for_each(coarsen);
        // The colour bar is written only for the full scene.
        coarse.options.splats.colorbar = None;
        coarse
    }

    /// Returns the options for loading the objects. With them, only an overview of large COPC files is read, which is
    /// enough to place a camera; for [`Pictures::Any`], all points are read. The content for the name `-` isn't part of
    /// them.
    pub fn load_options(&self) -> LoadOptions {
        // Verification compares the image with one that antialiases edges, for which interior weights are needed.
        let options = LoadOptions::default().with_interior_weight(self.options.verify).for_settings(&self.settings);
        let up = self.scene.as_ref().and_then(|(file, _)| file.up);
        let label = self.options.label.clone().unwrap_or_else(|| DEFAULT_LABEL.to_owned());
        let options = options.with_label(self.options.wants_label().then_some(label));
        let options = options.with_rows(self.has_rows || self.options.wants_rows());
        let gaussians = options.gaussians || self.tells_composite();
        options
            .with_gaussians(gaussians)
            .with_memory(self.options.splats.memory)
            .with_up(self.options.up.flatten().or(up))
            .with_level_store(Some(self.level_store.clone()))
            .with_levels((self.pictures != Pictures::Any).then_some(Levels::Overview))
    }

    /// Loads the objects.
    ///
    /// # Errors
    /// Errors of [`load_objects`], and [`Error::Unsuitable`] if options are for Gaussians drawn over one another and
    /// there are none.
    pub fn load(&self, progress: &dyn Progress) -> Result<LoadedObjects, Error> {
        let options = self.load_options().with_stdin(self.stdin.clone());
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

    /// True if the files decide how Gaussians are composited, because neither a scene file nor an option does.
    fn tells_composite(&self) -> bool {
        self.scene.is_none() && self.options.composite.is_none() && self.options.first_surface_option().is_none()
    }

    /// Assembles the scene from its objects. Chooses camera and lights, unless a scene file defines them, and reads the
    /// LOD nodes that the images need. Passes notes for the user to `note`, as sentences without a full stop.
    ///
    /// # Errors
    /// - [`Error::Usage`] for options without effect or for an invalid camera;
    /// - [`Error::Model`] and [`Error::Unsuitable`] for objects that can't be framed and numbers out of range;
    /// - [`Error::Io`] for a matcap that can't be read;
    /// - otherwise as [`load_objects`].
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

    /// Reads the LOD nodes of large files that the images need, and returns the objects with these nodes.
    fn refine(
        &self,
        mut loaded: LoadedObjects,
        (file, turntable): (&SceneFile, &Turntable),
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<LoadedObjects, Error> {
        if is_partial(&loaded) && self.pictures != Pictures::Any {
            let views = self.pictures.views(&file.camera, turntable, &self.options)?;
            // Geometry outside the frustum may cast a shadow into it.
            let casts_shadows = file.lights.iter().flatten().any(Light::casts_shadow);
            let margin_px = (!casts_shadows).then(|| SplatVisibility::margin_px(&file.settings));
            let selection = ViewSelection { views: &views, error_px: file.settings.lod_error_px, margin_px };
            refine_objects(&mut loaded, &self.objects, &self.base, &self.load_options(), &selection, progress)?;
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
            // Shadows of the default headlight are never visible, so that lights aren't added here.
            file.lights = file.lights.take().map(with_shadows);
        }
        let up = file.up.or_else(|| loaded.facts.first().map(|f| f.up)).unwrap_or(Up::PlusY);
        let objects_only = Scene { objects: self.estimates.framed(&loaded).objects, ..Scene::default() };
        if options.view.is_some() {
            let kept = self.estimates.kept(&loaded, &objects_only);
            if let Some(framed) = camera::reframe(&file.camera, &objects_only, kept, up, options) {
                file.camera = framed;
                note_strays(&objects_only, kept, note);
            }
        }
        file.camera.validate().map_err(|e| out_of_range(&name, &e))?;
        camera::apply_flags(&mut file.camera, &objects_only, up, false, options);
        let kept = self.estimates.kept(&loaded, &objects_only);
        let given = SkyAndGround { sky: file.sky.take(), ground: file.ground.take() };
        let found = (up.vector(), &file.camera);
        SkyAndGround::of(given, file.settings.shader, options, (&objects_only, kept), found)?.put(&mut file);
        cull(&mut file, options);
        // A scene file's camera turns around its target, about the scene's up axis or else its own.
        let axis = file.up.map_or(DVec3::from(file.camera.up).normalize_or(DVec3::Y), Up::vector);
        let turntable = Turntable { center: file.camera.target.into(), axis };
        let frames_all = loaded.frames_all();
        let mut loaded = self.refine(loaded, (&file, &turntable), progress, note)?;
        let (beside, colorings) = (beside(&loaded)?, loaded.colorings.clone());
        let in_file = |e: Error| Error::Unsuitable { path: name.clone(), problem: e.to_string() };
        loaded.draw_points(&file.objects).map_err(in_file)?;
        let mut scene = assemble(&file, loaded.objects).map_err(in_file)?;
        absolute_paths(&mut file, &self.base)?;
        scene.matcap = matcap(&mut file, options)?;
        note_near(&scene, &file.camera, note);
        let has_own_camera = self.options.view.is_none();
        let lighting = None;
        Ok(Resolved { file, scene, turntable, up, has_own_camera, beside, colorings, lighting, frames_all })
    }
}

/// Determines one colouring for the values of several sources, each of which gets its own image. Returns `None` if no
/// source is coloured by values. Loads the sources one after another.
///
/// # Errors
/// [`Error::Usage`] if the options don't name an attribute; otherwise as [`Request::new`] and [`Request::load`].
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
        let request = Request::new(source?, &Pictures::One, options)?.with_stdin(stdin.clone());
        request.load(progress)?.tally(&mut tallies);
    }
    let found = tallies.coloring(attribute).map(|(coloring, _)| coloring);
    Ok(found.filter(|coloring| coloring.scale != ColorScale::Direct))
}

/// Applies the options for converting an object's file to splats.
fn apply(options: &RenderOptions, object: &mut ObjectFile) -> Result<(), Error> {
    splats::apply(&options.splats, &mut object.convert)?;
    object.convert.all_levels |= options.all_levels;
    object.material.color = options.color.or(object.material.color);
    Ok(())
}

fn is_partial(loaded: &LoadedObjects) -> bool {
    loaded.facts.iter().any(|facts| facts.partial)
}

/// Passes the notes about the files to `note`, checks for options without effect, and writes the colour bar.
fn tell(loaded: &LoadedObjects, options: &RenderOptions, note: &mut dyn FnMut(String)) -> Result<(), Error> {
    for ObjectNote { path, text } in &loaded.notes {
        note(format!("{}: {text}", display(path)));
    }
    splats::check_used(&options.splats, &loaded.unused, note)?;
    splats::write_color_bar(&options.splats, loaded.colorings.iter(), note)
}

/// Passes a note to `note` if more than half of the trained Gaussians in front of a perspective camera are too near to
/// be drawn.
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

/// Returns the note about an estimated up axis, with the option that overrides it.
pub(crate) fn up_note(Upright { up, reason }: Upright) -> String {
    let other = if up == Up::PlusZ { Up::PlusY } else { Up::PlusZ };
    format!("up is {up} ({reason}); if that is wrong: --up {other}")
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

/// Returns the settings of a preset, overridden by the settings that the scene file states. `file` has the settings of
/// the scene file, and `keys` the names of those that it states. Returns `file` if there is no preset.
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

/// Returns the settings with the options' filter as the filter of trained Gaussians, if these are composited with
/// [`Composite::Over`].
fn apply_gaussian_filter(settings: Settings, options: &RenderOptions) -> Settings {
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
    apply_gaussian_filter(settings, options)
}

pub(crate) fn with_shadows(mut lights: Vec<Light>) -> Vec<Light> {
    for light in &mut lights {
        if let Light::Directional { shadow, .. } | Light::Spot { shadow, .. } = light {
            *shadow = true;
        }
    }
    lights
}

/// Applies the culling option to all objects.
fn cull(file: &mut SceneFile, options: &RenderOptions) {
    if let Some(cull) = options.splats.cull {
        file.objects.iter_mut().for_each(|object| object.material.cull = cull);
    }
}

/// Makes all paths of a scene file absolute, except the name of stdin.
fn absolute_paths(file: &mut SceneFile, base: &Path) -> Result<(), Error> {
    paths::for_each(file, |path| {
        *path = absolute(&base.join(&*path))?;
        Ok(())
    })
}

/// Loads the matcap image that the options name, or else the one that the scene file names. A path from the options is
/// made absolute and stored in `file`. Returns `None` if the shader isn't `matcap`, if the matcap is the built-in one,
/// and if none is named.
fn matcap(file: &mut SceneFile, options: &RenderOptions) -> Result<Option<Arc<Matcap>>, Error> {
    if let Some(given) = &options.matcap {
        file.matcap = if given.as_os_str() == "builtin" { None } else { Some(absolute(given)?) };
    }
    load_matcap(file, Path::new(""))
}

/// Passes a note to `note` with the number of stray points outside of the framed sphere `kept`, if there are any.
/// `None` for the sphere means that all points are framed.
fn note_strays(scene: &Scene, kept: Option<Sphere>, note: &mut dyn FnMut(String)) {
    if let Some(LeftOut { count, times }) = kept.and_then(|kept| surfel_framing::left_out(scene, &kept)) {
        let points = if count == 1 { "1 stray point".to_owned() } else { format!("{count} stray points") };
        note(format!(
            "left {points} out of the frame, up to {times:.0} times as far out as the rest (--outliers drop removes \
             isolated points; --eye and --target place the camera)"
        ));
    }
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
