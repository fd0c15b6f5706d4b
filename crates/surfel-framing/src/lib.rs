//! Up axis, semantic front, best view and camera of objects, estimated from their shape.
//!
//! Main functions and types, in reading order:
//!
//! 1. [`patches::Patches`]: sample of the surfaces of all objects, on which all estimates are based;
//! 2. [`strays`]: detects stray points, and returns the sphere around the other ones;
//! 3. [`upright()`]: estimates the up axis, and gives a reason ([`UpReason`]);
//! 4. [`ViewChoice`] and [`ViewAxes`]: direction from which a scene is viewed, stated or chosen ([`ViewReason`]);
//! 5. [`frame_camera`]: places a camera so that the scene fills the image ([`FrameOptions`]).
//!
//! ```
//! use surfel_framing::{FrameOptions, FrameProjection, ViewAxes, ViewChoice, frame_camera};
//! use surfel_model::{Scene, SplatCloud, Up};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::from(SplatCloud::disks(&[[1.0, 2.0, 3.0]], &[[0.0, 0.0, 1.0]], &[0.5])?);
//! let axes = ViewAxes::of_choice(ViewChoice::default(), &scene.objects, Up::PlusZ);
//! let projection = FrameProjection::Perspective(35.0);
//! let camera = frame_camera(&scene, &FrameOptions { axes, projection, size: [640, 480], fill: 0.9, turning: None });
//! assert_eq!(camera.map(|camera| camera.target), Some([1.0, 2.0, 3.0]));
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate is between `surfel-model`, which defines the objects, and `surfel-load`, which needs the up axis for
//! colours by height. It opens no file and draws no image.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod equal;
mod framing;
mod front;
pub mod patches;
mod samples;
pub mod strays;
mod up_axis;
mod view;
pub mod viewpoint;

pub use framing::*;
pub use samples::Samples;
pub use up_axis::{UpConvention, UpReason, Upright};
pub use view::{ChosenView, NamedView, ViewAngles, ViewAxes, ViewChoice, ViewReason};
