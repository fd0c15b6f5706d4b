//! Conversion of errors to Python exceptions. Messages name options as keyword arguments.

use pyo3::exceptions::{PyMemoryError, PyRuntimeError};
use pyo3::prelude::*;
use std::io::ErrorKind;
use std::path::PathBuf;
use surfel_app::wording::as_keywords;
use surfel_backend::BackendError;
use surfel_io::IoError;
use surfel_io::ShowPath as _;
use surfel_load::Error;
use surfel_render::RenderError;
use surfel_sample::SampleError;

/// Message of the error that [`defect`](crate::interrupt::defect) returns for a panic.
pub(crate) const DEFECT: &str = "this is a defect of surfel, not of your input: please report it";

/// Converts option names in a message to keyword arguments. Flags such as `--depth-tolerance` from `surfel-app` become
/// `depth_tolerance`. Option names in backquotes, from packages below `surfel-app`, are converted by [`as_keywords`].
pub(crate) fn in_python(message: &str) -> String {
    let message = as_keywords(message);
    let mut text = String::with_capacity(message.len());
    let mut rest = message.as_ref();
    while let Some(at) = rest.find("--") {
        let (before, after) = (&rest[..at], &rest[at + 2..]);
        // Dashes within a file name don't begin a flag.
        let begins = !before.ends_with(|c: char| c.is_alphanumeric() || matches!(c, '-' | '/' | '.' | '_'));
        let is_flag = begins && after.starts_with(|c: char| c.is_ascii_lowercase());
        let length = after.find(|c: char| !c.is_ascii_alphanumeric() && c != '-').unwrap_or(after.len());
        text.push_str(before);
        if is_flag {
            text.push_str(&after[..length].replace('-', "_"));
        } else {
            text.push_str("--");
            text.push_str(&after[..length]);
        }
        rest = &after[length..];
    }
    text + rest
}

/// Name of the argument that contains a scene's arrays, in messages.
pub(crate) const ARRAYS: &str = "points";

/// Converts a message about standard input to one about the argument [`ARRAYS`]. Arrays are read as if they were
/// standard input.
pub(crate) fn of_arrays(message: &str) -> String {
    let mut text = String::with_capacity(message.len());
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | '/' | '\\');
    let mut rest = message.strip_prefix("-: ").map_or(message, |rest| {
        text.push_str(ARRAYS);
        text.push_str(": ");
        rest
    });
    while let Some(at) = rest.find("stdin") {
        let (before, after) = (&rest[..at], &rest[at + "stdin".len()..]);
        let is_word = !before.ends_with(is_part) && !after.starts_with(is_part);
        text.push_str(before);
        text.push_str(if is_word { ARRAYS } else { "stdin" });
        rest = after;
    }
    text + rest
}

/// Converts an error about standard input to one about the argument [`ARRAYS`]. Arrays are read as if they were
/// standard input.
pub(crate) fn error_of_arrays(mut error: Error) -> Error {
    let rename = |path: &mut PathBuf| {
        if surfel_load::paths::is_stdin(path) || path.as_os_str() == "stdin" {
            *path = ARRAYS.into();
        }
    };
    match &mut error {
        Error::Io(
            IoError::System { path, .. }
            | IoError::Exists { path }
            | IoError::Invalid { path, .. }
            | IoError::Model { path, .. },
        )
        | Error::Sample { path, .. } => rename(path),
        Error::Unsuitable { path, problem } => {
            rename(path);
            *problem = of_arrays(problem);
        }
        Error::Usage(text) | Error::Input(text) => *text = of_arrays(text),
        _ => {}
    }
    error
}

/// Creates an exception of the Python package, given by its class name. If that fails, returns a `MemoryError` or a
/// `RuntimeError`.
pub(crate) fn exception(py: Python<'_>, class: &str, message: &str) -> PyErr {
    let made = py.import("surfel._errors").and_then(|module| module.getattr(class)?.call1((in_python(message),)));
    match made {
        Ok(value) => PyErr::from_value(value),
        Err(failed) if failed.is_instance_of::<PyMemoryError>(py) => failed,
        Err(_) => PyRuntimeError::new_err(message.to_owned()),
    }
}

/// Returns the pip command that installs the package with a Cargo feature.
pub(crate) fn how_to_build(py: Python<'_>, feature: &str) -> PyResult<String> {
    py.import("surfel._errors")?.call_method1("how_to_build", (feature,))?.extract()
}

/// Creates a `UsageError`.
pub(crate) fn usage(py: Python<'_>, message: &str) -> PyErr {
    exception(py, "UsageError", message)
}

pub(crate) fn raise(py: Python<'_>, error: &Error) -> PyErr {
    let class = match error {
        Error::Io(IoError::System { source, .. }) => {
            // Scripts catch these built-in exception classes.
            let message = in_python(&error.to_string());
            return match source.kind() {
                ErrorKind::NotFound => pyo3::exceptions::PyFileNotFoundError::new_err(message),
                ErrorKind::PermissionDenied => pyo3::exceptions::PyPermissionError::new_err(message),
                ErrorKind::IsADirectory => pyo3::exceptions::PyIsADirectoryError::new_err(message),
                ErrorKind::NotADirectory => pyo3::exceptions::PyNotADirectoryError::new_err(message),
                ErrorKind::OutOfMemory => PyMemoryError::new_err(message),
                _ => pyo3::exceptions::PyOSError::new_err(message),
            };
        }
        Error::Io(IoError::Exists { path }) => {
            let message = format!("{}: already exists: force=True overwrites it; or choose another name", path.shown());
            return pyo3::exceptions::PyFileExistsError::new_err(message);
        }
        Error::Input(text) if text == DEFECT => "Error",
        Error::Usage(_) | Error::Sample { source: SampleError::Option { .. }, .. } => "UsageError",
        Error::Backend(BackendError::NotBuilt { name, feature, available }) => {
            // The message contains flags of pip, which must not become keyword arguments.
            let made =
                py.import("surfel._errors").and_then(|m| m.call_method1("not_built", (name, feature, available)));
            return made.map_or_else(|failed| failed, PyErr::from_value);
        }
        Error::Backend(_) | Error::Render(RenderError::Unsupported { .. }) => "BackendError",
        e if e.is_bad_input() => "InputError",
        _ => "Error",
    };
    exception(py, class, &error.to_string())
}
