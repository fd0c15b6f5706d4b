//! Figures: the command `figure`.

use crate::draw::on_threads;
use crate::errors;
use crate::frame::array;
use crate::interrupt;
use crate::memory::py_bytes;
use crate::pool::{BackendRequest, PooledBackend};
use crate::scene::{Flags, wrong};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use surfel_app::figure::{FigureFormat, FigureImage, FigureRequest, check_output};
use surfel_app::options::{Commands, Options, table};
use surfel_backend::BackendOptions;
use surfel_load::Error;

/// Drawn figure.
#[pyclass(frozen, module = "surfel._native", name = "Figure")]
pub(crate) struct NativeFigure {
    image: FigureImage,
    #[pyo3(get)]
    notes: Vec<String>,
}

#[pymethods]
impl NativeFigure {
    #[getter]
    fn size(&self) -> [u32; 2] {
        self.image.drawing.size
    }

    #[getter]
    fn dpi(&self) -> f64 {
        self.image.dpi
    }

    /// Returns the pixels in 8-bit sRGB with alpha, as in a PNG; None if there are none.
    fn rgba(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let picture = py.detach(|| self.image.drawing.picture());
        let [w, h] = picture.size.map(|side| side as usize);
        array(py, picture.rgba.into_flattened(), 0..4 * w * h, &[h, w, 4])
    }

    /// Encodes the figure as PNG, SVG or PDF; `format` is the file extension.
    fn bytes<'py>(&self, py: Python<'py>, format: &str) -> PyResult<Bound<'py, PyBytes>> {
        let format = FigureFormat::of(format!("figure.{format}").as_ref());
        let format = format.map_err(|error| errors::raise(py, &error))?;
        let bytes = py.detach(|| self.image.bytes(format));
        py_bytes(py, &bytes)
    }

    /// Writes the figure as PDF, SVG or PNG, by the extension of the path.
    fn save(&self, py: Python<'_>, path: PathBuf, force: bool) -> PyResult<()> {
        let saved = py.detach(|| check_output(&path, force).and_then(|_| self.image.save(&path, force)));
        saved.map_err(|error| errors::raise(py, &error))
    }
}

/// Draws a figure.
#[pyfunction]
pub(crate) fn figure(py: Python<'_>, inputs: Vec<PathBuf>, flags: Flags) -> PyResult<NativeFigure> {
    let mut options = Options::default();
    let mut who = BackendRequest { name: "auto".to_owned(), options: BackendOptions::default() };
    for (flag, text) in &flags {
        let set = who.set(flag, text).and_then(|set| match set {
            true => Ok(()),
            false => table().set(&mut options, Commands::FIGURE, flag, text),
        });
        set.map_err(|message| wrong(py, flag, text, &message))?;
    }
    let (image, notes) = interrupt::run(py, move |progress| {
        let Options { render, figure, .. } = &options;
        let request = FigureRequest { inputs: &inputs, render, figure, stdin: None };
        request.check()?;
        let mut notes = Vec::new();
        let image = on_threads(who.options.threads, || {
            let mut taken = PooledBackend::new(&who, |_| None)?;
            request.draw(taken.backend()?, progress, &mut |note| notes.push(note))
        })??;
        Ok::<_, Error>((image, notes))
    })?;
    Ok(NativeFigure { image, notes: notes.iter().map(|note| errors::in_python(note)).collect() })
}
