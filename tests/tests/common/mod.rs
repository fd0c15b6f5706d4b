//! GPU backends where there is an adapter; a line that says so where there is none.
#![allow(dead_code, reason = "each test uses some of it")]

pub(crate) mod faulty;
pub(crate) mod files;

use surfel_conformance::backends::{is_required, listen, take_messages};
use surfel_render::Storage;

/// The backend if it starts; else the test is skipped, or fails where the backend is required.
fn started<R>(name: &str, start: Result<R, impl std::fmt::Display>) -> Option<R> {
    match start {
        Ok(renderer) => Some(renderer),
        Err(error) if is_required(name) => panic!("SURFEL_REQUIRE asks for {name}, but: {error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    }
}

/// Fails if a validation layer, or wgpu itself, had anything to say.
pub(crate) fn no_messages() {
    let messages = take_messages();
    assert!(messages.is_empty(), "{}", messages.join("\n"));
}

/// The Vulkan backend, validated: whatever the layer says is an error of the call.
pub(crate) fn ash() -> Option<surfel_ash::Renderer> {
    ash_with(surfel_ash::Limits::default(), Storage::F32)
}

/// The same, with less of the device, or storage of another kind.
pub(crate) fn ash_with(limits: surfel_ash::Limits, storage: Storage) -> Option<surfel_ash::Renderer> {
    let options = surfel_ash::Options { validation: true, limits, storage, ..surfel_ash::Options::default() };
    started("ash", surfel_ash::Renderer::with_options(&options))
}

/// The wgpu backend, validated.
pub(crate) fn wgpu() -> Option<surfel_wgpu::Renderer> {
    wgpu_with(surfel_wgpu::Limits::default(), Storage::F32)
}

/// The same, with less of the device, or storage of another kind.
pub(crate) fn wgpu_with(limits: surfel_wgpu::Limits, storage: Storage) -> Option<surfel_wgpu::Renderer> {
    listen();
    let options = surfel_wgpu::Options { validation: true, limits, storage, ..surfel_wgpu::Options::default() };
    started("wgpu", surfel_wgpu::Renderer::with_options(&options))
}
