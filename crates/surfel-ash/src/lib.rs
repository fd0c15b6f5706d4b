//! Surfel's backend on raw Vulkan 1.1: the same shaders and schedule as `surfel-wgpu`, without an intermediate layer.
//!
//! Main types, in reading order:
//!
//! 1. [`Renderer`]: uploads scenes and draws frames; implements [`surfel_render::Renderer`]. [`Renderer::new`] opens a
//!    device, [`Renderer::from_raw`] uses a program's own;
//! 2. [`Options`]: adapter, validation, [`Limits`], [`Storage`] and [`GpuPath`] of a renderer; [`devices`] lists this
//!    machine's devices;
//! 3. [`ResidentScene`]: an uploaded scene;
//! 4. [`RawDevice`]: the handles of a program's own device, of the version of [`ash`] that this crate re-exports.
//!
//! # A frame
//! ```no_run
//! use surfel_model::{Camera, Scene, Settings, SplatCloud};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::from(SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?);
//! let camera = Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [800, 600]);
//!
//! let mut renderer = surfel_ash::Renderer::new(Default::default())?;
//! let resident = renderer.upload(&scene)?;
//! let frame = renderer.render(&resident, &camera, &Settings::default())?;
//! assert_eq!(frame.color().len(), 800 * 600);
//! # Ok(())
//! # }
//! ```
//!
//! # A program's own device
//! [`Renderer::from_raw`] draws on a Vulkan device that the program has created. Frames are read back to the host's
//! memory: only `surfel-wgpu` also draws into a program's textures (`render_to_view`).
//!
//! ```no_run
//! use surfel_ash::{RawDevice, Renderer, ash};
//! use surfel_render::RenderError;
//!
//! fn renderer(
//!     entry: &ash::Entry,
//!     instance: &ash::Instance,
//!     physical: ash::vk::PhysicalDevice,
//!     (device, queue, family): (&ash::Device, ash::vk::Queue, u32),
//! ) -> Result<Renderer, RenderError> {
//!     // A program that uses its device further must keep the entry: dropping the last one unloads Vulkan.
//!     let (entry, instance, device) = (entry.clone(), instance.clone(), device.clone());
//!     // SAFETY: the handles belong together and outlive the renderer, and no other thread submits to the queue.
//!     unsafe { Renderer::from_raw(RawDevice { entry, instance, physical, device, queue, family }) }
//! }
//! ```
//!
//! # Layer
//! `surfel-gpu` schedules the passes of a frame, and this crate executes them with the SPIR-V of `surfel-shaders`. It
//! is the only crate of the workspace with `unsafe` code. It has no Cargo features.
//!
//! Each file covers one family of Vulkan objects. Every object is owned by a value that destroys it (`object.rs`,
//! `memory.rs`), has a name for debuggers, and holds a reference to its device. The CPU waits for every submission
//! before it drops the resources in use. This costs nothing, since it reads each frame back. No result is unwrapped;
//! exhausted memory and a lost device are errors.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod cells;
mod commands;
mod descriptors;
mod device;
mod error;
mod execute;
mod instance;
mod memory;
mod object;
mod options;
mod passes;
mod pipelines;
mod queries;
mod recorder;
mod renderer;
mod scene;
mod summary;
mod targets;

pub use options::Options;
pub use renderer::{RawDevice, Renderer};
pub use scene::ResidentScene;
pub use summary::{DeviceSummary, devices};
pub use surfel_gpu::{FillRate, FillRateProbe, GpuPath, Limits};
pub use surfel_model::Storage;
pub use surfel_render::UploadProgress;

use surfel_render::Capabilities;

/// Vulkan bindings, in the version that [`RawDevice`] uses.
pub use ash;

/// Name of the backend in messages and on the command line.
const NAME: &str = "ash";

/// Capabilities of the backend, the same on any adapter: its name, and the features that it lacks.
pub const CAPABILITIES: Capabilities = Capabilities { backend: NAME, lacks: surfel_gpu::UNSUPPORTED };
