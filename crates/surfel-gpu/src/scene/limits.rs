//! Limits of a device, and of a renderer's use of it. A *record* is a splat as set up for a tile: its projected forms,
//! pixel boxes and colour in a buffer.

/// Limits on the use of a device. Frames that exceed some of them are drawn in parts or more slowly, with the same
/// image; others are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest size of a buffer that a shader reads, in bytes.
    pub buffer_bytes: u64,
    /// Largest side of a texture, in pixels.
    pub texture_side: u32,
    /// Largest total size of the records of a scene, in bytes. If records exceed it, all segments share one buffer and
    /// are set up again for each pass, which takes less memory and more time. Trained Gaussians whose records and lists
    /// exceed it are drawn in parts.
    pub record_bytes: u64,
    /// Largest size of a buffer of records, of pairs, or of parts of dense cells in the compute path, and of samples
    /// with transparent layers, in bytes. Tiles that need more are drawn by raster hardware.
    pub cell_bytes: u64,
    /// Largest size of a scene and its records, in bytes. A scene that needs more is refused before anything is
    /// allocated. Trained Gaussians of a tile that need more are drawn in parts, or refused if those of a single cell
    /// need more.
    pub memory_bytes: u64,
}

impl Default for Limits {
    /// Returns limits that allow the whole device, half a gibibyte of records, and buffers of up to four gibibytes in
    /// the compute path.
    fn default() -> Self {
        let all = u64::MAX;
        let (record_bytes, cell_bytes) = (512 << 20, 4 << 30);
        Self { buffer_bytes: all, texture_side: u32::MAX, record_bytes, cell_bytes, memory_bytes: all }
    }
}

impl Limits {
    /// Returns these limits, reduced to those of a device: the largest size of a buffer in bytes, and the largest side
    /// of a texture in pixels.
    #[must_use]
    pub fn within(self, buffer_bytes: u64, texture_side: u32) -> Self {
        Self {
            buffer_bytes: self.buffer_bytes.min(buffer_bytes),
            texture_side: self.texture_side.min(texture_side),
            ..self
        }
    }

    /// Returns these limits, reduced to a device's memory in bytes. A buffer of the compute path may take an eighth of
    /// the memory.
    #[must_use]
    pub fn within_memory(self, bytes: u64) -> Self {
        Self { memory_bytes: self.memory_bytes.min(bytes), cell_bytes: self.cell_bytes.min(bytes / 8), ..self }
    }
}
