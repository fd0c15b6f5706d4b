//! SIMD lanes of numbers and the CPU's instructions, without reference to splats.

pub(crate) mod compress;
pub(crate) mod fused;
pub(crate) mod lanes;
pub(crate) mod level;
pub(crate) mod math;
#[cfg(test)]
pub(crate) mod xorshift;
