//! The formulas of surface splatting, written once over [`Real`]: f64 for the reference, f32 and SIMD lanes for the
//! fast backends.
//!
//! A splat passes through these modules in order:
//!
//! 1. [`projection`]: pixels of view-space points; [`project`]: a splat's centre, affine projection J, depth slope and
//!    classification;
//! 2. [`filter`]: the footprint after a screen-space filter, as linear forms over pixels ([`mapping`]);
//! 3. [`bounds`]: the pixels that the footprint can touch;
//! 4. [`clip`]: the part of the footprint that a clip retains ([`clip_paper`]: the same by C12's formula);
//! 5. [`depth`]: depth of a fragment, tolerance of visibility; [`facing`]: the visible side of a surface; [`kernel`]: a
//!    fragment's weight and coverage.
//!
//! [`triangle`] does the same for polygons; [`shadow`] samples shadow maps; [`toon`], [`matcap`] and [`eye_dome`] are
//! shaders; [`quantise`] stores numbers in 16 bits.
//!
//! [`gaussian`] is for trained Gaussians, which are drawn one over another.
//!
//! Section numbers (§) refer to `docs/rendering-model.md`. The crate allocates nothing and does no I/O.

pub mod basis;
pub mod bounds;
pub mod clip;
pub mod clip_paper;
pub mod depth;
pub mod eye_dome;
pub mod facing;
pub mod filter;
pub mod gaussian;
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
