//! Surfel's backend on wgpu: Vulkan, Metal, DX12, GL and WebGPU.
//!
//! A frame runs as `surfel-gpu` schedules it: records of splats are set up by a compute shader, their quads drawn twice
//! (visibility into a depth buffer, attributes into float targets that blend by adding), and pixels shaded by a compute
//! shader into an array that is read back. The shaders are `surfel-shaders`'.
//!
//! ```no_run
//! use surfel_render::Settings;
//! # fn main() -> Result<(), surfel_render::RenderError> {
//! # let (scene, camera): (surfel_model::Scene, surfel_model::Camera) = unreachable!();
//! let mut renderer = surfel_wgpu::Renderer::new(Default::default())?;
//! let resident = renderer.upload(&scene)?;
//! let frame = renderer.render(&resident, &camera, &Settings::default())?;
//! # Ok(())
//! # }
//! ```

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod adapter;
mod cells;
mod error;
mod execute;
mod host;
mod host_target;
mod options;
mod pipelines;
mod queries;
mod readback;
mod renderer;
mod scene;
mod targets;

pub use adapter::{AdapterSummary, adapters};
pub use host_target::{HostDepth, HostTarget};
pub use options::Options;
pub use renderer::Renderer;
pub use scene::ResidentScene;
pub use surfel_gpu::{FillRate, FillRateProbe, GpuPath, Limits};
pub use surfel_model::Storage;
pub use surfel_render::UploadProgress;

use surfel_render::Capabilities;

/// Name used in messages and on the command line.
const NAME: &str = "wgpu";

/// What the backend draws, on any adapter.
pub const CAPABILITIES: Capabilities = Capabilities { backend: NAME, lacks: surfel_gpu::UNSUPPORTED };
