//! Options of a renderer.

use crate::simd::level::SimdLevel;
use surfel_model::Storage;

/// Options of a [`Renderer`](crate::Renderer): threads, instructions and storage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Options {
    /// Number of threads. 0 uses the environment variable `RAYON_NUM_THREADS`, or as many threads as there are cores.
    /// WebAssembly has no threads, and ignores the number.
    pub threads: usize,
    /// SIMD instructions that the renderer uses.
    pub simd: SimdLevel,
    /// Storage format of splats in memory.
    pub storage: Storage,
}

impl Options {
    surfel_model::setters! {
        with_threads threads: usize,
        with_simd simd: SimdLevel,
        with_storage storage: Storage,
    }
}
