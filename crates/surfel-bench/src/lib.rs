//! Presentation of measurements: [`chart::Chart`]s as SVG, and [`page::Page`]s, which are single HTML files of text,
//! tables, charts and images. Pages load nothing and run no scripts.
//!
//! The program of this package times frames and measures the cost of settings. It runs as `cargo xtask bench` and
//! `cargo xtask tradeoff`. Other programs can run it through [`main`].

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

/// Runs the program `surfel-bench` with these arguments, the first of which is its name.
pub fn main(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    program::main(words)
}
