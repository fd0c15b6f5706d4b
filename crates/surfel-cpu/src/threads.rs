//! Threads of a renderer.

use surfel_render::RenderError;

/// Size of a thread's stack, in bytes. Unoptimised, as Cargo's profile `dev` builds a dependency, drawing touches 2.3
/// MiB, more than the default stack. Unused stack occupies no memory.
#[cfg(not(target_family = "wasm"))]
const STACK_BYTES: usize = 8 << 20;

/// A renderer's own threads. WebAssembly has none: there the caller's thread draws alone, as rayon's global pool.
pub(crate) struct Threads {
    #[cfg(not(target_family = "wasm"))]
    pool: rayon::ThreadPool,
}

#[cfg(not(target_family = "wasm"))]
impl Threads {
    /// Starts `count` threads; for 0, the default number that [`crate::Options::threads`] states.
    pub(crate) fn start(count: usize) -> Result<Self, RenderError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .stack_size(STACK_BYTES)
            .build()
            .map_err(|e| RenderError::Threads { backend: "cpu", message: e.to_string() })?;
        // Waits until each thread has run, so that callers can measure the memory that thread starts leave.
        pool.broadcast(|_| ());
        Ok(Self { pool })
    }

    pub(crate) fn count(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Runs a function on one of the threads, where rayon's parallel iterators use all of them.
    pub(crate) fn install<R: Send>(&self, run: impl FnOnce() -> R + Send) -> R {
        self.pool.install(run)
    }
}

#[cfg(target_family = "wasm")]
impl Threads {
    /// Returns a value that starts no thread; the number is ignored.
    pub(crate) fn start(_: usize) -> Result<Self, RenderError> {
        Ok(Self {})
    }

    pub(crate) fn count(&self) -> usize {
        1
    }

    /// Runs a function on the current thread.
    pub(crate) fn install<R: Send>(&self, run: impl FnOnce() -> R + Send) -> R {
        run()
    }
}
