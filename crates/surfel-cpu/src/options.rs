//! How a renderer works.

use crate::simd::level::SimdLevel;
use surfel_model::Storage;

/// How a [`Renderer`](crate::Renderer) works.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Options {
    /// Threads; 0: as many as there are cores, or as the environment's `RAYON_NUM_THREADS` says.
    pub threads: usize,
    /// SIMD instructions.
    pub simd: SimdLevel,
    /// How splats are kept in memory.
    pub storage: Storage,
}

impl Options {
    surfel_model::setters! {
        with_threads threads: usize,
        with_simd simd: SimdLevel,
        with_storage storage: Storage,
    }
}
