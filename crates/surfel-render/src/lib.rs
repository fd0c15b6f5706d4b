//! The interface of all Surfel backends: inputs ([`View`], [`Settings`]), instructions ([`plan()`]) and outputs
//! ([`Frame`], [`Stats`], [`RenderError`]).
//!
//! Main types, in reading order:
//!
//! 1. [`Renderer`]: the trait that every backend implements: `upload` a scene, `render` a frame;
//! 2. [`View`]: a validated camera, and the [`Region`] of its image to render;
//! 3. [`Planes`] and [`Frame`]: requested and rendered planes (colours, depths, normals, …);
//! 4. [`plan()`]: decides which passes and attributes a frame needs, from a [`SceneSummary`], a view, settings and
//!    planes. The result is a [`FramePlan`] of [`Pass`]es; [`Capabilities`] state what a backend supports;
//! 5. [`Preset`]: named settings from fastest to most accurate; [`select_levels`]: selection of levels of detail;
//! 6. [`Stats`] and [`RenderError`]: what a frame cost, and why it couldn't be drawn.
//!
//! Data flows one way: scene → plan → passes → frame. Every per-frame decision is made once, in [`plan()`]; backends
//! execute it and decide nothing. Cost follows content: an unlit image accumulates no normals.
//!
//! ```
//! use surfel_model::{Camera, Scene, Shader, SplatCloud};
//! use surfel_render::{Capabilities, Pass, Planes, SceneSummary, Settings, View, plan};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let disk = SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?.with_colors(&[[0.8, 0.2, 0.1]])?;
//! let scene = Scene::from(disk);
//! let view = View::new(&Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [64, 64]))?;
//! let settings = Settings::default().with_shader(Shader::Unlit);
//! let backend = Capabilities::everything("example");
//!
//! let plan = plan(&SceneSummary::of(&scene), &view, &settings, Planes::COLOR, &backend)?;
//! assert!(plan.has(Pass::Visibility) && plan.has(Pass::Attributes) && plan.has(Pass::Shade));
//! assert!(plan.attributes.color && !plan.attributes.normal);
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate lies between `surfel-model` and the backends `surfel-cpu`, `surfel-gpu`, `surfel-wgpu`, `surfel-ash` and
//! `surfel-reference`. It draws nothing, and no GPU type is visible.
//!
//! # Features
//! `save` adds `Frame::save_png` and `Frame::planes`, and `exr` adds `Frame::save_exr`.

mod background;
mod balls;
#[doc(hidden)]
pub mod clock;
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
mod scene_geometry;
mod shadow;
mod stats;
mod summary;
mod view;

pub use background::Background;
pub use balls::{BallPixel, BallPixelForm, ball_scale};
pub use error::{BackendError, RenderError};
pub use frame::{Frame, FramePlanes, Identity, Planes, PlanesMut};
pub use gaussians::GaussianView;
pub use lod::{
    FADE_OCTAVES, LevelNode, LevelSelection, Magnification, Selection, SplatVisibility, StopReason, select,
    select_levels,
};
pub use plan::{
    Attributes, FramePlan, Pass, SAMPLES_SIDE, SelectedParts, SplatFilter, needs_interior_weight, plan, unsupported,
};
pub use preset::{Preset, Promise, inside_surfaces};
pub use renderer::{Capabilities, Feature, Renderer, RendererInfo, UploadProgress};
pub use scene_geometry::SceneGeometry;
pub use shadow::{SHADOW_BIAS_RADII, SHADOW_MAP_SIDE, ShadowMap, ShadowScene};
pub use stats::{PassTime, Stats};
pub use summary::{GaussianColors, SceneOctree, SceneSummary};
pub use surfel_model::Settings;
pub use view::{Region, View};
