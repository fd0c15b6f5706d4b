//! Native half of the Python package `surfel`: scenes, frames and files. Its functions take command-line flags as text,
//! which the package's Python half creates from keyword arguments.
//!
//! Modules, in reading order:
//!
//! - `scene`: scenes in Python, and their arguments; `draw`: drawing of frames from a scene's files and options;
//! - `frame`: an image's planes as NumPy arrays, and writing of image files; `many`: images from many cameras;
//! - `figure`: the command `figure`; `film`: sequences and films; `camera_path`: their cameras; `files`: the commands
//!   `convert`, `ortho`, `info`, `compare` and `backends`; `painter`: the page in a notebook;
//! - `errors`: conversion of errors to exceptions; `interrupt`: work that Ctrl-C can interrupt; `memory`: checks of the
//!   memory that arguments require; `pool`: started backends, reused from frame to frame.
//!
//! ```python
//! import surfel
//! surfel.open("scan.ply").render(size=(1024, 768)).save("scan.png")
//! ```
//!
//! # Layer
//! The package lies above `surfel-app`, as the command line does, and draws the same bits. Its Cargo features `cpu`,
//! `reference`, `sharp` (all on by default), `zstd` and `gpu` are those of `surfel-app`.

mod camera_path;
mod draw;
mod errors;
mod figure;
mod files;
mod film;
mod frame;
mod interrupt;
mod many;
mod memory;
mod painter;
mod pool;
mod scene;

use pyo3::prelude::*;

#[pymodule(name = "_native")]
mod native {
    use super::*;

    #[pymodule_export]
    use crate::figure::{NativeFigure, figure};
    #[pymodule_export]
    use crate::files::{backends, compare, convert, info, ortho};
    #[pymodule_export]
    use crate::film::{NativeFilm, NativeSequence, film_frames};
    #[pymodule_export]
    use crate::frame::{NativeFrame, frame_of};
    #[pymodule_export]
    use crate::many::{NativeFrames, NativeMany};
    #[pymodule_export]
    use crate::painter::{NativePainter, widget_page};
    #[pymodule_export]
    use crate::scene::NativeScene;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
