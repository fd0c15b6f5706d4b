//! Colour plane aligned to cache lines.

use std::ops::{Deref, DerefMut};

/// Size of a CPU's cache line, in bytes.
const LINE: usize = 64;

/// Number of RGBA pixels in a cache line.
const PIXELS: usize = LINE / size_of::<[f32; 4]>();

/// Colour plane of an image: the RGBA values of its pixels. Dereferences to a slice of them.
///
/// The first pixel is at the start of a cache line, so that no row of four pixels, which backends write at once,
/// crosses two lines. Crossing lines makes a frame of few large splats on a CPU take 5 % longer.
#[derive(Default)]
pub(crate) struct ColorPlane {
    /// Allocated memory: the pixels, and a few unused elements before and after them that allow the alignment.
    memory: Vec<[f32; 4]>,
    /// Index in `memory` of the first pixel.
    first: usize,
    /// Number of pixels.
    count: usize,
}

impl ColorPlane {
    /// Resizes the plane to `count` pixels, with unspecified contents.
    ///
    /// New memory is zeroed by the system on first access, so that all threads share the cost when they write the
    /// pixels.
    pub(crate) fn resize(&mut self, count: usize) {
        let room = count + if count > 0 { PIXELS - 1 } else { 0 };
        if self.memory.capacity() < room {
            // The old memory is freed first, so that both never exist at once.
            self.memory = Vec::new();
            self.memory = vec![[0.0; 4]; room];
        } else if self.memory.len() < room {
            self.memory.resize(room, [0.0; 4]);
        }
        // If the address doesn't allow alignment, the plane stays unaligned.
        let first = self.memory.as_ptr().align_offset(LINE);
        (self.first, self.count) = (if first < PIXELS && count > 0 { first } else { 0 }, count);
    }
}

impl ColorPlane {
    /// Returns the allocated memory without a copy, and the index of the first pixel in it. A plane without pixels
    /// returns an empty vector.
    pub(crate) fn into_memory(self) -> (Vec<[f32; 4]>, usize) {
        if self.count == 0 { (Vec::new(), 0) } else { (self.memory, self.first) }
    }
}

impl Deref for ColorPlane {
    type Target = [[f32; 4]];

    fn deref(&self) -> &Self::Target {
        &self.memory[self.first..self.first + self.count]
    }
}

impl DerefMut for ColorPlane {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.memory[self.first..self.first + self.count]
    }
}

impl Clone for ColorPlane {
    fn clone(&self) -> Self {
        let mut copy = Self::default();
        copy.resize(self.count);
        copy.copy_from_slice(self);
        copy
    }
}

impl PartialEq for ColorPlane {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl std::fmt::Debug for ColorPlane {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn color_planes_begin_with_a_line_whatever_is_done_to_them() {
        let mut plane = ColorPlane::default();
        assert!(plane.is_empty());
        // Sizes of a few bytes and of many, which systems allocate differently.
        for count in [1, 3, 4, 5, 1 << 20, 100, 0, 7, 1 << 21] {
            plane.resize(count);
            assert_eq!(plane.len(), count);
            let copy = plane.clone();
            assert_eq!(copy, plane);
            if let (Some(a), Some(b)) = (plane.first(), copy.first()) {
                assert_eq!([a, b].map(|pixel| std::ptr::from_ref(pixel).addr() % LINE), [0; 2], "{count} pixels");
            }
            if let Some(last) = plane.last_mut() {
                *last = [count as f32; 4];
                assert_ne!(copy, plane);
            }
            let (memory, first) = copy.into_memory();
            assert_eq!(memory.get(first..first + count).map(<[_]>::len), Some(count));
        }
    }
}
