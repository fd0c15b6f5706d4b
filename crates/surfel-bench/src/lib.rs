//! Benchmarks of Surfel as a program, and the charts and pages that present its measurements.
//!
//! The program times frames and measures the cost of settings. It runs as `cargo xtask bench` and `cargo xtask
//! tradeoff`; other programs can run it through [`main`].
//!
//! Main types, in reading order:
//!
//! 1. [`chart::Chart`]: series of points over logarithmic axes, as SVG;
//! 2. [`page::Table`]: a table as text, Markdown or HTML;
//! 3. [`page::Page`]: a single HTML file of text, tables, charts and images, which loads nothing and runs no scripts;
//! 4. [`kit`]: measurements of a GPU on another machine (`surfel-bench kit`).
//!
//! ```
//! use surfel_bench::chart::{Axis, Chart, Series, Style};
//! use surfel_bench::page::Page;
//!
//! let frames = vec![[1e4, 2.0], [1e5, 6.5], [1e6, 48.0]];
//! let chart = Chart {
//!     title: "One frame".into(),
//!     x: Axis::new("splats"),
//!     y: Axis::new("time (ms)"),
//!     series: vec![Series::new("cpu", Style::Line, 0, frames)],
//!     shaded: None,
//! };
//! let mut page = Page::new("Frame times");
//! page.section("Growth");
//! page.chart(&chart);
//! assert!(page.html().contains("</svg>"));
//! ```
//!
//! # Layer
//! The package draws by `surfel-backend`, as any program does; only the conformance tests and `cargo xtask` use it.
//! No test times anything.
//!
//! # Features
//! `wgpu` and `ash` build the GPU backends in.

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

/// Runs the program `surfel-bench` with these arguments. The first argument is the program's name.
pub fn main(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    program::main(words)
}
