//! Camera paths from Python.

use std::path::PathBuf;
use surfel_app::film::CameraPath;
use surfel_app::request::RenderOptions;

/// Keys of a camera path: the path of their file, or their content. Both are `None` without a camera path.
pub(crate) type Keys = (Option<PathBuf>, Option<String>);

/// Reads the camera path of these keys; `None` without keys.
pub(crate) fn camera_path(keys: Keys, options: &RenderOptions) -> Result<Option<CameraPath>, surfel_load::Error> {
    match keys {
        (Some(path), _) => CameraPath::read(&path, options).map(Some),
        (None, Some(text)) => CameraPath::parse(text.as_bytes(), "path".as_ref(), options).map(Some),
        (None, None) => Ok(None),
    }
}
