//! The CPU backend: the reference's image by SIMD, on any number of threads.
//!
//! A frame passes through these folders in order, and each imports only from those above it:
//!
//! 1. `simd`: lanes of 16 numbers, and the CPU's instructions;
//! 2. `scene`: what stays resident: splats in Morton order, in chunks of up to 256 with an f64 origin and bounds;
//! 3. `tiles`: blocks of 4×4 pixels, tiles of 32×32, lists of what touches them, threads and their scratch memory;
//! 4. `cull`: chunks outside of the view, back-facing or occluded; cells, the parts of an image that one thread draws
//!    by itself, so that records are still in its cache when they are drawn;
//! 5. `setup`: 16 splats at a time become records: footprints on the screen, by `surfel-math`'s formulas over lanes,
//!    sorted stably into tiles; splats at the near plane in f64;
//! 6. `raster`: per block two loops over the same list, depth thresholds, then weighted sums in registers;
//! 7. `shade`: sums are divided and lit; shadow maps; transparent layers are composited;
//! 8. `screen`: blocks become tiles of the image while they are hot; edge antialiasing, outlines and eye-dome lighting
//!    look at a G-buffer of a tile and its neighbours.
//!
//! `gaussians` draws trained Gaussians, which have none of these stages, by `simd` and `scene` alone.
//!
//! `renderer` and `frame` know all of them. What a frame lacks costs it nothing.
//!
//! Output is bit-identical for any number of threads and any SIMD level: every sum is in splat order, every operation
//! is correctly rounded, and nothing depends on lane width.

mod cull;
#[doc(hidden)]
pub mod formulas;
mod frame;
mod gaussians;
mod options;
mod raster;
mod renderer;
mod scene;
mod screen;
mod setup;
mod shade;
mod simd;
#[cfg(test)]
mod tests;
mod tiles;

pub use options::Options;
pub use renderer::Renderer;
pub use scene::resident::ResidentScene;
pub use simd::level::SimdLevel;
pub use surfel_model::Storage;
