//! Conversion of point clouds and triangle meshes to splats: normals, local spacing, radii, surface sampling.
//!
//! Main functions, in reading order:
//!
//! - [`splats_from_points`]: estimates missing normals by PCA, with consistent signs, and computes radii from each
//!   point's Voronoi cell in its tangent plane, so that the surface has no holes ([`PointOptions`], [`PointReport`]).
//!   [`PointClass`] lists the classes of points: surface, foliage, lines, isolated points and others.
//! - [`outliers()`]: finds isolated points by statistics.
//! - [`splats_from_mesh`]: makes one splat per face, one per vertex, or blue-noise samples ([`MeshOptions`],
//!   [`MeshReport`]).
//! - [`octree_from_mesh`]: makes an octree of levels of detail, with splats in all nodes and the mesh's triangles in
//!   the leaves.
//! - [`sharp_splats_from_mesh`] (feature `sharp`): makes few, large splats clipped along the mesh's creases and
//!   borders.
//! - [`sharpen_points`] (feature `sharp`): clips the splats of points along edges detected in the points.
//! - [`fit_to_mesh`], [`fit_point_colors`]: fit the colours and normals of splats so that the blend of overlapping
//!   splats equals the surface's colours and normals (docs/textures.md).
//! - [`interior_weight`]: computes the typical sum of splat weights, Σw, inside a cloud's own surface (rendering model
//!   §5, coverage).
//!
//! ```
//! use surfel_model::glam::Vec3;
//! use surfel_model::{Column3, Mesh};
//! use surfel_sample::{MeshMethod, MeshOptions, NoProgress, splats_from_mesh};
//! # fn main() -> Result<(), surfel_sample::SampleError> {
//! let corners = vec![Vec3::new(0.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
//! let mesh = Mesh { positions: Column3::from_f32(corners), triangles: vec![[0, 1, 2]], ..Mesh::default() };
//!
//! let options = MeshOptions::new(MeshMethod::PerFace);
//! let (cloud, _report) = splats_from_mesh(&mesh, &options, &NoProgress)?;
//! assert_eq!(cloud.len(), 1); // one ellipse per triangle
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate builds on `surfel-model` and `surfel-math`. `surfel-load` calls it after `surfel-io` has read a file and
//! before a backend draws the splats. The crate opens no file. Work runs in the rayon pool that the caller installed;
//! results don't depend on the number of threads.
//!
//! # Features
//! `sharp`, on by default: splats clipped along creases and edges.
//!
//! # Neighbour search
//! Points are sorted along a Morton curve, in leaves of 16 points, and processed in blocks. A search gathers the points
//! near a leaf once for all queries from that leaf. Unlike the search of a general crate, this one never allocates in a
//! query and breaks ties of equal distance in a fixed order. It also accepts any number of coincident points, and is
//! several times as fast. A small k-d tree serves queries at positions that aren't points of the cloud.

mod assemble;
mod block;
mod boxes;
mod cell;
mod class;
mod distances;
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
mod size;
mod sorted;
mod tree;

pub use class::{DENSITY, PointClass};
pub use distances::Distances;
pub use error::SampleError;
pub use fit::{FitReport, PointFitReport, fit_point_colors, fit_to_mesh};
pub use interior::interior_weight;
pub use mesh::{
    BOTH_SIDES, CLOSED_MESH, Detail, FINE_SPLATS, FLAT_PARTS, MeshMethod, MeshOptions, MeshPlaces, MeshReport,
    OctreeOptions, is_closed, is_oriented, octree_from_mesh, points_from_mesh, splats_from_mesh, turn_outward,
};
pub use options::{PointOptions, PointReport};
pub use outliers::outliers;
pub use points::{MAX_SPACINGS, OF_POINTS, splats_from_points};
pub use progress::{NoProgress, Progress};
#[cfg(feature = "sharp")]
pub use sharp::{SharpErrors, SharpOptions, SharpPointsReport, SharpReport, sharp_splats_from_mesh, sharpen_points};
