//! Buffers and images, with the memory they are bound to.

use crate::device::Device;
use crate::error::Failure;
use crate::object::{Owned, destroy};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::{Arc, PoisonError};

/// Device memory of a buffer or image, freed when it is dropped.
struct Memory {
    device: Arc<Device>,
    /// The allocation; `None` once it is freed.
    allocation: Option<Allocation>,
}

impl Memory {
    fn new(
        device: &Arc<Device>,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Self, Failure> {
        let allocation_scheme = AllocationScheme::GpuAllocatorManaged;
        let description = AllocationCreateDesc { name, requirements, location, linear, allocation_scheme };
        let mut allocator = device.allocator.lock().unwrap_or_else(PoisonError::into_inner);
        let allocation = allocator.allocate(&description)?;
        Ok(Self { device: device.clone(), allocation: Some(allocation) })
    }

    /// Returns the handle of the block of device memory that contains this memory, and the offset in the block, in
    /// bytes. `None` after the memory was freed.
    fn place(&self) -> Option<(vk::DeviceMemory, u64)> {
        // SAFETY: the handle is only bound to; the allocator keeps it alive while the allocation is.
        self.allocation.as_ref().map(|allocation| (unsafe { allocation.memory() }, allocation.offset()))
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        if let Some(allocation) = self.allocation.take() {
            let mut allocator = self.device.allocator.lock().unwrap_or_else(PoisonError::into_inner);
            // Freeing fails only for memory of another allocator.
            let _ = allocator.free(allocation);
        }
    }
}

/// A Vulkan buffer with its memory.
pub(crate) struct Buffer {
    // Declared before its memory, so that it is destroyed first.
    object: Owned<vk::Buffer>,
    memory: Memory,
    /// Size in bytes.
    pub bytes: u64,
}

impl Buffer {
    /// Creates a buffer of at least four bytes, with undefined contents, in the kind of memory that `location` names.
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self, Failure> {
        let bytes = bytes.max(4);
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: the size is not 0, and exclusive sharing needs no families.
        let raw = unsafe { device.raw.create_buffer(&info, None) }?;
        let object = Owned::new(device, raw, name, destroy!(destroy_buffer));
        // SAFETY: the buffer is this device's.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        let memory = Memory::new(device, name, requirements, location, true)?;
        let (block, offset) = memory.place().ok_or(Failure::OutOfMemory)?;
        // SAFETY: the memory fits the buffer's requirements and nothing else is bound to that part of it.
        unsafe { device.raw.bind_buffer_memory(raw, block, offset) }?;
        Ok(Self { object, memory, bytes })
    }

    /// Creates a buffer in memory that the host can write, and writes `words` to it.
    pub(crate) fn filled(
        device: &Arc<Device>,
        name: &str,
        words: &[u32],
        usage: vk::BufferUsageFlags,
    ) -> Result<Self, Failure> {
        let bytes: &[u8] = bytemuck::cast_slice(words);
        let mut buffer = Self::new(device, name, bytes.len() as u64, usage, MemoryLocation::CpuToGpu)?;
        buffer.write(bytes)?;
        Ok(buffer)
    }

    pub(crate) fn raw(&self) -> vk::Buffer {
        self.object.raw
    }

    /// Writes to the beginning of a host-writable buffer.
    fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let mapped = self.memory.allocation.as_mut().and_then(Allocation::mapped_slice_mut);
        let place = mapped.and_then(|mapped| mapped.get_mut(..bytes.len()));
        place.ok_or_else(not_mapped)?.copy_from_slice(bytes);
        Ok(())
    }

    /// Returns the first `count` words of a buffer that the host can read. The device must have finished writing them.
    pub(crate) fn words(&self, count: usize) -> Result<&[u32], Failure> {
        let mapped = self.memory.allocation.as_ref().and_then(Allocation::mapped_slice);
        let bytes = mapped.and_then(|mapped| mapped.get(..4 * count)).ok_or_else(not_mapped)?;
        bytemuck::try_cast_slice(bytes).map_err(Failure::other)
    }
}

/// Returns the error for memory that the host can't reach.
fn not_mapped() -> Failure {
    Failure::other("memory that the host should reach isn't mapped")
}

/// Two-dimensional image with one mip level, and its view.
pub(crate) struct Image {
    // Fields are declared in the order of their destruction.
    view: Owned<vk::ImageView>,
    object: Owned<vk::Image>,
    _memory: Memory,
    format: vk::Format,
    /// Aspect of the image: depth or colour.
    pub aspect: vk::ImageAspectFlags,
}

impl Image {
    /// Creates an image that passes draw into and shaders read, of a width and height in pixels.
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        [width, height]: [u32; 2],
        format: vk::Format,
    ) -> Result<Self, Failure> {
        let is_depth = format == vk::Format::D32_SFLOAT;
        let (aspect, attachment) = if is_depth {
            (vk::ImageAspectFlags::DEPTH, vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT)
        } else {
            (vk::ImageAspectFlags::COLOR, vk::ImageUsageFlags::COLOR_ATTACHMENT)
        };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(attachment | vk::ImageUsageFlags::SAMPLED)
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: tiles are cut to the device's largest image; the formats are checked or required of every device.
        let raw = unsafe { device.raw.create_image(&info, None) }?;
        let object = Owned::new(device, raw, name, destroy!(destroy_image));
        // SAFETY: the image is this device's.
        let requirements = unsafe { device.raw.get_image_memory_requirements(raw) };
        let memory = Memory::new(device, name, requirements, MemoryLocation::GpuOnly, false)?;
        let (block, offset) = memory.place().ok_or(Failure::OutOfMemory)?;
        // SAFETY: the memory fits the image's requirements and nothing else is bound to that part of it.
        unsafe { device.raw.bind_image_memory(raw, block, offset) }?;
        let info = vk::ImageViewCreateInfo::default()
            .image(raw)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(whole(aspect));
        // SAFETY: the image is bound to memory and has this format, level and layer.
        let view = unsafe { device.raw.create_image_view(&info, None) }?;
        let view = Owned::new(device, view, name, destroy!(destroy_image_view));
        Ok(Self { view, object, _memory: memory, format, aspect })
    }

    pub(crate) fn view(&self) -> vk::ImageView {
        self.view.raw
    }

    pub(crate) fn raw(&self) -> vk::Image {
        self.object.raw
    }

    /// Returns the layout in which shaders read the image.
    pub(crate) fn read_layout(&self) -> vk::ImageLayout {
        read_layout(self.format)
    }
}

/// Returns the layout in which shaders read images of a format.
pub(crate) fn read_layout(format: vk::Format) -> vk::ImageLayout {
    if format == vk::Format::D32_SFLOAT {
        vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL
    } else {
        vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL
    }
}

/// Returns the subresource range of a whole image.
pub(crate) fn whole(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default().aspect_mask(aspect).level_count(1).layer_count(1)
}
