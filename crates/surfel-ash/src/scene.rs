//! Scene in the device's memory. A *segment* is the part of an object's splats that shares a buffer
//! ([`surfel_gpu::Segment`]). Its *records* are the splats as set up for a tile.

use crate::commands::submit;
use crate::device::Device;
use crate::error::Failure;
use crate::memory::Buffer;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;
use surfel_gpu::{Limits, RecordBytes, Upload, UploadedScene};
use surfel_model::Scene;
use surfel_model::Storage;
use surfel_render::{RenderError, UploadProgress};

/// Uploaded scene of this backend. Splats are in the device's memory, their chunks and clouds in the main memory.
pub struct ResidentScene {
    pub(crate) cpu: UploadedScene,
    /// Buffers of each segment, in the order of the segments of `cpu`.
    pub(crate) segments: Vec<ResidentSegment>,
    /// Textures of the polygons.
    pub(crate) texels: Buffer,
    /// True if all segments share one buffer of records.
    pub(crate) shared_records: bool,
    /// Device memory of the splats in bytes, without their records.
    pub(crate) bytes: u64,
}

/// Buffers of a segment of splats: uniform, splats and records, and the number of splats.
pub(crate) struct ResidentSegment {
    pub uniform: Buffer,
    pub splats: Buffer,
    pub records: Arc<Records>,
    pub count: u32,
}

/// Buffers of the records of splats.
pub(crate) struct Records {
    pub records: Buffer,
    /// Clips of the records; `None` unless the splats are clipped.
    pub clips: Option<Buffer>,
}

impl ResidentScene {
    /// Returns the device memory of the splats in bytes, without their records.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Uploads a scene, and reports the progress after each segment.
pub(crate) fn upload(
    device: &Arc<Device>,
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
        splats.push(resident(device, "splats", &words).map_err(|failure| too_large(failure, needed, done))?);
        done += 4 * words.len() as u64;
        progress(UploadProgress { done_bytes: done, total_bytes: bytes });
    }
    let cpu = upload.finish();
    let (record_bytes, shared_records) = cpu.records(limits);
    let segments = segments(device, &cpu, splats, &record_bytes, shared_records)
        .map_err(|failure| too_large(failure, needed, done))?;
    let texels = resident(device, "texels", &cpu.texels).map_err(|failure| too_large(failure, needed, done))?;
    Ok(ResidentScene { cpu, segments, texels, shared_records, bytes })
}

/// Creates the buffers of the segments whose splats were uploaded to `splats`.
fn segments(
    device: &Arc<Device>,
    cpu: &UploadedScene,
    splats: Vec<Buffer>,
    record_bytes: &[RecordBytes],
    shared_records: bool,
) -> Result<Vec<ResidentSegment>, Failure> {
    let buffer = |name, bytes: u64| {
        Buffer::new(device, name, bytes, vk::BufferUsageFlags::STORAGE_BUFFER, MemoryLocation::GpuOnly)
    };
    let records = |bytes: RecordBytes| -> Result<Arc<Records>, Failure> {
        let clips = if bytes.clips > 0 { Some(buffer("clips", bytes.clips)?) } else { None };
        Ok(Arc::new(Records { records: buffer("records", bytes.records)?, clips }))
    };
    let shared = if shared_records { Some(records(RecordBytes::largest(record_bytes))?) } else { None };
    let mut segments = Vec::with_capacity(splats.len());
    for ((segment, splats), &bytes) in cpu.segments.iter().zip(splats).zip(record_bytes) {
        segments.push(ResidentSegment {
            uniform: Buffer::filled(device, "segment", &segment.uniform, vk::BufferUsageFlags::UNIFORM_BUFFER)?,
            splats,
            records: shared.clone().map_or_else(|| records(bytes), Ok)?,
            count: segment.members.len() as u32,
        });
    }
    Ok(segments)
}

/// Copies words to a new buffer in the device's own memory, through a staging buffer.
pub(crate) fn resident(device: &Arc<Device>, name: &str, words: &[u32]) -> Result<Buffer, Failure> {
    resident_before(device, name, words, 0)
}

/// Copies words to a new buffer like [`resident`]. The buffer has `more` uninitialised bytes after the words.
pub(crate) fn resident_before(device: &Arc<Device>, name: &str, words: &[u32], more: u64) -> Result<Buffer, Failure> {
    let bytes = 4 * words.len() as u64;
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_DST;
    let buffer = Buffer::new(device, name, bytes + more, usage, MemoryLocation::GpuOnly)?;
    let staged = Buffer::filled(device, "staged", words, vk::BufferUsageFlags::TRANSFER_SRC)?;
    submit(device, |commands| {
        commands.copy(staged.raw(), buffer.raw(), bytes);
        commands.barrier();
        Ok(())
    })?;
    Ok(buffer)
}

/// Converts an error of the upload. `needed` and `available` are the bytes that the scene needs and those uploaded so
/// far. Less memory may be free than the device has, because other programs use it, too.
fn too_large(failure: Failure, needed: u64, available: u64) -> RenderError {
    match failure {
        Failure::OutOfMemory => RenderError::SceneTooLarge { backend: crate::NAME, needed, available },
        other => other.into(),
    }
}
