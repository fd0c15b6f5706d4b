//! Sessions: a scene in memory that is drawn many times, with options that change from image to image.

use crate::camera::{self, resized};
use crate::metadata::{self, Input};
use crate::request::{Pictures, Request, Resolved, Source};
use crate::{RenderOptions, progressive};
use glam::DVec3;
use serde_json::{Map, Value, json};
use std::cell::OnceCell;
use std::path::PathBuf;
use std::sync::Arc;
use surfel_backend::{Backend, BackendOptions, BackendScene};
use surfel_backend::{Chosen, refusals};
use surfel_framing::ViewAxes;
use surfel_load::LoadedObjects;
use surfel_load::coloring::{Category, ColorScale, Coloring};
use surfel_load::info::attributes::{class_counts, classes, column};
use surfel_load::{Error, LevelStore, LoadOptions, levels};
use surfel_math::srgb::nearest_8_bit;
use surfel_model::{Camera, EdgeAa, ExtraColumn, Geometry, Object, ObjectFile, Projection, Scene, Settings};
use surfel_render::{Frame, Planes, Preset, Region, Renderer as _, SceneSummary, Stats, View};
use surfel_sample::NoProgress;
use surfel_sample::Progress;
use surfel_stage::Estimates;

/// Largest number of splats that two loaded scenes may have together for both to stay in memory.
const MAX_SPLATS_OF_TWO: u64 = 4_000_000;

/// Loaded scenes of one set of input files. The scene shown last is resident in a backend.
///
/// All options may change from image to image. Files are read again only if the options change the data that is read
/// from them. Splats are uploaded again only if they differ. Images are bit-identical to those of [`Request`] with the
/// same options.
///
/// ```no_run
/// # fn main() -> Result<(), surfel_load::Error> {
/// use surfel_app::{RenderOptions, session::Session};
/// use surfel_backend::BackendOptions;
/// use surfel_render::Planes;
/// use surfel_sample::NoProgress;
/// let mut session = Session::start(vec!["scan.ply".into()], None, "auto", BackendOptions::default())?;
/// for view in ["front", "top"] {
///     let mut options = RenderOptions::default();
///     options.set("view", view).map_err(surfel_load::Error::Usage)?;
///     session.show(&options, &NoProgress, &mut |_| ())?;
///     session.draw(&options, Planes::COLOR)?;
///     session.frame().save_png(format!("{view}.png"))?;
/// }
/// # Ok(())
/// # }
/// ```
pub struct Session {
    inputs: Vec<PathBuf>,
    /// Content of the input named `-`.
    stdin: Option<Arc<[u8]>>,
    backend: Backend,
    backend_name: String,
    backend_options: BackendOptions,
    level_store: Arc<LevelStore>,
    /// True if the scene must suit any camera, because the cameras of images aren't known when it is shown
    /// ([`Session::for_any_camera`]).
    is_for_any_camera: bool,
    /// True if some file has levels of detail; empty until the files have been examined.
    has_levels: OnceCell<bool>,
    /// Loaded scenes, most recently shown first.
    loaded: Vec<LoadedScene>,
    frame: Frame,
}

/// Input files that were loaded with certain options, and data derived from them.
struct LoadedScene {
    options: LoadOptions,
    files: Vec<ObjectFile>,
    objects: LoadedObjects,
    /// Cache of estimates about the objects, such as their centre, reused from image to image.
    estimates: Arc<Estimates>,
    /// True if only a coarse selection of the files' points is loaded.
    is_coarse: bool,
    /// Eight corners of the objects' bounding box, in world space, for the depth planes of previews and for the
    /// description; empty if there are no bounds.
    corners: Vec<DVec3>,
    /// Names and hashes of the input files, for metadata; `None` until they are first needed.
    hashes: Option<Vec<Input>>,
    /// Description of the scene as JSON ([`described`]); null until it is first needed.
    description: Value,
    shown: Option<Shown>,
}

/// Scene that was shown last, and its copy in the backend.
struct Shown {
    /// Options with which the scene is shown, to detect that nothing has changed. `None` for a coarse selection, and
    /// after the lights have followed another camera.
    options: Option<RenderOptions>,
    resolved: Resolved,
    /// Scene resident in the backend; `None` until a camera selects its levels of detail.
    resident: Option<BackendScene>,
    /// Camera for which the resident levels of detail were selected; `None` if all cameras share the scene.
    camera: Option<Camera>,
}

/// Loader for the files of a session. It can run on another thread while the session draws a coarse selection of
/// points.
pub struct Loader {
    request: Request,
}

/// Files that a [`Loader`] has loaded, for [`Session::adopt`].
pub struct Loaded(LoadedScene);

impl Loader {
    /// Loads the files.
    ///
    /// # Errors
    /// Errors of [`Request::load`].
    pub fn load(self, progress: &dyn Progress) -> Result<Loaded, Error> {
        let objects = self.request.load(progress)?;
        Ok(Loaded(LoadedScene::new(&self.request, objects)))
    }
}

/// Properties of the surface at a picked pixel.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Picked {
    /// Position in world space.
    pub position: [f64; 3],
    /// Unit normal in world space.
    pub normal: [f32; 3],
    /// Depth: distance from the eye along the viewing direction, in world units.
    pub depth: f64,
    /// Index of the object, and row of the nearest splat in the object's file. `None` for polygons and Gaussians, and
    /// if splats have no row numbers.
    pub row: Option<(usize, u32)>,
    /// Names and values of the splat's attributes; empty if `row` is `None`.
    pub values: Vec<(String, f64)>,
}

impl Session {
    /// Creates a session with a backend chosen by its name ([`Backend::by_name`]). `stdin` is the content of the input
    /// named `-`. Files are loaded when the first image is drawn.
    ///
    /// # Errors
    /// [`Error::Backend`] if the backend doesn't start.
    pub fn start(
        inputs: Vec<PathBuf>,
        stdin: Option<Arc<[u8]>>,
        backend_name: &str,
        backend_options: BackendOptions,
    ) -> Result<Self, Error> {
        let backend = Backend::by_name(backend_name, &backend_options)?;
        Ok(Self::with_backend(inputs, stdin, backend, (backend_name, backend_options)))
    }

    /// Creates a session like [`Session::start`], with a backend that was already started by the given name and
    /// options.
    pub fn with_backend(
        inputs: Vec<PathBuf>,
        stdin: Option<Arc<[u8]>>,
        backend: Backend,
        (backend_name, backend_options): (&str, BackendOptions),
    ) -> Self {
        Self {
            inputs,
            stdin,
            backend,
            backend_name: backend_name.to_owned(),
            backend_options,
            level_store: Arc::new(LevelStore::caching_nodes()),
            is_for_any_camera: false,
            has_levels: OnceCell::new(),
            loaded: Vec::new(),
            frame: Frame::default(),
        }
    }

    /// Prepares the session for [`Session::draw_from`]. Scenes without a scene file are then lit along the view, so
    /// that all cameras share one scene. All points are resident if they fit into memory.
    #[must_use]
    pub fn for_any_camera(self) -> Self {
        Self { is_for_any_camera: true, ..self }
    }

    /// Returns the backend.
    pub fn backend(&self) -> &Backend {
        &self.backend
    }

    /// Returns the frame that was drawn last.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// True if the loaded scenes are so large that another session shouldn't stay in memory at the same time.
    pub fn is_large(&self) -> bool {
        self.loaded.iter().map(LoadedScene::splats).sum::<u64>() > MAX_SPLATS_OF_TWO
    }

    /// Returns the loaded objects of the scene shown last, if there is one.
    pub fn objects(&self) -> Option<&LoadedObjects> {
        self.loaded.first().map(|loaded| &loaded.objects)
    }

    /// Returns the scene shown last, if there is one.
    pub fn shown(&self) -> Option<&Resolved> {
        self.loaded.first()?.shown.as_ref().map(|shown| &shown.resolved)
    }

    fn request(&self, options: &RenderOptions) -> Result<Request, Error> {
        let source = Source::of(&self.inputs, self.stdin.as_deref())?;
        let request = Request::new(source, &Pictures::One, options)?
            .with_stdin(self.stdin.clone())
            .with_level_store(self.level_store.clone());
        if self.is_for_any_camera {
            let by_levels = request.exceeds_memory() && !options.all_levels;
            return Ok(if by_levels { request } else { request.with_pictures(Pictures::Any) });
        }
        // Row numbers would require reading points outside of the view, too, so that files with levels don't get them.
        let has_levels = *self.has_levels.get_or_init(|| request.files().any(|path| levels::has_levels(&path)));
        Ok(if has_levels { request } else { request.with_rows() })
    }

    /// Loads and shows a coarse selection of the points, if the files aren't loaded yet and have many points.
    ///
    /// Returns a loader for all points, whose result is passed to [`Session::adopt`]. Returns `None` if nothing was
    /// shown; the caller then uses [`Session::show`]. Files with few points are completely loaded in this case.
    ///
    /// # Errors
    /// Errors of [`Session::show`].
    pub fn show_coarse(&mut self, options: &RenderOptions, progress: &dyn Progress) -> Result<Option<Loader>, Error> {
        let request = self.request(options)?;
        if self.loaded.iter().any(|loaded| loaded.is_for(&request)) {
            return Ok(None);
        }
        let (coarse, objects) = match progressive::first(&request, progress)? {
            progressive::First::Coarse(coarse, objects) => (coarse, objects),
            progressive::First::Whole(objects) => {
                self.make_room();
                self.loaded.insert(0, LoadedScene::new(&request, objects));
                return Ok(None);
            }
            progressive::First::Nothing => return Ok(None),
        };
        let resolved = coarse.resolve(objects.clone(), progress, &mut |_| ())?;
        self.settle_backend(&resolved, &mut |_| ())?;
        let resident = Some(self.backend.upload(&resolved.scene)?);
        let mut loaded = LoadedScene::new(&request, objects);
        loaded.is_coarse = true;
        loaded.shown = Some(Shown { options: None, resolved, resident, camera: None });
        self.loaded.insert(0, loaded);
        Ok(Some(Loader { request }))
    }

    /// Replaces the coarse selection of points by the files that a [`Loader`] loaded.
    pub fn adopt(&mut self, loaded: Loaded) {
        self.loaded.retain(|loaded| !loaded.is_coarse);
        self.loaded.insert(0, loaded.0);
    }

    /// Shows the scene with the given options. Loads the files unless they are loaded, and uploads the scene if its
    /// splats differ from the resident ones. Passes notes for the user to `note`, as sentences without a full stop.
    ///
    /// # Errors
    /// Errors of [`Request::new`], [`Request::load`] and [`Request::resolve`], and [`Error::Render`] if the scene can't
    /// be uploaded.
    pub fn show(
        &mut self,
        options: &RenderOptions,
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<&Resolved, Error> {
        let request = self.request(options)?;
        self.load(&request, progress)?;
        let Some(loaded) = self.loaded.first_mut() else { return Err(nothing_shown()) };
        let is_shown = loaded.shown.as_ref().is_some_and(|shown| shown.options.as_ref() == Some(options));
        if !is_shown {
            let is_bare = request.is_bare();
            let by_levels = self.is_for_any_camera && loaded.is_partial();
            let request = request.with_estimates(loaded.estimates.clone());
            let request = if by_levels { request.with_pictures(Pictures::Any) } else { request };
            let mut resolved = request.resolve(loaded.objects.clone(), progress, note)?;
            if self.is_for_any_camera && is_bare {
                (resolved.file.lights, resolved.scene.lights, resolved.lighting) = (None, None, None);
            }
            if by_levels {
                note("not all points fit into memory (--memory): each image is drawn by levels of detail".to_owned());
            }
            if let Some(facts) = loaded.objects.facts.first_mut().filter(|_| is_bare && options.up.flatten().is_none())
            {
                // The estimate depends only on the files, so that it is stored for further images.
                let reason = surfel_framing::UpReason::Convention;
                (facts.up, facts.up_reason) = (resolved.up, facts.up_reason.or(Some(reason)));
            }
            self.upload(options, resolved, note)?;
        }
        self.shown().ok_or_else(nothing_shown)
    }

    /// Makes the scene for a request the first of the loaded ones: moves it to the front if it is loaded, and loads it
    /// otherwise.
    fn load(&mut self, request: &Request, progress: &dyn Progress) -> Result<(), Error> {
        self.loaded.retain(|loaded| !loaded.is_coarse);
        if let Some(place) = self.loaded.iter().position(|loaded| loaded.is_for(request)) {
            self.loaded[..=place].rotate_right(1);
            return Ok(());
        }
        self.make_room();
        let objects = request.load(progress)?;
        self.loaded.insert(0, LoadedScene::new(request, objects));
        Ok(())
    }

    /// Drops loaded scenes before another one is loaded. The scene shown last is retained if twice the number of splats
    /// in all loaded scenes is at most [`MAX_SPLATS_OF_TWO`].
    fn make_room(&mut self) {
        let splats: u64 = self.loaded.iter().map(LoadedScene::splats).sum();
        self.loaded.truncate(usize::from(2 * splats <= MAX_SPLATS_OF_TWO));
    }

    /// Makes the resolved scene resident in the backend, unless each camera selects its own levels of detail.
    fn upload(
        &mut self,
        options: &RenderOptions,
        resolved: Resolved,
        note: &mut dyn FnMut(String),
    ) -> Result<(), Error> {
        let is_new = self.settle_backend(&resolved, note)?;
        let Some(loaded) = self.loaded.first_mut() else { return Err(nothing_shown()) };
        let before = loaded.shown.take().filter(|shown| !is_new && have_same_splats(&shown.resolved, &resolved));
        let mut kept = before.and_then(|shown| shown.resident);
        if let Some(resident) = &mut kept
            && !self.backend.update(resident, &resolved.scene)?
        {
            kept = None;
        }
        let by_levels = self.is_for_any_camera && loaded.is_partial();
        let resident = match kept.filter(|_| !by_levels) {
            None if !by_levels => Some(self.backend.upload(&resolved.scene)?),
            kept => kept,
        };
        loaded.shown = Some(Shown { options: Some(options.clone()), resolved, resident, camera: None });
        Ok(())
    }

    /// Starts another backend if the current one was selected automatically and can't draw the scene. Returns true if
    /// it did; no scene is resident in the new backend yet.
    fn settle_backend(&mut self, resolved: &Resolved, note: &mut dyn FnMut(String)) -> Result<bool, Error> {
        let planes = if self.is_for_any_camera { Planes::ALL } else { Planes::COLOR };
        let refuses = refusals(&resolved.scene, &resolved.file.settings, planes);
        if self.backend_name != "auto" || refuses(&self.backend.info().capabilities).is_none() {
            return Ok(false);
        }
        let Chosen { backend, rejected } = Backend::choose(&self.backend_options, refuses)?;
        note(format!("drawing with '{}' ({})", backend.info().backend, rejected.join("; ")));
        self.backend = backend;
        self.loaded.iter_mut().for_each(|loaded| loaded.shown = None);
        Ok(true)
    }

    /// Draws the scene shown last into [`Session::frame`]. `options` are those with which it was shown.
    ///
    /// # Errors
    /// [`Error::Render`], and [`Error::Usage`] for a camera out of range.
    pub fn draw(&mut self, options: &RenderOptions, planes: Planes) -> Result<Stats, Error> {
        let shown = self.loaded.first().and_then(|loaded| loaded.shown.as_ref()).ok_or_else(nothing_shown)?;
        let view = camera::view(&shown.resolved.file.camera, options)?;
        self.draw_view(&view, planes)
    }

    fn draw_view(&mut self, view: &View, planes: Planes) -> Result<Stats, Error> {
        let shown = self.loaded.first().and_then(|loaded| loaded.shown.as_ref()).ok_or_else(nothing_shown)?;
        let resident = shown.resident.as_ref().ok_or_else(nothing_shown)?;
        let settings = &shown.resolved.file.settings;
        Ok(self.backend.render_into(resident, view, settings, planes, &mut self.frame)?)
    }

    /// Draws the scene shown last from another camera into [`Session::frame`]. `options` state the region. If not all
    /// points fit into memory, the levels of detail for the camera are read first.
    ///
    /// # Errors
    /// Errors of [`Session::show`] and [`Session::draw`].
    pub fn draw_from(&mut self, camera: &Camera, options: &RenderOptions, planes: Planes) -> Result<Stats, Error> {
        let view = camera::view(camera, options)?;
        let loaded = self.loaded.first().ok_or_else(nothing_shown)?;
        let shown = loaded.shown.as_ref().ok_or_else(nothing_shown)?;
        if self.is_for_any_camera && loaded.is_partial() && shown.camera.as_ref() != Some(camera) {
            let shown_with = shown.options.clone().unwrap_or_default();
            let request = self.request(&shown_with)?.with_pictures(Pictures::Cameras(vec![camera.clone()]));
            let (objects, is_bare) = (loaded.objects.clone(), request.is_bare());
            // The old levels are freed before the new ones are read.
            if let Some(shown) = self.loaded.first_mut().and_then(|loaded| loaded.shown.as_mut()) {
                (shown.resident, shown.camera) = (None, None);
            }
            let mut scene = request.resolve(objects, &NoProgress, &mut |_| ())?.scene;
            if is_bare {
                scene.lights = None;
            }
            let resident = self.backend.upload(&scene)?;
            if let Some(shown) = self.loaded.first_mut().and_then(|loaded| loaded.shown.as_mut()) {
                (shown.resident, shown.camera) = (Some(resident), Some(camera.clone()));
            }
        }
        self.draw_view(&view, planes)
    }

    /// Frees buffers that are reused for later frames. Useful after an image that is much larger than the next ones.
    pub fn release_memory(&mut self) {
        self.frame = Frame::default();
        self.backend.release_memory();
    }

    /// Draws a fast, less accurate preview of the scene shown last, while the user moves the camera. Only the camera's
    /// options are applied. Returns the camera and statistics.
    ///
    /// # Errors
    /// Errors of [`Session::draw`].
    pub fn draw_preview(&mut self, options: &RenderOptions) -> Result<(Camera, Stats), Error> {
        let Some(loaded) = self.loaded.first_mut() else { return Err(nothing_shown()) };
        let Some(shown) = loaded.shown.as_mut() else { return Err(nothing_shown()) };
        let Some(resident) = &mut shown.resident else { return Err(nothing_shown()) };
        let camera = moved(&shown.resolved, options, &loaded.corners);
        let view = View::new(&camera).map_err(|e| Error::Usage(e.to_string()))?;
        if let Some(lighting) = shown.resolved.lighting {
            let scene = shown.resolved.lit(lighting.lights(&camera));
            if self.backend.update(resident, &scene)? {
                shown.options = None;
            }
        }
        let settings = coarse_settings(shown.resolved.file.settings);
        let stats = self.backend.render_into(resident, &view, &settings, Planes::COLOR, &mut self.frame)?;
        Ok((camera, stats))
    }

    /// Returns names and hashes of the input files of the scene shown last, for an image's metadata.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that can't be read.
    pub fn hashes(&mut self) -> Result<Vec<Input>, Error> {
        let Some(loaded) = self.loaded.first_mut() else { return Err(nothing_shown()) };
        let Some(shown) = &loaded.shown else { return Err(nothing_shown()) };
        if loaded.hashes.is_none() {
            let resolved = &shown.resolved;
            loaded.hashes = Some(metadata::inputs(&resolved.file, &resolved.beside, self.stdin.as_deref())?);
        }
        Ok(loaded.hashes.clone().unwrap_or_default())
    }

    /// Describes the scene shown last as JSON: number of splats, bounds, up axis, centre, columns with their ranges,
    /// classes, and the legend of its colours. Up axis and centre follow the scene; the rest changes only when other
    /// files or points are loaded. Returns null before a scene is loaded.
    pub fn description(&mut self) -> Value {
        let Some(loaded) = self.loaded.first_mut() else { return Value::Null };
        if loaded.description.is_null() {
            loaded.description = described(&loaded.objects, &loaded.corners);
        }
        let mut description = loaded.description.clone();
        if let Some(Shown { resolved, .. }) = &loaded.shown {
            description["up"] = json!(resolved.up.to_string());
            description["center"] = json!(resolved.turntable.center.to_array());
        }
        description
    }

    /// Returns the properties of the surface at a pixel of the scene shown last. `at` is its column and row, counted
    /// from the top left corner; a pixel outside of the image is moved to its border. `None` if the pixel shows the
    /// background.
    ///
    /// # Errors
    /// Errors of [`Session::draw`].
    pub fn pick(&mut self, at: [u32; 2]) -> Result<Option<Picked>, Error> {
        let Some(loaded) = self.loaded.first() else { return Err(nothing_shown()) };
        let Some(shown) = &loaded.shown else { return Err(nothing_shown()) };
        let Resolved { file, scene, .. } = &shown.resolved;
        let [width, height] = file.camera.size;
        let pixel = Region { x: at[0].min(width - 1), y: at[1].min(height - 1), width: 1, height: 1 };
        let view = View::of_region(&file.camera, Some(pixel))?;
        let summary = SceneSummary::of(scene);
        let has_rows = summary.without_rows.is_none() && summary.gaussians.is_none();
        let planes = Planes::COLOR.with_depth(true).with_normal(true).with_position(true).with_index(has_rows);
        let resident = shown.resident.as_ref().ok_or_else(nothing_shown)?;
        self.backend.render_into(resident, &view, &file.settings, planes, &mut self.frame)?;
        let frame = &self.frame;
        let Some(position) = frame.position().first().copied().filter(|p| p.iter().all(|x| x.is_finite())) else {
            return Ok(None);
        };
        let normal = frame.normal().first().copied().unwrap_or_default();
        let depth = frame.depth().first().map_or(f64::INFINITY, |depth| f64::from(*depth));
        let row = frame.object().first().zip(frame.index().first()).map(|(object, row)| (*object as usize, *row));
        let row = row.filter(|(object, _)| *object < scene.objects.len());
        let values = row.map(|(object, row)| values_of(&scene.objects[object], row)).unwrap_or_default();
        Ok(Some(Picked { position, normal, depth, row, values }))
    }
}

impl LoadedScene {
    fn new(request: &Request, objects: LoadedObjects) -> Self {
        let scene = Scene { objects: objects.objects.clone(), ..Scene::default() };
        let (options, files) = (request.load_options(), request.objects().to_vec());
        let corners = surfel_framing::scene_bounds(&scene).map_or_else(Vec::new, |(lo, hi)| {
            let corner =
                |i: usize| DVec3::from_array(std::array::from_fn(|k| if i >> k & 1 == 0 { lo[k] } else { hi[k] }));
            (0..8).map(corner).collect()
        });
        let estimates = Arc::default();
        Self {
            options,
            files,
            objects,
            estimates,
            is_coarse: false,
            corners,
            hashes: None,
            description: Value::Null,
            shown: None,
        }
    }

    /// True if the request would load the same files with the same options.
    fn is_for(&self, request: &Request) -> bool {
        self.files == request.objects() && self.options == request.load_options()
    }

    /// True if only an overview of some file is loaded, which lacks finer levels of detail.
    fn is_partial(&self) -> bool {
        self.objects.facts.iter().any(|facts| facts.partial)
    }

    fn splats(&self) -> u64 {
        SceneSummary::of(&Scene { objects: self.objects.objects.clone(), ..Scene::default() }).splats
    }
}

fn nothing_shown() -> Error {
    Error::Usage("no scene is resident: call show first, or draw_from if not all points fit into memory".to_owned())
}

/// True if two scenes have the same geometry at the same positions, and the same sky and ground.
fn have_same_splats(a: &Resolved, b: &Resolved) -> bool {
    let is_same = |(a, b): (&Object, &Object)| {
        let geometry = match (&a.geometry, &b.geometry) {
            (Geometry::Splats(a), Geometry::Splats(b)) => Arc::ptr_eq(a, b),
            (Geometry::Mesh(a), Geometry::Mesh(b)) => Arc::ptr_eq(a, b),
            (Geometry::Octree(a), Geometry::Octree(b)) => Arc::ptr_eq(a, b),
            (Geometry::Gaussians(a), Geometry::Gaussians(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        geometry && a.world_from_object == b.world_from_object
    };
    let have_same_light = a.scene.sky == b.scene.sky && a.scene.ground == b.scene.ground;
    let (a, b) = (&a.scene.objects, &b.scene.objects);
    have_same_light && a.len() == b.len() && a.iter().zip(b).all(is_same)
}

/// Returns fast, less accurate settings for previews while the camera moves.
fn coarse_settings(settings: Settings) -> Settings {
    let fast = Preset::Fastest.apply(settings).with_edge_aa(EdgeAa::Off);
    // With this error, octrees are drawn by larger and fewer splats.
    fast.with_lod_error_px(settings.lod_error_px.max(2.0))
}

/// Returns the camera for the given options. If there are corners, the near plane is fitted to their box, unless the
/// scene has its own camera. The far plane is fitted to the box for an orthographic camera only.
fn moved(resolved: &Resolved, options: &RenderOptions, corners: &[DVec3]) -> Camera {
    let own = &resolved.file.camera;
    let mut camera = resized(own, options.size.unwrap_or(own.size));
    camera.eye = options.eye.unwrap_or(camera.eye);
    camera.target = options.target.unwrap_or(camera.target);
    camera.up = options.camera_up.unwrap_or(camera.up);
    if let Some(fov_y_deg) = options.fov_y {
        camera.projection = Projection::Perspective { fov_y_deg };
    }
    if let Some(height) = options.ortho_height {
        camera.projection = Projection::Orthographic { height };
    }
    let (eye, forward) = (DVec3::from(camera.eye), ViewAxes::of(&camera).forward);
    let depths = corners.iter().map(|corner| forward.dot(*corner - eye));
    let (first, last) = depths.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| (a.min(d), b.max(d)));
    if first.is_finite() && last.is_finite() {
        let size = (last - first).max(1e-6);
        if !resolved.has_own_camera {
            camera.near = if first > 0.0 { 0.5 * first } else { 1e-3 * size };
        }
        let is_parallel = matches!(camera.projection, Projection::Orthographic { .. });
        camera.far = if is_parallel { Some((last + 0.01 * size).max(2.0 * camera.near)) } else { camera.far };
    }
    camera
}

/// Returns the names and values of the columns of an object's splat, which is identified by its row in the file. Empty
/// for geometry other than splats, and if no splat has the row.
fn values_of(object: &Object, row: u32) -> Vec<(String, f64)> {
    let Geometry::Splats(cloud) = &object.geometry else { return Vec::new() };
    let data = cloud.data();
    let slot = data.rows.as_ref().and_then(|rows| rows.iter().position(|r| *r == row));
    let Some(slot) = slot else { return Vec::new() };
    let value = |extra: &ExtraColumn| (slot < extra.values.len()).then(|| (extra.name.clone(), extra.values.get(slot)));
    data.extras.iter().filter_map(value).collect()
}

/// Returns the JSON for [`Session::description`], without up axis and centre.
fn described(loaded: &LoadedObjects, corners: &[DVec3]) -> Value {
    let mut columns = Map::new();
    let mut counts: Option<[u64; 256]> = None;
    for object in &loaded.objects {
        let Geometry::Splats(cloud) = &object.geometry else { continue };
        for extra in &cloud.data().extras {
            columns.entry(extra.name.clone()).or_insert_with(|| column(extra));
        }
        if let Some(of_object) = class_counts(&cloud.data().extras) {
            let sums = counts.get_or_insert([0; 256]);
            sums.iter_mut().zip(of_object).for_each(|(sum, count)| *sum += count);
        }
    }
    let scene = Scene { objects: loaded.objects.clone(), ..Scene::default() };
    let legends: Vec<Value> = loaded.colorings.iter().filter_map(|(_, coloring)| legend(coloring)).collect();
    json!({
        "splats": SceneSummary::of(&scene).splats,
        "gaussians": loaded.has_gaussians(),
        "bounds": corners.first().zip(corners.last()).map(|(lo, hi)| [lo.to_array(), hi.to_array()]),
        "columns": columns,
        "classes": counts.as_ref().map(classes),
        "legend": legends.first(),
    })
}

/// Describes the colours of an attribute as JSON; `None` for colours that don't represent values.
fn legend(Coloring { attribute, scale }: &Coloring) -> Option<Value> {
    let hex = |[r, g, b]: [u8; 3]| format!("#{r:02x}{g:02x}{b:02x}");
    match scale {
        ColorScale::Direct => None,
        ColorScale::Range { map, range } => {
            let painter = scale.painter();
            let value = |i: u32| range[0] + (range[1] - range[0]) * f64::from(i) / 16.0;
            let at = |i: u32| hex(painter(value(i)).map(nearest_8_bit));
            let colors: Vec<String> = (0..=16).map(at).collect();
            Some(json!({ "attribute": attribute, "map": map.name(), "range": range, "colors": colors }))
        }
        ColorScale::Categories(all) => {
            let entry = |c: &Category| {
                let (value, name, color, count) = (c.value, c.name.as_deref(), hex(c.color), c.count);
                json!({ "value": value, "name": name, "color": color, "count": count })
            };
            Some(json!({ "attribute": attribute, "categories": all.iter().map(entry).collect::<Vec<_>>() }))
        }
    }
}
