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
//! shaders; [`quantise`] stores numbers in 16 bits; [`cone`] culls back-facing splats together. [`gaussian`] is for
//! trained Gaussians, which are drawn one over another.
//!
//! The main types, in reading order, are [`Real`], [`projection::Projection`], [`project::ViewSplat`],
//! [`project::Projected`], [`mapping::Footprint`] and [`filter::Filtered`]. This example computes the weight of one
//! fragment:
//!
//! ```
//! use surfel_math::project::{Projected, ViewSplat};
//! use surfel_math::projection::{Projection, ProjectionKind};
//! use surfel_math::{V2, V3, filter, kernel};
//!
//! // A pinhole camera with a focal length of 100 pixels and its optical axis through pixel position (50, 50).
//! let projection = Projection {
//!     kind: ProjectionKind::Perspective,
//!     focal_px: [100.0; 2],
//!     principal_px: [50.0; 2],
//!     near: 0.01,
//! };
//! // A disk of radius 0.1 that faces the eye from 4 units away: its radius is 2.5 pixels.
//! let splat = ViewSplat {
//!     p: V3::new(0.0, 0.0, 4.0),
//!     s: V3::new(0.1, 0.0, 0.0),
//!     t: V3::new(0.0, -0.1, 0.0),
//!     n: V3::new(0.0, 0.0, -1.0),
//! };
//! let projected = Projected::new(&splat, &projection);
//! let filtered = filter::principal(&projected, 0.7, true);
//!
//! // A fragment 1.25 pixels to the right of the centre is halfway to the rim: ρ = 1/2.
//! let (u, v, w) = filtered.footprint.at(V2::new(1.25, 0.0));
//! let rho_squared = (u * u + v * v) / (w * w);
//! assert!((rho_squared - 0.25_f64).abs() < 1e-12);
//! let weight = filtered.weight_scale * kernel::weight(rho_squared, 2.0);
//! assert!((weight - (-0.5_f64).exp()).abs() < 1e-12);
//! ```
//!
//! # Layer
//! All backends on the CPU call these functions, and `surfel-shaders` has a twin of each in WGSL. The crate depends on
//! `glam` alone, allocates nothing and does no I/O. It has no Cargo features.
//!
//! Section numbers (§) refer to `docs/rendering-model.md`. Papers are cited by a letter and a year, such as Z01, as in
//! that page's list of sources.

pub mod ball;
pub mod basis;
pub mod bounds;
pub mod clip;
pub mod clip_paper;
pub mod cone;
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
