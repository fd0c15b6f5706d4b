//! Bytes of the WebAssembly modules with which exported pages of `surfel view` draw.
//!
//! `cargo xtask web` compiles `surfel-web` to the folder `module` of this package, once for each set of instructions.
//! The package in a registry contains the compiled modules.
//!
//! ```
//! let module = surfel_web_module::FUSED;
//! assert!(module.is_empty() || module.starts_with(b"\0asm"), "empty where it isn't built");
//! ```

/// Module for browsers with relaxed SIMD, in which a multiplication and an addition are rounded once. Empty if it isn't
/// built.
pub const FUSED: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/fused.wasm"));

/// Module for all browsers with SIMD, which emulates the fused multiply-add. Empty if it isn't built.
pub const EMULATED: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/emulated.wasm"));
