//! What holds every backend against the rendering model: scenes that catch one fault each, truths that don't
//! come from a renderer, and the harness that compares a backend with the reference.
//!
//! - [`scenes`]: plain seeded functions, small images;
//! - [`random_scenes`]: scenes that nobody has thought of, one for each seed;
//! - [`harness`]: [`harness::check_backend`] renders them all on a backend and on the reference and compares;
//! - [`expectations`]: what backends are known to miss, and why;
//! - [`backends`]: the backends by name, watched by validation layers;
//! - [`report`]: what was found, as a table and as a page;
//! - [`runner`]: the program `cargo xtask conformance`;
//! - [`truths`]: the reference's images in a file, for machines that shouldn't draw them;
//! - [`raycast`]: exact images of meshes, which splats made of them are held against;
//! - [`stability`]: sweeps of one number to its extreme, against exact arithmetic;
//! - [`checkerboard`]: how well each filter reproduces a pattern that runs to the horizon (§5);
//! - [`test_data`]: where data is that isn't shipped.
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
