//! Automatic scenes for files without a scene file: camera, lights, materials, background and settings, chosen to suit
//! the loaded objects.
//!
//! Main functions and types, in reading order:
//!
//! 1. [`open`]: opens a scene file, or any number of geometry files, as a [`LoadedScene`];
//! 2. [`auto_up`], [`auto_composite`], [`auto_transparency`], [`auto_depth_tolerance`] and [`auto_points_as`]: make
//!    single choices, most of them with a note that gives the reason;
//! 3. [`auto_scene`]: creates the scene file for loaded objects, according to [`AutoOptions`];
//! 4. [`studio_lights`]: returns three lights that follow the camera; [`NamedLight`]: skies of named lights.
//!
//! ```no_run
//! # fn main() -> Result<(), surfel_load::Error> {
//! let loaded = surfel_stage::open(&["scan.ply".as_ref()], &surfel_sample::NoProgress)?;
//! println!("seen from {:?}", loaded.file.camera.eye);
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate is above `surfel-load`, which loads the objects, and `surfel-framing`, which estimates views and cameras.
//! It draws no image.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod auto;
mod brightness;
mod estimates;
mod lights;
mod named_light;
mod sheets;
mod watertight;

pub use auto::*;
pub use estimates::Estimates;
pub use lights::{Lighting, studio_lights};
pub use named_light::NamedLight;
