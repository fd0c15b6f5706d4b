//! Camera paths from Python.

use std::path::PathBuf;
use surfel_app::film::CameraPath;
use surfel_app::request::RenderOptions;

/// Cameras of a path: a file, or its content.
pub(crate) type Keys = (Option<PathBuf>, Option<String>);

/// Reads a camera path.
pub(crate) fn camera_path(keys: Keys, options: &RenderOptions) -> Result<Option<CameraPath>, surfel_load::Error> {
    match keys {
        (Some(path), _) => CameraPath::read(&path, options).map(Some),
        (None, Some(text)) => CameraPath::parse(text.as_bytes(), "path".as_ref(), options).map(Some),
        (None, None) => Ok(None),
    }
}
