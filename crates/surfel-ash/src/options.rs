//! Options of a renderer.

use surfel_gpu::{GpuPath, Limits};
use surfel_model::Storage;

/// How a [`Renderer`](crate::Renderer) is opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Options {
    /// A part of the adapter's name, in any case; `None`: the fastest kind of adapter there is.
    pub adapter: Option<String>,
    /// Has the validation layer check every call. Whatever it says becomes an error.
    pub validation: bool,
    /// What may be used of the device.
    pub limits: Limits,
    /// How splats are stored in the device's memory.
    pub storage: Storage,
    /// Compute shaders or raster hardware.
    pub path: GpuPath,
}

impl Options {
    /// With a part of the adapter's name, in any case; `None`: any adapter.
    #[must_use]
    pub fn with_adapter(mut self, adapter: impl Into<Option<String>>) -> Self {
        self.adapter = adapter.into();
        self
    }

    surfel_model::setters! {
        with_validation validation: bool,
        with_limits limits: Limits,
        with_storage storage: Storage,
        with_path path: GpuPath,
    }
}
