//! The rendering model (`docs/rendering-model.md` §1–§8) in f64 by brute force: the executable definition of a correct
//! image. Every other backend is compared with it.
//!
//! Main types, in reading order:
//!
//! 1. [`Renderer`]: uploads scenes and draws frames, also supersampled; implements [`surfel_render::Renderer`];
//! 2. [`Options`]: threads of a renderer;
//! 3. [`ResidentScene`]: an uploaded scene.
//!
//! ```
//! use surfel_model::{Camera, Scene, Settings, SplatCloud};
//! use surfel_render::{Frame, Planes, Renderer as _, View};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let disk = SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?;
//! let camera = Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [32, 32]);
//!
//! let mut renderer = surfel_reference::Renderer::new(Default::default())?;
//! let resident = renderer.upload(&Scene::from(disk))?;
//! // The plane `margin`, which no other backend has, marks pixels that rounding could change.
//! let (planes, mut frame) = (Planes::COLOR.with_depth(true).with_margin(true), Frame::default());
//! renderer.render_into(&resident, &View::new(&camera)?, &Settings::default(), planes, &mut frame)?;
//! assert_eq!(frame.depth()[16 * 32 + 16], 3.0); // the disk lies 3 units before the eye
//! assert_eq!(frame.depth()[0], f32::INFINITY); // nothing is visible in the corner
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The backend executes the plan of `surfel-render` with the formulas of `surfel-math`. It has no tiles, no culling
//! beyond the model's, and shares no rasterisation code with another backend. It has no Cargo features.
//!
//! # How a frame is drawn
//! The backend draws one splat after another, in index order, and culls only what the model culls. Rows are rendered in
//! parallel, which changes nothing: every pixel sums its fragments in the same order.
//!
//! From the bottom up:
//!
//! - `scene` stores scenes between frames; `splat` projects splats to footprints, `clip` clips them, `polygon` finds
//!   the nearest polygon of a pixel, `ball` the fragments of balls in a pixel;
//! - `raster` runs the visibility and attribute passes, with `threshold`s between them, over `pixels`;
//! - `shade` lights a surface, `shadow` draws and samples shadow maps, `matcap` and `eye_dome` are shaders of their
//!   own;
//! - `edge` finds edge pixels, `steps` and `samples` are edges by samples, `outlines` draws lines; `peeling` and
//!   `abuffer` find transparent layers, which a `layer_compositor` composites over the opaque image;
//! - `margin` finds decisions that rounding could change;
//! - `gaussians` draws trained Gaussians, one over another, and uses none of the above;
//! - `frame` runs a plan's passes in order, `supersample` averages a finer frame, `renderer` is the backend.

mod abuffer;
mod ball;
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
