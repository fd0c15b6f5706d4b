//! Limits of a device, and of how much of it a renderer may use.

/// What may be used of a device. What doesn't fit at once is drawn in parts, to the same image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest buffer that a shader reads, bytes.
    pub buffer_bytes: u64,
    /// Largest side of a texture, pixels.
    pub texture_side: u32,
    /// Records of a scene that take more than this, in bytes, share one buffer and are set up again for each pass,
    /// which takes less memory and more time. Trained Gaussians whose records and lists do are drawn in parts.
    pub record_bytes: u64,
    /// Largest buffer of records or pairs of the compute path, bytes. Frames that need more are drawn by raster
    /// hardware.
    pub cell_bytes: u64,
    /// Memory that a scene and its records may take, bytes. A scene that needs more is refused before anything is
    /// allocated.
    pub memory_bytes: u64,
}

impl Default for Limits {
    /// All of the device, and half a gibibyte of records; of the compute path four.
    fn default() -> Self {
        let all = u64::MAX;
        let (record_bytes, cell_bytes) = (512 << 20, 4 << 30);
        Self { buffer_bytes: all, texture_side: u32::MAX, record_bytes, cell_bytes, memory_bytes: all }
    }
}

impl Limits {
    /// The lesser of these limits and a device's own.
    #[must_use]
    pub fn within(self, buffer_bytes: u64, texture_side: u32) -> Self {
        Self {
            buffer_bytes: self.buffer_bytes.min(buffer_bytes),
            texture_side: self.texture_side.min(texture_side),
            ..self
        }
    }

    /// The lesser of these limits and a device's memory, bytes, an eighth of it for records of the compute path.
    #[must_use]
    pub fn within_memory(self, bytes: u64) -> Self {
        Self { memory_bytes: self.memory_bytes.min(bytes), cell_bytes: self.cell_bytes.min(bytes / 8), ..self }
    }
}
