//! GPU backends where there is an adapter; a line that says so where there is none.
#![allow(dead_code, reason = "each test uses some of it")]

/// True if `SURFEL_REQUIRE`, a list separated by commas, names `what`: then nothing of it may be skipped.
fn is_required(what: &str) -> bool {
    std::env::var("SURFEL_REQUIRE").is_ok_and(|list| list.split(',').any(|word| word.trim() == what))
}

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

/// Messages of validation layers, which wgpu passes to the `log` crate.
static MESSAGES: std::sync::Mutex<Vec<String>> = std::sync::Mutex::new(Vec::new());

struct Listener;

impl log::Log for Listener {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= log::Level::Warn && metadata.target().starts_with("wgpu")
    }
    fn log(&self, record: &log::Record<'_>) {
        let text = record.args().to_string();
        // naga's debug information names WGSL as its source language, which layers of before 2023 don't know. What a message
        // is about follows it as a record of its own.
        let is_known = text.contains("Invalid source language operand: 10") || text.trim().starts_with("objects:");
        if self.enabled(record.metadata()) && !is_known {
            MESSAGES.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(format!(
                "{} {}",
                record.target(),
                record.args()
            ));
        }
    }
    fn flush(&self) {}
}

/// Fails if a validation layer, or wgpu itself, had anything to say.
pub(crate) fn no_messages() {
    let messages = MESSAGES.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    assert!(messages.is_empty(), "{}", messages.join("\n"));
}

/// The Vulkan backend, validated: whatever the layer says is an error of the call.
pub(crate) fn ash() -> Option<surfel_ash::Renderer> {
    ash_within(surfel_ash::Limits::default())
}

/// The same, with less of the device.
pub(crate) fn ash_within(limits: surfel_ash::Limits) -> Option<surfel_ash::Renderer> {
    let options = surfel_ash::Options { validation: true, limits, ..surfel_ash::Options::default() };
    started("ash", surfel_ash::Renderer::with_options(&options))
}

/// The wgpu backend, validated.
pub(crate) fn wgpu() -> Option<surfel_wgpu::Renderer> {
    wgpu_within(surfel_wgpu::Limits::default())
}

/// The same, with less of the device.
pub(crate) fn wgpu_within(limits: surfel_wgpu::Limits) -> Option<surfel_wgpu::Renderer> {
    // A second test of the same program has installed it already.
    if log::set_logger(&Listener).is_ok() {
        log::set_max_level(log::LevelFilter::Warn);
    }
    let options = surfel_wgpu::Options { validation: true, limits, ..surfel_wgpu::Options::default() };
    started("wgpu", surfel_wgpu::Renderer::with_options(&options))
}
