//! Splats packed into words of a buffer, as f32 or as 16 bits relative to a scale of their chunk.

use crate::scene::clip::{self, STORED_WORDS, Variant};
use crate::struct_writer::StructWriter;
use glam::DVec3;
use surfel_math::V3;
use surfel_math::quantise::{STEPS, folded, to_step};
use surfel_model::{ChunkSpace, Storage, stored_axes};
use surfel_model::{Shape, SplatCloud};
use surfel_shaders::layout;

/// Offsets of the fields within a stored splat, and its size (`stride`), in words, or in half-words if splats are
/// quantised to 16 bits. Fields that the splats don't have are `layout::ABSENT`.
pub(crate) struct StoredLayout {
    storage: Storage,
    is_disk: bool,
    stride: u32,
    center_at: u32,
    shape_at: u32,
    color_at: u32,
    shading_normal_at: u32,
    clip_at: u32,
    alpha_at: u32,
}

/// Buffer of splats being packed: words, or half-words if splats are quantised.
pub(crate) enum StoredWriter {
    StructWriter(Vec<u32>),
    Halves(Vec<u16>),
}

impl StoredLayout {
    /// Returns the layout for splats of a cloud: clipped if `variant` says so, and with alpha if `is_transparent`.
    pub(crate) fn of(cloud: &SplatCloud, variant: Variant, is_transparent: bool, storage: Storage) -> Self {
        let data = cloud.data();
        let is_disk = matches!(data.shape, Shape::Disks { .. });
        // Lengths of a word, of a number and of a unit vector.
        let (word, number, unit) = match storage {
            Storage::F32 => (1, 1, 3),
            Storage::Quantised => (2, 1, 2),
        };
        let mut stride = 0;
        let mut field = |there: bool, length: u32| {
            let at = if there { stride } else { layout::ABSENT };
            stride += if there { length } else { 0 };
            at
        };
        // A splat begins with its chunk.
        field(true, word);
        let center_at = field(true, 3 * number);
        let shape_at = field(true, if is_disk { unit + number } else { 6 * word });
        let color_at = field(data.colors.is_some(), 3 * number);
        let shading_normal_at = field(data.shading_normals.is_some(), unit);
        let clip_at = field(variant == Variant::Clipped, STORED_WORDS * word);
        let alpha_at = field(is_transparent, word);
        Self { storage, is_disk, stride, center_at, shape_at, color_at, shading_normal_at, clip_at, alpha_at }
    }

    /// Returns the number of words that `splats` splats and the scales of `chunks` chunks take.
    pub(crate) fn words(&self, splats: usize, chunks: usize) -> u64 {
        let units = splats as u64 * u64::from(self.stride);
        match self.storage {
            Storage::F32 => units,
            Storage::Quantised => units.div_ceil(2) + 3 * chunks as u64,
        }
    }

    /// Returns the words of the shaders' `Segment` for `count` splats of the object with index `object`. `scales_at` is
    /// the offset of the chunks' scales in words; `None` without quantisation.
    pub(crate) fn uniform(&self, object: u32, count: u32, scales_at: Option<u32>) -> Vec<u32> {
        use layout::segment as at;
        let mut words = StructWriter::new(at::SIZE);
        words.u32(at::OBJECT, object).u32(at::COUNT, count).u32(at::STRIDE, self.stride);
        words.u32(at::IS_DISK, u32::from(self.is_disk)).u32(at::CENTER_AT, self.center_at);
        words.u32(at::SHAPE_AT, self.shape_at).u32(at::COLOR_AT, self.color_at);
        words.u32(at::SHADING_NORMAL_AT, self.shading_normal_at).u32(at::CLIP_AT, self.clip_at);
        words.u32(at::ALPHA_AT, self.alpha_at).u32(at::SCALES_AT, scales_at.unwrap_or(layout::ABSENT));
        words.into_words()
    }

    /// Appends splat `i` of the cloud. `space` are the origin and scales of its chunk. `code` is the splat's first
    /// word: its chunk's number times 256, plus its index within the chunk.
    pub(crate) fn push(&self, cloud: &SplatCloud, i: usize, space: &ChunkSpace, code: u32, to: &mut StoredWriter) {
        to.word(code);
        to.numbers((cloud.center(i) - space.origin).as_vec3().to_array(), space.center);
        match &cloud.data().shape {
            // Balls are stored elsewhere; octrees have none.
            Shape::Disks { .. } | Shape::Balls { .. } => {
                to.unit(cloud.normal(i));
                to.numbers([cloud.radius_max(i) as f32], space.radius);
            }
            Shape::Ellipses { .. } => {
                let (s, t) = stored_axes(cloud, i);
                s.to_array().into_iter().chain(t.to_array()).for_each(|c| to.word(c.to_bits()));
            }
        }
        if self.color_at != layout::ABSENT {
            to.numbers(cloud.color(i), space.color);
        }
        if self.shading_normal_at != layout::ABSENT {
            to.unit(cloud.shading_normal(i));
        }
        if self.clip_at != layout::ABSENT {
            clip::stored(cloud, i).into_iter().for_each(|word| to.word(word));
        }
        if self.alpha_at != layout::ABSENT {
            to.word(cloud.alpha(i).to_bits());
        }
    }
}

impl StoredWriter {
    pub(crate) fn new(storage: Storage) -> Self {
        match storage {
            Storage::F32 => Self::StructWriter(Vec::new()),
            Storage::Quantised => Self::Halves(Vec::new()),
        }
    }

    /// Appends a word; as two half-words, the lower one first, if splats are quantised.
    fn word(&mut self, word: u32) {
        match self {
            Self::StructWriter(words) => words.push(word),
            Self::Halves(halves) => halves.extend([word as u16, (word >> 16) as u16]),
        }
    }

    /// Appends numbers in the range −`scale` to `scale`: as f32, or as multiples of a step in 16 bits if splats are
    /// quantised.
    fn numbers<const N: usize>(&mut self, values: [f32; N], scale: f32) {
        match self {
            Self::StructWriter(words) => words.extend(values.map(f32::to_bits)),
            Self::Halves(halves) => halves.extend(values.map(|value| to_step(value / scale))),
        }
    }

    /// Appends a unit vector: as three f32 numbers, or as two octahedral coordinates if splats are quantised.
    fn unit(&mut self, v: DVec3) {
        let v = v.as_vec3();
        match self {
            Self::StructWriter(words) => words.extend(v.to_array().map(f32::to_bits)),
            Self::Halves(halves) => halves.extend(folded(V3::new(v.x, v.y, v.z)).map(to_step)),
        }
    }

    /// Returns the buffer's content as 32-bit words. If splats are quantised, the chunks' scales (from `spaces`) are at
    /// its end, and the second value is their offset, in words.
    pub(crate) fn finish(self, spaces: impl Iterator<Item = ChunkSpace>) -> (Vec<u32>, Option<u32>) {
        match self {
            Self::StructWriter(words) => (words, None),
            Self::Halves(halves) => {
                let pair = |pair: &[u16]| pair.iter().rev().fold(0, |word, &half| word << 16 | u32::from(half));
                let mut words: Vec<u32> = halves.chunks(2).map(pair).collect();
                let at = words.len() as u32;
                let scales = |s: ChunkSpace| [s.center, s.radius, s.color].map(|scale| (scale / STEPS).to_bits());
                words.extend(spaces.flat_map(scales));
                (words, Some(at))
            }
        }
    }
}
