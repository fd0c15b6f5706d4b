//! Films from Python: sequences of files, and film files made of frames.

use crate::camera_path::{Keys, camera_path};
use crate::draw::{From, Job, Prepared, draw_prepared, on_threads};
use crate::errors;
use crate::frame::NativeFrame;
use crate::interrupt;
use crate::scene::{Flags, job, wrong};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use surfel_app::film::{FilmEncoder, FilmOptions, FilmWriter, FrameRate, Sequence};
use surfel_app::request::{Pictures, RenderOptions};
use surfel_app::values;

/// Sequence of files, each of which is a frame of a film.
#[pyclass(frozen, module = "surfel._native", name = "Sequence")]
pub(crate) struct NativeSequence {
    sequence: Arc<Sequence>,
    job: Job,
    #[pyo3(get)]
    notes: Vec<String>,
}

#[pymethods]
impl NativeSequence {
    /// Creates a sequence: determines the up axis, camera and other choices that all frames share.
    #[new]
    fn new(py: Python<'_>, paths: Vec<PathBuf>, flags: Flags, turntable: bool, keys: Keys) -> PyResult<Self> {
        let job = job(py, &flags, &["color".to_owned()], false, turntable)?;
        let (options, threads) = (job.options.clone(), job.who.options.threads);
        let (sequence, notes) = interrupt::run(py, move |progress| {
            let count = u32::try_from(paths.len()).unwrap_or(u32::MAX);
            let path = camera_path(keys, &options)?;
            let motion = match path {
                Some(path) => Pictures::Path(path.cameras(count)?),
                None if turntable => Pictures::Turn(count),
                None => Pictures::One,
            };
            let mut notes = Vec::new();
            let survey = || Sequence::survey(&paths, &options, &motion, progress, &mut |note| notes.push(note));
            let sequence = on_threads(threads, survey)??;
            Ok((sequence, notes))
        })?;
        let notes = notes.iter().map(|note| errors::in_python(note)).collect();
        Ok(Self { sequence: Arc::new(sequence), job, notes })
    }

    fn __len__(&self) -> usize {
        self.sequence.len()
    }

    /// Loads and draws the frame with this index.
    fn draw(&self, py: Python<'_>, index: usize) -> PyResult<NativeFrame> {
        let (sequence, job) = (self.sequence.clone(), self.job.clone());
        let drawn = interrupt::run(py, move |progress| {
            let mut notes = Vec::new();
            let load = || sequence.load(index, progress, &mut |note| notes.push(note));
            let resolved = on_threads(job.who.options.threads, load)??;
            draw_prepared(&Prepared::alone(resolved, notes), &job, &From::Options)
        })?;
        NativeFrame::new(py, drawn)
    }
}

/// A film that is being written.
#[pyclass(frozen, module = "surfel._native", name = "Film")]
pub(crate) struct NativeFilm {
    path: PathBuf,
    encoder: FilmEncoder,
    overwrite: bool,
    frames: u32,
    rate: FrameRate,
    writer: Mutex<Option<FilmWriter>>,
}

#[pymethods]
impl NativeFilm {
    /// Finds the encoder for the film's format and creates the film.
    #[new]
    fn new(py: Python<'_>, path: PathBuf, overwrite: bool, frames: u32, fps: &str) -> PyResult<Self> {
        let rate = values::frame_rate(fps).map_err(|message| wrong(py, "fps", fps, &message))?;
        let encoder = FilmEncoder::find(&path).map_err(|error| errors::raise(py, &error.into()))?;
        Ok(Self { path, encoder, overwrite, frames, rate, writer: Mutex::new(None) })
    }

    /// Appends a frame to the film.
    fn push(&self, py: Python<'_>, frame: &NativeFrame) -> PyResult<()> {
        let pushed = frame.with_colors(py, |planes, [r, g, b, _]| {
            let mut writer = self.writer();
            if writer.is_none() {
                let (size, background) = ([planes.width, planes.height], [r, g, b].map(|c| c as f32));
                let options = FilmOptions { size, frames: self.frames, rate: self.rate, background };
                *writer = Some(FilmWriter::create(&self.path, self.overwrite, &self.encoder, &options)?);
            }
            writer.as_mut().map_or(Ok(()), |writer| writer.push(planes))
        })?;
        pushed.map_err(|error| errors::raise(py, &error.into()))
    }

    /// Completes the film and returns the name of its encoder.
    fn finish(&self, py: Python<'_>) -> PyResult<String> {
        let writer = self.writer().take();
        let finished = py.detach(move || writer.map_or(Ok(()), FilmWriter::finish));
        finished.map_err(|error| errors::raise(py, &error.into()))?;
        Ok(self.encoder.to_string())
    }

    /// Stops writing, and removes an incomplete film.
    fn close(&self) {
        let writer = self.writer().take();
        drop(writer);
    }
}

impl NativeFilm {
    fn writer(&self) -> MutexGuard<'_, Option<FilmWriter>> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the number of frames with which a turntable or camera path has its default duration.
#[pyfunction]
pub(crate) fn film_frames(py: Python<'_>, keys: Keys, fps: &str) -> PyResult<u32> {
    let rate = values::frame_rate(fps).map_err(|message| wrong(py, "fps", fps, &message))?;
    // The number doesn't depend on the size of the images, which keys of the path may state differently.
    let mut options = RenderOptions::default();
    options.size = Some([1, 1]);
    let path = camera_path(keys, &options).map_err(|error| errors::raise(py, &error))?;
    Ok(path.map_or_else(|| surfel_app::film::turn_frames(rate), |path| path.frames(rate)))
}
