//! The contract that every Surfel backend keeps: what it is given ([`View`], [`Settings`]), what it must do
//! ([`plan()`]), and what it gives back ([`Frame`], [`Stats`], [`RenderError`]).
//!
//! Data flows one way: scene → plan → passes → frame. Every per-frame decision is made once, in [`plan()`]; backends
//! execute it and decide nothing.

mod chunk;
mod color_plane;
mod error;
mod frame;
mod lod;
mod needs;
mod plan;
mod preset;
mod renderer;
mod shadow;
mod stats;
mod summary;
mod view;

pub use chunk::{CHUNK_SPLATS, ChunkSpace, Storage, StoredSplat, chunks, stored_axes};
pub use color_plane::ColorPlane;
pub use error::RenderError;
pub use frame::{Frame, Planes};
pub use lod::{Selection, select};
pub use plan::{Attributes, FramePlan, Pass, SplatFilter, needs_interior_weight, plan, unsupported};
pub use preset::{Preset, Promise, inside_surfaces};
pub use renderer::{Capabilities, Feature, Renderer, RendererInfo, UploadProgress};
pub use shadow::{SHADOW_BIAS_RADII, SHADOW_MAP_SIDE, ShadowMap, ShadowScene};
pub use stats::{PassTime, Stats};
pub use summary::SceneSummary;
pub use surfel_model::Settings;
pub use view::{Region, View};
