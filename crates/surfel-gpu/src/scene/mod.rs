//! Scene in GPU buffers: chunks and segments of splats, their clips, textures of polygons, and splats that the
//! embedding application places.

pub(crate) mod chunk;
pub(crate) mod clip;
pub(crate) mod limits;
pub(crate) mod placement;
pub(crate) mod segment;
pub(crate) mod stored_splats;
pub(crate) mod textures;
pub(crate) mod upload;
