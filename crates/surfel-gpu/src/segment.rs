//! Splats as they lie in GPU buffers.

use crate::chunk::Chunk;
use crate::clip::Variant;
use glam::DAffine3;
use std::sync::Arc;
use surfel_model::{Light, Matcap, Material, Mesh, SplatCloud};
use surfel_render::{SceneSummary, Storage};
use surfel_shaders::layout;

/// What may be used of a device. What doesn't fit at once is drawn in parts, to the same picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest buffer that a shader reads, bytes.
    pub buffer_bytes: u64,
    /// Largest side of a texture, pixels.
    pub texture_side: u32,
    /// Records of a scene that take more than this, in bytes, share one buffer and are set up anew for each pass: time for
    /// memory.
    pub record_bytes: u64,
    /// Memory that a scene and its records may take, bytes. A scene that needs more is refused before anything is allocated.
    pub memory_bytes: u64,
}

impl Default for Limits {
    /// All that there is; half a gibibyte of records.
    fn default() -> Self {
        Self { buffer_bytes: u64::MAX, texture_side: u32::MAX, record_bytes: 512 << 20, memory_bytes: u64::MAX }
    }
}

impl Limits {
    /// These limits, and a device's own.
    #[must_use]
    pub fn within(self, buffer_bytes: u64, texture_side: u32) -> Self {
        Self {
            buffer_bytes: self.buffer_bytes.min(buffer_bytes),
            texture_side: self.texture_side.min(texture_side),
            ..self
        }
    }

    /// These limits, and a device's memory.
    #[must_use]
    pub fn within_memory(self, bytes: u64) -> Self {
        Self { memory_bytes: self.memory_bytes.min(bytes), ..self }
    }
}

/// A part of an object's splats that one buffer holds. The CPU keeps what frames need of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Index of the object among the scene's objects of splats.
    pub object: u32,
    /// Whether all of its splats are clipped or none is.
    pub variant: Variant,
    /// Whether all of its splats have an alpha below 1 or none has.
    pub is_transparent: bool,
    /// Chunks in order.
    pub chunks: Vec<Chunk>,
    /// Which splat of the cloud each of the segment's is.
    pub members: Vec<u32>,
    /// The shaders' `Segment`.
    pub uniform: Vec<u32>,
}

/// An object of splats.
#[derive(Clone, Debug)]
pub(crate) struct UploadedObject {
    pub cloud: Arc<SplatCloud>,
    pub world_from_object: DAffine3,
    pub material: Material,
}

/// An object of polygons.
#[derive(Clone, Debug)]
pub(crate) struct UploadedMesh {
    pub mesh: Arc<Mesh>,
    pub world_from_object: DAffine3,
    pub material: Material,
    /// Where its texture starts in the texels, or `layout::ABSENT`.
    pub texture_at: u32,
}

/// What the CPU keeps of a scene.
#[derive(Clone, Debug)]
pub struct UploadedScene {
    /// What planning needs.
    pub summary: SceneSummary,
    /// How splats are stored.
    pub storage: Storage,
    /// In the order in which they were uploaded.
    pub segments: Vec<Segment>,
    /// The shaders' `texels`, one word at least.
    pub texels: Vec<u32>,
    /// Its own: two uploads of a scene are two scenes.
    pub(crate) identity: Arc<()>,
    pub(crate) objects: Vec<UploadedObject>,
    pub(crate) meshes: Vec<UploadedMesh>,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Linear, premultiplied.
    pub(crate) background: [f64; 4],
}

/// Bytes of a segment's records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordBytes {
    /// Of the records themselves.
    pub records: u64,
    /// Of what clips them; 0 where nothing does.
    pub clips: u64,
}

impl UploadedScene {
    /// Bytes of each segment's records, and whether all segments share one buffer of them.
    pub fn records(&self, limits: Limits) -> (Vec<RecordBytes>, bool) {
        let each: Vec<RecordBytes> =
            self.segments.iter().map(|segment| RecordBytes::of(segment.members.len(), segment.variant)).collect();
        let shared = RecordBytes::are_shared(&each, limits);
        (each, shared)
    }
}

impl RecordBytes {
    /// Of so many splats.
    pub(crate) fn of(count: usize, variant: Variant) -> Self {
        let clip = if variant == Variant::Clipped { layout::record_clip::SIZE } else { 0 };
        Self { records: (count * layout::record::SIZE) as u64, clips: (count * clip) as u64 }
    }

    /// Whether segments share one buffer of records.
    fn are_shared(each: &[Self], limits: Limits) -> bool {
        each.iter().map(|b| b.records + b.clips).sum::<u64>() > limits.record_bytes
    }

    /// What holds any one of them.
    pub fn largest(each: &[Self]) -> Self {
        let largest = |of: fn(&Self) -> u64| each.iter().map(of).max().unwrap_or(0);
        Self { records: largest(|b| b.records), clips: largest(|b| b.clips) }
    }

    /// Bytes of all buffers of records.
    pub(crate) fn total(each: &[Self], limits: Limits) -> u64 {
        if Self::are_shared(each, limits) {
            let largest = Self::largest(each);
            return largest.records + largest.clips;
        }
        each.iter().map(|b| b.records + b.clips).sum()
    }
}
