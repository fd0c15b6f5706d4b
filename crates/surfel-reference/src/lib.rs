//! The rendering model (`docs/rendering-model.md` §1–§8) in f64, brute force: the executable definition of a correct
//! picture. Every other backend is held against it.
//!
//! One splat after another, in index order, no culling but what the model says. Rows are rendered in parallel, which
//! changes nothing: every pixel sums its fragments in the same order.
//!
//! `splat` turns splats into footprints, `clip` says what they keep of them, `raster` runs the visibility and attribute
//! passes, `shade` lights a pixel, `polygon` finds the polygons among them, `edge` does edge antialiasing, `layers` and
//! `abuffer` draw transparent splats into `veil`s, `shadow` draws and reads shadow maps, `outline` draws lines, `matcap`
//! and `eye_dome` are shaders of their own, `frame` runs the plan's passes and puts pixels together, `margin` finds decisions that rounding could flip.

mod abuffer;
mod clip;
mod edge;
mod eye_dome;
mod frame;
mod layers;
mod margin;
mod matcap;
mod outline;
mod polygon;
mod raster;
mod renderer;
mod shade;
mod shadow;
mod splat;
mod supersample;
mod veil;

pub use renderer::{Renderer, ResidentScene};
