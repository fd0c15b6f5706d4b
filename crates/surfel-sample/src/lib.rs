//! Makes splats of point clouds and triangle meshes: normals, local spacing, radii, surface sampling.
//!
//! - [`splats_from_points`]: normals by PCA where they are missing, oriented by a minimum spanning tree, and
//!   radii from each point's Voronoi cell in its tangent plane, so that the surface closes.
//! - [`splats_from_mesh`]: one splat a face, one a vertex, or blue-noise samples.
//! - [`octree_from_mesh`]: splats of every size and the polygons themselves, in an octree.
//! - [`sharp_splats_from_mesh`]: few, large splats clipped along the mesh's creases and borders.
//! - [`sharpen_points`]: splats of points, clipped along the edges that the points show.
//! - [`fit_to_mesh`], [`fit_point_colors`]: colours and normals whose blend is the surface's (docs/textures.md).
//! - [`interior_weight`]: the Σw that a cloud has inside its own surface (rendering model §5, coverage).
//!
//! Work runs in whatever rayon pool the caller installed; results don't depend on the number of threads.
//!
//! Neighbours come from a small k-d tree of our own rather than a crate's: it never allocates in a query, breaks
//! ties of equal distance in a fixed order, takes any number of coincident points, and cannot panic on them.

mod assemble;
mod cell;
mod eigen;
mod error;
mod fit;
mod interior;
mod mesh;
mod neighbours;
mod normals;
mod options;
mod orient;
mod parallel;
mod points;
mod progress;
mod radii;
#[cfg(feature = "sharp")]
mod sharp;
mod tree;

pub use error::SampleError;
pub use fit::{FitReport, PointFitReport, fit_point_colors, fit_to_mesh};
pub use interior::interior_weight;
pub use mesh::{
    CLOSED_MESH, Detail, FLAT_PARTS, MeshMethod, MeshOptions, MeshReport, OctreeOptions, is_closed, is_oriented,
    octree_from_mesh, points_from_mesh, splats_from_mesh,
};
pub use options::{Outliers, PointOptions, PointReport};
pub use points::splats_from_points;
pub use progress::{NoProgress, Progress};
#[cfg(feature = "sharp")]
pub use sharp::{SharpErrors, SharpOptions, SharpPointsReport, SharpReport, sharp_splats_from_mesh, sharpen_points};
