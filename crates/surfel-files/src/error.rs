//! Errors of reading and writing files. They name the file, and the position in it where possible.

use std::fmt;
use std::path::{Path, PathBuf};
use surfel_model::ModelError;

/// Reason why a file could not be read or written; displayed in at most four lines.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IoError {
    /// The operating system reported an error.
    #[error("{}: cannot {action}: {source}", .path.shown())]
    System {
        /// The file or folder that the system could not access.
        path: PathBuf,
        /// The action that failed, in the words of the message: "read it", "write it", …
        action: &'static str,
        /// The system's reason for the failure.
        source: std::io::Error,
    },
    /// A file of that name already exists.
    #[error("{}: already exists\n  help: `force` overwrites it; or choose another name", .path.shown())]
    Exists {
        /// The existing file, which is not overwritten.
        path: PathBuf,
    },
    /// The file's content violates its format, or Surfel doesn't support it.
    #[error("{}: {problem}", .path.shown())]
    Invalid {
        /// The file with the invalid or unsupported content.
        path: PathBuf,
        /// Description of what is wrong, where, what was expected and what to do.
        problem: Box<Problem>,
    },
    /// The file was read, but its data violate a rule of Surfel's data model, such as equal lengths of columns.
    #[error("{}: {source}", .path.shown())]
    Model {
        /// The file with the data.
        path: PathBuf,
        /// The violated rule of the data model.
        source: ModelError,
    },
}

impl IoError {
    /// Returns the file that the error is about.
    pub fn path(&self) -> &Path {
        match self {
            Self::System { path, .. }
            | Self::Exists { path }
            | Self::Invalid { path, .. }
            | Self::Model { path, .. } => path,
        }
    }

    /// True if the input itself is at fault: it doesn't exist, can't be read, or has the wrong content.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Invalid { .. } | Self::Model { .. } => true,
            Self::System { action, .. } => *action == READ,
            Self::Exists { .. } => false,
        }
    }
}

/// Value of `action` in [`IoError::System`] for a file that can't be read.
pub const READ: &str = "read it";
/// Value of `action` in [`IoError::System`] for a file that can't be written.
pub const WRITE: &str = "write it";
/// Value of `action` in [`IoError::System`] for a folder in which no temporary file can be written.
pub const WRITE_THERE: &str = "write a temporary file there";

/// Display of paths in messages.
pub trait ShowPath {
    /// Returns the path for display on one line. Control characters, and those that reverse text, are escaped: a
    /// terminal must not obey a file name.
    fn shown(&self) -> ShownPath<'_>;
}

impl ShowPath for Path {
    fn shown(&self) -> ShownPath<'_> {
        ShownPath(self)
    }
}

/// A path, displayed as [`ShowPath::shown`] describes.
#[derive(Clone, Copy, Debug)]
pub struct ShownPath<'a>(&'a Path);

impl fmt::Display for ShownPath<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.to_string_lossy().chars().try_for_each(|c| match is_obeyed(c) {
            true => write!(f, "{}", c.escape_default()),
            false => write!(f, "{c}"),
        })
    }
}

/// True for characters that a terminal obeys instead of displaying: control characters, and those that reverse text.
pub fn is_obeyed(c: char) -> bool {
    let reverses = matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || reverses
}

/// A position in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Location {
    /// Offset from the start, in bytes.
    Byte(usize),
    /// Line, counted from 1.
    Line(usize),
    /// Line and column, counted from 1.
    LineColumn(usize, usize),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Byte(offset) => write!(f, "byte {offset}"),
            Self::Line(line) => write!(f, "line {line}"),
            Self::LineColumn(line, column) => write!(f, "line {line}, column {column}"),
        }
    }
}

/// Description of what is wrong with a file's content.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Description of the fault, which follows the file's name in a message: "is no PLY file".
    pub what: String,
    /// The position of the fault in the file, if one is known.
    pub location: Option<Location>,
    /// The content that the reader expected instead, if stating it helps.
    pub expected: Option<String>,
    /// Advice to the user: how to mend or replace the file.
    pub help: Option<String>,
}

impl Problem {
    /// Creates a problem from a description that follows the file's name: "is no PLY file". Position, expected content
    /// and advice are added by the other methods.
    pub fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), location: None, expected: None, help: None }
    }

    /// Returns the problem of a supported format whose Cargo feature is missing in this build.
    pub fn not_built(format: &str, feature: &str) -> Self {
        Self::new(format!("is a {format} file, and this build has no reader for {format}"))
            .help(format!("build with the Cargo feature \"{feature}\" of surfel-io"))
    }

    /// Adds the position in the file.
    pub fn at(mut self, location: Location) -> Self {
        self.location = Some(location);
        self
    }

    /// Adds the expected content.
    pub fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = Some(expected.into());
        self
    }

    /// Adds advice for the user.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)?;
        if let Some(location) = self.location {
            write!(f, " ({location})")?;
        }
        if let Some(expected) = &self.expected {
            write!(f, "\n  expected: {expected}")?;
        }
        if let Some(help) = &self.help {
            write!(f, "\n  help: {help}")?;
        }
        Ok(())
    }
}

/// Error of a reader that doesn't know the file's name: a problem of the content, or a violated rule of the data model.
/// [`Fault::of`] adds the name.
#[derive(Debug)]
pub enum Fault {
    /// The file's content violates its format, or Surfel doesn't support it.
    Problem(Box<Problem>),
    /// The data violate a rule of Surfel's data model.
    Model(ModelError),
}

impl From<Problem> for Fault {
    fn from(problem: Problem) -> Self {
        Self::Problem(Box::new(problem))
    }
}

/// Returns the problem of a compressed file whose unpacked data can't be written to a temporary file.
pub fn unwritable(error: std::io::Error) -> Problem {
    Problem::new(format!("can't be unpacked to a temporary file: {error}"))
}

impl From<ModelError> for Fault {
    fn from(error: ModelError) -> Self {
        Self::Model(error)
    }
}

impl Fault {
    /// Adds the name of the part of the file that the fault is in, such as an archive's member.
    pub fn within(self, name: &str) -> Self {
        let mut problem = match self {
            Self::Problem(problem) => problem,
            Self::Model(error) => Box::new(Problem::new(error.to_string())),
        };
        problem.what = format!("in {}: {}", quote(name), problem.what);
        Self::Problem(problem)
    }

    /// Converts the fault to an error that names the file.
    pub fn of(self, path: &Path) -> IoError {
        let path = path.to_path_buf();
        match self {
            Self::Problem(problem) => IoError::Invalid { path, problem },
            Self::Model(source) => IoError::Model { path, source },
        }
    }
}

/// Quotes text from a file for a message: on one line, without control characters, at most 60 characters.
pub fn quote(text: impl AsRef<[u8]>) -> String {
    let text = String::from_utf8_lossy(text.as_ref());
    let mut shown: String = text.chars().take(60).flat_map(char::escape_debug).collect();
    if text.chars().nth(60).is_some() {
        shown.push('…');
    }
    format!("'{shown}'")
}

/// Lists names for a message, separated by blanks: at most 24 of them, then the number of all. Returns "nothing" if
/// there are none.
pub fn list<S: AsRef<str>>(names: &[S]) -> String {
    if names.is_empty() {
        return "nothing".into();
    }
    let mut shown: Vec<String> =
        names.iter().take(24).map(|n| quote(n.as_ref()).trim_matches('\'').to_owned()).collect();
    if names.len() > shown.len() {
        shown.push(format!("… ({} in all)", names.len()));
    }
    shown.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_shown_on_one_line_without_control_characters() {
        let path = Path::new("ä b\n\x1b[31mc\u{9b}\u{202e}gnp.ply");
        assert_eq!(path.shown().to_string(), "ä b\\n\\u{1b}[31mc\\u{9b}\\u{202e}gnp.ply");
    }

    #[test]
    fn error_prints_at_most_four_lines_and_no_control_characters() {
        let problem = Problem::new(format!("found {}", quote("a\n\x1b[31mb".repeat(50))))
            .at(Location::Line(3))
            .expected("numbers")
            .help("look");
        let error = Fault::from(problem).of(Path::new("a.ply"));
        let text = error.to_string();
        assert!(text.lines().count() <= 4, "{text}");
        assert!(!text.contains('\x1b'), "{text:?}");
        assert!(text.starts_with("a.ply: found 'a\\n") && text.contains("(line 3)"), "{text}");
    }
}
