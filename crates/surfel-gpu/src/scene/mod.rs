//! Scene in GPU buffers: chunks and segments of splats, their clips, textures of polygons.

pub(crate) mod chunk;
pub(crate) mod clip;
pub(crate) mod limits;
pub(crate) mod segment;
pub(crate) mod stored_splats;
pub(crate) mod textures;
pub(crate) mod upload;
