//! Failures of a run, with their exit codes and messages.

use surfel_app::wording::as_flags;
use surfel_backend::BackendError;
use surfel_io::IoError;
use surfel_load::Error;
use surfel_render::RenderError;
use surfel_sample::SampleError;

/// A failed run: an exit code and a message of at most four lines, which names options as flags.
#[derive(Debug)]
pub(crate) struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    /// Creates a failure with exit code 1.
    pub(crate) fn other(message: impl Into<String>) -> Self {
        Self::with_code(1, message)
    }

    /// Creates a failure with exit code 2: a usage error.
    pub(crate) fn usage(message: impl Into<String>) -> Self {
        Self::with_code(2, message)
    }

    /// Creates a failure with exit code 3: an invalid or missing input.
    pub(crate) fn input(message: impl Into<String>) -> Self {
        Self::with_code(3, message)
    }

    /// Creates a failure with exit code 4: the backend isn't available, or doesn't support the image.
    pub(crate) fn backend(message: impl Into<String>) -> Self {
        Self::with_code(4, message)
    }

    /// Creates a failure with exit code 5: a comparison exceeds its threshold.
    pub(crate) fn threshold(message: impl Into<String>) -> Self {
        Self::with_code(5, message)
    }

    /// Creates a failure with the exit code of an earlier failure.
    pub(crate) fn with_code(code: u8, message: impl Into<String>) -> Self {
        Self { code, message: as_flags(&message.into()).into_owned() }
    }

    /// Creates a failure for an error of writing to stdout. A closed pipe gives exit code 0 and no message, because the
    /// reader doesn't want more.
    pub(crate) fn stdout(error: &std::io::Error) -> Self {
        if error.kind() == std::io::ErrorKind::BrokenPipe {
            return Self { code: 0, message: String::new() };
        }
        Self::other(format!("stdout: cannot write it: {error}"))
    }

    /// Returns the exit code.
    pub(crate) fn code(&self) -> u8 {
        self.code
    }

    /// Returns the message; empty if nothing is to be printed.
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
