//! What all files share: errors in terms of the file, reading within limits, and writing whole or not at all.
//!
//! * [`IoError`] and [`Problem`]: the reason why a file could not be read or written, in at most four lines.
//! * [`input`]: whole files up to a limit, and the files that a file refers to.
//! * [`atomic`]: files that appear complete or not at all.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod atomic;
pub mod error;
pub mod input;

pub use error::{IoError, Location, Problem, ShowPath, ShownPath, is_obeyed};
