//! The rendering model (`docs/rendering-model.md` §1–§8) in f64 by brute force: the executable definition of a correct
//! image. Every other backend is compared with it.
//!
//! The backend draws one splat after another, in index order, and culls only what the model culls. Rows are rendered in
//! parallel, which changes nothing: every pixel sums its fragments in the same order.
//!
//! From the bottom up:
//!
//! - `scene` stores scenes between frames; `splat` projects splats to footprints, `clip` clips them, `polygon` finds
//!   the nearest polygon of a pixel;
//! - `raster` runs the visibility and attribute passes, with `threshold`s between them, over `pixels`;
//! - `shade` lights a surface, `shadow` draws and samples shadow maps, `matcap` and `eye_dome` are shaders of their
//!   own;
//! - `edge` finds edge pixels, `steps` and `samples` are edges by samples, `outlines` draws lines; `peeling` and
//!   `abuffer` find transparent layers, which a `layer_compositor` composites over the opaque image;
//! - `margin` finds decisions that rounding could change;
//! - `gaussians` draws trained Gaussians, one over another, and uses none of the above;
//! - `frame` runs a plan's passes in order, `supersample` averages a finer frame, `renderer` is the backend.

mod abuffer;
mod clip;
mod edge;
mod eye_dome;
mod frame;
mod front;
mod gaussians;
mod layer_compositor;
mod margin;
mod matcap;
mod nearest;
mod outlines;
mod peeling;
mod pixels;
mod polygon;
mod raster;
mod renderer;
mod samples;
mod scene;
mod shade;
mod shadow;
mod splat;
mod steps;
mod supersample;
mod threshold;

pub use renderer::{Options, Renderer};
pub use scene::ResidentScene;
