//! Queue of a device that counts the bytes written through it.

use std::sync::atomic::{AtomicU64, Ordering};

/// Queue of a device, and the number of bytes that were written through it.
pub(crate) struct Queue {
    raw: wgpu::Queue,
    written: AtomicU64,
}

impl Queue {
    pub(crate) fn new(raw: wgpu::Queue) -> Self {
        Self { raw, written: AtomicU64::new(0) }
    }

    /// Writes to the beginning of a buffer.
    pub(crate) fn write(&self, buffer: &wgpu::Buffer, bytes: &[u8]) {
        self.raw.write_buffer(buffer, 0, bytes);
        self.written.fetch_add(bytes.len() as u64, Ordering::Relaxed);
    }

    /// Submits commands to the device.
    pub(crate) fn submit(&self, commands: impl IntoIterator<Item = wgpu::CommandBuffer>) {
        self.raw.submit(commands);
    }

    /// Returns the number of bytes written so far.
    pub(crate) fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }
}
