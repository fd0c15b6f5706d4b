//! From resident splats and triangles to records on the screen, sorted into tiles; and what a record is at a pixel.

pub(crate) mod candidates;
pub(crate) mod clips;
pub(crate) mod evaluate;
pub(crate) mod footprint;
pub(crate) mod kernel;
pub(crate) mod mask;
pub(crate) mod near;
pub(crate) mod prepare;
pub(crate) mod project;
pub(crate) mod record;
pub(crate) mod rows;
pub(crate) mod segment;
pub(crate) mod tiny;
pub(crate) mod triangles;
