//! Scenes as Python sees them, and their arguments.

use crate::draw::{From, Input, Job, draw};
use crate::errors;
use crate::frame::NativeFrame;
use crate::interrupt;
use crate::many::NativeMany;
use crate::pool::Who;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel::request::{Pictures, RenderOptions};
use surfel::{BackendOptions, Camera, Error, Planes, camera};

/// Flags by their names, as texts.
pub(crate) type Flags = Vec<(String, String)>;

/// Files, or the bytes of one, that make one scene.
#[pyclass(frozen, module = "surfel._native", name = "Scene")]
pub(crate) struct NativeScene {
    pub(crate) input: Arc<Input>,
}

/// What a wrong text of an argument is told.
pub(crate) fn wrong(py: Python<'_>, flag: &str, text: &str, message: &str) -> PyErr {
    errors::usage(py, &format!("{}={text}: {message}", flag.replace('-', "_")))
}

/// What the flags ask for.
pub(crate) fn job(py: Python<'_>, flags: &Flags, planes: &[String], cameras: bool, turntable: bool) -> PyResult<Job> {
    let mut options = RenderOptions::default();
    let mut who = Who { name: "auto".to_owned(), options: BackendOptions::default() };
    for (flag, text) in flags {
        let set = who.set(flag, text).and_then(|set| if set { Ok(()) } else { options.set(flag, text) });
        set.map_err(|message| wrong(py, flag, text, &message))?;
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

/// Cameras of a file or folder, or of JSON's text.
pub(crate) fn cameras(
    (path, json): (Option<PathBuf>, Option<String>),
    size: Option<[u32; 2]>,
) -> Result<Vec<(String, Camera)>, Error> {
    match (path, json) {
        (Some(path), _) => camera::named(&path, size),
        (None, Some(json)) => camera::named_in_json(json.as_bytes(), Path::new("camera"), size),
        (None, None) => Ok(Vec::new()),
    }
}

#[pymethods]
impl NativeScene {
    #[new]
    fn new(paths: Vec<PathBuf>, bytes: Option<PyReadonlyArray1<'_, u8>>) -> PyResult<Self> {
        let bytes = bytes.as_ref().map(|bytes| bytes.as_slice().map(Arc::from)).transpose()?;
        Ok(Self { input: Arc::new(Input::new(paths, bytes)) })
    }

    /// The bytes of its arrays' file.
    fn data<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        self.input.bytes.as_ref().map(|bytes| PyBytes::new(py, bytes))
    }

    /// The scene of a picture, and the flags that it was drawn by.
    #[staticmethod]
    fn of_picture(py: Python<'_>, path: PathBuf) -> PyResult<(Self, Flags)> {
        let (input, flags) = Input::of_picture(path).map_err(|error| errors::raise(py, &error))?;
        Ok((Self { input: Arc::new(input) }, flags))
    }

    /// Draws one image; `camera` is JSON of K, R and t.
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
                let first = found.into_iter().next().map(|(_, camera)| camera);
                let camera = first.ok_or_else(|| errors::usage(py, "K: holds no camera"))?;
                job.pictures = Arc::new(Pictures::Cameras(vec![camera.clone()]));
                From::Camera(camera)
            }
        };
        let input = self.input.clone();
        let drawn = interrupt::run(py, move |progress| draw(&input, &job, &from, progress))?;
        NativeFrame::new(py, drawn)
    }

    /// An image from each camera of a file, a folder or JSON, or each frame of a turn.
    fn many(
        &self,
        py: Python<'_>,
        flags: Flags,
        planes: Vec<String>,
        path: Option<PathBuf>,
        json: Option<String>,
        frames: Option<u32>,
    ) -> PyResult<NativeMany> {
        let mut job = job(py, &flags, &planes, frames.is_none(), frames.is_some())?;
        let from = match frames {
            Some(frames) => {
                job.pictures = Arc::new(Pictures::Turn(frames));
                (0..frames).map(|index| (format!("{index:04}"), From::Turn(index, frames))).collect()
            }
            None => {
                let found = cameras((path, json), job.options.size).map_err(|error| errors::raise(py, &error))?;
                let all = found.iter().map(|(_, camera)| camera.clone()).collect();
                job.pictures = Arc::new(Pictures::Cameras(all));
                found.into_iter().map(|(name, camera)| (name, From::Camera(camera))).collect()
            }
        };
        Ok(NativeMany { input: self.input.clone(), job, from })
    }

    /// Loads, frames and lights the scene, so that the first image needn't.
    fn prepare(&self, py: Python<'_>, flags: Flags) -> PyResult<Vec<String>> {
        let job = job(py, &flags, &["color".to_owned()], false, false)?;
        let input = self.input.clone();
        let threads = job.who.options.threads;
        let prepared =
            interrupt::run(py, move |progress| input.prepare(&job.options, &job.pictures, threads, progress))?;
        Ok(prepared.notes.iter().map(|note| errors::in_python(note)).collect())
    }
}
