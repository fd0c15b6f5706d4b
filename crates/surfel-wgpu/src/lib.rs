//! Surfel's backend on wgpu: Vulkan, Metal, DX12, GL and WebGPU.
//!
//! `surfel-gpu` schedules the passes of a frame. A compute shader sets up records of splats. Their quads are drawn
//! twice: visibility into a depth buffer, then attributes into float targets with additive blending. A compute shader
//! shades the pixels into an array that is read back. The shaders are those of `surfel-shaders`.
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

/// Name of the backend in messages and on the command line.
const NAME: &str = "wgpu";

/// Features that the backend supports, on any adapter.
pub const CAPABILITIES: Capabilities = Capabilities { backend: NAME, lacks: surfel_gpu::UNSUPPORTED };
