//! Tests of splats against the meshes and points from which they were made.

mod common;
mod interior_weight;
mod mesh_cover;
mod normal_maps;
mod points_classes;
mod points_cover;
mod points_edge_cases;
mod points_outlines;
#[cfg(feature = "sharp")]
mod sharp;
