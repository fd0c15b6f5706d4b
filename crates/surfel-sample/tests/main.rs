//! Splats of meshes and points against the surfaces they were made of.

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
