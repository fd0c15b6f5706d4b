//! Conversion of point clouds and triangle meshes to splats: normals, local spacing, radii, surface sampling.
//!
//! - [`splats_from_points`]: estimates missing normals by PCA, with consistent signs, and computes radii from each
//!   point's Voronoi cell in its tangent plane, so that the surface has no holes.
//! - [`outliers`]: finds isolated points by statistics.
//! - [`splats_from_mesh`]: makes one splat per face, one per vertex, or blue-noise samples.
//! - [`octree_from_mesh`]: makes an octree with splats of every size and the polygons themselves.
//! - [`sharp_splats_from_mesh`]: makes few, large splats clipped along the mesh's creases and borders.
//! - [`sharpen_points`]: clips the splats of points along edges detected in the points.
//! - [`fit_to_mesh`], [`fit_point_colors`]: fit colours and normals so that their blend equals the surface's
//!   (docs/textures.md).
//! - [`interior_weight`]: computes the Σw of a cloud inside its own surface (rendering model §5, coverage).
//!
//! Work runs in the rayon pool that the caller installed; results don't depend on the number of threads.
//!
//! Points are sorted along a Morton curve and processed in blocks. A search gathers the points near a leaf of 16 points
//! once for all queries from that leaf. It replaces a crate's search because it never allocates in a query and breaks
//! ties of equal distance in a fixed order. It also accepts any number of coincident points, and is several times as
//! fast. A small k-d tree serves queries at other positions than the points.

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
