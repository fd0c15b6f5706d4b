//! Conformance tests of every backend against the rendering model: scenes that catch one fault each, truths that don't
//! come from a renderer, and the harness that compares a backend with the reference.
//!
//! Modules, in reading order:
//!
//! - [`scenes`]: functions that return the scenes, with small images; [`scenes::Case`] is one image to draw;
//! - [`random_scenes`]: random scenes, one for each seed;
//! - [`harness`]: [`harness::check_backend`] renders all scenes on a backend and on the reference and compares them;
//! - [`expectations`]: known differences of backends, with reasons;
//! - [`backends`]: the backends by name, with validation layers enabled;
//! - [`report`]: results as a table and as a page;
//! - [`runner`]: the program `cargo xtask conformance`;
//! - [`truths`]: the reference's images in a file, for machines on which drawing them would take too long;
//! - [`raycast`]: exact images of meshes by ray casting, which images of splats made from the meshes are compared with;
//! - [`stability`]: sweeps of one parameter to extreme values, compared with exact arithmetic;
//! - [`checkerboard`]: the error of each filter on a pattern that extends to the horizon;
//! - [`test_data`]: location of test data that isn't shipped.
//!
//! A new backend implements [`surfel_render::Renderer`] and is checked like this:
//!
//! ```
//! use surfel_conformance::{build, harness, scenes::Case};
//! use surfel_model::glam::DVec3;
//! # fn main() -> Result<(), surfel_render::RenderError> {
//! let disk = build::Splat::disk(DVec3::ZERO, DVec3::Z, 0.5, [0.8, 0.4, 0.1]);
//! let case = Case::new("one disk", build::scene(&[disk]), build::camera(3.0, 45.0, [16, 16]));
//!
//! let mut backend = surfel_cpu::Renderer::new(Default::default())?;
//! let mut reference = surfel_reference::Renderer::new(Default::default())?;
//! let report = harness::check_case(&mut backend, &mut reference, &case);
//! assert!(report.is_ok(), "{:?}", report.broken);
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The package lies at the top of the workspace: it depends on all backends, and nothing depends on it. It has no Cargo
//! features.
//!
//! Section numbers (§) refer to `docs/rendering-model.md`.

pub mod backends;
pub mod build;
pub mod checkerboard;
pub mod expectations;
pub mod harness;
pub mod polygons;
pub mod random;
pub mod random_scenes;
pub mod raycast;
pub mod report;
pub mod runner;
pub mod scenes;
pub mod stability;
pub mod test_data;
pub mod truths;

/// The example of README.md, compiled so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;

/// The examples of docs/library.md, compiled so that they stay true.
#[cfg(doctest)]
#[doc = include_str!("../../docs/library.md")]
struct LibraryPage;
