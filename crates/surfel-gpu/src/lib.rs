//! What Surfel's GPU backends share, whatever their API: how a scene lies in buffers ([`Upload`]), what each frame puts
//! beside it ([`TileData`]), and how a picture is cut into tiles and passes ([`tiles()`], [`Sums`]).
//!
//! Everything that needs f64 happens here, on the CPU: origins of chunks relative to the eye, culling of chunks, and the
//! few splats that reach the near plane. The rest is set up on the GPU by the twins of surfel-math's formulas. Buffers are
//! filled by the offsets that `surfel-shaders` reflects from the shaders.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bindings;
mod ceilings;
mod chunk;
mod clip;
mod cost;
mod culling;
mod layers;
mod memory;
mod near;
mod placement;
mod planes;
mod polygon;
mod rounds;
mod schedule;
mod segment;
mod shadows;
mod stored;
mod targets;
mod texels;
mod tile;
mod uniforms;
mod upload;
mod words;

pub use bindings::{Slot, groups, slots};
pub use ceilings::{CEILING_RUNS, Ceiling, CeilingFrame, FillRate};
pub use chunk::Chunk;
pub use clip::Variant;
pub use cost::PlanCost;
pub use layers::{LAYER_HEADER_BYTES, count_layers, layer_draw_offset, layer_draw_words};
pub use memory::{Precision, TargetKey, count_frame_bytes, target_bytes, veil_bytes};
pub use planes::PlaneLayout;
pub use rounds::{HOST_DEPTH_BINDING, PIXEL_BUFFERS, PIXEL_READS, Pixels};
pub use schedule::{LACKS, Step, schedule};
pub use segment::{Limits, RecordBytes, Segment, UploadedScene};
pub use shadows::{MapCache, MapJob, SHADOW_MAPS, map_jobs, shadow_texels};
pub use targets::{Draw, Layer, Sums, Target, TargetFormat};
pub use tile::{NearRecords, SegmentData, TileData, Visible, tiles};
pub use uniforms::FrameScene;
pub use upload::Upload;
