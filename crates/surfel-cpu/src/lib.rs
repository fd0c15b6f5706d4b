//! The processor backend: the reference's picture by SIMD, on any number of threads.
//!
//! A frame passes through these modules in order:
//!
//! 1. `store`: splats in Morton order, in chunks of up to 256 with an f64 origin (once, at upload);
//! 2. `setup`: 16 splats at a time become `record`s: screen footprints, by `surfel-math`'s formulas over SIMD lanes;
//!    `near` takes the few that reach the near plane, in f64;
//! 3. `bins`: records are sorted stably into 32×32 pixel tiles;
//! 4. `tile`: per tile two loops over the same list, nearest depth, then weighted sums, in buffers that stay in cache;
//! 5. `finish`: several blocks at a time are divided (`shade`), lit (`light`, `sight`) and written while they are hot.
//!
//! Of a frame of many splats, `cells` are parts that one thread sets up and draws by itself, so that records are still in its
//! cache when they are drawn.
//!
//! A frame with more than opaque splats has its tiles drawn by `composite`: `mesh` and `polygon` find polygons, `between` puts
//! splats before them, `veil` draws transparent layers, `planes` and `window` serve a second look at edges and lines; `matcap` and `eye_dome` are
//! shaders of their own; `shadow` draws maps by
//! the same setup. What a frame lacks costs it nothing.
//!
//! Output is bit-identical for any number of threads and any SIMD level: every sum is in splat order, every operation
//! is correctly rounded, and nothing depends on lane width.

mod between;
mod bins;
mod cells;
mod clip;
mod column;
mod composite;
mod dot_fragments;
mod dot_tiles;
mod dots;
mod eye_dome;
mod finish;
#[doc(hidden)]
pub mod formulas;
mod fours;
mod fragment;
mod frame;
mod hidden;
mod kernel;
mod lane_math;
mod lanes;
mod level;
mod light;
mod limit;
mod lists;
mod mask;
mod matcap;
mod mesh;
mod near;
mod pixel_sums;
mod placed;
mod planes;
mod polygon;
mod prepare;
mod raster;
mod record;
mod recycle;
mod renderer;
mod rows;
mod set_bits;
mod setup;
mod shade;
mod shadow;
mod sight;
mod sixteens;
mod small_dots;
mod spot;
mod store;
mod target;
mod tile;
mod veil;
mod visibility;
mod window;

pub use level::SimdLevel;
pub use renderer::{Dots, Evaluation, Options, Peeling, Renderer, ResidentScene, Work};
pub use surfel_render::Storage;
