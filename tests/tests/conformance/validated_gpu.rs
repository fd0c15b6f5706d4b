//! GPU backends where there is an adapter; a line that says so where there is none.

use std::sync::{Once, OnceLock};
use surfel_conformance::backends::{is_required, listen, start_ash, take_messages};
use surfel_conformance::expectations::Extent;
use surfel_conformance::harness::{Checked, Truth, check_all};
use surfel_gpu::GpuPath;
use surfel_model::Storage;
use surfel_render::Renderer;

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

/// The Vulkan backend, validated where the validation layer is installed: its messages are errors of the calls.
pub(crate) fn ash() -> Option<surfel_ash::Renderer> {
    ash_with(surfel_ash::Limits::default(), Storage::F32)
}

/// The same, with less of the device, or storage of another kind.
pub(crate) fn ash_with(limits: surfel_ash::Limits, storage: Storage) -> Option<surfel_ash::Renderer> {
    static SAID: Once = Once::new();
    let options = surfel_ash::Options::default().with_limits(limits).with_storage(storage);
    let (renderer, note) = started("ash", start_ash(options))?;
    if let Some(note) = note {
        SAID.call_once(|| println!("note: {note}"));
    }
    Some(renderer)
}

/// The wgpu backend, validated where the validation layer is installed.
pub(crate) fn wgpu() -> Option<surfel_wgpu::Renderer> {
    wgpu_with(surfel_wgpu::Limits::default(), Storage::F32)
}

/// The same, with less of the device, or storage of another kind.
pub(crate) fn wgpu_with(limits: surfel_wgpu::Limits, storage: Storage) -> Option<surfel_wgpu::Renderer> {
    listen();
    let options = surfel_wgpu::Options::default().with_validation(true).with_limits(limits).with_storage(storage);
    started("wgpu", surfel_wgpu::Renderer::new(options))
}

/// The Vulkan backend that draws by one path.
pub(crate) fn ash_by(path: GpuPath) -> Option<surfel_ash::Renderer> {
    let options = surfel_ash::Options::default().with_path(path);
    started("ash", start_ash(options)).map(|(renderer, _)| renderer)
}

/// The wgpu backend that draws by one path.
pub(crate) fn wgpu_by(path: GpuPath) -> Option<surfel_wgpu::Renderer> {
    listen();
    let options = surfel_wgpu::Options::default().with_validation(true).with_path(path);
    started("wgpu", surfel_wgpu::Renderer::new(options))
}

/// Every scene, as this backend draws it and how it compares; a backend of this name draws them once in a process.
pub(crate) fn every_scene(renderer: &mut impl Renderer) -> &'static [Checked] {
    static ASH: OnceLock<Vec<Checked>> = OnceLock::new();
    static WGPU: OnceLock<Vec<Checked>> = OnceLock::new();
    let drawn = if renderer.info().backend == "ash" { &ASH } else { &WGPU };
    drawn.get_or_init(|| check_all(renderer, Truth::of_every_scene().unwrap(), Extent::EveryScene))
}
