//! The formulas of surface splatting.

pub mod basis;
pub mod srgb;
