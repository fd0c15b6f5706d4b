//! The native half of the Python package `surfel`: scenes, frames and files. Arguments are command-line flags as text,
//! which the package's Python half creates.

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
