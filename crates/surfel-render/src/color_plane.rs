//! Colours that begin with a cache line.

use std::ops::{Deref, DerefMut};

/// Bytes of a cache line.
const LINE: usize = 64;

/// Pixels in a line.
const PIXELS: usize = LINE / size_of::<[f32; 4]>();

/// RGBA of an image's pixels, used as a slice of them.
///
/// Its first pixel begins a cache line, so that rows of four pixels, which backends write, don't cross lines: a frame
/// of few large splats on a CPU takes a twentieth longer where they do.
#[derive(Default)]
pub(crate) struct ColorPlane {
    /// The pixels, and some around them.
    memory: Vec<[f32; 4]>,
    first: usize,
    count: usize,
}

impl ColorPlane {
    /// Makes it `count` pixels; what they hold is left open.
    ///
    /// Zeros that come from the system are written by nobody: whoever writes the pixels then meets fresh pages, on all
    /// threads.
    pub(crate) fn resize(&mut self, count: usize) {
        let room = count + if count > 0 { PIXELS - 1 } else { 0 };
        if self.memory.capacity() < room {
            // The old goes first.
            self.memory = Vec::new();
            self.memory = vec![[0.0; 4]; room];
        } else if self.memory.len() < room {
            self.memory.resize(room, [0.0; 4]);
        }
        // An address that no pixel can move to the beginning of a line is left as it is.
        let first = self.memory.as_ptr().align_offset(LINE);
        (self.first, self.count) = (if first < PIXELS && count > 0 { first } else { 0 }, count);
    }
}

impl ColorPlane {
    /// The memory, and where in it the first pixel is.
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
        // Of a few bytes and of many, which systems hand out differently.
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
