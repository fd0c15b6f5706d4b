//! Surfel's backend on raw Vulkan 1.1: the same shaders and schedule as `surfel-wgpu`, without an intermediate layer.
//!
//! Each file covers one family of Vulkan objects. Every object is owned by a value that destroys it (`object.rs`,
//! `memory.rs`), has a name for debuggers, and holds a reference to its device. The host waits for every submission
//! before it drops the resources in use: a frame is read back anyway. No result is unwrapped; exhausted memory and a
//! lost device are errors.
//!
//! ```no_run
//! use surfel_render::Settings;
//! # fn main() -> Result<(), surfel_render::RenderError> {
//! # let (scene, camera): (surfel_model::Scene, surfel_model::Camera) = unreachable!();
//! let mut renderer = surfel_ash::Renderer::new(Default::default())?;
//! let resident = renderer.upload(&scene)?;
//! let frame = renderer.render(&resident, &camera, &Settings::default())?;
//! # Ok(())
//! # }
//! ```

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

/// Features that the backend supports, on any adapter.
pub const CAPABILITIES: Capabilities = Capabilities { backend: NAME, lacks: surfel_gpu::UNSUPPORTED };
