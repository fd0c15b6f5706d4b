//! Splats as they lie in GPU buffers.

use crate::chunk::{Chunk, chunk_length};
use crate::clip::{self, STORED_WORDS, Variant};
use crate::texels::Texels;
use crate::words::Words;
use glam::{DAffine3, DVec3};
use std::collections::VecDeque;
use std::sync::Arc;
use surfel_model::{Geometry, Light, Material, Mesh, Scene, Shape, SplatCloud};
use surfel_render::{RenderError, SceneSummary};
use surfel_shaders::layout;

/// Most splats of a segment: 144 MiB of records.
const SEGMENT_SPLATS: usize = 1 << 20;

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
}

impl Default for Limits {
    /// All that there is; half a gibibyte of records.
    fn default() -> Self {
        Self { buffer_bytes: u64::MAX, texture_side: u32::MAX, record_bytes: 512 << 20 }
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
    /// In the order in which they were uploaded.
    pub segments: Vec<Segment>,
    /// The shaders' `texels`, one word at least.
    pub texels: Vec<u32>,
    pub(crate) objects: Vec<UploadedObject>,
    pub(crate) meshes: Vec<UploadedMesh>,
    pub(crate) lights: Option<Vec<Light>>,
    pub(crate) ambient: [f64; 3],
    /// Linear, premultiplied.
    pub(crate) background: [f64; 4],
}

/// A scene on its way to the GPU, a segment at a time, so that no more than one is ever copied.
pub struct Upload {
    scene: UploadedScene,
    limits: Limits,
    object: usize,
    /// What is still to be uploaded of the current object.
    parts: VecDeque<Part>,
}

/// Splats of an object that are drawn alike.
struct Part {
    variant: Variant,
    is_transparent: bool,
    /// In the order in which they are uploaded, and how many have been.
    order: Vec<u32>,
    at: usize,
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
        let bytes = |segment: &Segment| {
            let count = segment.members.len() as u64;
            let clip = if segment.variant == Variant::Clipped { layout::record_clip::SIZE } else { 0 };
            RecordBytes { records: count * layout::record::SIZE as u64, clips: count * clip as u64 }
        };
        let each: Vec<RecordBytes> = self.segments.iter().map(bytes).collect();
        let shared = each.iter().map(|b| b.records + b.clips).sum::<u64>() > limits.record_bytes;
        (each, shared)
    }
}

impl Upload {
    /// Starts an upload.
    ///
    /// # Errors
    /// [`RenderError::Model`] if the scene is invalid, [`RenderError::Backend`] if the device's buffers hold no splats, or
    /// not the textures.
    pub fn new(scene: &Scene, limits: Limits, backend: &'static str) -> Result<Self, RenderError> {
        scene.validate()?;
        let summary = SceneSummary::of(scene);
        let widest = if summary.clips { Variant::Clipped } else { Variant::Whole };
        if segment_splats(limits, widest) < layout::CHUNK_SPLATS as usize {
            let message =
                format!("the device's storage buffers hold {} bytes, too few to draw from", limits.buffer_bytes);
            return Err(RenderError::Backend { backend, message });
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
            let message =
                format!("the textures need {texel_bytes} bytes, more than the {most} of the device's buffers");
            return Err(RenderError::Backend { backend, message });
        }
        if texels.words.is_empty() {
            texels.words.push(0);
        }
        Ok(Self {
            scene: UploadedScene {
                summary,
                segments: Vec::new(),
                texels: texels.words,
                objects,
                meshes,
                lights: scene.lights.clone(),
                ambient: scene.ambient,
                background: [r * a, g * a, b * a, a],
            },
            limits,
            object: 0,
            parts: VecDeque::new(),
        })
    }

    /// Bytes of all segments together.
    pub fn total_bytes(&self) -> u64 {
        let of_cloud = |cloud: &SplatCloud| {
            let words = |part: Part| part.order.len() as u64 * u64::from(Columns::of(cloud, &part).stride);
            parts(cloud, (0..cloud.len() as u32).collect()).into_iter().map(words).sum::<u64>()
        };
        self.scene.objects.iter().map(|o| 4 * of_cloud(&o.cloud)).sum()
    }

    /// Words of the next segment's splats, or `None` after the last.
    pub fn next_segment(&mut self) -> Option<Vec<u32>> {
        while self.parts.is_empty() {
            let cloud = &self.scene.objects.get(self.object)?.cloud;
            self.parts = parts(cloud, cloud.morton_order());
            self.object += 1;
        }
        let index = self.object - 1;
        let cloud = self.scene.objects.get(index)?.cloud.clone();
        let part = self.parts.front_mut()?;
        let Part { variant, is_transparent, .. } = *part;
        let most = segment_splats(self.limits, variant);
        let columns = Columns::of(&cloud, part);
        let object = index as u32;
        let mut segment =
            Segment { object, variant, is_transparent, chunks: Vec::new(), members: Vec::new(), uniform: Vec::new() };
        let mut words = Vec::new();
        while let Some(rest) = part.order.get(part.at..).filter(|rest| !rest.is_empty()) {
            let (members, _) = rest.split_at(chunk_length(&cloud, rest));
            if segment.members.len() + members.len() > most {
                break;
            }
            let chunk = Chunk::new(&cloud, members, segment.members.len() as u32);
            let code = segment.chunks.len() as u32 * layout::CHUNK_SPLATS;
            for (k, &i) in members.iter().enumerate() {
                columns.push(&cloud, i as usize, chunk.origin, code + k as u32, &mut words);
            }
            segment.chunks.push(chunk);
            segment.members.extend_from_slice(members);
            part.at += members.len();
        }
        segment.uniform = columns.uniform(index as u32, segment.members.len() as u32);
        self.scene.segments.push(segment);
        if part.at == part.order.len() {
            self.parts.pop_front();
        }
        Some(words)
    }

    /// What the CPU keeps, after the last segment.
    pub fn finish(self) -> UploadedScene {
        self.scene
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

/// Splats of a cloud, given in order, by how they are drawn; no part is empty.
fn parts(cloud: &SplatCloud, order: Vec<u32>) -> VecDeque<Part> {
    let (clips, alphas) = (cloud.data().clips.is_some(), cloud.is_transparent());
    let split = |order: Vec<u32>, some: bool, is: &dyn Fn(usize) -> bool| -> [Vec<u32>; 2] {
        if !some {
            return [order, Vec::new()];
        }
        let (with, without) = order.into_iter().partition(|&i| is(i as usize));
        [without, with]
    };
    let mut parts = VecDeque::new();
    let by_alpha = split(order, alphas, &|i| cloud.alpha(i) < 1.0);
    for (order, is_transparent) in by_alpha.into_iter().zip([false, true]) {
        let by_clip = split(order, clips, &|i| clip::is_clipped(cloud, i));
        for (order, variant) in by_clip.into_iter().zip([Variant::Whole, Variant::Clipped]) {
            if !order.is_empty() {
                parts.push_back(Part { variant, is_transparent, order, at: 0 });
            }
        }
    }
    parts
}

/// Which words a cloud's splats have.
struct Columns {
    is_disk: bool,
    stride: u32,
    color_at: u32,
    shading_normal_at: u32,
    clip_at: u32,
    alpha_at: u32,
}

impl Columns {
    fn of(cloud: &SplatCloud, part: &Part) -> Self {
        let data = cloud.data();
        let is_disk = matches!(data.shape, Shape::Disks { .. });
        // The chunk, the centre, and normal and radius or s and t.
        let mut stride = if is_disk { 8 } else { 10 };
        let mut column = |there: bool, words: u32| {
            let at = if there { stride } else { layout::ABSENT };
            stride += if there { words } else { 0 };
            at
        };
        let color_at = column(data.colors.is_some(), 3);
        let shading_normal_at = column(data.shading_normals.is_some(), 3);
        let clip_at = column(part.variant == Variant::Clipped, STORED_WORDS);
        let alpha_at = column(part.is_transparent, 1);
        Self { is_disk, stride, color_at, shading_normal_at, clip_at, alpha_at }
    }

    fn uniform(&self, object: u32, count: u32) -> Vec<u32> {
        use layout::segment as at;
        let mut words = Words::new(at::SIZE);
        words.u32(at::OBJECT, object).u32(at::COUNT, count).u32(at::STRIDE, self.stride);
        words.u32(at::IS_DISK, u32::from(self.is_disk)).u32(at::COLOR_AT, self.color_at);
        words.u32(at::SHADING_NORMAL_AT, self.shading_normal_at).u32(at::CLIP_AT, self.clip_at);
        words.u32(at::ALPHA_AT, self.alpha_at);
        words.into_vec()
    }

    fn push(&self, cloud: &SplatCloud, i: usize, origin: DVec3, code: u32, words: &mut Vec<u32>) {
        let bits = |v: DVec3| v.as_vec3().to_array().map(f32::to_bits);
        words.push(code);
        words.extend(bits(cloud.center(i) - origin));
        match &cloud.data().shape {
            Shape::Disks { .. } => {
                words.extend(bits(cloud.normal(i)));
                words.push((cloud.radius_max(i) as f32).to_bits());
            }
            Shape::Ellipses { .. } => {
                let (s, t) = cloud.axes(i);
                words.extend(bits(s));
                words.extend(bits(t));
            }
        }
        if self.color_at != layout::ABSENT {
            words.extend(cloud.color(i).map(f32::to_bits));
        }
        if self.shading_normal_at != layout::ABSENT {
            words.extend(bits(cloud.shading_normal(i)));
        }
        if self.clip_at != layout::ABSENT {
            clip::push_stored(cloud, i, words);
        }
        if self.alpha_at != layout::ABSENT {
            words.push(cloud.alpha(i).to_bits());
        }
    }
}
