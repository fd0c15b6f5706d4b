//! Scenes in Python, and parsing of their arguments.

use crate::camera_path::{Keys, camera_path};
use crate::draw::{From, Input, Job, draw};
use crate::errors;
use crate::frame::NativeFrame;
use crate::interrupt;
use crate::many::{NativeMany, Views};
use crate::memory;
use crate::memory::py_bytes;
use crate::pool::BackendRequest;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_app::camera;
use surfel_app::render_options::CameraSource;
use surfel_app::request::{Pictures, RenderOptions};
use surfel_app::values;
use surfel_backend::BackendOptions;
use surfel_load::Error;
use surfel_model::{Camera, Light, Scene};
use surfel_render::Planes;

/// Maximum number of lights. Each light may need a shadow map.
const MAX_LIGHTS: usize = 256;

/// Options as pairs of long name and value, both as text.
pub(crate) type Flags = Vec<(String, String)>;

/// Scene: the paths of its files, or the bytes of a file.
#[pyclass(frozen, module = "surfel._native", name = "Scene")]
pub(crate) struct NativeScene {
    pub(crate) input: Arc<Input>,
}

/// Creates the exception for a keyword argument with an invalid value.
pub(crate) fn wrong(py: Python<'_>, flag: &str, text: &str, message: &str) -> PyErr {
    errors::usage(py, &format!("{}={text}: {message}", flag.replace('-', "_")))
}

/// Parses flags into the settings of an image.
pub(crate) fn job(py: Python<'_>, flags: &Flags, planes: &[String], cameras: bool, turntable: bool) -> PyResult<Job> {
    let mut options = RenderOptions::default();
    let mut who = BackendRequest { name: "auto".to_owned(), options: BackendOptions::default() };
    for (flag, text) in flags {
        match flag.as_str() {
            "camera-object" => {
                let (camera, fits_depth) = camera_of(text).map_err(|message| errors::usage(py, &message))?;
                options.camera = Some(CameraSource::Given { camera: Box::new(camera), fits_depth });
            }
            "lights" => options.lights = Some(lights(text).map_err(|message| errors::usage(py, &message))?),
            "force" => {
                options.splats.force = values::switch(text).map_err(|message| wrong(py, flag, text, &message))?;
            }
            _ => {
                let set = who.set(flag, text).and_then(|set| if set { Ok(()) } else { options.set(flag, text) });
                set.map_err(|message| wrong(py, flag, text, &message))?;
            }
        }
    }
    options.cameras = cameras;
    options.turntable = turntable;
    let mut wanted = Planes::default();
    for plane in planes {
        wanted = match plane.as_str() {
            "color" => wanted.with_color(true),
            "depth" => wanted.with_depth(true),
            "normal" => wanted.with_normal(true),
            "weight" => wanted.with_weight(true),
            more if RenderOptions::MORE_PLANES.contains(&more) => {
                options.planes.push(more.to_owned());
                wanted
            }
            _ => {
                let nearest = RenderOptions::MORE_PLANES.join(", ");
                let expected = format!("expected some of color, depth, normal, weight, {nearest}");
                return Err(wrong(py, "planes", plane, &expected));
            }
        };
    }
    let wanted = options.planes_besides(wanted);
    if wanted == Planes::default() {
        return Err(errors::usage(py, "planes=[]: expected one at least, such as color or depth"));
    }
    Ok(Job { options, pictures: Arc::default(), who, planes: wanted })
}

/// Parses the camera object of a scene file. The flag is true if it has neither a near nor a far plane, so that both
/// are fitted to the scene.
fn camera_of(json: &str) -> Result<(Camera, bool), String> {
    let mut value: serde_json::Value = serde_json::from_str(json).map_err(|e| format!("camera: {e}"))?;
    let keys = value.as_object_mut().ok_or("camera: expected an object")?;
    let fits_depth = !keys.contains_key("near") && !keys.contains_key("far");
    if fits_depth {
        // A parallel projection requires both planes. These placeholders are replaced when the scene is known.
        keys.insert("near".to_owned(), 1.0.into());
        keys.insert("far".to_owned(), 2.0.into());
    }
    let camera: Camera = serde_json::from_value(value).map_err(|e| format!("camera: {e}"))?;
    camera.validate().map_err(|e| e.to_string())?;
    Ok((camera, fits_depth))
}

/// Parses the list of lights of a scene file.
fn lights(json: &str) -> Result<Vec<Light>, String> {
    let listed: Vec<serde_json::Value> = serde_json::from_str(json).map_err(|e| format!("lights: {e}"))?;
    if listed.len() > MAX_LIGHTS {
        return Err(format!("lights: {} of them, expected at most {MAX_LIGHTS}", listed.len()));
    }
    let mut lights = Vec::new();
    for (i, value) in listed.into_iter().enumerate() {
        let light: Light = serde_json::from_value(value).map_err(|e| format!("lights[{i}]: {e}"))?;
        lights.push(light);
    }
    let scene = Scene { lights: Some(lights), ..Scene::default() };
    scene.validate().map_err(|e| e.to_string())?;
    Ok(scene.lights.unwrap_or_default())
}

/// Reads cameras from a file, a folder, or JSON. The JSON is a list of cameras in a supported file format, or of
/// objects with the `camera` of a scene file. Returns each camera with its name, and true if near and far planes are
/// fitted to the scene.
fn cameras(
    (path, json): (Option<PathBuf>, Option<String>),
    size: Option<[u32; 2]>,
) -> Result<Vec<(String, Camera, bool)>, Error> {
    let Some(json) = json else {
        let found = path.map(|path| camera::named(&path, size)).transpose()?.unwrap_or_default();
        return Ok(found.into_iter().map(|(name, camera)| (name, camera, true)).collect());
    };
    let wrong = |e: serde_json::Error| Error::Usage(format!("cameras: {e}"));
    let mut listed: Vec<serde_json::Value> = match serde_json::from_str(&json).map_err(wrong)? {
        serde_json::Value::Array(listed) => listed,
        one => vec![one],
    };
    // Cameras given by matrices are parsed together. Cameras of scene files are then inserted at their positions.
    let own: Vec<Option<serde_json::Value>> =
        listed.iter_mut().map(|camera| camera.as_object_mut().and_then(|keys| keys.remove("camera"))).collect();
    let names: Vec<String> = listed.iter().map(|camera| camera["name"].as_str().unwrap_or("").to_owned()).collect();
    let mut places = own.iter();
    listed.retain(|_| places.next().is_none_or(Option::is_none));
    let mut of_matrices = if listed.is_empty() {
        Vec::new().into_iter()
    } else {
        let text = serde_json::Value::Array(listed).to_string();
        camera::named_in_json(text.as_bytes(), Path::new("camera"), size)?.into_iter()
    };
    let mut found = Vec::new();
    for (i, (own, name)) in own.into_iter().zip(names).enumerate() {
        found.push(match own {
            Some(own) => {
                let of = |message: String| Error::Usage(format!("cameras[{i}]: {message}"));
                let (camera, fits_depth) = camera_of(&own.to_string()).map_err(of)?;
                let camera = size.map_or_else(|| camera.clone(), |size| camera.clone().with_size(size));
                (name, camera, fits_depth)
            }
            None => {
                let (name, camera) = of_matrices.next().ok_or_else(interrupt::defect)?;
                (name, camera, true)
            }
        });
    }
    Ok(found)
}

#[pymethods]
impl NativeScene {
    #[new]
    fn new(
        py: Python<'_>,
        paths: Vec<PathBuf>,
        bytes: Option<PyReadonlyArray1<'_, u8>>,
        points: u64,
        notes: Vec<String>,
    ) -> PyResult<Self> {
        let bytes = bytes.as_ref().map(|bytes| bytes.as_slice()).transpose()?;
        let fits = bytes.map(|bytes| memory::check("points", bytes.len() as u64, 1, None)).transpose();
        fits.map_err(|error| errors::raise(py, &error))?;
        Ok(Self { input: Arc::new(Input::new(paths, bytes.map(Arc::from), points, notes)) })
    }

    /// Returns the bytes of the file that arrays were converted to; None without arrays.
    fn data<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        self.input.bytes.as_ref().map(|bytes| py_bytes(py, bytes)).transpose()
    }

    /// Returns the number of points in the arrays; 0 if unknown.
    fn points(&self) -> u64 {
        self.input.points
    }

    /// Returns the messages for the user on how the Python arrays that the scene was made from were found and
    /// converted.
    fn notes(&self) -> Vec<String> {
        self.input.notes.clone()
    }

    /// Reads the scene embedded in an image, and the flags with which the image was drawn.
    #[staticmethod]
    fn of_picture(py: Python<'_>, path: PathBuf) -> PyResult<(Self, Flags)> {
        let (input, flags) = Input::of_picture(path).map_err(|error| errors::raise(py, &error))?;
        Ok((Self { input: Arc::new(input) }, flags))
    }

    /// Draws one image. `camera` is JSON of a camera with the matrices K, R and t, whose near and far planes are fitted
    /// to the scene; `None` uses the camera of the options.
    fn render(
        &self,
        py: Python<'_>,
        flags: Flags,
        planes: Vec<String>,
        camera: Option<String>,
    ) -> PyResult<NativeFrame> {
        let mut job = job(py, &flags, &planes, camera.is_some(), false)?;
        let from = match camera {
            None => From::Options,
            Some(json) => {
                let found = cameras((None, Some(json)), job.options.size).map_err(|error| errors::raise(py, &error))?;
                let first = found.into_iter().next().map(|(_, camera, _)| camera);
                let camera = first.ok_or_else(|| errors::usage(py, "K: holds no camera"))?;
                job.pictures = Arc::new(Pictures::Cameras(vec![camera.clone()]));
                From::Camera(camera, true)
            }
        };
        let input = self.input.clone();
        input.renew(&job.options);
        let drawn = interrupt::run(py, move |progress| draw(&input, &job, &from, progress))?;
        NativeFrame::new(py, drawn)
    }

    /// Creates the images for all cameras of a file, a folder or JSON, or for the frames of a turntable or a camera
    /// path.
    fn many(
        &self,
        py: Python<'_>,
        flags: Flags,
        planes: Vec<String>,
        path: Option<PathBuf>,
        json: Option<String>,
        moving: (Option<u32>, Keys),
    ) -> PyResult<NativeMany> {
        let (frames, keys) = moving;
        let moves = keys != (None, None);
        let mut job = job(py, &flags, &planes, frames.is_none(), frames.is_some() && !moves)?;
        let keys = camera_path(keys, &job.options).map_err(|error| errors::raise(py, &error))?;
        let views = match (frames, keys) {
            // The Python half of the package checks this number.
            (Some(frames), Some(path)) => {
                let cameras = path.cameras(frames).map_err(|error| errors::raise(py, &error))?;
                job.pictures = Arc::new(Pictures::Path(cameras));
                Views::Frames(frames)
            }
            (Some(frames), None) => {
                job.pictures = Arc::new(Pictures::Turn(frames));
                Views::Frames(frames)
            }
            (None, _) => {
                let found = cameras((path, json), job.options.size).map_err(|error| errors::raise(py, &error))?;
                let all = found.iter().map(|(_, camera, _)| camera.clone()).collect();
                job.pictures = Arc::new(Pictures::Cameras(all));
                Views::Cameras(found)
            }
        };
        Ok(NativeMany { input: self.input.clone(), job, views: Arc::new(views) })
    }

    /// Prepares the scene before the first image: loads it, and chooses camera and lights. Returns notes.
    fn prepare(&self, py: Python<'_>, flags: Flags) -> PyResult<Vec<String>> {
        let job = job(py, &flags, &["color".to_owned()], false, false)?;
        let input = self.input.clone();
        let threads = job.who.options.threads;
        let prepared =
            interrupt::run(py, move |progress| input.prepare(&job.options, &job.pictures, threads, progress))?;
        Ok(prepared.notes.iter().map(|note| errors::in_python(note)).collect())
    }
}
