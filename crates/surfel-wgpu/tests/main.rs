//! Tests on a real driver: drawing into the render target of an embedding application, with the application's splats
//! and shaders, and formulas in WGSL.

mod host;
mod placed;
mod shader;
mod twins;
