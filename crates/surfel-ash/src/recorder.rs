//! The command buffer that submissions reuse.

use ash::vk;

/// A command buffer with its pool and fence, reused from one submission to the next: making and destroying them takes a
/// driver longer than recording a frame.
pub(crate) struct Recorder {
    pub pool: vk::CommandPool,
    pub buffer: vk::CommandBuffer,
    pub fence: vk::Fence,
}

impl Recorder {
    /// Destroys it. No submission of it is being executed.
    pub(crate) fn destroy(self, device: &ash::Device) {
        // SAFETY: the fence is the device's, and no submission that signals it is being executed.
        unsafe { device.destroy_fence(self.fence, None) };
        // SAFETY: the pool is the device's, and none of its command buffers is being executed.
        unsafe { device.destroy_command_pool(self.pool, None) };
    }
}
