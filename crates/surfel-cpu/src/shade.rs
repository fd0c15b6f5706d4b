//! Shading: divides the pixels' sums by their weights and lights the results (rendering model §5), also with shadow
//! maps. It also evaluates surfaces of triangles, and composites transparent layers.

pub(crate) mod balls;
pub(crate) mod lighting;
pub(crate) mod matcap;
pub(crate) mod mesh_surface;
pub(crate) mod resolve;
pub(crate) mod shadow_draw;
pub(crate) mod shadow_map;
pub(crate) mod surface;
pub(crate) mod transparent;
pub(crate) mod view_ray;
