//! Images and buffers of a tile, kept from frame to frame while they fit.

use crate::commands::submit;
use crate::device::Device;
use crate::error::Failure;
use crate::memory::{Buffer, Image};
use crate::object::Owned;
use crate::passes::{KEPT_FORMAT, Kind, Precision, framebuffer};
use crate::pipelines::Pipelines;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;
use surfel_gpu::Sums;

/// What a tile's targets have to be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TargetKey {
    pub size: [u32; 2],
    pub precision: Precision,
    pub sums: Vec<Sums>,
    /// Floats of the planes.
    pub floats: u32,
}

pub(crate) struct Targets {
    pub key: TargetKey,
    framebuffers: Vec<(Kind, Owned<vk::Framebuffer>)>,
    pub kept: Image,
    /// Colour, surface, material and count sums; 1×1 where they aren't needed.
    pub sums: [Image; 4],
    pub planes: Buffer,
    /// The planes, and after them how many splats were drawn, for the host to read.
    pub readback: Buffer,
}

impl Targets {
    /// The pipelines of these sums have been prepared.
    pub(crate) fn new(device: &Arc<Device>, pipelines: &Pipelines, key: TargetKey) -> Result<Self, Failure> {
        let image =
            |name, format, needed: bool| Image::new(device, name, if needed { key.size } else { [1, 1] }, format);
        let (four, one) = (key.precision.four(), key.precision.one());
        let further = key.sums.contains(&Sums::Further);
        let kept = image("kept depth", KEPT_FORMAT, true)?;
        let sums = [
            image("colour sums", four, true)?,
            image("surface sums", four, key.sums.contains(&Sums::Surface))?,
            image("material sums", four, further)?,
            image("fragment counts", one, further)?,
        ];
        let mut framebuffers = Vec::new();
        let kinds = key.sums.iter().map(|&sums| Kind::Sums(sums, key.precision));
        for kind in kinds.chain([Kind::Visibility]) {
            let [color, surface, material, count] = &sums;
            let images: &[&Image] = match kind {
                Kind::Visibility => &[&kept],
                Kind::Sums(Sums::Color, _) => &[color],
                Kind::Sums(Sums::Surface, _) => &[color, surface],
                Kind::Sums(Sums::Further, _) => &[material, count],
            };
            framebuffers.push((kind, framebuffer(device, &pipelines.draw(kind)?.pass, images, key.size)?));
        }
        let bytes = 4 * u64::from(key.floats);
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_SRC;
        let planes = Buffer::new(device, "planes", bytes, usage, MemoryLocation::GpuOnly)?;
        let to_host = vk::BufferUsageFlags::TRANSFER_DST;
        let readback = Buffer::new(device, "planes to read", bytes, to_host, MemoryLocation::GpuToCpu)?;
        submit(device, |commands| {
            sums.iter().chain([&kept]).for_each(|image| commands.make_readable(image));
            Ok(())
        })?;
        Ok(Self { key, framebuffers, kept, sums, planes, readback })
    }

    pub(crate) fn framebuffer(&self, kind: Kind) -> Result<vk::Framebuffer, Failure> {
        let found = self.framebuffers.iter().find(|(of, _)| *of == kind);
        found.map(|(_, framebuffer)| framebuffer.raw).ok_or_else(|| Failure::other("a pass has no targets"))
    }
}
