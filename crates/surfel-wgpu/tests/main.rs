//! Tests on a real driver: drawing into a host's render target, with a host's splats and shaders, and formulas in WGSL.

mod host;
mod placed;
mod shader;
mod twins;
