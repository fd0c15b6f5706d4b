//! What can go wrong between a file and an image.

use crate::BackendError;
use std::path::PathBuf;
use surfel_io::IoError;
use surfel_io::ShowPath as _;
use surfel_model::ModelError;
use surfel_render::RenderError;
use surfel_sample::SampleError;

/// Errors of this crate and of those below it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file can't be read or written, or is damaged.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A number of a scene, camera or setting is out of its range.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No splats could be made of a file's points or triangles.
    #[error("{}: {source}", .path.shown())]
    Sample {
        /// The file.
        path: PathBuf,
        /// Why.
        source: SampleError,
    },
    /// A file was read, but is not what it is used as.
    #[error("{}: {problem}", .path.shown())]
    Unsuitable {
        /// The file.
        path: PathBuf,
        /// What was found, expected, and what to do.
        problem: String,
    },
    /// Options that contradict or need each other, or that nothing has a use for.
    #[error("{0}")]
    Usage(String),
    /// The input, as a whole, is not what is asked for.
    #[error("{0}")]
    Input(String),
    /// No image.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// No such backend here.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

impl Error {
    /// True if the input is at fault: a file that isn't there, is damaged, or breaks a rule.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Io(e) => e.is_bad_input(),
            Self::Model(_) | Self::Unsuitable { .. } | Self::Input(_) | Self::Render(RenderError::Model(_)) => true,
            Self::Sample { source, .. } => !matches!(source, SampleError::Option { .. }),
            Self::Render(_) | Self::Backend(_) | Self::Usage(_) => false,
        }
    }
}
