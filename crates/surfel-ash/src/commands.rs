//! Recording and submission of commands, and waiting for their execution.

use crate::device::Device;
use crate::error::Failure;
use crate::memory::{Image, whole};
use crate::object::{Owned, destroy};
use crate::recorder::Recorder;
use ash::vk;
use std::sync::{Arc, PoisonError};

/// Command buffer that is being recorded.
pub(crate) struct Commands<'a> {
    pub device: &'a Arc<Device>,
    pub raw: vk::CommandBuffer,
}

impl Recorder {
    /// Creates a command buffer with its pool and fence.
    fn new(device: &Arc<Device>) -> Result<Self, Failure> {
        let vulkan = &device.raw;
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(device.family)
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY: the family is the device's.
        let pool = unsafe { vulkan.create_command_pool(&info, None) }?;
        // The pool is destroyed at the end of this function, unless all other objects can be created.
        let owned_pool = Owned::new(device, pool, "commands", destroy!(destroy_command_pool));
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        // SAFETY: the pool is this device's, and only this function uses it.
        let buffers = unsafe { vulkan.allocate_command_buffers(&info) }?;
        let buffer = *buffers.first().ok_or(Failure::OutOfMemory)?;
        // SAFETY: no requirement.
        let fence = unsafe { vulkan.create_fence(&vk::FenceCreateInfo::default(), None) }?;
        device.name(fence, "submitted");
        owned_pool.keep();
        Ok(Self { pool, buffer, fence })
    }

    /// Resets the command buffer, records commands, submits them, and waits for their execution.
    fn submit(
        &self,
        device: &Arc<Device>,
        record: impl FnOnce(&Commands<'_>) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let (vulkan, raw) = (&device.raw, self.buffer);
        // SAFETY: the previously recorded commands have been executed and waited for.
        unsafe { vulkan.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }?;
        let fences = [self.fence];
        // SAFETY: no submission that signals the fence is being executed.
        unsafe { vulkan.reset_fences(&fences) }?;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the command buffer is new, or was reset with its pool.
        unsafe { vulkan.begin_command_buffer(raw, &info) }?;
        record(&Commands { device, raw })?;
        // SAFETY: it is being recorded; recorders end the render passes that they begin.
        unsafe { vulkan.end_command_buffer(raw) }?;
        let command_buffers = [raw];
        let submission = vk::SubmitInfo::default().command_buffers(&command_buffers);
        // SAFETY: the commands are recorded, the fence is not signalled, and the queue is used by this thread alone: a
        // renderer is borrowed mutably while it works.
        unsafe { vulkan.queue_submit(device.queue, &[submission], self.fence) }?;
        // SAFETY: the fence is this device's. After an error the device is lost and executes no more commands.
        unsafe { vulkan.wait_for_fences(&fences, true, u64::MAX) }?;
        Ok(())
    }
}

/// Records commands, submits them, and waits until the device has executed them.
pub(crate) fn submit(
    device: &Arc<Device>,
    record: impl FnOnce(&Commands<'_>) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let kept = device.recorder.lock().unwrap_or_else(PoisonError::into_inner).take();
    let recorder = kept.map_or_else(|| Recorder::new(device), Ok)?;
    let submitted = recorder.submit(device, record);
    if submitted.is_err() {
        recorder.destroy(&device.raw);
    } else {
        *device.recorder.lock().unwrap_or_else(PoisonError::into_inner) = Some(recorder);
    }
    submitted
}

impl Commands<'_> {
    /// Records a barrier that makes the writes of all earlier commands visible to all later ones. A finer barrier would
    /// gain little, because a tile has few steps, and each needs nearly all results of the step before.
    pub(crate) fn barrier(&self) {
        let memory = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE);
        let all = vk::PipelineStageFlags::ALL_COMMANDS;
        let none = vk::DependencyFlags::empty();
        // SAFETY: recorded outside of render passes.
        unsafe { self.device.raw.cmd_pipeline_barrier(self.raw, all, all, none, &[memory], &[], &[]) };
    }

    /// Records a barrier that makes the writes of earlier compute shaders visible to later compute shaders.
    pub(crate) fn barrier_of_compute(&self) {
        let memory = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::SHADER_WRITE)
            .dst_access_mask(vk::AccessFlags::SHADER_READ | vk::AccessFlags::SHADER_WRITE);
        let compute = vk::PipelineStageFlags::COMPUTE_SHADER;
        let none = vk::DependencyFlags::empty();
        // SAFETY: recorded outside of render passes.
        unsafe { self.device.raw.cmd_pipeline_barrier(self.raw, compute, compute, none, &[memory], &[], &[]) };
    }

    /// Records a barrier that makes the writes of all earlier commands visible to reads by the host (the CPU).
    pub(crate) fn barrier_to_host(&self) {
        let memory = vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ);
        let (all, host) = (vk::PipelineStageFlags::ALL_COMMANDS, vk::PipelineStageFlags::HOST);
        let none = vk::DependencyFlags::empty();
        // SAFETY: recorded outside of render passes.
        unsafe { self.device.raw.cmd_pipeline_barrier(self.raw, all, host, none, &[memory], &[], &[]) };
    }

    /// Records the transition of a new image to the layout in which shaders read it.
    pub(crate) fn make_readable(&self, image: &Image) {
        let barrier = vk::ImageMemoryBarrier::default()
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE)
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(image.read_layout())
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image.raw())
            .subresource_range(whole(image.aspect));
        let (start, all) = (vk::PipelineStageFlags::TOP_OF_PIPE, vk::PipelineStageFlags::ALL_COMMANDS);
        let none = vk::DependencyFlags::empty();
        // SAFETY: recorded outside of render passes; the image is alive and has never been used.
        unsafe { self.device.raw.cmd_pipeline_barrier(self.raw, start, all, none, &[], &[], &[barrier]) };
    }

    /// Records a copy of the first `bytes` bytes of a buffer to the beginning of another.
    pub(crate) fn copy(&self, from: vk::Buffer, to: vk::Buffer, bytes: u64) {
        let regions = [vk::BufferCopy::default().size(bytes)];
        // SAFETY: both buffers have at least that many bytes and the usages of a copy; recorded outside of render
        // passes.
        unsafe { self.device.raw.cmd_copy_buffer(self.raw, from, to, &regions) };
    }
}
