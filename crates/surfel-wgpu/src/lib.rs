//! Surfel's backend on wgpu: Vulkan, Metal, DX12, GL and WebGPU. It draws into frames, or into the render target of the
//! *application*: the program that embeds Surfel and draws by wgpu itself. The prefix `Host` in names means the
//! application; only in [`HostWork`] it means the CPU.
//!
//! Main types, in reading order:
//!
//! 1. [`Renderer`]: uploads scenes and draws frames; implements [`surfel_render::Renderer`]. [`Renderer::new`] opens a
//!    device, [`Renderer::from_device`] uses the application's own;
//! 2. [`Options`]: adapter, validation, [`Limits`], [`Storage`] and [`GpuPath`] of a renderer; [`adapters`] lists this
//!    machine's adapters;
//! 3. [`ResidentScene`]: an uploaded scene;
//! 4. [`Renderer::render_to_view`], [`HostTarget`] and [`HostDepth`]: drawing into the application's textures;
//! 5. [`Renderer::set_shader`]: a shader of the application, as a WGSL function;
//! 6. [`Renderer::place_splats`], [`HostSplats`] and [`HostLayout`]: splats whose positions, normals and colours are in
//!    the application's buffer.
//!
//! # A frame
//! ```no_run
//! use surfel_model::{Camera, Scene, Settings, SplatCloud};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::from(SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?);
//! let camera = Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [800, 600]);
//!
//! let mut renderer = surfel_wgpu::Renderer::new(Default::default())?;
//! let resident = renderer.upload(&scene)?;
//! let frame = renderer.render(&resident, &camera, &Settings::default())?;
//! assert_eq!(frame.color().len(), 800 * 600);
//! # Ok(())
//! # }
//! ```
//!
//! # The application's image
//! An application that owns a wgpu device passes it to [`Renderer::from_device`]. [`Renderer::render_to_view`] then
//! records the scene into the application's command encoder: the splats are tested against the application's depth
//! buffer, and write it. [`wgpu`] is the version of wgpu that this crate uses, and
//! [`Camera::from_matrices`](surfel_model::Camera::from_matrices) makes a camera of the application's matrices.
//! `examples/among_triangles.rs` is a complete application: `cargo run -p surfel-wgpu --example among_triangles --
//! image.png`.
//!
//! ```no_run
//! use surfel_model::{Camera, Scene, Settings};
//! use surfel_render::{RenderError, View};
//! use surfel_wgpu::{HostDepth, HostTarget, Renderer, wgpu};
//!
//! /// Draws a scene over the application's image. The depth buffer stores near/z; the splats' near plane is the same.
//! fn draw(
//!     (device, queue): (&wgpu::Device, &wgpu::Queue),
//!     (color, depth): (&wgpu::TextureView, &wgpu::TextureView),
//!     scene: &Scene,
//!     camera: &Camera,
//! ) -> Result<(), RenderError> {
//!     // Once per program and per scene:
//!     let mut renderer = Renderer::from_device(device.clone(), queue.clone())?;
//!     let resident = renderer.upload(scene)?;
//!
//!     // Once per frame:
//!     let target = HostTarget {
//!         color,
//!         color_format: wgpu::TextureFormat::Rgba8UnormSrgb,
//!         depth,
//!         depth_format: wgpu::TextureFormat::Depth32Float,
//!         mapping: HostDepth::reversed(camera.near as f32),
//!         index: None,
//!     };
//!     let mut encoder = device.create_command_encoder(&Default::default());
//!     renderer.render_to_view(&mut encoder, &resident, &View::new(camera)?, &Settings::default(), &target)?;
//!     queue.submit([encoder.finish()]);
//!     Ok(())
//! }
//! ```
//!
//! # Layer
//! `surfel-gpu` schedules the passes of a frame, and this crate executes them with the shaders of `surfel-shaders`. A
//! compute shader sets up records of splats. Opaque splats are drawn by compute shaders, or as quads by raster
//! hardware: visibility into a depth buffer, then attributes into float targets with additive blending ([`GpuPath`]). A
//! compute shader shades the pixels into an array that is read back.
//!
//! On Vulkan, shaders are SPIR-V that was built with the crate, so that the driver compiles the same code as for
//! `surfel-ash`. The call that hands it to the driver is the crate's only `unsafe` code. Elsewhere, on a device of the
//! application without `wgpu::Features::PASSTHROUGH_SHADERS`, and with [`Options::wgsl`], wgpu translates WGSL.
//!
//! # Features
//! Graphics APIs, each on the platforms that have it: `vulkan`, `metal` and `dx12` (on by default), `gles` and
//! `webgpu`.

#![deny(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod adapter;
mod cells;
mod error;
mod execute;
mod host;
mod host_target;
mod options;
mod pipelines;
mod place;
mod queries;
mod queue;
mod readback;
mod renderer;
mod scene;
mod shader;
#[allow(unsafe_code)]
mod spirv;
mod targets;

pub use adapter::{AdapterSummary, adapters};
pub use host::HostIndex;
pub use host_target::{HostDepth, HostTarget};
pub use options::Options;
pub use place::HostSplats;
pub use renderer::Renderer;
pub use scene::ResidentScene;
pub use surfel_gpu::{FillRate, FillRateProbe, GpuPath, HostAttribute, HostFormat, HostLayout, HostWork, Limits};
pub use surfel_model::Storage;
pub use surfel_render::UploadProgress;
/// The version of wgpu whose types this crate's functions take.
pub use wgpu;

use surfel_render::Capabilities;

/// Name of the backend in messages and on the command line.
const NAME: &str = "wgpu";

/// Capabilities of the backend, the same on any adapter: its name, and the features that it lacks.
pub const CAPABILITIES: Capabilities = Capabilities { backend: NAME, lacks: surfel_gpu::UNSUPPORTED };
