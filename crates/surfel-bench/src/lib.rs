//! What measurements are shown with: [`chart::Chart`]s as SVG, and [`page::Page`]s that are one HTML file of words,
//! tables, charts and images. Nothing is fetched from elsewhere, and no script runs.
//!
//! The program of this package times frames and weighs settings; it runs as `cargo xtask bench` and
//! `cargo xtask tradeoff`. [`main`] is that program, for others to contain it.

mod alternate;
pub mod chart;
mod clouds;
mod compare;
mod growth;
pub mod kit;
mod machine;
mod measure;
pub mod page;
mod prepare;
mod program;
mod report;
mod scale;
mod scenes;
mod start;
mod table;
mod tradeoff;

use std::ffi::OsString;
use std::process::ExitCode;

use program::{Arguments, Backend, Failure, Simd, read};

/// Runs the program `surfel-bench` with these words, the first of which is its name.
pub fn main(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    program::main(words)
}
