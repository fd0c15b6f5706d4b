//! Columns of numbers of stored splats: f32, or 16 bits relative to a scale per chunk. 16 bits halve the memory, as the
//! half floats of B05 §7 do (B05 is one of the rendering model's sources), but cover only the range of a chunk.
//!
//! A *slot* is the index of a stored splat in the columns of its object
//! ([`StoredObject`](crate::scene::cloud::StoredObject)).

use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::Simd;
use glam::Vec3;
use surfel_math::quantise::{STEPS, folded, steps as steps_of, to_step, unfolded};
use surfel_math::{Real, V3};
use surfel_model::Storage;

/// A growing column of numbers, one per slot: f32, or 16 bits relative to a scale.
pub(crate) enum Column {
    F32(Vec<f32>),
    Quantised(Vec<u16>),
}

impl Column {
    pub(crate) fn new(storage: Storage, capacity: usize) -> Self {
        match storage {
            Storage::F32 => Self::F32(Vec::with_capacity(capacity)),
            Storage::Quantised => Self::Quantised(Vec::with_capacity(capacity)),
        }
    }

    /// Appends a number between −`scale` and `scale`; `scale` is unused in f32 columns.
    pub(crate) fn push(&mut self, value: f32, scale: f32) {
        let at = self.len();
        self.grow(1);
        self.set(at, value, scale);
    }

    /// Appends `count` zeros to the column.
    fn grow(&mut self, count: usize) {
        match self {
            Self::F32(values) => values.resize(values.len() + count, 0.0),
            Self::Quantised(steps) => steps.resize(steps.len() + count, 0),
        }
    }

    fn set(&mut self, at: usize, value: f32, scale: f32) {
        match self {
            Self::F32(values) => values[at] = value,
            Self::Quantised(steps) => steps[at] = to_step(value / scale),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::Quantised(steps) => steps.len(),
        }
    }

    /// Appends another column of the same storage format.
    pub(crate) fn append(&mut self, more: Self) {
        match (self, more) {
            (Self::F32(values), Self::F32(more)) => values.extend_from_slice(&more),
            (Self::Quantised(steps), Self::Quantised(more)) => steps.extend_from_slice(&more),
            _ => unreachable!("columns of one storage"),
        }
    }

    /// Loads sixteen numbers from slot `at` on; `scale` is the scale of 16-bit numbers there.
    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self, simd: S, at: usize, scale: f32) -> Lanes<S> {
        match self {
            Self::F32(values) => Lanes::load(simd, &values[at..]),
            Self::Quantised(steps) => from_steps(simd, &steps[at..]) * Lanes::splat(simd, scale / STEPS),
        }
    }

    /// Frees memory that is reserved for further numbers.
    pub(crate) fn trim(&mut self) {
        match self {
            Self::F32(values) => values.shrink_to_fit(),
            Self::Quantised(steps) => steps.shrink_to_fit(),
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::F32(values) => size_of_val(values.as_slice()),
            Self::Quantised(steps) => size_of_val(steps.as_slice()),
        }
    }
}

#[inline(always)]
fn from_steps<S: Simd>(simd: S, steps: &[u16]) -> Lanes<S> {
    let mut values = [0.0; LANES];
    if let Some(steps) = steps.first_chunk::<LANES>() {
        for i in 0..LANES {
            values[i] = steps_of(steps[i]);
        }
    }
    Lanes::load(simd, &values)
}

/// A column of vectors, stored in groups of sixteen x, sixteen y and sixteen z, so that a group is contiguous in
/// memory. Every chunk is padded to whole groups.
pub(crate) struct Column3 {
    coordinates: Column,
    vectors: usize,
}

impl Column3 {
    pub(crate) fn new(storage: Storage, capacity: usize) -> Self {
        Self { coordinates: Column::new(storage, 3 * capacity), vectors: 0 }
    }

    /// Appends a vector whose coordinates are between −`scale` and `scale`.
    pub(crate) fn push(&mut self, v: Vec3, scale: f32) {
        let lane = self.vectors % LANES;
        if lane == 0 {
            self.coordinates.grow(3 * LANES);
        }
        let x = 3 * (self.vectors - lane) + lane;
        for (axis, value) in v.to_array().into_iter().enumerate() {
            self.coordinates.set(x + axis * LANES, value, scale);
        }
        self.vectors += 1;
    }

    /// Appends another column of the same storage format. This column must consist of whole groups of sixteen.
    pub(crate) fn append(&mut self, more: Self) {
        assert!(self.vectors.is_multiple_of(LANES));
        self.coordinates.append(more.coordinates);
        self.vectors += more.vectors;
    }

    /// Loads sixteen vectors from slot `at` on, which must be a multiple of sixteen; `scale` is the scale of 16-bit
    /// numbers there.
    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self, simd: S, at: usize, scale: f32) -> V3<Lanes<S>> {
        let (all, x) = (&self.coordinates, 3 * at);
        V3::new(all.load(simd, x, scale), all.load(simd, x + LANES, scale), all.load(simd, x + 2 * LANES, scale))
    }

    /// Returns the number of vectors.
    pub(crate) fn len(&self) -> usize {
        self.vectors
    }

    pub(crate) fn trim(&mut self) {
        self.coordinates.trim();
    }

    pub(crate) fn bytes(&self) -> usize {
        self.coordinates.bytes()
    }
}

/// A column of unit vectors: three f32, or two 16-bit coordinates on an octahedron (Meyer et al. 2010).
pub(crate) enum Units {
    F32(Column3),
    Octahedral([Column; 2]),
}

impl Units {
    pub(crate) fn new(storage: Storage, capacity: usize) -> Self {
        match storage {
            Storage::F32 => Self::F32(Column3::new(storage, capacity)),
            Storage::Quantised => Self::Octahedral([(); 2].map(|()| Column::new(storage, capacity))),
        }
    }

    pub(crate) fn push(&mut self, v: Vec3) {
        match self {
            Self::F32(column) => column.push(v, 1.0),
            Self::Octahedral([x, y]) => {
                let [a, b] = folded(V3::new(v.x, v.y, v.z));
                x.push(a, 1.0);
                y.push(b, 1.0);
            }
        }
    }

    /// Appends another column of the same storage format. This column must consist of whole groups of sixteen.
    pub(crate) fn append(&mut self, more: Self) {
        match (self, more) {
            (Self::F32(column), Self::F32(more)) => column.append(more),
            (Self::Octahedral([x, y]), Self::Octahedral([a, b])) => {
                x.append(a);
                y.append(b);
            }
            _ => unreachable!("columns of one storage"),
        }
    }

    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self, simd: S, at: usize) -> V3<Lanes<S>> {
        match self {
            Self::F32(column) => column.load(simd, at, 1.0),
            Self::Octahedral([x, y]) => {
                let v = unfolded(x.load(simd, at, 1.0), y.load(simd, at, 1.0));
                v * v.dot(v).inverse_sqrt()
            }
        }
    }

    pub(crate) fn trim(&mut self) {
        match self {
            Self::F32(column) => column.trim(),
            Self::Octahedral(columns) => columns.iter_mut().for_each(Column::trim),
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::F32(column) => column.bytes(),
            Self::Octahedral(columns) => columns.iter().map(Column::bytes).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};

    #[test]
    fn quantised_numbers_are_within_half_a_step() {
        let mut column = Column::new(Storage::Quantised, 0);
        let values: Vec<f32> = (0..LANES).map(|i| i as f32 * 0.37 - 3.0).collect();
        values.iter().for_each(|&v| column.push(v, 3.0));
        let mut zeros = Column::new(Storage::Quantised, 0);
        (0..LANES).for_each(|_| zeros.push(0.0, 0.0));
        let instructions = Instructions::new(SimdLevel::Best).unwrap();
        with_instructions!(instructions, simd => {
            let loaded = column.load(simd, 0, 3.0).to_array();
            for (value, loaded) in values.iter().zip(loaded) {
                // Half of 3/32767, and rounding.
                assert!((value - loaded).abs() <= 4.6e-5, "{value} {loaded}");
            }
            assert_eq!(zeros.load(simd, 0, 0.0).to_array(), [0.0; LANES]);
        });
    }

    #[test]
    fn octahedral_normals_turn_by_less_than_their_bound() {
        let mut units = Units::new(Storage::Quantised, 0);
        let directions: Vec<Vec3> = (0..LANES * 64)
            .map(|i| {
                let (z, angle) = (1.0 - (i as f32 + 0.5) / (32 * LANES) as f32, i as f32 * 2.399_963);
                let r = (1.0 - z * z).sqrt();
                Vec3::new(r * angle.cos(), r * angle.sin(), z)
            })
            .chain([Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z])
            .collect();
        directions.iter().for_each(|&v| units.push(v));
        (0..LANES).for_each(|_| units.push(Vec3::Z));
        let instructions = Instructions::new(SimdLevel::Best).unwrap();
        with_instructions!(instructions, simd => {
            for (i, direction) in directions.iter().enumerate() {
                let v = units.load(simd, i);
                let loaded = Vec3::new(v.x.to_array()[0], v.y.to_array()[0], v.z.to_array()[0]);
                assert!((loaded - *direction).length() < 1e-4, "{direction} {loaded}");
            }
        });
    }
}
