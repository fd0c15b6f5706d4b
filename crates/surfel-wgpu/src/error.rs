//! Conversion of wgpu's errors into [`RenderError`].

use crate::NAME;
use std::sync::{Arc, Mutex, PoisonError};
use surfel_render::RenderError;

/// Returns an error of this backend with a message.
pub(crate) fn failed(message: impl Into<String>) -> RenderError {
    RenderError::Backend { backend: NAME, message: message.into() }
}

/// Receiver of errors that wgpu reports outside of any call: a lost device, or an error that no error scope caught. It
/// stores the first one until [`ErrorSink::check`].
#[derive(Clone, Debug, Default)]
pub(crate) struct ErrorSink(Arc<Mutex<Option<String>>>);

impl ErrorSink {
    /// Creates a sink and registers it as the device's error handler. Without a handler, wgpu panics.
    pub(crate) fn of(device: &wgpu::Device) -> Self {
        let mailbox = Self::default();
        let uncaptured = mailbox.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| uncaptured.put(error.to_string())));
        let lost = mailbox.clone();
        device.set_device_lost_callback(move |reason, message| {
            // If the renderer itself destroys the device, that is no error.
            if reason != wgpu::DeviceLostReason::Destroyed {
                lost.put(format!("the device was lost: {message}"));
            }
        });
        mailbox
    }

    /// Stores an error's message, unless there is one.
    fn put(&self, message: String) {
        // Only the first error is stored, since later ones usually follow from it.
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
    }

    /// Returns the first error that arrived since the last call of this function, if any.
    pub(crate) fn check(&self) -> Result<(), RenderError> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), |message| Err(failed(message)))
    }
}

/// Error that wgpu reported within [`scoped`].
pub(crate) enum ScopedError {
    /// The device is out of memory.
    OutOfMemory,
    /// Any other error, as the message of wgpu.
    Other(String),
}

impl From<ScopedError> for RenderError {
    fn from(caught: ScopedError) -> Self {
        match caught {
            ScopedError::OutOfMemory => failed("the device is out of memory; render by `region` or draw fewer splats"),
            ScopedError::Other(message) => failed(message),
        }
    }
}

/// Runs `work` within error scopes. Returns the first error that wgpu reports, if any.
pub(crate) fn scoped<T>(device: &wgpu::Device, work: impl FnOnce() -> T) -> Result<T, ScopedError> {
    let filters = [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory];
    let mut scopes = filters.map(|filter| Some(device.push_error_scope(filter)));
    let result = work();
    // Scopes are popped in reverse order.
    let mut caught = None;
    for scope in scopes.iter_mut().rev().filter_map(Option::take) {
        caught = caught.or(pollster::block_on(scope.pop()));
    }
    match caught {
        None => Ok(result),
        Some(wgpu::Error::OutOfMemory { .. }) => Err(ScopedError::OutOfMemory),
        Some(other) => Err(ScopedError::Other(other.to_string())),
    }
}
