//! Surfel's backend on raw Vulkan 1.1: the same shaders and the same schedule as `surfel-wgpu`, without a layer
//! between.
//!
//! One file an object family. Every Vulkan object is owned by a value that destroys it (`object.rs`, `memory.rs`),
//! carries a name where a debugger can see it, and keeps its device alive. Every submission is waited for before what
//! it uses can go: a frame is read back anyway. No result is unwrapped; out of memory and a lost device are errors.
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

/// Vulkan's bindings, in the version that [`RawDevice`] is made of.
pub use ash;

/// Name used in messages and on the command line.
const NAME: &str = "ash";

/// What the backend draws, on any adapter.
pub const CAPABILITIES: Capabilities = Capabilities { backend: NAME, lacks: surfel_gpu::UNSUPPORTED };
