//! Writes structs in the layout of the shaders: 32-bit words at reflected byte offsets.

use glam::{DMat3, DVec2, DVec3};
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_shaders::layout;

/// Struct in the layout of the shaders, as 32-bit words. Words that aren't set are zero.
#[derive(Clone, Debug)]
pub(crate) struct StructWriter {
    words: Vec<u32>,
    /// Index of the struct's first word.
    first: usize,
}

impl StructWriter {
    /// Creates a struct of `bytes` zero bytes, a multiple of four.
    pub(crate) fn new(bytes: usize) -> Self {
        Self::after(Vec::new(), bytes)
    }

    /// Creates a struct of `bytes` zero bytes after other words, for arrays of structs.
    pub(crate) fn after(mut words: Vec<u32>, bytes: usize) -> Self {
        let first = words.len();
        words.resize(first + bytes / 4, 0);
        Self { words, first }
    }

    /// Sets the word at a byte offset.
    pub(crate) fn u32(&mut self, offset: usize, value: u32) -> &mut Self {
        if let Some(word) = self.words.get_mut(self.first + offset / 4) {
            *word = value;
        }
        self
    }

    /// Returns the word at a byte offset.
    pub(crate) fn get(&self, offset: usize) -> u32 {
        self.words.get(self.first + offset / 4).copied().unwrap_or(0)
    }

    /// Sets consecutive words, beginning at a byte offset.
    pub(crate) fn u32s(&mut self, offset: usize, values: &[u32]) -> &mut Self {
        for (i, &value) in values.iter().enumerate() {
            self.u32(offset + 4 * i, value);
        }
        self
    }

    /// Sets an f32 at a byte offset.
    pub(crate) fn f32(&mut self, offset: usize, value: f32) -> &mut Self {
        self.u32(offset, value.to_bits())
    }

    /// Sets a number at a byte offset, rounded to f32.
    pub(crate) fn f64(&mut self, offset: usize, value: f64) -> &mut Self {
        self.f32(offset, value as f32)
    }

    /// Sets a `vec2i` at a byte offset.
    pub(crate) fn i32x2(&mut self, offset: usize, value: [i32; 2]) -> &mut Self {
        self.u32(offset, value[0].cast_unsigned()).u32(offset + 4, value[1].cast_unsigned())
    }

    /// Sets consecutive numbers, beginning at a byte offset, each rounded to f32.
    pub(crate) fn f64s<const N: usize>(&mut self, offset: usize, values: [f64; N]) -> &mut Self {
        for (i, value) in values.into_iter().enumerate() {
            self.f64(offset + 4 * i, value);
        }
        self
    }

    /// Sets a `vec2f` at a byte offset.
    pub(crate) fn vec2(&mut self, offset: usize, v: DVec2) -> &mut Self {
        self.f64s(offset, v.to_array())
    }

    /// Sets a `vec3f` at a byte offset.
    pub(crate) fn vec3(&mut self, offset: usize, v: DVec3) -> &mut Self {
        self.f64s(offset, v.to_array())
    }

    /// Sets a `mat3x3f` at a byte offset: three columns, each padded to sixteen bytes.
    pub(crate) fn mat3(&mut self, offset: usize, m: DMat3) -> &mut Self {
        self.vec3(offset, m.x_axis).vec3(offset + 16, m.y_axis).vec3(offset + 32, m.z_axis)
    }

    /// Sets the shaders' `Projection` at a byte offset. The far plane of a perspective projection, infinitely far, is
    /// written as the largest f32.
    pub(crate) fn projection(&mut self, offset: usize, p: &Projection) -> &mut Self {
        use layout::projection as at;
        let (kind, height) = match p.kind {
            ProjectionKind::Perspective => (layout::PERSPECTIVE, 0.0),
            ProjectionKind::Orthographic { height, .. } => (layout::ORTHOGRAPHIC, height),
        };
        self.f64s(offset + at::FOCAL_PX, p.focal_px).f64s(offset + at::PRINCIPAL_PX, p.principal_px);
        self.f64(offset + at::NEAR, p.near).f64(offset + at::FAR, p.far().min(f64::from(f32::MAX)));
        self.f64(offset + at::HEIGHT, height).u32(offset + at::KIND, kind)
    }

    /// Returns all words: those before the struct, followed by those of the struct.
    pub(crate) fn into_words(self) -> Vec<u32> {
        self.words
    }
}
