//! The formulas of surface splatting, written once over [`Real`]: f64 for the reference, f32 and SIMD
//! lanes for the fast backends.
//!
//! A splat passes through these modules in order:
//!
//! 1. [`projection`]: pixels of view-space points; [`project`]: a splat's centre, affine projection J,
//!    depth slope and classification;
//! 2. [`filter`]: the footprint that a screen-space filter leaves, as linear forms over pixels ([`mapping`]);
//! 3. [`bounds`]: the pixels it can touch;
//! 4. [`clip`]: what a clipped splat keeps of it ([`clip_paper`]: the same as C12 has it);
//! 5. [`depth`]: depth of a fragment, tolerance of visibility; [`kernel`]: its weight and coverage.
//!
//! [`triangle`] does the same for polygons; [`shadow`] looks shadow maps up;
//! [`toon`], [`matcap`] and [`eye_dome`] are drawing styles; [`quantise`] keeps numbers in 16 bits.
//!
//! Section numbers (§) refer to `docs/rendering-model.md`. Nothing here allocates or does I/O.

pub mod basis;
pub mod bounds;
pub mod clip;
pub mod clip_paper;
pub mod depth;
pub mod eye_dome;
pub mod filter;
pub mod kernel;
pub mod mapping;
pub mod matcap;
pub mod project;
pub mod projection;
pub mod quantise;
pub mod real;
pub mod shadow;
pub mod srgb;
pub mod svd;
pub mod toon;
pub mod triangle;
pub mod vector;

pub use real::Real;
pub use vector::{V2, V3};
