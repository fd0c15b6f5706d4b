//! Foundations of file access: errors that name the file, reading within limits, and files that are written completely
//! or not at all.
//!
//! Main types and modules, in reading order:
//!
//! 1. [`IoError`]: the reason why a file could not be read or written, in at most four lines: the file, the position in
//!    it ([`Location`]), what is wrong and what was expected ([`Problem`]);
//! 2. [`atomic`]: [`atomic::write`] writes a temporary file that replaces the target once it is complete;
//! 3. [`input`]: reads whole files up to a limit, and the files that a file refers to ([`input::Siblings`]);
//! 4. [`RegularFile`]: a file that is read with seeking, from the file system or from a host such as a browser
//!    ([`HostFile`]);
//! 5. [`lines`]: lines of a stream, up to a maximum length;
//! 6. [`programs`]: other programs, which never outlive this one;
//! 7. [`ShowPath`]: paths in messages, with control characters escaped.
//!
//! ```
//! use std::path::Path;
//! use surfel_files::{IoError, Location, Problem, atomic};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("three.txt");
//! atomic::write(&path, false, |out| out.write_all(b"3"))?;
//! // An existing file is only replaced if the caller asks for it.
//! assert!(matches!(atomic::write(&path, false, |out| out.write_all(b"4")), Err(IoError::Exists { .. })));
//!
//! let problem = Problem::new("has no vertices").at(Location::Line(4)).expected("at least one");
//! assert!(problem.to_string().contains("line 4"));
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate lies below `surfel-images` and `surfel-io`, which read and write formats. It depends on `surfel-model`
//! alone, whose errors a file can cause. It has no Cargo features.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod atomic;
pub mod error;
pub mod input;
pub mod lines;
pub mod programs;
mod regular;

pub use error::{IoError, Location, Problem, ShowPath, ShownPath, is_obeyed};
pub use regular::{HostFile, RegularFile, set_host_file};
