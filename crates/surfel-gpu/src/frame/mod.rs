//! Data that a frame uploads in addition to the resident scene: its tiles and uniforms, visible chunks, splats that
//! reach the near plane, polygons, balls and trained Gaussians.

pub(crate) mod balls;
pub(crate) mod cell_tiles;
pub(crate) mod culling;
pub(crate) mod gaussians;
pub(crate) mod near_plane;
pub(crate) mod object_transform;
pub(crate) mod pixel_range;
pub(crate) mod planes;
pub(crate) mod polygons;
pub(crate) mod samples;
pub(crate) mod shadow_maps;
pub(crate) mod surface_count;
pub(crate) mod tile;
pub(crate) mod tiling;
pub(crate) mod uniforms;
