//! Options of a renderer.

use surfel_gpu::{GpuPath, Limits};
use surfel_model::Storage;

/// Options for opening a [`Renderer`](crate::Renderer).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Options {
    /// Part of the name of the adapter to open, in upper or lower case. `None` for the first adapter of the fastest
    /// kind.
    pub adapter: Option<String>,
    /// True if the graphics API's validation, where installed, checks every call. Its messages go to the `log` crate.
    pub validation: bool,
    /// Limits on the use of the device.
    pub limits: Limits,
    /// Storage format of splats in the device's memory.
    pub storage: Storage,
    /// Way in which frames are drawn: by compute shaders or by raster hardware.
    pub path: GpuPath,
    /// True if wgpu translates shaders from WGSL on Vulkan, too, as it does elsewhere. Else the driver gets the SPIR-V
    /// that was built with this crate. Images are the same up to the rounding of the driver's code.
    pub wgsl: bool,
}

impl Options {
    /// Sets the part of the adapter's name, in upper or lower case; `None` allows any adapter.
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
        with_wgsl wgsl: bool,
    }
}
