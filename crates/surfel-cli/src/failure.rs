//! Why a run failed, and with which exit code.

use surfel::io::IoError;
use surfel::render::RenderError;
use surfel::sample::SampleError;
use surfel::{BackendError, Error};

/// A failed run: an exit code and a message of at most four lines.
#[derive(Debug)]
pub(crate) struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    /// Exit code 1.
    pub(crate) fn other(message: impl Into<String>) -> Self {
        Self { code: 1, message: message.into() }
    }

    /// Exit code 2: the command line is at fault.
    pub(crate) fn usage(message: impl Into<String>) -> Self {
        Self { code: 2, message: message.into() }
    }

    /// Exit code 3: the input is at fault.
    pub(crate) fn input(message: impl Into<String>) -> Self {
        Self { code: 3, message: message.into() }
    }

    /// Exit code 4: the backend that was asked for is not here, or doesn't draw what was asked of it.
    pub(crate) fn backend(message: impl Into<String>) -> Self {
        Self { code: 4, message: message.into() }
    }

    /// Exit code 5: a comparison over its threshold.
    pub(crate) fn threshold(message: impl Into<String>) -> Self {
        Self { code: 5, message: message.into() }
    }

    /// Another exit code, that of what happened before.
    pub(crate) fn with_code(code: u8, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }

    /// Writing to stdout failed. A reader that has seen enough and closed its end is no failure.
    pub(crate) fn stdout(error: &std::io::Error) -> Self {
        if error.kind() == std::io::ErrorKind::BrokenPipe {
            return Self { code: 0, message: String::new() };
        }
        Self::other(format!("stdout: cannot write it: {error}"))
    }

    /// The exit code.
    pub(crate) fn code(&self) -> u8 {
        self.code
    }

    /// The message; empty where there is nothing to say.
    pub(crate) fn message(&self) -> &str {
        &self.message
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::Backend(e) => e.into(),
            Error::Render(RenderError::Unsupported { .. }) => Self::backend(message),
            Error::Usage(_) | Error::Sample { source: SampleError::Option { .. }, .. } => Self::usage(message),
            e if e.is_bad_input() => Self::input(message),
            _ => Self::other(message),
        }
    }
}

impl From<IoError> for Failure {
    fn from(error: IoError) -> Self {
        Error::from(error).into()
    }
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Self {
        Error::from(error).into()
    }
}

impl From<BackendError> for Failure {
    fn from(error: BackendError) -> Self {
        Self::backend(error.to_string())
    }
}
