//! Setup: converts resident splats and triangles to records on the screen, and sorts the records into tiles. It also
//! evaluates a record at a pixel.

pub(crate) mod balls;
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
