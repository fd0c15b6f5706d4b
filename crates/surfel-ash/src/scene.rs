//! A scene in the device's memory.

use crate::commands::submit;
use crate::device::Device;
use crate::error::Failure;
use crate::memory::Buffer;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;
use surfel_gpu::{Limits, RecordBytes, Upload, UploadedScene};
use surfel_model::Scene;
use surfel_render::RenderError;

/// A scene as this backend keeps it: splats in the device's memory, chunks and clouds in the host's.
pub struct ResidentScene {
    pub(crate) cpu: UploadedScene,
    pub(crate) segments: Vec<ResidentSegment>,
    /// Textures of polygons.
    pub(crate) texels: Buffer,
    /// All segments have the same buffer of records.
    pub(crate) shared_records: bool,
    pub(crate) bytes: u64,
}

pub(crate) struct ResidentSegment {
    pub uniform: Buffer,
    pub splats: Buffer,
    pub records: Arc<Records>,
    pub count: u32,
}

/// Records of splats.
pub(crate) struct Records {
    pub records: Buffer,
    /// What clips them; `None` where nothing does.
    pub clips: Option<Buffer>,
}

impl ResidentScene {
    /// Bytes of device memory that the splats use; records are beside that.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

pub(crate) fn upload(device: &Arc<Device>, scene: &Scene, limits: Limits) -> Result<ResidentScene, RenderError> {
    let mut upload = Upload::new(scene, limits, crate::NAME)?;
    let bytes = upload.total_bytes();
    let memory = device.facts.memory_bytes;
    if bytes > memory {
        return Err(too_large(bytes, memory).into());
    }
    let mut done = 0;
    let mut splats = Vec::new();
    while let Some(words) = upload.next_segment() {
        splats.push(resident(device, "splats", &words).map_err(|failure| missing(failure, bytes, done))?);
        done += 4 * words.len() as u64;
    }
    let cpu = upload.finish();
    let (record_bytes, shared_records) = cpu.records(limits);
    let segments = segments(device, &cpu, splats, &record_bytes, shared_records)
        .map_err(|failure| missing(failure, bytes, done))?;
    let texels = resident(device, "texels", &cpu.texels).map_err(|failure| missing(failure, bytes, done))?;
    Ok(ResidentScene { cpu, segments, texels, shared_records, bytes })
}

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
    let largest = |of: fn(&RecordBytes) -> u64| record_bytes.iter().map(of).max().unwrap_or(0);
    let largest = RecordBytes { records: largest(|b| b.records), clips: largest(|b| b.clips) };
    let shared = if shared_records { Some(records(largest)?) } else { None };
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

/// Words in the device's own memory, by way of the host's.
fn resident(device: &Arc<Device>, name: &str, words: &[u32]) -> Result<Buffer, Failure> {
    let bytes = 4 * words.len() as u64;
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_DST;
    let buffer = Buffer::new(device, name, bytes, usage, MemoryLocation::GpuOnly)?;
    let staged = Buffer::filled(device, "staged", words, vk::BufferUsageFlags::TRANSFER_SRC)?;
    submit(device, |commands| {
        commands.copy(staged.raw(), buffer.raw(), bytes);
        commands.barrier();
        Ok(())
    })?;
    Ok(buffer)
}

fn too_large(needed: u64, there: u64) -> Failure {
    Failure::Other(format!(
        "the scene's splats need {needed} bytes of device memory, which has {there}: {} are missing; draw fewer splats, or \
         choose --backend cpu",
        needed.saturating_sub(there)
    ))
}

fn missing(failure: Failure, needed: u64, done: u64) -> RenderError {
    match failure {
        Failure::OutOfMemory => too_large(needed, done).into(),
        other => other.into(),
    }
}
