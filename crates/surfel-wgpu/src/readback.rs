//! Copies of device buffers that the host reads.

use crate::error::failed;
use crate::scene::empty;
use std::sync::mpsc;
use surfel_render::RenderError;

/// Copies of the beginnings of several device buffers, one after another in a buffer that the host can map.
pub(crate) struct Readback {
    buffer: wgpu::Buffer,
    /// Length of each copied region, in bytes.
    lengths: Vec<u64>,
}

impl Readback {
    /// Records copies of the first bytes of several buffers. `parts` are pairs of a buffer and a number of bytes.
    pub(crate) fn record(
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        parts: &[(&wgpu::Buffer, u64)],
    ) -> Self {
        Self::record_into(None, device, encoder, parts)
    }

    /// Records copies like [`Readback::record`] into `kept`, a buffer that [`Readback::read_and_keep`] returned, if its
    /// size is the required one or up to four times as large. Otherwise a new buffer is created. Mapping the memory
    /// pages of a new buffer would take longer.
    pub(crate) fn record_into(
        kept: Option<wgpu::Buffer>,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        parts: &[(&wgpu::Buffer, u64)],
    ) -> Self {
        let lengths: Vec<u64> = parts.iter().map(|part| part.1).collect();
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let bytes: u64 = lengths.iter().sum();
        let kept = kept.filter(|buffer| (bytes..=4 * bytes).contains(&buffer.size()));
        let buffer = kept.unwrap_or_else(|| empty(device, "readback", bytes, usage));
        let mut at = 0;
        for &(from, length) in parts.iter().filter(|part| part.1 > 0) {
            encoder.copy_buffer_to_buffer(from, 0, &buffer, at, length);
            at += length;
        }
        Self { buffer, lengths }
    }

    /// Waits for the device and passes the words of each copied region to `read`.
    pub(crate) fn read<T>(self, device: &wgpu::Device, read: impl FnOnce(&[&[u32]]) -> T) -> Result<T, RenderError> {
        self.read_and_keep(device, read).map(|(result, _)| result)
    }

    /// Reads like [`Readback::read`], and also returns the buffer for [`Readback::record_into`].
    pub(crate) fn read_and_keep<T>(
        self,
        device: &wgpu::Device,
        read: impl FnOnce(&[&[u32]]) -> T,
    ) -> Result<(T, wgpu::Buffer), RenderError> {
        let (sender, receiver) = mpsc::channel();
        self.buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver no longer exists if waiting failed.
            let _ = sender.send(result);
        });
        device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| failed(error.to_string()))?;
        let mapped = receiver.recv().map_err(|_| failed("the device gave no answer"))?;
        mapped.map_err(|error| failed(error.to_string()))?;
        let view = self.buffer.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
        let words: &[u32] = bytemuck::try_cast_slice(&view).map_err(|error| failed(error.to_string()))?;
        let mut rest = words;
        let mut parts = Vec::with_capacity(self.lengths.len());
        for &length in &self.lengths {
            let (part, after) = rest.split_at_checked((length / 4) as usize).unwrap_or((rest, &[]));
            parts.push(part);
            rest = after;
        }
        let result = read(&parts);
        drop(view);
        self.buffer.unmap();
        Ok((result, self.buffer))
    }
}
