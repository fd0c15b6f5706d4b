//! Upload of a scene: splits clouds into segments and packs them one at a time. A *segment* is the part of an object's
//! splats that shares a buffer; its *records* are the splats as set up for a tile.

use crate::scene::chunk::Chunk;
use crate::scene::clip::{self, Variant};
use crate::scene::limits::Limits;
use crate::scene::segment::{
    RecordBytes, Segment, UploadedBalls, UploadedGaussians, UploadedMesh, UploadedObject, UploadedScene,
};
use crate::scene::stored_splats::{StoredLayout, StoredWriter};
use crate::scene::textures::TextureBuffer;
use std::collections::VecDeque;
use std::sync::Arc;
use surfel_model::{ChunkSpace, Storage, chunks};
use surfel_model::{Geometry, Material, Scene, SplatCloud};
use surfel_render::{RenderError, SceneGeometry, SceneSummary};
use surfel_shaders::layout;

/// Maximum number of splats of a segment. The records of so many splats take 144 MiB.
const SEGMENT_SPLATS: usize = 1 << 20;

/// Upload of a scene in progress. Segments are packed one at a time, so that main memory has a packed copy of at most
/// one.
pub struct Upload {
    scene: UploadedScene,
    /// Segments that aren't packed yet, in order.
    segments: VecDeque<PlannedSegment>,
    splat_bytes: u64,
    needed_bytes: u64,
}

/// Segment that isn't packed yet.
struct PlannedSegment {
    object: u32,
    variant: Variant,
    is_transparent: bool,
    /// Index in the object's cloud of each of the segment's splats.
    members: Vec<u32>,
    /// Chunks of the segment, in order.
    chunks: Vec<PlannedChunk>,
}

/// Chunk of a planned segment.
struct PlannedChunk {
    /// Object-space origin of the chunk's centres, and the scales of its quantised numbers.
    space: ChunkSpace,
    /// End of the chunk (exclusive) among the segment's splats.
    end: usize,
}

/// Objects of a scene, grouped by kind of geometry.
#[derive(Default)]
struct Geometries {
    objects: Vec<UploadedObject>,
    meshes: Vec<UploadedMesh>,
    textures: TextureBuffer,
    gaussians: Vec<UploadedGaussians>,
    balls: Vec<UploadedBalls>,
}

impl Geometries {
    /// Groups the objects of a scene by kind.
    ///
    /// # Errors
    /// [`RenderError::Model`] if a mesh is invalid.
    fn of(scene: &Scene) -> Result<Self, RenderError> {
        let mut sorted = Self::default();
        // Of polygons at equal depth the first is drawn. Octrees come after all meshes, so that meshes have priority.
        let mut octrees = Vec::new();
        for (index, object) in scene.objects.iter().enumerate() {
            let (world_from_object, material, source) = (object.world_from_object, object.material, index as u32);
            match &object.geometry {
                Geometry::Splats(cloud) if cloud.is_balls() => {
                    sorted.balls.push(UploadedBalls { source, cloud: cloud.clone(), world_from_object, material });
                }
                Geometry::Splats(cloud) => {
                    let cloud = cloud.clone();
                    sorted.objects.push(UploadedObject { source, cloud, octree: None, world_from_object, material });
                }
                Geometry::Mesh(mesh) => {
                    mesh.validate()?;
                    for mesh in mesh.by_texture() {
                        let texture_at = sorted.textures.add(&mesh);
                        sorted.meshes.push(UploadedMesh {
                            source,
                            mesh,
                            octree: None,
                            world_from_object,
                            material,
                            texture_at,
                        });
                    }
                }
                Geometry::Gaussians(cloud) => {
                    sorted.gaussians.push(UploadedGaussians { source, cloud: cloud.clone(), world_from_object });
                }
                Geometry::Octree(octree) => {
                    let (cloud, parts) = (octree.shared_cloud(), Some((index, octree.clone())));
                    sorted.objects.push(UploadedObject { source, cloud, octree: parts, world_from_object, material });
                    octrees.push((index, octree.shared_mesh(), object));
                }
            }
        }
        for (index, mesh, object) in octrees {
            let (world_from_object, material, source) = (object.world_from_object, object.material, index as u32);
            let texture_at = sorted.textures.add(&mesh);
            let octree = Some(index);
            sorted.meshes.push(UploadedMesh { source, mesh, octree, world_from_object, material, texture_at });
        }
        Ok(sorted)
    }
}

impl Upload {
    /// Starts the upload of a scene: plans its segments, and packs its textures. `backend` is a name for messages.
    ///
    /// # Errors
    /// [`RenderError::Model`] if the scene is invalid, [`RenderError::SceneTooLarge`] if it exceeds the memory limit,
    /// [`RenderError::Backend`] if the device's buffers are too small for the textures or for any splats.
    pub fn new(scene: &Scene, storage: Storage, limits: Limits, backend: &'static str) -> Result<Self, RenderError> {
        scene.validate()?;
        let summary = SceneSummary::of(scene);
        let refused = |message| Err(RenderError::Backend { backend, message });
        let widest = if summary.clips { Variant::Clipped } else { Variant::Whole };
        if segment_splats(limits, widest) < layout::CHUNK_SPLATS as usize {
            let most = limits.buffer_bytes;
            return refused(format!("the device's storage buffers hold {most} bytes, too few to draw from"));
        }
        let Geometries { objects, meshes, mut textures, gaussians, balls } = Geometries::of(scene)?;
        let texel_bytes = 4 * textures.words.len() as u64;
        if texel_bytes > limits.buffer_bytes.min(4 * u64::from(u32::MAX)) {
            let most = limits.buffer_bytes;
            return refused(format!(
                "the textures need {texel_bytes} bytes, more than the {most} of the device's buffers"
            ));
        }
        if textures.words.is_empty() {
            textures.words.push(0);
        }
        let of_object = |(object, uploaded): (usize, &UploadedObject)| {
            planned_segments(object as u32, uploaded, storage, |variant| segment_splats(limits, variant))
        };
        let segments: VecDeque<PlannedSegment> = objects.iter().enumerate().flat_map(of_object).collect();
        let words = |planned: &PlannedSegment| {
            let cloud = objects.get(planned.object as usize).map(|object| &object.cloud);
            cloud.map_or(0, |cloud| planned.fields(cloud, storage).words(planned.members.len(), planned.chunks.len()))
        };
        let splat_bytes = 4 * segments.iter().map(words).sum::<u64>();
        let records: Vec<RecordBytes> =
            segments.iter().map(|planned| RecordBytes::of(planned.members.len(), planned.variant)).collect();
        let needed = splat_bytes + texel_bytes + RecordBytes::total(&records, limits);
        if needed > limits.memory_bytes {
            return Err(RenderError::SceneTooLarge { backend, needed, available: limits.memory_bytes });
        }
        let mut uploaded = UploadedScene {
            balls,
            material: Material::default(),
            uploaded_shadows: summary.shadows.clone(),
            summary,
            storage,
            segments: Vec::with_capacity(segments.len()),
            texels: textures.words,
            geometry: SceneGeometry::of(scene),
            identity: Arc::new(()),
            objects,
            meshes,
            gaussians,
            lights: None,
            ambient: [0.0; 3],
            matcap: None,
            background: [0.0; 4],
        };
        uploaded.light(scene);
        Ok(Self { scene: uploaded, segments, splat_bytes, needed_bytes: needed })
    }

    /// Returns the total size of all segments' splats, in bytes.
    pub fn splat_bytes(&self) -> u64 {
        self.splat_bytes
    }

    /// Returns the total size of splats, textures and records, in bytes.
    pub fn needed_bytes(&self) -> u64 {
        self.needed_bytes
    }

    /// Packs the next segment and returns the words of its splats; `None` after the last segment.
    pub fn next_segment(&mut self) -> Option<Vec<u32>> {
        let planned = self.segments.pop_front()?;
        let cloud = &self.scene.objects.get(planned.object as usize)?.cloud;
        let storage = self.scene.storage;
        let fields = planned.fields(cloud, storage);
        let mut packed = StoredWriter::new(storage);
        let mut chunks = Vec::with_capacity(planned.chunks.len());
        let mut first = 0;
        for (index, &PlannedChunk { space, end }) in planned.chunks.iter().enumerate() {
            let members = planned.members.get(first..end).unwrap_or_default();
            let code = index as u32 * layout::CHUNK_SPLATS;
            for (k, &i) in members.iter().enumerate() {
                fields.push(cloud, i as usize, &space, code + k as u32, &mut packed);
            }
            chunks.push(Chunk::new(cloud, members, space, first as u32));
            first = end;
        }
        let (words, scales_at) = packed.finish(planned.chunks.iter().map(|chunk| chunk.space));
        let PlannedSegment { object, variant, is_transparent, members, .. } = planned;
        let uniform = fields.uniform(object, members.len() as u32, scales_at);
        self.scene.segments.push(Segment { object, variant, is_transparent, chunks, members, uniform, placed: None });
        Some(words)
    }

    /// Returns the data that stays on the CPU. Must be called after the last segment.
    pub fn finish(self) -> UploadedScene {
        self.scene
    }
}

impl PlannedSegment {
    fn new(object: u32, variant: Variant, is_transparent: bool) -> Self {
        Self { object, variant, is_transparent, members: Vec::new(), chunks: Vec::new() }
    }

    /// Returns the layout of the segment's stored splats.
    fn fields(&self, cloud: &SplatCloud, storage: Storage) -> StoredLayout {
        StoredLayout::of(cloud, self.variant, self.is_transparent, storage)
    }
}

/// Returns the maximum number of splats of a segment of a clip variant: [`SEGMENT_SPLATS`], or fewer if their records
/// wouldn't fit a buffer.
fn segment_splats(limits: Limits, variant: Variant) -> usize {
    let largest = match variant {
        Variant::Whole => layout::record::SIZE,
        Variant::Clipped => layout::record::SIZE.max(layout::record_clip::SIZE),
    };
    (limits.buffer_bytes / largest as u64).min(SEGMENT_SPLATS as u64) as usize
}

/// Splits an object's cloud into segments by clip variant and transparency; none is empty. `most` returns the maximum
/// number of splats of a segment. Chunks are cut before this separation, so that their quantised numbers equal those of
/// the CPU backend.
fn planned_segments(
    object: u32,
    uploaded: &UploadedObject,
    storage: Storage,
    most: impl Fn(Variant) -> usize,
) -> Vec<PlannedSegment> {
    let cloud: &SplatCloud = &uploaded.cloud;
    let (has_clips, has_alphas) = (cloud.data().clips.is_some(), cloud.is_transparent());
    let kinds = [false, true].map(|transparent| [Variant::Whole, Variant::Clipped].map(|v| (v, transparent)));
    let mut open = kinds.as_flattened().iter().map(|&(v, transparent)| PlannedSegment::new(object, v, transparent));
    let mut open: Vec<PlannedSegment> = open.by_ref().collect();
    let mut full = Vec::new();
    // A chunk of an octree must not mix splats of different nodes or transitions.
    let orders: Vec<Vec<u32>> = match &uploaded.octree {
        Some((_, octree)) => octree.parts().map(Iterator::collect).collect(),
        None => vec![cloud.morton_order()],
    };
    for (space, members) in orders.iter().flat_map(|order| chunks(cloud, order, storage)) {
        for segment in &mut open {
            let is_own = |i: usize| {
                (has_alphas && cloud.alpha(i) < 1.0) == segment.is_transparent
                    && (has_clips && clip::is_clipped(cloud, i)) == (segment.variant == Variant::Clipped)
            };
            let own: Vec<u32> = members.iter().copied().filter(|&i| is_own(i as usize)).collect();
            if own.is_empty() {
                continue;
            }
            if segment.members.len() + own.len() > most(segment.variant) {
                let next = PlannedSegment::new(object, segment.variant, segment.is_transparent);
                full.push(std::mem::replace(segment, next));
            }
            segment.members.extend(own);
            segment.chunks.push(PlannedChunk { space, end: segment.members.len() });
        }
    }
    full.extend(open.into_iter().filter(|segment| !segment.members.is_empty()));
    full
}
