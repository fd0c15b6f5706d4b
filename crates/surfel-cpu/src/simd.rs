//! Lanes of numbers and the CPU's instructions. Nothing here knows of splats.

pub(crate) mod compress;
pub(crate) mod lanes;
pub(crate) mod level;
pub(crate) mod math;
#[cfg(test)]
pub(crate) mod xorshift;
