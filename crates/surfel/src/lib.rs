//! Surfel draws surfaces made of splats: scans, point clouds, meshes and trained Gaussians, filtered, blended and
//! shaded. This crate is the entry point for library users. It re-exports the types that most programs need, and the
//! packages behind them as eight modules.
//!
//! # Tour
//! **A file.** [`open`] loads geometry or a scene file, and chooses camera, lights and settings where none are stated.
//! A [`Backend`] draws the result:
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (loaded, mut backend) = (surfel::open(&["scan.ply".as_ref()], &surfel::NoProgress)?, surfel::Backend::auto()?);
//! let resident = backend.upload(&loaded.scene)?;
//! backend.render(&resident, &loaded.file.camera, &loaded.file.settings)?.save_png("scan.png")?;
//! # Ok(())
//! # }
//! ```
//!
//! **Bare arrays.** Points need neither normals nor radii: [`sample::splats_from_points`] estimates both.
//!
//! ```
//! use surfel::model::glam::Vec3;
//! use surfel::model::{Column3, PointCloud};
//! use surfel::sample::{PointOptions, splats_from_points};
//! use surfel::{Backend, Camera, NoProgress, Scene, Settings};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // 1000 points on the unit sphere, along a spiral.
//! let on_sphere = |i: u16| {
//!     let (z, turn) = ((f32::from(i) + 0.5) / 500.0 - 1.0, 2.4 * f32::from(i));
//!     Vec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
//! };
//! let positions = Column3::from_f32((0..1000).map(on_sphere).collect());
//!
//! let points = PointCloud { positions, ..PointCloud::default() };
//! let (cloud, report) = splats_from_points(&points, &PointOptions::default(), &NoProgress)?;
//! assert_eq!(report.normals_estimated, 1000);
//!
//! let camera = Camera::perspective([0.0, 0.0, 4.0], [0.0; 3], 45.0, [64, 64]);
//! let mut backend = Backend::auto()?;
//! let resident = backend.upload(&Scene::from(cloud))?;
//! let frame = backend.render(&resident, &camera, &Settings::default())?;
//! assert_eq!(frame.color()[32 * 64 + 32][3], 1.0); // alpha: the sphere has no hole here
//! # Ok(())
//! # }
//! ```
//!
//! **A scene of own splats.** A [`SplatCloud`] consists of disks or ellipses. A [`Scene`] places clouds, meshes and
//! octrees, with lights, materials and a background. [`Renderer::render_into`] can render planes other than colours,
//! and parts of an image. It reuses the frame's memory.
//!
//! ```
//! use surfel::model::Object;
//! use surfel::{Backend, Camera, Frame, Light, Planes, Renderer as _, Scene, Settings, SplatCloud, View};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let out = std::env::temp_dir().join("surfel-front-page.png");
//! let (centers, normals, radii) = ([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]], [[0.0, 0.0, 1.0]; 2], [0.6, 0.6]);
//! let colors = [[0.8, 0.2, 0.1], [0.1, 0.3, 0.8]]; // linear RGB
//! let disks = SplatCloud::disks(&centers, &normals, &radii)?.with_colors(&colors)?;
//! let floor = SplatCloud::ellipses(&[[0.0, -0.7, 0.0]], &[[2.0, 0.0, 0.0]], &[[0.0, 0.0, -1.0]])?;
//!
//! let scene = Scene {
//!     background: [1.0, 1.0, 1.0, 1.0], // linear RGB and alpha
//!     lights: Some(vec![Light::directional([-1.0, -1.0, -1.0])]),
//!     objects: vec![Object::from(disks), Object::from(floor)],
//!     ..Scene::default()
//! };
//! let view = View::new(&Camera::perspective([0.0, 0.5, 3.0], [0.0; 3], 45.0, [200, 150]))?;
//! let (planes, mut frame) = (Planes::COLOR.with_depth(true), Frame::default());
//!
//! let mut backend = Backend::auto()?; // or surfel_cpu::Renderer::new(Default::default())?
//! let resident = backend.upload(&scene)?;
//! backend.render_into(&resident, &view, &Settings::default(), planes, &mut frame)?;
//! frame.save_png(&out)?;
//! assert!(frame.depth().iter().any(|depth| depth.is_finite()));
//! # Ok(())
//! # }
//! ```
//!
//! # Where things are documented
//!
//! | task | items |
//! | --- | --- |
//! | Start a backend; list those that work here | [`Backend`], [`BackendOptions`], [`backends`] |
//! | Describe what is drawn | [`Scene`], [`SplatCloud`], [`Camera`], [`Light`], [`Material`], [`Settings`], [`model`] |
//! | Render planes, regions and statistics | [`Renderer`], [`View`], [`Planes`], [`Frame`], [`Stats`], [`render`] |
//! | Load one file as splats | [`load()`], [`LoadOptions`], [`LoadedCloud`] |
//! | Load a scene file, colour by an attribute, keep within memory | [`load_scene`], [`mod@load`] |
//! | Choose camera, light and materials of bare files | [`open`], [`stage`] |
//! | Apply the flags of `surfel render`; draw many times; figures and films | [`RenderOptions`], [`app`] |
//! | Draw orthoimages and surface models | [`ortho`] |
//! | Convert points and meshes to splats; clip, fit and weigh splats | [`sample`] |
//! | Read and write single formats | [`io`] |
//! | Look up a formula | the package `surfel-math` |
//!
//! [`Error`] covers the errors of all packages that this crate uses.
//!
//! # Layer
//! The crate has no code of its own. Programs depend on it or on the packages behind it:
//!
//! - `surfel-io` reads files;
//! - `surfel-sample` converts points and meshes to splats;
//! - `surfel-load` combines the two;
//! - `surfel-framing` estimates views;
//! - `surfel-stage` chooses scenes;
//! - `surfel-backend` draws;
//! - `surfel-ortho` draws orthoimages;
//! - `surfel-app` has options and requests.
//!
//! A library user can do everything that the program can do.
//!
//! # Features
//!
//! | feature | effect |
//! | --- | --- |
//! | `cpu` (default) | the CPU backend |
//! | `ortho` (default) | orthoimages as GeoTIFF |
//! | `reference` | the reference backend: exact and slow |
//! | `wgpu`, `ash` | GPU backends by wgpu and by Vulkan; `gpu` enables both |
//! | `sharp` | splats clipped along sharp features of meshes and points |
//! | `zstd` | SPZ files of version 4 |

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub use surfel_app as app;
pub use surfel_io as io;
pub use surfel_load as load;
pub use surfel_model as model;
#[cfg(feature = "ortho")]
pub use surfel_ortho as ortho;
pub use surfel_render as render;
pub use surfel_sample as sample;
pub use surfel_stage as stage;

pub use surfel_app::RenderOptions;
#[cfg(any(feature = "wgpu", feature = "ash"))]
pub use surfel_backend::GpuPath;
pub use surfel_backend::{Backend, BackendInfo, BackendOptions, BackendScene, backends};
pub use surfel_load::{Error, LoadOptions, LoadedCloud, load, load_scene};
pub use surfel_model::{Camera, Light, Material, Scene, Settings, Shader, SplatCloud};
pub use surfel_render::{BackendError, Frame, Planes, Preset, Region, Renderer, Stats, View};
pub use surfel_sample::{NoProgress, Progress};
pub use surfel_stage::{LoadedScene, open};
