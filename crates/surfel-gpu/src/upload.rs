//! A scene on its way to the GPU, a segment at a time.

use crate::chunk::Chunk;
use crate::clip::{self, Variant};
use crate::segment::{Limits, RecordBytes, Segment, UploadedMesh, UploadedObject, UploadedScene};
use crate::stored::{Fields, Packed};
use crate::texels::Texels;
use std::collections::VecDeque;
use std::sync::Arc;
use surfel_model::{Geometry, Scene, SplatCloud};
use surfel_render::{ChunkSpace, RenderError, SceneSummary, Storage, chunks};
use surfel_shaders::layout;

/// Most splats of a segment: 144 MiB of records.
const SEGMENT_SPLATS: usize = 1 << 20;

/// A scene on its way to the GPU, a segment at a time, so that no more than one is ever copied.
pub struct Upload {
    scene: UploadedScene,
    segments: VecDeque<Planned>,
    splat_bytes: u64,
    needed_bytes: u64,
}

/// A segment that is still to be uploaded.
struct Planned {
    object: u32,
    variant: Variant,
    is_transparent: bool,
    members: Vec<u32>,
    /// Of its chunks, in order: what their numbers are relative to, and one past the last of their members.
    chunks: Vec<(ChunkSpace, usize)>,
}

impl Upload {
    /// Starts an upload.
    ///
    /// # Errors
    /// [`RenderError::Model`] if the scene is invalid, [`RenderError::SceneTooLarge`] if it doesn't fit into the memory,
    /// [`RenderError::Backend`] if the device's buffers hold no splats, or not the textures.
    pub fn new(scene: &Scene, storage: Storage, limits: Limits, backend: &'static str) -> Result<Self, RenderError> {
        scene.validate()?;
        let summary = SceneSummary::of(scene);
        let refused = |message| Err(RenderError::Backend { backend, message });
        let widest = if summary.clips { Variant::Clipped } else { Variant::Whole };
        if segment_splats(limits, widest) < layout::CHUNK_SPLATS as usize {
            let most = limits.buffer_bytes;
            return refused(format!("the device's storage buffers hold {most} bytes, too few to draw from"));
        }
        let [r, g, b, a] = scene.background;
        let (mut objects, mut meshes, mut texels) = (Vec::new(), Vec::new(), Texels::default());
        for object in &scene.objects {
            let (world_from_object, material) = (object.world_from_object, object.material);
            match &object.geometry {
                Geometry::Splats(cloud) => {
                    objects.push(UploadedObject { cloud: cloud.clone(), world_from_object, material });
                }
                Geometry::Mesh(mesh) => {
                    mesh.validate()?;
                    let texture_at = texels.of(mesh);
                    meshes.push(UploadedMesh { mesh: mesh.clone(), world_from_object, material, texture_at });
                }
            }
        }
        let texel_bytes = 4 * texels.words.len() as u64;
        if texel_bytes > limits.buffer_bytes.min(4 * u64::from(u32::MAX)) {
            let most = limits.buffer_bytes;
            return refused(format!(
                "the textures need {texel_bytes} bytes, more than the {most} of the device's buffers"
            ));
        }
        if texels.words.is_empty() {
            texels.words.push(0);
        }
        let of_object = |(object, uploaded): (usize, &UploadedObject)| {
            planned(object as u32, &uploaded.cloud, storage, |variant| segment_splats(limits, variant))
        };
        let segments: VecDeque<Planned> = objects.iter().enumerate().flat_map(of_object).collect();
        let words = |planned: &Planned| {
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
        let scene = UploadedScene {
            summary,
            storage,
            segments: Vec::with_capacity(segments.len()),
            texels: texels.words,
            identity: Arc::new(()),
            objects,
            meshes,
            lights: scene.lights.clone(),
            ambient: scene.ambient,
            matcap: scene.matcap.clone(),
            background: [r * a, g * a, b * a, a],
        };
        Ok(Self { scene, segments, splat_bytes, needed_bytes: needed })
    }

    /// Bytes of all segments' splats together.
    pub fn splat_bytes(&self) -> u64 {
        self.splat_bytes
    }

    /// Bytes of splats, textures and records together.
    pub fn needed_bytes(&self) -> u64 {
        self.needed_bytes
    }

    /// Words of the next segment's splats, or `None` after the last.
    pub fn next_segment(&mut self) -> Option<Vec<u32>> {
        let planned = self.segments.pop_front()?;
        let cloud = &self.scene.objects.get(planned.object as usize)?.cloud;
        let storage = self.scene.storage;
        let fields = planned.fields(cloud, storage);
        let mut packed = Packed::new(storage);
        let mut chunks = Vec::with_capacity(planned.chunks.len());
        let mut first = 0;
        for (index, &(space, end)) in planned.chunks.iter().enumerate() {
            let members = planned.members.get(first..end).unwrap_or_default();
            let code = index as u32 * layout::CHUNK_SPLATS;
            for (k, &i) in members.iter().enumerate() {
                fields.push(cloud, i as usize, &space, code + k as u32, &mut packed);
            }
            chunks.push(Chunk::new(cloud, members, space, first as u32));
            first = end;
        }
        let (words, scales_at) = packed.finish(planned.chunks.iter().map(|chunk| chunk.0));
        let Planned { object, variant, is_transparent, members, .. } = planned;
        let uniform = fields.uniform(object, members.len() as u32, scales_at);
        self.scene.segments.push(Segment { object, variant, is_transparent, chunks, members, uniform });
        Some(words)
    }

    /// What the CPU keeps, after the last segment.
    pub fn finish(self) -> UploadedScene {
        self.scene
    }
}

impl Planned {
    fn new(object: u32, variant: Variant, is_transparent: bool) -> Self {
        Self { object, variant, is_transparent, members: Vec::new(), chunks: Vec::new() }
    }

    fn fields(&self, cloud: &SplatCloud, storage: Storage) -> Fields {
        Fields::of(cloud, self.variant, self.is_transparent, storage)
    }
}

/// Most splats of a segment.
fn segment_splats(limits: Limits, variant: Variant) -> usize {
    let largest = match variant {
        Variant::Whole => layout::record::SIZE,
        Variant::Clipped => layout::record::SIZE.max(layout::record_clip::SIZE),
    };
    (limits.buffer_bytes / largest as u64).min(SEGMENT_SPLATS as u64) as usize
}

/// Segments of a cloud, by how its splats are drawn; none is empty. Chunks are cut before splats are sorted by that, so that
/// their numbers are what they are on the processor.
fn planned(object: u32, cloud: &SplatCloud, storage: Storage, most: impl Fn(Variant) -> usize) -> Vec<Planned> {
    let (has_clips, has_alphas) = (cloud.data().clips.is_some(), cloud.is_transparent());
    let kinds = [false, true].map(|transparent| [Variant::Whole, Variant::Clipped].map(|v| (v, transparent)));
    let mut open = kinds.as_flattened().iter().map(|&(v, transparent)| Planned::new(object, v, transparent));
    let mut open: Vec<Planned> = open.by_ref().collect();
    let mut full = Vec::new();
    let order = cloud.morton_order();
    for (space, members) in chunks(cloud, &order, storage) {
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
                let next = Planned::new(object, segment.variant, segment.is_transparent);
                full.push(std::mem::replace(segment, next));
            }
            segment.members.extend(own);
            segment.chunks.push((space, segment.members.len()));
        }
    }
    full.extend(open.into_iter().filter(|segment| !segment.members.is_empty()));
    full
}
