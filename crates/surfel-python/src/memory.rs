//! Checks of the memory that arguments require. A failed allocation would end the process, including Python. These
//! checks return an error before the allocation, which becomes a `MemoryError`.

use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::fmt::Display;
use std::io::ErrorKind;
use surfel_app::request::SplatOptions;
use surfel_io::{IoError, byte_size};
use surfel_load::Error;
use surfel_load::memory::default_budget;
use surfel_model::SplatCount;
use surfel_render::SHADOW_MAP_SIDE;
use surfel_render::{Planes, View};

/// Maximum memory of points in arrays, or of splats made of a mesh, until they are drawn; in bytes per point or splat.
/// The copy of the arrays isn't included.
const POINT_BYTES: u64 = 200;
/// Memory of an image in addition to its planes, in bytes per pixel: encoding, edges and tiles.
const PIXEL_BYTES: u64 = 40;
/// Memory of an image of the backend `reference`, which sums in f64, in addition to its planes, in bytes per pixel.
const REFERENCE_PIXEL_BYTES: u64 = 640;
/// Memory of a shadow map while it is drawn and used, in bytes per texel.
const TEXEL_BYTES: u64 = 24;
/// Address space, in bytes, that must stay free for small allocations, whose failure can't be handled.
const ROOM_BYTES: u64 = 24 << 20;
/// Address space of a thread's arena of glibc, in bytes. A thread reserves an arena at any time if so much space is
/// free.
const ARENA_BYTES: u64 = 64 << 20;
/// Default size of the stack of a thread, in bytes.
pub(crate) const STACK_BYTES: u64 = 2 << 20;
/// Size of the stack of a backend's thread, in bytes.
pub(crate) const BACKEND_STACK_BYTES: u64 = 8 << 20;

/// Returns an error if `bytes` exceed the memory budget, or can't be allocated beside the needs of `threads` threads.
///
/// `budget` is the value of `--memory`; `None` means the machine's default. 0 threads stand for one per core. `what` is
/// the argument that requires the memory, for the message.
pub(crate) fn check(what: &str, bytes: u64, threads: usize, budget: Option<u64>) -> Result<(), Error> {
    let budget = budget.or_else(default_budget).unwrap_or(u64::MAX);
    let kept_free = room_bytes(threads);
    let problem = if bytes > budget {
        format!("{} are needed, and {} may be used, or more by --memory", byte_size(bytes), byte_size(budget))
    } else if is_free(bytes.saturating_add(kept_free)) {
        return Ok(());
    } else {
        let (needed, kept_free) = (byte_size(bytes), byte_size(kept_free));
        format!("{needed} are needed, beside {kept_free} of free address space, and the system has less")
    };
    let source = std::io::Error::new(ErrorKind::OutOfMemory, problem);
    Err(IoError::System { path: what.into(), action: "fit into memory", source }.into())
}

/// Returns the address space, in bytes, that `threads` threads and the waiting caller need for small allocations.
fn room_bytes(threads: usize) -> u64 {
    let most = std::env::var("MALLOC_ARENA_MAX").ok().and_then(|text| text.trim().parse::<u64>().ok());
    // The heap is the first arena. Without the environment variable, there are at most eight arenas per core.
    let arenas = most.filter(|most| *most > 0).map_or(8 * count(0) as u64, |most| most - 1);
    ROOM_BYTES + ARENA_BYTES.saturating_mul(arenas.min(count(threads) as u64 + 1))
}

/// Returns the number of threads; 0 stands for one per core.
fn count(threads: usize) -> usize {
    if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads }
}

/// True if the system can allocate `bytes` bytes.
fn is_free(bytes: u64) -> bool {
    usize::try_from(bytes).is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok())
}

/// Returns an error unless there is memory for `threads` stacks of `stack` bytes; 0 threads stand for one per core.
pub(crate) fn check_threads(threads: usize, stack: u64) -> Result<(), Error> {
    check("threads", (count(threads) as u64).saturating_mul(stack), threads, Some(u64::MAX))
}

/// Returns the error for threads that didn't start. It is the error of [`check_threads`], or else the system's
/// `problem`, which then is a limit on the number of threads.
pub(crate) fn threads_error(threads: usize, stack: u64, problem: &dyn Display) -> Error {
    check_threads(threads, stack).err().unwrap_or_else(|| {
        let source = std::io::Error::other(problem.to_string());
        IoError::System { path: "threads".into(), action: "start", source }.into()
    })
}

/// Returns an error unless there is memory for `points` points in arrays, and for the splats of a mesh, if the options
/// state their number.
pub(crate) fn check_splats(points: u64, options: &SplatOptions, threads: usize) -> Result<(), Error> {
    check("points", points.saturating_mul(POINT_BYTES), threads, options.memory)?;
    let Some(SplatCount::Count(splats)) = options.convert.splats else { return Ok(()) };
    check("splats", u64::from(splats).saturating_mul(POINT_BYTES), threads, options.memory)
}

/// Returns an error unless there is memory for an image and its shadow maps. `samples` is the number of samples along a
/// pixel's side.
pub(crate) fn check_image(
    view: &View,
    samples: u32,
    shadow_maps: usize,
    planes: Planes,
    (backend, threads): (&str, usize),
    budget: Option<u64>,
) -> Result<(), Error> {
    let of_planes = [
        (planes.shows_color(), 16),
        (planes.depth || planes.position, 4),
        (planes.normal, 12),
        (planes.weight, 4),
        (planes.index || planes.label, 12),
        (planes.position, 24),
        (planes.alpha, 4),
        (planes.median_depth, 4),
        (planes.distortion, 4),
    ];
    let own = if backend == "reference" { REFERENCE_PIXEL_BYTES } else { PIXEL_BYTES };
    let pixel_bytes: u64 = own + of_planes.iter().filter(|(wanted, _)| *wanted).map(|(_, bytes)| bytes).sum::<u64>();
    let pixels = u64::from(view.region.width) * u64::from(view.region.height);
    let drawn = pixels.saturating_mul(u64::from(samples).pow(2)).saturating_mul(pixel_bytes);
    let texels = shadow_maps as u64 * u64::from(SHADOW_MAP_SIDE).pow(2);
    check("size", drawn.saturating_add(texels.saturating_mul(TEXEL_BYTES)), threads, budget)
}

/// Copies bytes to a Python object. Raises `MemoryError` if the allocation fails.
pub(crate) fn py_bytes<'py>(py: Python<'py>, bytes: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
    PyBytes::new_with(py, bytes.len(), |copy| {
        copy.copy_from_slice(bytes);
        Ok(())
    })
}
