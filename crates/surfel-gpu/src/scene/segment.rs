//! Segments, which are splats that share a buffer, and the data of an uploaded scene that stays on the CPU. The
//! *records* of a segment are its splats as set up for a tile; they have a buffer, too.

use crate::scene::chunk::Chunk;
use crate::scene::clip::Variant;
use crate::scene::limits::Limits;
use crate::scene::placement::Placed;
use glam::DAffine3;
use std::sync::Arc;
use surfel_math::kernel::interior_weight_at_cutoff;
use surfel_math::srgb::limit_color;
use surfel_model::{GaussianCloud, Light, Matcap, Material, Mesh, Octree, Scene, SplatCloud, Storage};
use surfel_render::{FramePlan, RenderError, SceneGeometry, SceneSummary, ShadowScene};
use surfel_shaders::layout;

/// Splats of an object that share a buffer. The struct has the data that frames need on the CPU; the splats themselves
/// are in the buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Index of the object among the scene's objects of splats.
    pub object: u32,
    /// Clip variant of all the segment's splats.
    pub variant: Variant,
    /// True if all the segment's splats have an alpha below 1, false if none has.
    pub is_transparent: bool,
    /// Chunks of the segment, in the order of its splats.
    pub chunks: Vec<Chunk>,
    /// Index in the object's cloud of each of the segment's splats, in the order in which the buffer stores them.
    pub members: Vec<u32>,
    /// Words of the shaders' `Segment`.
    pub uniform: Vec<u32>,
    /// Bounds of the splats if the application that embeds Surfel places them, else `None`. The chunks then no longer
    /// apply.
    pub placed: Option<Placed>,
}

/// Object of splats in an uploaded scene.
#[derive(Clone, Debug)]
pub(crate) struct UploadedObject {
    /// Index of the object in the scene.
    pub source: u32,
    pub cloud: Arc<SplatCloud>,
    /// Index of the object in the scene, and its octree; `None` unless the object is an octree.
    pub octree: Option<(usize, Arc<Octree>)>,
    pub world_from_object: DAffine3,
    pub material: Material,
}

impl UploadedObject {
    /// True if the object is oriented: all outward normals point out of the same surface.
    pub(crate) fn is_oriented(&self) -> bool {
        self.material.is_oriented(&self.cloud)
    }

    /// Returns the coverage per unit of weight of the object (rendering model §5): the reciprocal of the interior
    /// weight, which is the sum of weights inside the surface. Returns 1 if the interior weight is unknown; then no
    /// plan reads the coverage.
    pub(crate) fn coverage(&self, plan: &FramePlan) -> f64 {
        let known = self.material.interior_weight.or(self.cloud.data().interior_weight);
        known.map_or(1.0, |weight| 1.0 / interior_weight_at_cutoff(weight, plan.splat_filter.cutoff))
    }
}

/// Object of polygons in an uploaded scene.
#[derive(Clone, Debug)]
pub(crate) struct UploadedMesh {
    /// Index in [`Scene::objects`] of the object that the polygons belong to: a mesh or an octree.
    pub source: u32,
    pub mesh: Arc<Mesh>,
    /// Same index as `source` if the object is an octree, of which each frame draws only selected parts; else `None`.
    pub octree: Option<usize>,
    pub world_from_object: DAffine3,
    pub material: Material,
    /// Offset of the mesh's texture in the buffer `texels`, in words; `layout::ABSENT` without a texture.
    pub texture_at: u32,
}

/// Object of balls in an uploaded scene. The CPU projects the balls for each frame.
#[derive(Clone, Debug)]
pub(crate) struct UploadedBalls {
    /// Index of the object in the scene.
    pub source: u32,
    pub cloud: Arc<SplatCloud>,
    pub world_from_object: DAffine3,
    pub material: Material,
}

/// Object of trained Gaussians in an uploaded scene. The CPU projects the Gaussians for each frame.
#[derive(Clone, Debug)]
pub(crate) struct UploadedGaussians {
    /// Index of the object in the scene.
    pub source: u32,
    pub cloud: Arc<GaussianCloud>,
    pub world_from_object: DAffine3,
}

/// Data of an uploaded scene that stays on the CPU.
#[derive(Clone, Debug)]
pub struct UploadedScene {
    /// Properties of the scene by which frames are planned.
    pub summary: SceneSummary,
    /// Storage format of splats.
    pub storage: Storage,
    /// Segments, in upload order.
    pub segments: Vec<Segment>,
    /// Content of the shaders' buffer `texels`: the linear values of the 256 sRGB bytes, then the textures of all
    /// meshes. A single word if there are no textures, since a buffer can't be empty.
    pub texels: Vec<u32>,
    /// Bounds of the scene for shadow maps, with all splats where they were uploaded; `None` if no light casts shadows.
    pub(crate) uploaded_shadows: Option<ShadowScene>,
    /// Identity of the geometry of the scene's objects.
    pub(crate) geometry: SceneGeometry,
    /// Identity of this upload, with the objects' current placements. Two uploads of the same scene have different
    /// identities.
    pub(crate) identity: Arc<()>,
    /// Objects of splats.
    pub(crate) objects: Vec<UploadedObject>,
    /// Objects of polygons: one for each texture of each mesh, then one for each octree.
    pub(crate) meshes: Vec<UploadedMesh>,
    /// Objects of balls and dots.
    pub(crate) balls: Vec<UploadedBalls>,
    /// Material of the scene's first object.
    pub(crate) material: Material,
    /// Objects of trained Gaussians; empty in a scene of surfaces.
    pub(crate) gaussians: Vec<UploadedGaussians>,
    /// Lights of the scene; `None` for one light along the view.
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    pub(crate) matcap: Option<Arc<Matcap>>,
    /// Background colour, linear and premultiplied.
    pub(crate) background: [f64; 4],
}

/// Sizes of the buffers of a segment's records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordBytes {
    /// Size of the records, in bytes.
    pub records: u64,
    /// Size of the records' clips, in bytes; 0 unless the splats are clipped.
    pub clips: u64,
}

impl UploadedScene {
    /// Replaces everything except the geometry by the data of `scene`. Returns false, and changes nothing, if `scene`
    /// has different geometry.
    ///
    /// # Errors
    /// [`RenderError::Model`] if the scene is invalid.
    pub fn update(&mut self, scene: &Scene) -> Result<bool, RenderError> {
        scene.validate()?;
        if !self.geometry.is_of(scene) {
            return Ok(false);
        }
        self.summary = SceneSummary::of(scene);
        self.uploaded_shadows.clone_from(&self.summary.shadows);
        self.light(scene);
        let place = |source: u32, matrix: &mut DAffine3, material: &mut Material| {
            let Some(object) = scene.objects.get(source as usize) else { return false };
            let is_other = (*matrix, *material) != (object.world_from_object, object.material);
            (*matrix, *material) = (object.world_from_object, object.material);
            is_other
        };
        let mut is_other = false;
        for object in &mut self.objects {
            is_other |= place(object.source, &mut object.world_from_object, &mut object.material);
        }
        for mesh in &mut self.meshes {
            is_other |= place(mesh.source, &mut mesh.world_from_object, &mut mesh.material);
        }
        for balls in &mut self.balls {
            is_other |= place(balls.source, &mut balls.world_from_object, &mut balls.material);
        }
        for gaussians in &mut self.gaussians {
            is_other |= place(gaussians.source, &mut gaussians.world_from_object, &mut Material::default());
        }
        self.cast_shadows_from_placed();
        if is_other {
            // Cached shadow maps show the objects at their old placements.
            self.identity = Arc::new(());
        }
        Ok(true)
    }

    /// Stores the lights, background and other data of a scene that aren't geometry.
    pub(crate) fn light(&mut self, scene: &Scene) {
        let [r, g, b, a] = scene.background;
        self.material = scene.objects.first().map_or(Material::default(), |object| object.material);
        self.lights.clone_from(&scene.lights);
        self.ambient = scene.ambient;
        self.matcap.clone_from(&scene.matcap);
        self.background = [r * a, g * a, b * a, a].map(limit_color);
    }

    /// Returns the sizes of each segment's records, and true if all segments share one buffer of records.
    pub fn records(&self, limits: Limits) -> (Vec<RecordBytes>, bool) {
        let each: Vec<RecordBytes> =
            self.segments.iter().map(|segment| RecordBytes::of(segment.members.len(), segment.variant)).collect();
        let shared = RecordBytes::are_shared(&each, limits);
        (each, shared)
    }
}

impl RecordBytes {
    /// Returns the sizes for `count` splats of a clip variant.
    pub fn of(count: usize, variant: Variant) -> Self {
        let clip = if variant == Variant::Clipped { layout::record_clip::SIZE } else { 0 };
        Self { records: (count * layout::record::SIZE) as u64, clips: (count * clip) as u64 }
    }

    /// True if the segments have to share one buffer of records, because all records together exceed the limit.
    fn are_shared(each: &[Self], limits: Limits) -> bool {
        each.iter().map(|b| b.records + b.clips).sum::<u64>() > limits.record_bytes
    }

    /// Returns the sizes of buffers that fit the records of any single segment.
    pub fn largest(each: &[Self]) -> Self {
        let largest = |of: fn(&Self) -> u64| each.iter().map(of).max().unwrap_or(0);
        Self { records: largest(|b| b.records), clips: largest(|b| b.clips) }
    }

    /// Returns the total size of all buffers of records and their clips, in bytes.
    pub(crate) fn total(each: &[Self], limits: Limits) -> u64 {
        if Self::are_shared(each, limits) {
            let largest = Self::largest(each);
            return largest.records + largest.clips;
        }
        each.iter().map(|b| b.records + b.clips).sum()
    }
}
