//! Interface of all Surfel backends: inputs ([`View`], [`Settings`]), instructions ([`plan()`]) and outputs ([`Frame`],
//! [`Stats`], [`RenderError`]).
//!
//! Data flows one way: scene → plan → passes → frame. Every per-frame decision is made once, in [`plan()`]; backends
//! execute it and decide nothing.
//!
//! The feature `save` adds methods that write frames as PNG and EXR.

mod background;
mod color_plane;
mod error;
mod frame;
mod gaussians;
mod lod;
mod needs;
mod plan;
mod preset;
mod renderer;
#[cfg(feature = "save")]
mod save;
mod shadow;
mod stats;
mod summary;
mod view;

pub use background::Background;
pub use error::RenderError;
pub use frame::{Frame, FramePlanes, Identity, Planes, PlanesMut};
pub use gaussians::GaussianView;
pub use lod::{
    FADE_OCTAVES, LevelEnd, LevelNode, LevelSelection, Magnification, Selection, Sight, select, select_levels,
};
pub use plan::{
    Attributes, ChosenParts, FramePlan, Pass, SAMPLES_SIDE, SplatFilter, needs_interior_weight, plan, unsupported,
};
pub use preset::{Preset, Promise, inside_surfaces};
pub use renderer::{Capabilities, Feature, Renderer, RendererInfo, UploadProgress};
pub use shadow::{SHADOW_BIAS_RADII, SHADOW_MAP_SIDE, ShadowMap, ShadowScene};
pub use stats::{PassTime, Stats};
pub use summary::{GaussianColors, SceneOctree, SceneSummary};
pub use surfel_model::Settings;
pub use view::{Region, View};
