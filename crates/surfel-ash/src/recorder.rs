//! Command buffer that all submissions reuse.

use ash::vk;

/// Command buffer with its pool and fence, reused by each submission. In a driver, creating and destroying them takes
/// longer than recording a frame.
pub(crate) struct Recorder {
    pub pool: vk::CommandPool,
    pub buffer: vk::CommandBuffer,
    pub fence: vk::Fence,
}

impl Recorder {
    /// Destroys the command buffer, pool and fence. The device must have finished all submissions of this command
    /// buffer.
    pub(crate) fn destroy(self, device: &ash::Device) {
        // SAFETY: the fence is the device's, and no submission that signals it is being executed.
        unsafe { device.destroy_fence(self.fence, None) };
        // SAFETY: the pool is the device's, and none of its command buffers is being executed.
        unsafe { device.destroy_command_pool(self.pool, None) };
    }
}
