//! Segments of splats that one buffer holds, and what the CPU keeps of an uploaded scene.

use crate::scene::chunk::Chunk;
use crate::scene::clip::Variant;
use crate::scene::limits::Limits;
use glam::DAffine3;
use std::sync::Arc;
use surfel_math::kernel::interior_weight_at_cutoff;
use surfel_model::{GaussianCloud, Light, Matcap, Material, Mesh, Octree, SplatCloud, Storage};
use surfel_render::{FramePlan, SceneSummary};
use surfel_shaders::layout;

/// A part of an object's splats that one buffer holds: what the CPU keeps of it for frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Index of the object among the scene's objects of splats.
    pub object: u32,
    /// Whether all of its splats are clipped or none is.
    pub variant: Variant,
    /// Whether all of its splats have an alpha below 1 or none has.
    pub is_transparent: bool,
    /// Chunks, in order.
    pub chunks: Vec<Chunk>,
    /// Index in the cloud of each of the segment's splats.
    pub members: Vec<u32>,
    /// The shaders' `Segment`.
    pub uniform: Vec<u32>,
}

/// An object of splats.
#[derive(Clone, Debug)]
pub(crate) struct UploadedObject {
    /// Index of the scene's object.
    pub source: u32,
    pub cloud: Arc<SplatCloud>,
    /// If it is an octree: the index of the scene's object, and the octree.
    pub octree: Option<(usize, Arc<Octree>)>,
    pub world_from_object: DAffine3,
    pub material: Material,
}

impl UploadedObject {
    /// Whether its normals all point out of the same surface.
    pub(crate) fn is_oriented(&self) -> bool {
        self.material.is_oriented(&self.cloud)
    }

    /// The coverage of a unit of the object's weight (§5); 1 where its interior weight isn't known, which no plan with
    /// coverage has.
    pub(crate) fn coverage(&self, plan: &FramePlan) -> f64 {
        let known = self.material.interior_weight.or(self.cloud.data().interior_weight);
        known.map_or(1.0, |weight| 1.0 / interior_weight_at_cutoff(weight, plan.splat_filter.cutoff))
    }
}

/// An object of polygons.
#[derive(Clone, Debug)]
pub(crate) struct UploadedMesh {
    /// Index of the scene's object.
    pub source: u32,
    pub mesh: Arc<Mesh>,
    /// Index of the scene's object, if it is an octree.
    pub octree: Option<usize>,
    pub world_from_object: DAffine3,
    pub material: Material,
    /// Where its texture starts in the texels, or `layout::ABSENT`.
    pub texture_at: u32,
}

/// An object of trained Gaussians, which the CPU projects for each frame.
#[derive(Clone, Debug)]
pub(crate) struct UploadedGaussians {
    pub cloud: Arc<GaussianCloud>,
    pub world_from_object: DAffine3,
}

/// What the CPU keeps of a scene.
#[derive(Clone, Debug)]
pub struct UploadedScene {
    /// The facts that planning needs.
    pub summary: SceneSummary,
    /// How splats are stored.
    pub storage: Storage,
    /// Segments, in the order in which they were uploaded.
    pub segments: Vec<Segment>,
    /// The shaders' `texels`, one word at least.
    pub texels: Vec<u32>,
    /// Tells scenes apart: two uploads of a scene are two scenes.
    pub(crate) identity: Arc<()>,
    pub(crate) objects: Vec<UploadedObject>,
    pub(crate) meshes: Vec<UploadedMesh>,
    /// Of a scene of surfaces there are none.
    pub(crate) gaussians: Vec<UploadedGaussians>,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Background colour, linear and premultiplied.
    pub(crate) background: [f64; 4],
}

/// Bytes of a segment's records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordBytes {
    /// Bytes of the records themselves.
    pub records: u64,
    /// Bytes of their clips; 0 for splats that aren't clipped.
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
    /// Bytes for `count` splats.
    pub fn of(count: usize, variant: Variant) -> Self {
        let clip = if variant == Variant::Clipped { layout::record_clip::SIZE } else { 0 };
        Self { records: (count * layout::record::SIZE) as u64, clips: (count * clip) as u64 }
    }

    /// Whether segments share one buffer of records.
    fn are_shared(each: &[Self], limits: Limits) -> bool {
        each.iter().map(|b| b.records + b.clips).sum::<u64>() > limits.record_bytes
    }

    /// Bytes of buffers that hold any one of the segments' records.
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
