//! Errors of reading, converting and drawing files.

use std::path::PathBuf;
use surfel_io::IoError;
use surfel_io::ShowPath as _;
use surfel_model::ModelError;
use surfel_render::{BackendError, RenderError};
use surfel_sample::SampleError;

/// An error of this crate or a package below it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file can't be read or written, or is damaged.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A number of a scene, camera or setting is out of range.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A file's points or triangles can't be converted to splats.
    #[error("{}: {source}", .path.shown())]
    Sample {
        /// Path of the file.
        path: PathBuf,
        /// Reason why no splats could be made.
        source: SampleError,
    },
    /// A file was read, but its content is unsuitable for its use.
    #[error("{}: {problem}", .path.shown())]
    Unsuitable {
        /// Path of the file.
        path: PathBuf,
        /// Description of what was found and expected, and how to fix it.
        problem: String,
    },
    /// Options contradict each other, lack another option, or have no effect.
    #[error("{0}")]
    Usage(String),
    /// The input as a whole is unsuitable, such as two images of different sizes.
    #[error("{0}")]
    Input(String),
    /// An image couldn't be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The backend isn't available on this machine or in this program.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

impl Error {
    /// True if the input caused the error: a file that is missing, damaged or breaks a rule.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Io(e) => e.is_bad_input(),
            Self::Model(_) | Self::Unsuitable { .. } | Self::Input(_) | Self::Render(RenderError::Model(_)) => true,
            Self::Sample { source, .. } => !matches!(source, SampleError::Option { .. }),
            Self::Render(_) | Self::Backend(_) | Self::Usage(_) => false,
        }
    }
}
