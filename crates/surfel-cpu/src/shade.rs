//! From sums to colours: dividing, lighting (§5), shadow maps, what triangles look like, and transparent layers
//! composited.

pub(crate) mod lighting;
pub(crate) mod matcap;
pub(crate) mod mesh_surface;
pub(crate) mod resolve;
pub(crate) mod shadow_draw;
pub(crate) mod shadow_map;
pub(crate) mod surface;
pub(crate) mod transparent;
pub(crate) mod view_ray;
