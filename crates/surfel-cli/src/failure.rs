//! Why a run failed, and with which exit code.

use crate::console;
use surfel::io::IoError;
use surfel::sample::SampleError;
use surfel::{BackendError, Error, RenderError};

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

    /// Exit code 5: a comparison over its threshold.
    pub(crate) fn threshold(message: impl Into<String>) -> Self {
        Self { code: 5, message: message.into() }
    }

    /// Writing to stdout failed. A reader that has seen enough and closed its end is no failure.
    pub(crate) fn stdout(error: &std::io::Error) -> Self {
        if error.kind() == std::io::ErrorKind::BrokenPipe {
            return Self { code: 0, message: String::new() };
        }
        Self::other(format!("stdout: cannot write it: {error}"))
    }

    /// Prints the message and gives the exit code.
    pub(crate) fn report(&self) -> u8 {
        if !self.message.is_empty() {
            console::error(&self.message);
        }
        self.code
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::Backend(e) => e.into(),
            Error::Sample { source: SampleError::Option { .. }, .. } => Self::usage(message),
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
        Self { code: 4, message: error.to_string() }
    }
}
