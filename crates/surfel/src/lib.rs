//! Surfel renders surfaces given as splats: scans, point clouds and meshes, filtered, blended and shaded.
//!
//! ```
//! use surfel::{Backend, Camera, Scene, Settings, SplatCloud};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let out = std::env::temp_dir().join("surfel-front-page.png");
//! let (centers, normals, radii) = ([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]], [[0.0, 0.0, 1.0]; 2], [0.6, 0.6]);
//! let colors = [[0.8, 0.2, 0.1], [0.1, 0.3, 0.8]];
//!
//! let cloud = SplatCloud::disks(&centers, &normals, &radii)?.with_colors(&colors)?;
//! let scene = Scene::from(cloud);
//! let camera = Camera::perspective([0., 0., 3.], [0.; 3], 45.0, [800, 600]);
//! let mut backend = Backend::auto()?; // or surfel_cpu::Renderer::new(Default::default())?
//! let resident = backend.upload(&scene)?;
//! let frame = backend.render(&resident, &camera, &Settings::default())?;
//! frame.save_png(&out)?;
//! # Ok(())
//! # }
//! ```
//!
//! [`Renderer::render_into`] also gives other planes, regions and statistics, and reuses a frame's memory. Files are
//! loaded by [`open`], [`load_scene`] and [`load`]; [`framing`] and [`scene`] frame and light what comes without a
//! camera:
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let loaded = surfel::open(&["bunny.obj".as_ref()], &surfel::NoProgress)?;
//! let mut backend = surfel::Backend::auto()?;
//! let resident = backend.upload(&loaded.scene)?;
//! backend.render(&resident, &loaded.file.camera, &loaded.file.settings)?.save_png("bunny.png")?;
//! # Ok(())
//! # }
//! ```
//!
//! Cargo's features are backends and tools: `cpu` and `ortho` (orthoimages; the defaults), `reference`,
//! `gpu` = `wgpu` and `ash`, and `sharp`, splats clipped along sharp features ([`sample`]).

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod attributes;
mod auto;
pub mod backend;
pub mod camera;
mod closed;
pub mod coloring;
pub mod compare;
mod convert;
mod equal;
mod error;
pub mod framing;
mod front;
pub mod info;
pub mod labels;
mod level_store;
pub mod levels;
mod lights;
mod load;
pub mod memory;
mod mesh_columns;
pub mod metadata;
mod noise;
mod octree;
#[cfg(feature = "ortho")]
pub mod ortho;
mod patches;
pub mod paths;
pub mod progressive;
mod render_options;
pub mod request;
pub mod scene;
mod sheets;
pub mod splat_file;
pub mod splats;
mod survey;
pub mod unseen;
mod upright;
pub mod values;
mod viewpoint;
pub mod words;

pub use surfel_io as io;
pub use surfel_math as math;
pub use surfel_model as model;
pub use surfel_model::glam;
pub use surfel_render as render;
pub use surfel_sample as sample;

pub use auto::{LoadedScene, open};
#[cfg(any(feature = "wgpu", feature = "ash"))]
pub use backend::GpuPath;
pub use backend::{Backend, BackendError, BackendOptions, BackendScene, backends};
pub use error::Error;
pub use level_store::LevelStore;
pub use load::{Conversion, LoadOptions, LoadedCloud, load};
pub use octree::load_octree;
pub use scene::load_scene;
pub use surfel_model::{Camera, Light, Material, Scene, Settings, Shader, SplatCloud};
pub use surfel_render::{Frame, Planes, Preset, Region, Renderer, Stats, View};
pub use surfel_sample::{NoProgress, Progress};

/// The README's example, compiled so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
