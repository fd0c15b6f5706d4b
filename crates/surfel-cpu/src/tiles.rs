//! How an image is cut: blocks, tiles, where they write, and lists of what touches them. Every stage may use this.

pub(crate) mod bins;
pub(crate) mod drawn;
pub(crate) mod driver;
mod encode;
pub(crate) mod grid;
pub(crate) mod lists;
pub(crate) mod pool;
pub(crate) mod target;
