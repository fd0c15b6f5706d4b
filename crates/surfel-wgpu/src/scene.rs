//! Scene in the device's memory. A *segment* is the part of an object's splats that shares a buffer
//! ([`surfel_gpu::Segment`]). Its *records* are the splats as set up for a tile.

use crate::error::{ScopedError, scoped};
use crate::pipelines::SplatPipeline;
use crate::queue::Queue;
use surfel_gpu::{Limits, RecordBytes, Upload, UploadedScene, Variant};
use surfel_model::Scene;
use surfel_model::Storage;
use surfel_render::{RenderError, UploadProgress};

/// Scene as this backend stores it: splats in the device's memory, their chunks and clouds in the main memory.
pub struct ResidentScene {
    pub(crate) cpu: UploadedScene,
    /// Buffers of each segment, in the order of the segments of `cpu`.
    pub(crate) segments: Vec<ResidentSegment>,
    /// Textures of polygons.
    pub(crate) texels: wgpu::Buffer,
    /// True if all segments share one buffer of records.
    pub(crate) shared_records: bool,
    /// Device memory of the splats in bytes, without their records.
    pub(crate) bytes: u64,
}

/// Buffers of a segment of splats, and the number of splats.
pub(crate) struct ResidentSegment {
    pub uniform: wgpu::Buffer,
    pub splats: wgpu::Buffer,
    pub records: Records,
    pub count: u32,
    /// Index in the object's cloud of each splat, if the application places the splats, else `None`.
    pub members: Option<wgpu::Buffer>,
}

/// Buffers of the records of splats.
#[derive(Clone)]
pub(crate) struct Records {
    pub records: wgpu::Buffer,
    /// Clips of the records; `None` unless the splats are clipped.
    pub clips: Option<wgpu::Buffer>,
}

impl Records {
    /// Creates the bind group through which draws read the records and, for the variant `Clipped`, their clips.
    pub(crate) fn group(&self, device: &wgpu::Device, pipeline: &SplatPipeline, variant: Variant) -> wgpu::BindGroup {
        let clips = self.clips.iter().filter(|_| variant == Variant::Clipped);
        bind(
            device,
            "records",
            &pipeline.records_group.layout,
            &[&self.records].into_iter().chain(clips).collect::<Vec<_>>(),
        )
    }
}

impl ResidentScene {
    /// Returns the device memory of the splats in bytes, without their records.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Creates a buffer with these words.
pub(crate) fn filled(
    device: &wgpu::Device,
    queue: &Queue,
    label: &str,
    words: &[u32],
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    filled_before(device, queue, label, words, 0, usage)
}

/// Creates a buffer with these words, followed by `more` zero bytes.
pub(crate) fn filled_before(
    device: &wgpu::Device,
    queue: &Queue,
    label: &str,
    words: &[u32],
    more: u64,
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    let bytes: &[u8] = bytemuck::cast_slice(words);
    let buffer = empty(device, label, bytes.len() as u64 + more, usage | wgpu::BufferUsages::COPY_DST);
    queue.write(&buffer, bytes);
    buffer
}

/// Creates a buffer of at least four zero bytes.
pub(crate) fn empty(device: &wgpu::Device, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    // An empty binding is an error.
    let size = bytes.max(4);
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}

/// Uploads a scene, and reports the progress after each segment.
pub(crate) fn upload(
    device: &wgpu::Device,
    queue: &Queue,
    (scene, storage): (&Scene, Storage),
    limits: Limits,
    progress: &mut dyn FnMut(UploadProgress),
) -> Result<ResidentScene, RenderError> {
    let mut upload = Upload::new(scene, storage, limits, crate::NAME)?;
    let (bytes, needed) = (upload.splat_bytes(), upload.needed_bytes());
    let mut done = 0;
    progress(UploadProgress { done_bytes: done, total_bytes: bytes });
    let mut splats = Vec::new();
    while let Some(words) = upload.next_segment() {
        let made = scoped(device, || {
            let buffer = filled(device, queue, "splats", &words, wgpu::BufferUsages::STORAGE);
            // Submitting copies the staged data, so that at most one segment is staged at a time.
            queue.submit([]);
            buffer
        });
        splats.push(made.map_err(|caught| too_large(caught, needed, done))?);
        done += 4 * words.len() as u64;
        progress(UploadProgress { done_bytes: done, total_bytes: bytes });
    }
    let cpu = upload.finish();
    let (record_bytes, shared_records) = cpu.records(limits);
    let usage = wgpu::BufferUsages::STORAGE;
    let made = scoped(device, || {
        let texels = filled(device, queue, "texels", &cpu.texels, usage);
        let records = |RecordBytes { records, clips }| Records {
            records: empty(device, "records", records, usage),
            clips: (clips > 0).then(|| empty(device, "clips", clips, usage)),
        };
        let shared = shared_records.then(|| records(RecordBytes::largest(&record_bytes)));
        let each = cpu.segments.iter().zip(splats).zip(&record_bytes);
        let segments = each.map(|((segment, splats), &bytes)| ResidentSegment {
            uniform: filled(device, queue, "segment", &segment.uniform, wgpu::BufferUsages::UNIFORM),
            splats,
            records: shared.clone().unwrap_or_else(|| records(bytes)),
            count: segment.members.len() as u32,
            members: None,
        });
        (texels, segments.collect())
    });
    let (texels, segments) = made.map_err(|caught| too_large(caught, needed, done))?;
    Ok(ResidentScene { cpu, segments, texels, shared_records, bytes })
}

/// Creates a bind group of buffers, whose binding numbers count from 0.
pub(crate) fn bind(
    device: &wgpu::Device,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    buffers: &[&wgpu::Buffer],
) -> wgpu::BindGroup {
    bind_with(device, label, layout, buffers, &[])
}

/// Creates a bind group of buffers, given with their binding numbers.
pub(crate) fn bind_some(
    device: &wgpu::Device,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    buffers: &[(u32, &wgpu::Buffer)],
) -> wgpu::BindGroup {
    let entries: Vec<wgpu::BindGroupEntry<'_>> = buffers
        .iter()
        .map(|&(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout, entries: &entries })
}

/// Creates a bind group of buffers, whose binding numbers count from 0, and of other entries.
pub(crate) fn bind_with(
    device: &wgpu::Device,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    buffers: &[&wgpu::Buffer],
    others: &[wgpu::BindGroupEntry<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
        .zip(buffers)
        .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .chain(others.iter().cloned())
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout, entries: &entries })
}

/// Converts an error of the upload. `needed` and `available` are the bytes that the scene needs and those uploaded so
/// far. wgpu doesn't report how much memory a device has, so a shortage shows only when an allocation fails.
fn too_large(caught: ScopedError, needed: u64, available: u64) -> RenderError {
    match caught {
        ScopedError::OutOfMemory => RenderError::SceneTooLarge { backend: crate::NAME, needed, available },
        other => other.into(),
    }
}
