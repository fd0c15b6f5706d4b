//! Execution of work on a separate thread while Python waits. Meanwhile other Python threads run, Ctrl-C works, and
//! progress is shown.

use crate::{errors, memory};
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use surfel_load::Error;
use surfel_sample::Progress;

/// Interval at which the waiting thread checks for signals, such as Ctrl-C, and updates the progress.
pub(crate) const TICK: Duration = Duration::from_millis(50);
/// Running time after which work shows its progress.
const PROGRESS_DELAY: Duration = Duration::from_millis(700);

/// Progress of running work, which the waiting thread reads.
#[derive(Default)]
pub(crate) struct Reporter {
    stage: Mutex<(String, u64)>,
    done: AtomicU64,
}

impl Progress for Reporter {
    fn stage(&self, name: &str, total: u64) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        *stage = (name.to_owned(), total);
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }
}

impl Reporter {
    fn show(&self, py: Python<'_>) -> PyResult<()> {
        let (name, total) = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let done = self.done.load(Ordering::Relaxed) as f64;
        let share = if total > 0 { (done / total as f64).min(1.0) } else { 0.0 };
        py.import("surfel._progress")?.getattr("show")?.call1((name, share)).map(|_| ())
    }
}

/// Returns the error of a panic, which becomes `surfel.Error` in Python.
pub(crate) fn defect() -> Error {
    Error::Input(errors::DEFECT.to_owned())
}

/// Runs `work` on another thread and waits for the result. Ctrl-C ends the waiting at once. The work then continues to
/// its end, and its result is dropped.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&Reporter) -> Result<T, Error> + Send + 'static,
) -> PyResult<T> {
    let reporter = Arc::new(Reporter::default());
    let (sender, mut receiver) = channel();
    let shared = reporter.clone();
    let start = Instant::now();
    let started = spawn(move || {
        let result = catch_unwind(AssertUnwindSafe(|| work(&shared))).unwrap_or_else(|_| Err(defect()));
        // After Ctrl-C, nothing receives the result.
        let _ = sender.send(result);
    });
    started.map_err(|error| errors::raise(py, &error))?;
    let mut shown = false;
    let result = loop {
        let received;
        (received, receiver) = py.detach(move || (receiver.recv_timeout(TICK), receiver));
        match received {
            Ok(result) => break result,
            Err(RecvTimeoutError::Disconnected) => break Err(defect()),
            Err(RecvTimeoutError::Timeout) => {}
        }
        if start.elapsed() > PROGRESS_DELAY {
            reporter.show(py)?;
            shown = true;
        }
        if let Err(interrupted) = py.check_signals() {
            clear(py, shown)?;
            return Err(interrupted);
        }
    };
    clear(py, shown)?;
    result.map_err(|error| errors::raise(py, &error))
}

/// Starts a thread for `work`. Returns an error if there is no memory for its stack.
pub(crate) fn spawn(work: impl FnOnce() + Send + 'static) -> Result<(), Error> {
    memory::check_threads(1, memory::STACK_BYTES)?;
    let thread = std::thread::Builder::new().name("surfel".to_owned());
    thread.spawn(work).map(drop).map_err(|e| memory::threads_error(1, memory::STACK_BYTES, &e))
}

fn clear(py: Python<'_>, shown: bool) -> PyResult<()> {
    if shown {
        py.import("surfel._progress")?.getattr("clear")?.call0()?;
    }
    Ok(())
}
