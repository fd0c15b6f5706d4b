//! The WebAssembly module that exported pages of `surfel view` draw with, as bytes.
//!
//! `cargo xtask web` compiles `surfel-web` to the folder `module` of this package, once for each set of instructions. A
//! package from a registry has them already.
//!
//! ```
//! let module = surfel_web_module::FUSED;
//! assert!(module.is_empty() || module.starts_with(b"\0asm"), "empty where it isn't built");
//! ```

/// Module for browsers whose relaxed SIMD multiplies and adds with a single rounding. Empty if it isn't built.
pub const FUSED: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/fused.wasm"));

/// Module for all browsers with SIMD. Empty if it isn't built.
pub const EMULATED: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/emulated.wasm"));
