//! Drawing of frames from a scene's files and options, without Python.

use crate::errors::{error_of_arrays, of_arrays};
use crate::interrupt::defect;
use crate::memory;
use crate::pool::{BackendRequest, PooledBackend};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use surfel_app::camera;
use surfel_app::metadata::{self, Content};
use surfel_app::request::{Pictures, RenderOptions, Request, Resolved, SceneSource, Source};
use surfel_backend::BackendScene;
use surfel_backend::summary_of;
use surfel_load::LoadedObjects;
use surfel_load::paths::is_stdin;
use surfel_load::{Error, LevelStore};
use surfel_model::SceneFile;
use surfel_model::{Camera, Scene};
use surfel_render::{Capabilities, SceneSummary, unsupported};
use surfel_render::{Frame, Planes, Renderer, Stats};
use surfel_sample::Progress;

/// Maximum number of scenes that stay prepared, in addition to the last one.
const KEPT: usize = 1;

/// Inputs of a scene, with cached results of loading and preparing.
pub(crate) struct Input {
    pub(crate) paths: Vec<PathBuf>,
    /// Contents of the file that arrays were converted to; `None` without arrays. The name `-` among the paths stands
    /// for this file.
    pub(crate) bytes: Option<Arc<[u8]>>,
    /// Number of points in the arrays; 0 if unknown.
    pub(crate) points: u64,
    /// Notes for the user on how the arrays were found and converted.
    pub(crate) notes: Vec<String>,
    /// Text of the scene file that is embedded in an image; the image is the first of the paths. `None` for other
    /// inputs.
    carried: Option<String>,
    cache: Mutex<Cache>,
    level_store: Arc<LevelStore>,
}

/// Results of loading and preparing a scene, which the next images reuse.
#[derive(Default)]
struct Cache {
    /// Loaded objects, with a key of the options that they were loaded with.
    loaded: Option<(String, LoadedObjects)>,
    /// Prepared scenes, the newest first.
    prepared: Vec<Arc<Prepared>>,
}

/// Uploaded scene, with its key: the name of the backend, and true if splats are stored in 16 bits.
type Resident = ((&'static str, bool), Arc<BackendScene>);

/// Scene with its camera and lights, ready to be drawn.
pub(crate) struct Prepared {
    options: RenderOptions,
    /// Images whose views decided which parts of files were read; `None` if everything was read.
    read_for: Option<Arc<Pictures>>,
    pub(crate) resolved: Resolved,
    summary: SceneSummary,
    pub(crate) notes: Arc<[String]>,
    /// The scene as uploaded to the backend that last drew it.
    resident: Mutex<Option<Resident>>,
    files: Arc<Files>,
}

/// Files that a scene was loaded from.
#[derive(Default)]
pub(crate) struct Files {
    /// Files that the inputs refer to, such as textures.
    beside: BTreeSet<PathBuf>,
    /// The caller's arrays, encoded as a file, which inputs name `-` (as stdin); `None` if the caller gave no arrays.
    bytes: Option<Arc<[u8]>>,
    /// All files with their hashes; `None` until an image or its recipe is written for the first time.
    known: Mutex<Option<Vec<metadata::Input>>>,
}

/// Settings of an image to be drawn.
#[derive(Clone)]
pub(crate) struct Job {
    pub(crate) options: RenderOptions,
    /// All images that are drawn of the scene, which share up axis and conversion.
    pub(crate) pictures: Arc<Pictures>,
    pub(crate) who: BackendRequest,
    pub(crate) planes: Planes,
}

/// Source of an image's camera.
#[derive(Clone)]
pub(crate) enum From {
    /// Camera of the options.
    Options,
    /// Camera given by the caller. The flag is true if near and far planes are fitted to the scene.
    Camera(Camera, bool),
    /// Index of an image on the job's turntable or camera path, which determines the camera.
    Picture(u32),
}

/// Drawn image with the data to describe it.
pub(crate) struct Drawn {
    pub(crate) frame: Frame,
    pub(crate) stats: Stats,
    pub(crate) recipe: Recipe,
}

/// Description of how an image was drawn, embedded in the image file so that the image can be drawn again.
#[derive(Clone)]
pub(crate) struct Recipe {
    pub(crate) notes: Arc<[String]>,
    files: Arc<Files>,
    pub(crate) scene: SceneFile,
    pub(crate) drawn: serde_json::Map<String, serde_json::Value>,
    /// True if the near and far planes of the camera were fitted to the scene.
    fits_depth: bool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs `work` in a new pool of `threads` threads; 0 stands for one per core. Returns an error if there is no memory
/// for the threads.
pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T, Error> {
    memory::check_threads(threads, memory::STACK_BYTES)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| memory::threads_error(threads, memory::STACK_BYTES, &e))?;
    // After each thread has run once, the remaining memory is known.
    pool.broadcast(|_| ());
    memory::check_threads(threads, 0)?;
    Ok(pool.install(work))
}

impl Input {
    /// Creates the input of files or arrays.
    pub(crate) fn new(paths: Vec<PathBuf>, bytes: Option<Arc<[u8]>>, points: u64, notes: Vec<String>) -> Self {
        let level_store = Arc::new(LevelStore::caching_nodes());
        Self { paths, bytes, points, notes, carried: None, cache: Mutex::default(), level_store }
    }

    /// Returns `result`. If the input is arrays, an error names the argument `points` instead of a file.
    pub(crate) fn named<T>(&self, result: Result<T, Error>) -> Result<T, Error> {
        if self.bytes.is_some() { result.map_err(error_of_arrays) } else { result }
    }

    /// Returns `notes`. If the input is arrays, the notes about the arrays come first, and `notes` name the argument
    /// instead of a file.
    pub(crate) fn named_notes(&self, notes: Vec<String>) -> Vec<String> {
        if self.bytes.is_none() {
            return notes;
        }
        self.notes.iter().cloned().chain(notes.iter().map(|note| of_arrays(note))).collect()
    }

    /// Drops the cached scenes with these options if the options overwrite a colour-bar file, so that the file is
    /// written again.
    pub(crate) fn renew(&self, options: &RenderOptions) {
        if options.splats.force && options.splats.colorbar.is_some() {
            lock(&self.cache).prepared.retain(|prepared| prepared.options != *options);
        }
    }

    /// Reads the scene embedded in an image, and the flags with which the image was drawn.
    pub(crate) fn of_picture(path: PathBuf) -> Result<(Self, Vec<(String, String)>), Error> {
        let image = surfel_io::read_image(&path)?;
        let text = |key: &str| image.metadata.iter().find(|(k, _)| k == key).map(|(_, text)| text.clone());
        let unsuitable = |problem: &str| Error::Unsuitable { path: path.clone(), problem: problem.to_owned() };
        let Some(carried) = text(metadata::SCENE_KEY) else {
            return Err(unsuitable("carries no scene, expected a PNG or EXR that surfel drew with metadata"));
        };
        let drawn = text(metadata::DRAWN_KEY).unwrap_or_else(|| "{}".to_owned());
        let drawn: serde_json::Map<String, serde_json::Value> =
            serde_json::from_str(&drawn).map_err(|_| unsuitable("carries damaged flags: copy it again"))?;
        let flags = drawn.into_iter().filter(|(key, _)| {
            matches!(key.as_str(), "backend" | "region" | "samples" | "storage" | "planes" | "label")
        });
        let flags = flags.map(|(key, value)| (key, value.as_str().map_or_else(|| value.to_string(), str::to_owned)));
        let flags = flags.collect();
        Ok((Self { carried: Some(carried), ..Self::new(vec![path], None, 0, Vec::new()) }, flags))
    }

    fn source(&self) -> Result<Source, Error> {
        let (Some(text), Some(name)) = (&self.carried, self.paths.first()) else {
            return Source::of(&self.paths, self.bytes.as_deref());
        };
        let (file, keys) = surfel_load::scene::parse_scene_file(text.as_bytes(), name)?;
        let base = name.parent().unwrap_or(Path::new("")).to_path_buf();
        Ok(Source::Scene(Box::new(SceneSource { file, keys, name: name.clone(), base })))
    }

    /// Prepares the input's scene with the options: loads it, and chooses camera and lights. Returns the cached scene
    /// if one was prepared with the same options, and for the same images if only parts of files were read for these.
    pub(crate) fn prepare(
        &self,
        options: &RenderOptions,
        pictures: &Arc<Pictures>,
        threads: usize,
        progress: &dyn Progress,
    ) -> Result<Arc<Prepared>, Error> {
        self.named(self.prepare_unnamed(options, pictures, threads, progress))
    }

    fn prepare_unnamed(
        &self,
        options: &RenderOptions,
        pictures: &Arc<Pictures>,
        threads: usize,
        progress: &dyn Progress,
    ) -> Result<Arc<Prepared>, Error> {
        let mut cache = lock(&self.cache);
        let is_read_for = |known: &Arc<Pictures>| Arc::ptr_eq(known, pictures) || known == pictures;
        let suits = |p: &&Arc<Prepared>| p.options == *options && p.read_for.as_ref().is_none_or(is_read_for);
        if let Some(found) = cache.prepared.iter().find(suits) {
            return Ok(found.clone());
        }
        let request = Request::new(self.source()?, pictures, options)?
            .with_stdin(self.bytes.clone())
            .with_level_store(self.level_store.clone());
        let key = format!("{:?} {:?}", request.objects(), request.load_options());
        let loaded = match &cache.loaded {
            Some((known, loaded)) if *known == key => loaded.clone(),
            _ => {
                // The old scene is freed first.
                *cache = Cache::default();
                memory::check_splats(self.points, &options.splats, threads)?;
                let loaded = on_threads(threads, || request.load(progress))??;
                cache.loaded = Some((key, loaded.clone()));
                loaded
            }
        };
        let mut notes = Vec::new();
        let read_for = loaded.facts.iter().any(|facts| facts.partial).then(|| pictures.clone());
        let resolve = || request.resolve(loaded, progress, &mut |note| notes.push(note));
        let resolved = on_threads(threads, resolve)??;
        let summary = summary_of(&resolved.scene);
        let (options, resident) = (options.clone(), Mutex::default());
        let notes = self.named_notes(notes).into();
        let (beside, bytes) = (resolved.beside.clone(), self.bytes.clone());
        let files = Arc::new(Files { beside, bytes, known: Mutex::default() });
        let prepared = Arc::new(Prepared { options, read_for, resolved, summary, notes, resident, files });
        cache.prepared.truncate(KEPT);
        cache.prepared.insert(0, prepared.clone());
        Ok(prepared)
    }
}

/// Draws an image of the input.
pub(crate) fn draw(input: &Arc<Input>, job: &Job, from: &From, progress: &dyn Progress) -> Result<Drawn, Error> {
    input.named(draw_unnamed(input, job, from, progress))
}

fn draw_unnamed(input: &Arc<Input>, job: &Job, from: &From, progress: &dyn Progress) -> Result<Drawn, Error> {
    let prepared = input.prepare(&job.options, &job.pictures, job.who.options.threads, progress)?;
    draw_prepared(&prepared, job, from)
}

/// Draws an image of a prepared scene.
pub(crate) fn draw_prepared(prepared: &Prepared, job: &Job, from: &From) -> Result<Drawn, Error> {
    let (options, threads) = (&job.options, job.who.options.threads);
    let Resolved { file, scene, .. } = &prepared.resolved;
    let (camera, moved) = match from {
        From::Options => (file.camera.clone(), None),
        From::Camera(camera, true) => (camera::with_near(camera.clone(), scene), None),
        From::Camera(camera, false) => (camera.clone(), None),
        From::Picture(index) => prepared.resolved.picture(&job.pictures, *index),
    };
    let view = camera::view(&camera, options)?;
    let refuses = |c: &Capabilities| {
        unsupported(&prepared.summary, &file.settings, job.planes, c).map(|missing| missing.to_string())
    };
    let mut who = job.who.clone();
    if options.samples.is_some() {
        if !matches!(who.name.as_str(), "auto" | "reference") {
            return Err(Error::Usage(format!("--samples needs --backend reference, found {}", who.name)));
        }
        who.name = "reference".to_owned();
    }
    let mut taken = PooledBackend::new(&who, refuses)?;
    let backend = taken.backend()?;
    let (samples, name) = (options.samples.unwrap_or(1), backend.info().backend);
    let shadow_maps = file.lights.iter().flatten().filter(|light| light.casts_shadow()).count();
    memory::check_image(&view, samples, shadow_maps, job.planes, (name, threads), options.splats.memory)?;
    let quantised = who.options.quantised;
    let resident = match &moved {
        Some(moved) => Arc::new(backend.upload(moved)?),
        None => prepared.resident((backend.info().backend, quantised), scene, backend)?,
    };
    let mut frame = Frame::default();
    let stats = backend.render_sampled(&resident, &view, &file.settings, job.planes, options.samples, &mut frame)?;
    let drawn = metadata::drawn(options, &camera, quantised, backend.info())?;
    let lights = moved.map_or_else(|| file.lights.clone(), |moved| moved.lights);
    let scene = SceneFile { camera, lights, ..file.clone() };
    let fits_depth = match from {
        From::Camera(_, fits) => *fits,
        From::Options | From::Picture(_) => match &options.camera {
            Some(given) => given.fits_depth(),
            None => !prepared.resolved.has_own_camera,
        },
    };
    drop(taken);
    let (notes, files) = (prepared.notes.clone(), prepared.files.clone());
    Ok(Drawn { frame, stats, recipe: Recipe { notes, files, scene, drawn, fits_depth } })
}

impl Prepared {
    /// Wraps a scene that is drawn only once, and not cached.
    pub(crate) fn alone(resolved: Resolved, notes: Vec<String>) -> Self {
        let summary = summary_of(&resolved.scene);
        let files = Arc::new(Files { beside: resolved.beside.clone(), ..Files::default() });
        let (options, resident, notes) = (RenderOptions::default(), Mutex::default(), notes.into());
        Self { options, read_for: None, resolved, summary, notes, resident, files }
    }

    fn resident(
        &self,
        key: (&'static str, bool),
        scene: &Scene,
        backend: &mut surfel_backend::Backend,
    ) -> Result<Arc<BackendScene>, Error> {
        let mut resident = lock(&self.resident);
        if let Some((known, found)) = resident.as_ref()
            && *known == key
        {
            return Ok(found.clone());
        }
        *resident = None;
        let uploaded = Arc::new(backend.upload(scene)?);
        *resident = Some((key, uploaded.clone()));
        Ok(uploaded)
    }
}

impl Recipe {
    /// Returns the files from which the image was drawn, with their hashes.
    fn inputs(&self) -> Result<Vec<metadata::Input>, Error> {
        let mut known = lock(&self.files.known);
        if let Some(inputs) = known.as_ref() {
            return Ok(inputs.clone());
        }
        let of_bytes = self.scene.objects.iter().flat_map(|o| [&o.splats, &o.mesh]).flatten();
        let bytes = self.files.bytes.as_deref().filter(|_| of_bytes.into_iter().any(|path| is_stdin(path)));
        let inputs = metadata::inputs(&self.scene, &self.files.beside, bytes)?;
        Ok(known.insert(inputs).clone())
    }

    /// Returns the metadata of an image that is written to `folder`; empty if a path isn't UTF-8.
    pub(crate) fn entries(
        &self,
        folder: &Path,
        format: &[(&str, serde_json::Value)],
        is_exr: bool,
    ) -> Result<Vec<(String, String)>, Error> {
        let mut drawn = self.drawn.clone();
        drawn.extend(format.iter().map(|(key, value)| ((*key).to_owned(), value.clone())));
        let entries = metadata::entries(folder, &self.scene, &self.inputs()?, &drawn, is_exr)?;
        Ok(entries.unwrap_or_default())
    }

    /// Returns the scene file of the image, with paths relative to the current folder.
    pub(crate) fn scene_json(&self) -> Result<String, Error> {
        let text =
            surfel_io::scene_file::to_json_pretty(&surfel_load::paths::relative_to(Path::new("."), &self.scene)?);
        if text.trim().is_empty() { Err(defect()) } else { Ok(text) }
    }

    /// Returns the camera of the scene file as JSON. Near and far planes that were fitted to the scene are omitted.
    pub(crate) fn camera_json(&self) -> Result<String, Error> {
        let mut camera = serde_json::to_value(&self.scene.camera).map_err(|_| defect())?;
        if let (true, Some(keys)) = (self.fits_depth, camera.as_object_mut()) {
            keys.remove("near");
            keys.remove("far");
        }
        Ok(camera.to_string())
    }

    /// Serialises the recipe as JSON, for another process; `None` if a path isn't UTF-8.
    pub(crate) fn to_json(&self) -> Result<Option<String>, Error> {
        let Ok(scene) = serde_json::to_value(&self.scene) else { return Ok(None) };
        let mut inputs = Vec::new();
        for metadata::Input { path, content } in self.inputs()? {
            let Some(path) = path.to_str() else { return Ok(None) };
            inputs.push(match content {
                Content::Known { bytes, sha256 } => json!([path, bytes, sha256]),
                Content::Unknown => json!([path, null, null]),
                Content::Missing => json!([path, null, "missing"]),
            });
        }
        let json = json!({
            "scene": scene, "drawn": self.drawn, "inputs": inputs, "notes": &*self.notes, "fits_depth": self.fits_depth,
        });
        Ok(Some(json.to_string()))
    }

    /// Parses the JSON that [`Recipe::to_json`] returned; `None` if the text isn't such JSON.
    pub(crate) fn from_json(text: &str) -> Option<Self> {
        let json: serde_json::Value = serde_json::from_str(text).ok()?;
        let scene = serde_json::to_vec(json.get("scene")?).ok()?;
        let (scene, _) = surfel_load::scene::parse_scene_file(&scene, Path::new("image")).ok()?;
        let notes = json.get("notes")?.as_array()?.iter().map(|note| note.as_str().map(str::to_owned));
        let inputs = json.get("inputs")?.as_array()?.iter().map(|input| {
            let content = match (input.get(1)?.as_u64(), input.get(2)?.as_str()) {
                (Some(bytes), Some(sha256)) => Content::Known { bytes, sha256: sha256.to_owned() },
                (_, None) => Content::Unknown,
                (None, Some(_)) => Content::Missing,
            };
            Some(metadata::Input { path: input.get(0)?.as_str()?.into(), content })
        });
        let known = Mutex::new(Some(inputs.collect::<Option<_>>()?));
        let files = Arc::new(Files { known, ..Files::default() });
        let (drawn, fits_depth) = (json.get("drawn")?.as_object()?.clone(), json.get("fits_depth")?.as_bool()?);
        Some(Self { notes: notes.collect::<Option<_>>()?, files, scene, drawn, fits_depth })
    }
}
