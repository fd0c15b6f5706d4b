//! Code that Surfel's GPU backends share, whatever their API: the scene's layout in buffers, the data that each frame
//! uploads in addition, and the passes that draw it.
//!
//! Main types, in reading order:
//!
//! 1. [`Upload`]: packs a scene into [`Segment`]s of splats and returns an [`UploadedScene`]; [`Limits`] state what the
//!    device allows;
//! 2. [`FrameTiles`]: the tiles of a frame, each within the device's limits;
//! 3. [`FrameScene`] and [`TileData`]: the uniforms, visible chunks and near splats that a frame and a tile upload;
//! 4. [`schedule()`]: the [`Step`]s of a tile, which a backend runs in this order; [`Draw`] and [`PixelPass`] are the
//!    passes among them;
//! 5. [`CellTiles`]: the steps that draw splats by compute shaders in place of raster hardware ([`GpuPath`]);
//! 6. [`binding_slots`]: the bindings of an entry point, as reflected from the shaders.
//!
//! ```
//! use surfel_gpu::{Step, UNSUPPORTED, VisibleSegments, schedule};
//! use surfel_model::{Camera, Scene, Settings, SplatCloud};
//! use surfel_render::{Capabilities, Planes, SceneSummary, View, plan};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::from(SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?);
//! let view = View::new(&Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [64, 64]))?;
//! let capabilities = Capabilities { backend: "example", lacks: UNSUPPORTED };
//! let plan = plan(&SceneSummary::of(&scene), &view, &Settings::default(), Planes::COLOR, &capabilities)?;
//!
//! // One segment of opaque splats is visible in the tile: splats are set up before they are drawn.
//! let visible = VisibleSegments { opaque: vec![0], ..VisibleSegments::default() };
//! let steps = schedule(&plan, &visible, false);
//! assert!(matches!(&steps[0], Step::Setup { segments, first: true } if segments == &[0]));
//! assert!(steps.iter().any(|step| matches!(step, Step::Draw { .. })));
//! # Ok(())
//! # }
//! ```
//!
//! # Terms
//! - A *segment* is the part of an object's splats that shares a buffer ([`Segment`]). Its *chunks* are groups of up to
//!   256 neighbouring splats, which are culled together ([`Chunk`]).
//! - A *tile* is the part of the image that is drawn at once ([`FrameTiles`]).
//! - A *record* is a splat as set up for a tile: its projected forms, pixel boxes and colour in a buffer (`Record` in
//!   `shaders/passes/types.wgsl`).
//! - A *cell* is a small square of a tile's pixels that has its own list of splats, balls or Gaussians.
//! - An *entry point* is a function of a shader with which a pipeline begins. The *host* is the CPU side. Only in
//!   [`HostLayout`], [`HostAttribute`], [`HostFormat`] and names of bindings and passes it is the application that
//!   embeds Surfel.
//!
//! # Layer
//! The crate lies between `surfel-render`, whose plan it turns into steps, and the backends `surfel-wgpu` and
//! `surfel-ash`, which run them. No GPU API is visible. It has no Cargo features.
//!
//! Everything that needs f64 happens here, on the CPU: chunk origins relative to the eye, culling of chunks, and setup
//! of the few splats that reach the near plane (see `frame/near_plane.rs`). The GPU sets up all other splats, by the
//! WGSL twins of surfel-math's formulas. Buffers are filled at the offsets that `surfel-shaders` reflects from the
//! shaders.
//!
//! Modules import downward: `frame` (a view's tiles, uniforms, culling) uses `passes` (draws, targets, their order),
//! which uses `scene` (splats, clips and textures in buffers).

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bindings;
mod frame;
mod passes;
mod scene;
mod struct_writer;

pub use bindings::{BindingSlot, binding_slots, workgroups};
pub use frame::cell_tiles::CellTiles;
pub use frame::gaussians::GaussianLists;
pub use frame::planes::PlaneLayout;
pub use frame::samples::SamplePart;
pub use frame::shadow_maps::{SHADOW_MAPS, ShadowMapCache, ShadowMapJob, shadow_map_jobs, shadow_texels};
pub use frame::surface_count::min_surface_count;
pub use frame::tile::{HostWork, NearRecords, SegmentData, TileData};
pub use frame::tiling::FrameTiles;
pub use frame::uniforms::FrameScene;
pub use passes::cell_stages::{CellStage, CellStep, cell_entries, is_cell_entry};
pub use passes::cells::{CELL_PAIRS, CellBinding, CellBuffer, CellCapacity, CellCounts, CellRound, GpuPath};
pub use passes::draw::{Draw, Layer, Sums};
pub use passes::fill_rate::{FILL_RATE_RUNS, FillRate, FillRateFrame};
pub use passes::layer_draws::{LAYER_HEADER_BYTES, count_layers, layer_draw_offset, layer_draw_words, layers_remain};
pub use passes::memory::{Precision, TargetKey, count_frame_bytes, layer_composite_bytes, target_bytes};
pub use passes::pass_list::with_more_layers;
pub use passes::pixel_pass::{
    EDGE_SAMPLES, GAUSSIAN_BUFFERS, HOST_DEPTH_BINDING, HOST_PLANES_BINDING, PIXEL_PASS_BUFFERS, PIXEL_PASS_TEXTURES,
    PixelPass, SETUP_STEPS_BINDING,
};
pub use passes::plan_cost::PlanCost;
pub use passes::probe::FillRateProbe;
pub use passes::schedule::{Step, UNSUPPORTED, VisibleSegments, schedule};
pub use passes::targets::{Target, TargetFormat};
pub use scene::chunk::Chunk;
pub use scene::clip::Variant;
pub use scene::limits::Limits;
pub use scene::placement::{HostAttribute, HostFormat, HostLayout, Placed, PlacedBounds};
pub use scene::segment::{RecordBytes, Segment, UploadedScene};
pub use scene::upload::Upload;
