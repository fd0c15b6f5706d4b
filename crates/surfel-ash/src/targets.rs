//! Images and buffers into which a tile is drawn, reused from tile to tile and frame to frame if their key is the same.

use crate::commands::submit;
use crate::device::Device;
use crate::error::Failure;
use crate::memory::{Buffer, Image};
use crate::object::Owned;
use crate::passes::{attachments, format_of, framebuffer};
use crate::pipelines::Pipelines;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_gpu::{Draw, Target, TargetKey, Variant, layer_composite_bytes};

/// Images and buffers that a tile's passes write, for one [`TargetKey`].
pub(crate) struct Targets {
    pub key: TargetKey,
    // Declared before the images that they refer to, so that they are destroyed first.
    framebuffers: HashMap<Draw, Owned<vk::Framebuffer>>,
    /// Image of each target.
    images: HashMap<Target, Image>,
    /// Planes of the tile, which shading writes.
    pub planes: Buffer,
    /// Composites of the transparent layers, one per pixel.
    pub layer_composites: Buffer,
    /// Host-readable copy of the planes.
    pub readback: Buffer,
}

impl Targets {
    /// Creates the targets. The pipelines of the key's draws have to exist.
    pub(crate) fn new(device: &Arc<Device>, pipelines: &Pipelines, key: TargetKey) -> Result<Self, Failure> {
        let mut images = HashMap::new();
        for target in Target::ALL {
            let size = target.size(&key.draws, key.size);
            images.insert(target, Image::new(device, target.name(), size, format_of(target, key.precision))?);
        }
        let mut framebuffers = HashMap::new();
        for &draw in &key.draws {
            let drawn: Vec<&Image> = attachments(draw).filter_map(|target| images.get(&target)).collect();
            let pass = &pipelines.draw(draw, Variant::Whole, key.precision)?.pass;
            framebuffers.insert(draw, framebuffer(device, pass, &drawn, key.size)?);
        }
        let bytes = 4 * u64::from(key.floats);
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_SRC;
        let planes = Buffer::new(device, "planes", bytes, usage, MemoryLocation::GpuOnly)?;
        let layer_composite_bytes = layer_composite_bytes(&key.draws, key.size);
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let layer_composites =
            Buffer::new(device, "layer composites", layer_composite_bytes, storage, MemoryLocation::GpuOnly)?;
        let to_host = vk::BufferUsageFlags::TRANSFER_DST;
        let readback = Buffer::new(device, "planes to read", bytes, to_host, MemoryLocation::GpuToCpu)?;
        submit(device, |commands| {
            images.values().for_each(|image| commands.make_readable(image));
            Ok(())
        })?;
        Ok(Self { key, framebuffers, images, planes, layer_composites, readback })
    }

    /// Returns the framebuffer of a draw.
    pub(crate) fn framebuffer(&self, draw: Draw) -> Result<vk::Framebuffer, Failure> {
        let found = self.framebuffers.get(&draw);
        found.map(|framebuffer| framebuffer.raw).ok_or_else(|| Failure::other("a pass has no targets"))
    }

    /// Returns the images of the targets in `reads`, with their binding numbers.
    pub(crate) fn images(&self, reads: &[(u32, Target)]) -> Vec<(u32, &Image)> {
        reads.iter().filter_map(|&(binding, target)| Some((binding, self.images.get(&target)?))).collect()
    }
}
