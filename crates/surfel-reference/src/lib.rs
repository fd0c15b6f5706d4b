//! The rendering model (`docs/rendering-model.md` §1–§5, §7) in f64, brute force: the executable definition of a correct
//! picture. Every other backend is held against it.
//!
//! One splat after another, in index order, no culling but what the model says. Rows are rendered in parallel, which
//! changes nothing: every pixel sums its fragments in the same order.
//!
//! `splat` turns splats into footprints, `clip` says what they keep of them, `raster` runs the visibility and attribute passes, `shade` lights a
//! pixel, `edge` does edge antialiasing, `margin` finds decisions that rounding could flip.

mod clip;
mod edge;
mod margin;
mod raster;
mod renderer;
mod shade;
mod splat;
mod supersample;

pub use renderer::{Renderer, ResidentScene};
