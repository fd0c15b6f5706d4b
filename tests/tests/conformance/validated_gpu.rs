//! GPU backends, if there is an adapter; otherwise a printed note.

use std::sync::{Once, OnceLock};
use surfel_conformance::backends::{is_required, listen, start_ash, take_messages};
use surfel_conformance::expectations::Extent;
use surfel_conformance::harness::{Checked, Truth, check_all};
use surfel_gpu::GpuPath;
use surfel_model::Storage;
use surfel_render::Renderer;

/// Returns the backend if it starts; else the test is skipped, or fails if the backend is required.
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

/// Fails if a validation layer, or wgpu itself, sent a message.
pub(crate) fn no_messages() {
    let messages = take_messages();
    assert!(messages.is_empty(), "{}", messages.join("\n"));
}

/// Starts the Vulkan backend, validated if the validation layer is installed: its messages are errors of the calls.
pub(crate) fn ash() -> Option<surfel_ash::Renderer> {
    ash_with(surfel_ash::Limits::default(), Storage::F32)
}

/// Starts the validated Vulkan backend with limits and a kind of storage.
pub(crate) fn ash_with(limits: surfel_ash::Limits, storage: Storage) -> Option<surfel_ash::Renderer> {
    static SAID: Once = Once::new();
    let options = surfel_ash::Options::default().with_limits(limits).with_storage(storage);
    let (renderer, note) = started("ash", start_ash(options))?;
    if let Some(note) = note {
        SAID.call_once(|| println!("note: {note}"));
    }
    Some(renderer)
}

/// Starts the wgpu backend, validated if the validation layer is installed.
pub(crate) fn wgpu() -> Option<surfel_wgpu::Renderer> {
    wgpu_with(surfel_wgpu::Limits::default(), Storage::F32)
}

/// Starts the validated wgpu backend with limits and a kind of storage.
pub(crate) fn wgpu_with(limits: surfel_wgpu::Limits, storage: Storage) -> Option<surfel_wgpu::Renderer> {
    listen();
    let options = surfel_wgpu::Options::default().with_validation(true).with_limits(limits).with_storage(storage);
    started("wgpu", surfel_wgpu::Renderer::new(options))
}

/// Starts the Vulkan backend on one path.
pub(crate) fn ash_by(path: GpuPath) -> Option<surfel_ash::Renderer> {
    let options = surfel_ash::Options::default().with_path(path);
    started("ash", start_ash(options)).map(|(renderer, _)| renderer)
}

/// Starts the wgpu backend on one path.
pub(crate) fn wgpu_by(path: GpuPath) -> Option<surfel_wgpu::Renderer> {
    listen();
    let options = surfel_wgpu::Options::default().with_validation(true).with_path(path);
    started("wgpu", surfel_wgpu::Renderer::new(options))
}

/// Returns the backend's images of every scene with their reports, drawn once per process for each backend name.
pub(crate) fn every_scene(renderer: &mut impl Renderer) -> &'static [Checked] {
    static ASH: OnceLock<Vec<Checked>> = OnceLock::new();
    static WGPU: OnceLock<Vec<Checked>> = OnceLock::new();
    let drawn = if renderer.info().backend == "ash" { &ASH } else { &WGPU };
    drawn.get_or_init(|| check_all(renderer, Truth::of_every_scene().unwrap(), Extent::EveryScene))
}
