//! Division of an image into blocks and tiles, their targets, and lists of the splats and triangles that touch them.
//! Every stage may use this module.

pub(crate) mod bins;
pub(crate) mod drawn;
pub(crate) mod driver;
mod encode;
pub(crate) mod grid;
pub(crate) mod lists;
pub(crate) mod pool;
pub(crate) mod target;
