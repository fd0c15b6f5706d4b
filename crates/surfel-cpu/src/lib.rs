//! The CPU backend: draws the reference implementation's image by SIMD, on any number of threads.
//!
//! Main types, in reading order:
//!
//! 1. [`Renderer`]: uploads scenes and draws frames; implements [`surfel_render::Renderer`];
//! 2. [`Options`]: threads, [`SimdLevel`] and [`Storage`] of a renderer;
//! 3. [`ResidentScene`]: an uploaded scene.
//!
//! ```
//! use surfel_model::{Camera, Scene, Settings, Shader, SplatCloud};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let disk = SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?.with_colors(&[[1.0, 0.5, 0.0]])?;
//! let camera = Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [64, 64]);
//!
//! let mut renderer = surfel_cpu::Renderer::new(surfel_cpu::Options::default().with_threads(1))?;
//! let resident = renderer.upload(&Scene::from(disk))?;
//! let frame = renderer.render(&resident, &camera, &Settings::default().with_shader(Shader::Unlit))?;
//! let [r, g, b, a] = frame.color()[32 * 64 + 32]; // linear, premultiplied
//! assert!((r - 1.0).abs() < 1e-3 && (g - 0.5).abs() < 1e-3 && b == 0.0 && (a - 1.0).abs() < 1e-3);
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The backend executes the plan of `surfel-render`. It calls the formulas of `surfel-math` over lanes of 16 numbers,
//! and shares no rasterisation code with another backend. Feature `scalar` also draws on CPUs without AVX2, slowly; it
//! doubles the time that the crate takes to build. The crate has no other features.
//!
//! # How a frame is drawn
//! A frame passes through these folders in order, and each imports only from those above it:
//!
//! 1. `simd`: lanes of 16 numbers, and the CPU's instructions;
//! 2. `scene`: the resident scene: splats in Morton order, in chunks of up to 256 with an f64 origin and bounds;
//! 3. `tiles`: blocks of 4×4 pixels, tiles of 32×32, lists of splats and triangles per tile, threads' scratch memory;
//! 4. `cull`: culling of chunks outside the view, back-facing or occluded; cells, the parts of an image that one thread
//!    draws alone, so that records are still in its cache when they are drawn;
//! 5. `setup`: 16 splats at a time become records, which are footprints on the screen, by `surfel-math`'s formulas over
//!    lanes. Records are sorted stably into tiles; splats at the near plane are computed in f64;
//! 6. `raster`: two loops per block over the same list: depth thresholds, then weighted sums in registers;
//! 7. `shade`: sums are divided and lit; shadow maps; transparent layers are composited;
//! 8. `screen`: blocks become tiles of the image while they are in the cache; edge antialiasing, outlines and eye-dome
//!    lighting read a G-buffer of a tile and its neighbours.
//!
//! `gaussians` draws trained Gaussians. It uses only `simd` and `scene`, since Gaussians pass through none of the later
//! stages.
//!
//! `renderer` and `frame` drive all folders. A feature that a frame doesn't use costs it nothing.
//!
//! # Reproducibility
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
mod threads;
mod tiles;

pub use options::Options;
pub use renderer::Renderer;
pub use scene::resident::ResidentScene;
pub use simd::level::SimdLevel;
pub use surfel_model::Storage;
#[doc(hidden)]
pub use tiles::driver::Tuning;
