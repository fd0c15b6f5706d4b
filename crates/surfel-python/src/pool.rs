//! Pool of started backends. A backend is reused by one frame after another.

use crate::memory::{self, BACKEND_STACK_BYTES};
use std::sync::{Mutex, PoisonError};
use surfel_backend::{Backend, BackendOptions};
use surfel_backend::{BackendError, Chosen};
use surfel_load::Error;
use surfel_render::Renderer;
use surfel_render::{Capabilities, RenderError};

/// Requested backend with its options.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct BackendRequest {
    /// Name of the backend, or `auto`.
    pub(crate) name: String,
    pub(crate) options: BackendOptions,
}

impl BackendRequest {
    /// Sets a backend flag from its text; returns false if the name isn't a backend flag.
    pub(crate) fn set(&mut self, flag: &str, text: &str) -> Result<bool, String> {
        match flag {
            "backend" => self.name = text.to_owned(),
            "adapter" => self.options.adapter = Some(text.to_owned()),
            "storage" => match text {
                "32" => self.options.quantised = false,
                "16" => self.options.quantised = true,
                _ => return Err("expected 32 or 16".to_owned()),
            },
            "threads" => match text.parse::<u16>() {
                Ok(n @ 1..=1024) => self.options.threads = usize::from(n),
                _ => return Err("expected a whole number from 1 to 1024".to_owned()),
            },
            _ => return Ok(false),
        }
        Ok(true)
    }
}

/// Key of an idle backend in the pool.
#[derive(Clone, PartialEq, Eq)]
struct Key {
    who: BackendRequest,
    /// Reason why `auto` selected another backend than the fastest; `None` if it selected the fastest.
    refused: Option<String>,
    /// Process id. After a fork, a process can't use its parent's backends, because it doesn't have their threads.
    process: u32,
}

/// Backends that no frame uses at the moment, each with its key.
static IDLE: Mutex<Vec<(Key, Backend)>> = Mutex::new(Vec::new());
/// Maximum number of idle backends in the pool.
const MOST: usize = 16;

/// Backend that is in use. It returns to the pool when dropped, unless the thread panics.
pub(crate) struct PooledBackend {
    key: Key,
    backend: Option<Backend>,
}

impl PooledBackend {
    /// Takes a backend from the pool, or starts one. `refuses` returns the reason why a backend can't draw the image;
    /// `auto` then selects another backend.
    pub(crate) fn new(who: &BackendRequest, refuses: impl Fn(&Capabilities) -> Option<String>) -> Result<Self, Error> {
        let mut key = Key { who: who.clone(), refused: None, process: std::process::id() };
        if who.name != "auto" {
            let backend = match idle(&key) {
                Some(backend) => backend,
                None => start(who, || Backend::by_name(&who.name, &who.options))?,
            };
            return Ok(Self { key, backend: Some(backend) });
        }
        let choose = |refuses: &dyn Fn(&Capabilities) -> Option<String>| {
            start(who, || Backend::choose(&who.options, refuses).map(|Chosen { backend, .. }| backend))
        };
        let fastest = Self { backend: Some(idle(&key).map_or_else(|| choose(&|_| None), Ok)?), key: key.clone() };
        let Some(reason) = fastest.backend.as_ref().and_then(|b| refuses(&b.info().capabilities)) else {
            return Ok(fastest);
        };
        key.refused = Some(reason);
        let backend = idle(&key).map_or_else(|| choose(&refuses), Ok)?;
        Ok(Self { key, backend: Some(backend) })
    }

    pub(crate) fn backend(&mut self) -> Result<&mut Backend, Error> {
        self.backend.as_mut().ok_or_else(crate::interrupt::defect)
    }
}

/// Starts a backend. Returns an error if there is no memory for its threads.
fn start(who: &BackendRequest, start: impl FnOnce() -> Result<Backend, BackendError>) -> Result<Backend, Error> {
    let threads = who.options.threads;
    if !matches!(who.name.as_str(), "ash" | "wgpu") {
        memory::check_threads(threads, BACKEND_STACK_BYTES)?;
    }
    start().map_err(|error| match error {
        BackendError::NoStart { source: RenderError::Threads { .. }, .. } => {
            memory::check_threads(threads, BACKEND_STACK_BYTES).err().unwrap_or_else(|| error.into())
        }
        _ => error.into(),
    })
}

fn idle(key: &Key) -> Option<Backend> {
    let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
    let at = idle.iter().position(|(known, _)| known == key)?;
    Some(idle.swap_remove(at).1)
}

impl Drop for PooledBackend {
    fn drop(&mut self) {
        // If a frame panicked, the state of its backend is unknown, and the backend is dropped.
        let Some(backend) = self.backend.take().filter(|_| !std::thread::panicking()) else { return };
        let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
        idle.push((self.key.clone(), backend));
        if idle.len() > MOST {
            let oldest = idle.remove(0);
            drop(idle);
            drop(oldest);
        }
    }
}
