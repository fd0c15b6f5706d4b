//! Images from many cameras, drawn several at a time and returned in order.

use crate::draw::{Drawn, From, Input, Job, draw};
use crate::errors;
use crate::frame::NativeFrame;
use crate::interrupt::{self, TICK, defect};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use surfel_load::Error;
use surfel_model::Camera;
use surfel_sample::NoProgress;

/// Maximum number of images drawn at a time, since each image needs its own memory.
const MOST: usize = 4;

/// Cameras of several images.
pub(crate) enum Views {
    /// List of cameras with their names. The flag is true if near and far planes are fitted to the scene.
    Cameras(Vec<(String, Camera, bool)>),
    /// Number of frames of a turntable or a camera path.
    Frames(u32),
}

impl Views {
    fn len(&self) -> usize {
        match self {
            Self::Cameras(cameras) => cameras.len(),
            Self::Frames(frames) => *frames as usize,
        }
    }

    /// Returns the name and the source of an image's camera; `None` if there is no image with this index.
    fn get(&self, index: usize) -> Option<(String, From)> {
        match self {
            Self::Cameras(cameras) => {
                let (name, camera, fits) = cameras.get(index)?;
                Some((name.clone(), From::Camera(camera.clone(), *fits)))
            }
            Self::Frames(frames) => {
                let index = u32::try_from(index).ok().filter(|index| index < frames)?;
                Some((format!("{index:04}"), From::Picture(index)))
            }
        }
    }
}

/// Progress of drawing several images, which the drawing threads and the iterator share.
#[derive(Default)]
struct State {
    /// Index of the image that is drawn next.
    next: usize,
    /// Index of the image that is returned next.
    given: usize,
    /// Drawn images that wait to be returned, by index.
    done: BTreeMap<usize, Result<Drawn, Error>>,
    /// True if the drawing threads end without beginning another image.
    over: bool,
}

/// Data that the drawing threads share with the iterator over the images.
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    views: Arc<Views>,
    /// Maximum number of images that are being drawn or wait to be returned. It limits the memory.
    ahead: usize,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Draws images until all are drawn, the iterator is closed, or it has returned an error.
    fn work(&self, input: &Arc<Input>, job: &Job) {
        loop {
            let mut state = self.lock();
            while !state.over && state.next < self.views.len() && state.next >= state.given + self.ahead {
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
            if state.over || state.next >= self.views.len() {
                return;
            }
            let index = state.next;
            state.next += 1;
            drop(state);
            let Some((_, from)) = self.views.get(index) else { return };
            let drawn = catch_unwind(AssertUnwindSafe(|| draw(input, job, &from, &NoProgress)));
            self.lock().done.insert(index, drawn.unwrap_or_else(|_| Err(defect())));
            self.changed.notify_all();
        }
    }
}

/// Images of a scene that are drawn on request.
#[pyclass(frozen, module = "surfel._native", name = "Many")]
pub(crate) struct NativeMany {
    pub(crate) input: Arc<Input>,
    pub(crate) job: Job,
    pub(crate) views: Arc<Views>,
}

#[pymethods]
impl NativeMany {
    fn __len__(&self) -> usize {
        self.views.len()
    }

    /// Returns the name of an image's camera.
    fn name(&self, py: Python<'_>, index: usize) -> PyResult<String> {
        Ok(self.of(py, index)?.0)
    }

    /// Draws the image with this index.
    fn draw(&self, py: Python<'_>, index: usize) -> PyResult<NativeFrame> {
        let (input, job, from) = (self.input.clone(), self.job.clone(), self.of(py, index)?.1);
        NativeFrame::new(py, interrupt::run(py, move |progress| draw(&input, &job, &from, progress))?)
    }

    /// Starts drawing all images, several at a time. Returns an iterator over them.
    fn start(&self, py: Python<'_>) -> PyResult<NativeFrames> {
        self.input.renew(&self.job.options);
        NativeFrames::start(py, self.input.clone(), self.job.clone(), self.views.clone())
    }
}

impl NativeMany {
    fn of(&self, py: Python<'_>, index: usize) -> PyResult<(String, From)> {
        let none = || errors::usage(py, &format!("there is no image {index} among {}", self.views.len()));
        self.views.get(index).ok_or_else(none)
    }
}

/// Iterator over images in order, while the next ones are drawn.
#[pyclass(frozen, module = "surfel._native", name = "Frames")]
pub(crate) struct NativeFrames(Arc<Shared>);

impl NativeFrames {
    /// Starts the drawing threads, and returns the iterator over the images.
    fn start(py: Python<'_>, input: Arc<Input>, job: Job, views: Arc<Views>) -> PyResult<Self> {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = if job.who.options.threads == 0 { all } else { job.who.options.threads };
        // A GPU draws one image at a time. So does a film, because its lights move and the scene is uploaded again for
        // each image.
        let is_film = matches!(*views, Views::Frames(_));
        let alone = matches!(job.who.name.as_str(), "wgpu" | "ash") || is_film;
        let workers = if alone { 1 } else { threads.min(MOST).min(views.len()).max(1) };
        let shared = Shared { state: Mutex::default(), changed: Condvar::new(), views, ahead: workers + 1 };
        // If a thread doesn't start, this value is dropped, which ends the threads that did start.
        let frames = Self(Arc::new(shared));
        for _ in 0..workers {
            let (shared, input, mut job) = (frames.0.clone(), input.clone(), job.clone());
            if !alone {
                job.who.options.threads = (threads / workers).max(1);
            }
            let started = interrupt::spawn(move || shared.work(&input, &job));
            started.map_err(|error| errors::raise(py, &error))?;
        }
        Ok(frames)
    }
}

#[pymethods]
impl NativeFrames {
    /// Returns the next image with the name of its camera; None after the last.
    fn next(&self, py: Python<'_>) -> PyResult<Option<(String, NativeFrame)>> {
        loop {
            let shared = self.0.clone();
            let found = py.detach(move || {
                let mut state = shared.lock();
                let index = state.given;
                let (name, _) = shared.views.get(index).filter(|_| !state.over)?;
                if !state.done.contains_key(&index) {
                    let waited = shared.changed.wait_timeout(state, TICK);
                    state = waited.unwrap_or_else(PoisonError::into_inner).0;
                }
                let index = state.given;
                let drawn = state.done.remove(&index);
                if drawn.is_some() {
                    state.given += 1;
                    state.over |= drawn.as_ref().is_some_and(Result::is_err);
                    shared.changed.notify_all();
                }
                Some((name, drawn))
            });
            match found {
                None => return Ok(None),
                Some((name, Some(Ok(drawn)))) => return Ok(Some((name, NativeFrame::new(py, drawn)?))),
                Some((name, Some(Err(error)))) => {
                    let error = errors::raise(py, &error);
                    let note = format!("camera {name}");
                    // Python 3.11 and later show notes of exceptions; earlier versions don't.
                    let _ = error.value(py).call_method1("add_note", (note,));
                    return Err(error);
                }
                Some((_, None)) => py.check_signals()?,
            }
        }
    }

    /// Ends drawing after the images in progress.
    fn close(&self) {
        self.0.lock().over = true;
        self.0.changed.notify_all();
    }
}

impl Drop for NativeFrames {
    fn drop(&mut self) {
        self.close();
    }
}
