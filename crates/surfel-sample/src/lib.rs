//! Makes splats of point clouds and triangle meshes: normals, local spacing, radii, surface sampling.
//!
//! - [`splats_from_points`]: normals by PCA where they are missing, with signs that neighbours agree on, and
//!   radii from each point's Voronoi cell in its tangent plane, so that the surface closes.
//! - [`outliers`]: which points stand alone.
//! - [`splats_from_mesh`]: one splat a face, one a vertex, or blue-noise samples.
//! - [`octree_from_mesh`]: splats of every size and the polygons themselves, in an octree.
//! - [`sharp_splats_from_mesh`]: few, large splats clipped along the mesh's creases and borders.
//! - [`sharpen_points`]: splats of points, clipped along the edges that the points show.
//! - [`fit_to_mesh`], [`fit_point_colors`]: colours and normals whose blend is the surface's (docs/textures.md).
//! - [`interior_weight`]: the Σw that a cloud has inside its own surface (rendering model §5, coverage).
//!
//! Work runs in whatever rayon pool the caller installed; results don't depend on the number of threads.
//!
//! Points are sorted along a Morton curve and prepared in blocks, whose neighbours come from what lies near a leaf of
//! 16 points, gathered once for all of them. The search is our own rather than a crate's: it never allocates in a
//! query, breaks ties of equal distance in a fixed order, takes any number of coincident points, and is several times
//! as fast. A small k-d tree serves where the queries aren't the points themselves.

mod assemble;
mod block;
mod boxes;
mod cell;
mod class;
mod eigen;
mod error;
mod fit;
mod foliage;
mod interior;
mod lanes;
mod largest;
mod median;
mod mesh;
mod nearest;
#[cfg(feature = "sharp")]
mod neighbours;
mod normals;
mod options;
mod orient;
mod outliers;
mod parallel;
mod points;
mod progress;
mod radii;
#[cfg(feature = "sharp")]
mod sharp;
mod sorted;
mod tree;

pub use class::PointClass;
pub use error::SampleError;
pub use fit::{FitReport, PointFitReport, fit_point_colors, fit_to_mesh};
pub use interior::interior_weight;
pub use mesh::{
    BOTH_SIDES, CLOSED_MESH, Detail, FINE_SPLATS, FLAT_PARTS, MeshMethod, MeshOptions, MeshPlaces, MeshReport,
    OctreeOptions, is_closed, is_oriented, octree_from_mesh, points_from_mesh, splats_from_mesh, turn_outward,
};
pub use options::{PointOptions, PointReport};
pub use outliers::outliers;
pub use points::{MOST_SPACINGS, OF_POINTS, splats_from_points};
pub use progress::{NoProgress, Progress};
#[cfg(feature = "sharp")]
pub use sharp::{SharpErrors, SharpOptions, SharpPointsReport, SharpReport, sharp_splats_from_mesh, sharpen_points};
