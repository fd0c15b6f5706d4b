//! Conversion of Vulkan results into errors.

use crate::NAME;
use ash::vk;
use gpu_allocator::AllocationError;
use std::fmt::Display;
use surfel_render::RenderError;

/// Error of a failed Vulkan call, or of the backend itself.
#[derive(Debug)]
pub(crate) enum Failure {
    /// Host or device memory is exhausted.
    OutOfMemory,
    /// Any other error, as a message.
    Other(String),
}

impl Failure {
    /// Returns an error with a message.
    pub(crate) fn other(message: impl Display) -> Self {
        Self::Other(message.to_string())
    }
}

impl From<vk::Result> for Failure {
    fn from(result: vk::Result) -> Self {
        match result {
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY
            | vk::Result::ERROR_OUT_OF_HOST_MEMORY
            | vk::Result::ERROR_OUT_OF_POOL_MEMORY => Self::OutOfMemory,
            vk::Result::ERROR_DEVICE_LOST => Self::Other("the device was lost; start the renderer again".into()),
            other => Self::Other(format!("Vulkan says {other}")),
        }
    }
}

impl From<AllocationError> for Failure {
    fn from(error: AllocationError) -> Self {
        match error {
            AllocationError::OutOfMemory => Self::OutOfMemory,
            other => Self::Other(other.to_string()),
        }
    }
}

impl From<Failure> for RenderError {
    fn from(failure: Failure) -> Self {
        let message = match failure {
            Failure::OutOfMemory => "the device is out of memory; render by `region` or draw fewer splats".to_owned(),
            Failure::Other(message) => message,
        };
        Self::Backend { backend: NAME, message }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_devices_and_ended_memory_are_errors_that_say_what_to_do() {
        let text = |result: vk::Result| RenderError::from(Failure::from(result)).to_string();
        for result in [vk::Result::ERROR_OUT_OF_DEVICE_MEMORY, vk::Result::ERROR_OUT_OF_HOST_MEMORY] {
            assert!(text(result).contains("out of memory; render by `region`"), "{}", text(result));
        }
        assert!(text(vk::Result::ERROR_DEVICE_LOST).contains("device was lost; start"));
        assert!(matches!(Failure::from(AllocationError::OutOfMemory), Failure::OutOfMemory));
        assert!(text(vk::Result::ERROR_FORMAT_NOT_SUPPORTED).starts_with("ash: Vulkan says"));
    }
}
