//! Drawing for the viewer's page in a notebook.

use crate::errors;
use crate::interrupt;
use crate::memory::py_bytes;
use crate::scene::{Flags, NativeScene};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use surfel_load::Error;
use surfel_view::{Config, Message, Painter};

/// Returns the HTML of the page for a widget's frame.
#[pyfunction]
pub(crate) fn widget_page(py: Python<'_>) -> PyResult<String> {
    surfel_view::page_in_frame().map_err(|problem| errors::usage(py, &problem))
}

/// Painter that answers the requests of a page. A request is JSON; an answer is JSON, or a header with a file.
#[pyclass(frozen, module = "surfel._native", name = "Painter")]
pub(crate) struct NativePainter {
    painter: Arc<Mutex<Painter>>,
}

#[pymethods]
impl NativePainter {
    /// Creates a painter of a scene. `flags` are the initial options of the page.
    #[new]
    fn new(py: Python<'_>, scene: &NativeScene, flags: Flags, threads: usize) -> PyResult<Self> {
        let input = &scene.input;
        let (inputs, stdin) = (input.paths.clone(), input.bytes.clone());
        let config = Config { inputs, stdin, flags, threads, ..Config::default() };
        let painter = Painter::new(&config).map_err(|problem| errors::usage(py, &problem))?;
        Ok(Self { painter: Arc::new(Mutex::new(painter)) })
    }

    /// Returns the first message to the page.
    fn welcome(&self) -> String {
        self.painter.lock().unwrap_or_else(PoisonError::into_inner).welcome()
    }

    /// Answers a request. Returns JSON as text, or a header with a file as bytes.
    fn answer<'py>(&self, py: Python<'py>, request: String) -> PyResult<Bound<'py, PyAny>> {
        let painter = self.painter.clone();
        let answer = interrupt::run(py, move |_| {
            Ok::<_, Error>(painter.lock().unwrap_or_else(PoisonError::into_inner).answer(&request))
        })?;
        match answer {
            Message::Text(text) => Ok(text.into_pyobject(py)?.into_any()),
            Message::Binary(bytes) => Ok(py_bytes(py, &bytes)?.into_any()),
        }
    }
}
