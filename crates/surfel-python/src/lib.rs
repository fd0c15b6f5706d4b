//! The native half of the Python package `surfel`: scenes, frames and files. Arguments are command-line flags as text,
//! which the package's Python half creates.
//!
//! Modules, in reading order:
//!
//! - `scene`: a loaded scene that is resident in a backend; `draw` parses its flags;
//! - `frame`: a rendered image, whose planes become NumPy arrays;
//! - `many`: images of many cameras, and turns;
//! - `files`: `convert`, `info`, `compare`, `ortho` and `backends`;
//! - `errors`, `interrupt`, `memory`, `pool`: exceptions, Ctrl-C, arrays without copies, threads.
//!
//! ```python
//! import surfel
//! surfel.scene("scan.ply").render(size=(1024, 768)).save("scan.png")
//! ```
//!
//! # Layer
//! The package lies above the facade `surfel`, as the command line does, and draws the same bits. Its Cargo features
//! `cpu`, `reference`, `sharp` (all on by default), `zstd` and `gpu` are those of the facade.

mod draw;
mod errors;
mod files;
mod frame;
mod interrupt;
mod many;
mod memory;
mod pool;
mod scene;

use pyo3::prelude::*;

#[pymodule(name = "_native")]
mod native {
    use super::*;

    #[pymodule_export]
    use crate::files::{backends, compare, convert, info, ortho};
    #[pymodule_export]
    use crate::frame::{NativeFrame, frame_of};
    #[pymodule_export]
    use crate::many::{NativeFrames, NativeMany};
    #[pymodule_export]
    use crate::scene::NativeScene;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
