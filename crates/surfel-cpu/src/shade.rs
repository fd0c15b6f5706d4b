//! Shading: sums are divided and lit (§5), by shadow maps too; surfaces of triangles are evaluated; transparent layers
//! are composited.

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
