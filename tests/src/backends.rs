//! The backends by name, watched by validation layers.

use crate::expectations::Extent;
use crate::harness::{Checked, Truth, check, expect};
use std::sync::{Mutex, PoisonError};
use surfel_render::{RenderError, Renderer, RendererInfo};

/// What is held against the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// `surfel-cpu`.
    Cpu,
    /// `surfel-wgpu`.
    Wgpu,
    /// `surfel-ash`.
    Ash,
}

impl Backend {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Cpu, Self::Wgpu, Self::Ash];

    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Wgpu => "wgpu",
            Self::Ash => "ash",
        }
    }
}

/// A backend that was held against the reference.
pub struct Run {
    /// Who drew.
    pub info: RendererInfo,
    /// What to know about it: that nothing was validated.
    pub note: Option<String>,
    /// One result a truth, in their order; then those without an image.
    pub checked: Vec<Checked>,
}

impl Run {
    /// True if nothing failed.
    pub fn is_ok(&self) -> bool {
        self.checked.iter().all(|c| c.report.is_ok())
    }
}

/// A backend that was started.
pub struct Session {
    drawing: Drawing,
    note: Option<String>,
}

enum Drawing {
    Cpu(Box<surfel_cpu::Renderer>),
    Wgpu(Box<surfel_wgpu::Renderer>),
    Ash(Box<surfel_ash::Renderer>),
}

impl Session {
    /// Starts a backend, on the first adapter whose name contains `adapter` where it uses one.
    ///
    /// # Errors
    /// [`RenderError`] if it doesn't start.
    pub fn start(backend: Backend, adapter: Option<&str>) -> Result<Self, RenderError> {
        let adapter = adapter.map(str::to_owned);
        let drawing = match backend {
            Backend::Cpu => Drawing::Cpu(Box::new(surfel_cpu::Renderer::new(Default::default())?)),
            Backend::Wgpu => {
                listen();
                let options = surfel_wgpu::Options::default().with_adapter(adapter).with_validation(true);
                Drawing::Wgpu(Box::new(surfel_wgpu::Renderer::new(options)?))
            }
            Backend::Ash => {
                let (renderer, note) = start_ash(surfel_ash::Options::default().with_adapter(adapter))?;
                return Ok(Self { drawing: Drawing::Ash(Box::new(renderer)), note });
            }
        };
        Ok(Self { drawing, note: None })
    }

    /// Who draws.
    pub fn info(&self) -> &RendererInfo {
        match &self.drawing {
            Drawing::Cpu(renderer) => renderer.info(),
            Drawing::Wgpu(renderer) => renderer.info(),
            Drawing::Ash(renderer) => renderer.info(),
        }
    }

    /// Has the backend draw a case and compares. What validation layers say is a failure.
    pub fn check(&mut self, truth: &Truth) -> Checked {
        match &mut self.drawing {
            Drawing::Cpu(renderer) => check(renderer.as_mut(), truth),
            Drawing::Ash(renderer) => check(renderer.as_mut(), truth),
            Drawing::Wgpu(renderer) => {
                let mut checked = check(renderer.as_mut(), truth);
                checked.report.fail(take_messages().into_iter().map(|message| format!("validation: {message}")));
                checked
            }
        }
    }
}

/// Holds a backend against the reference, on the first adapter whose name contains `adapter` where it uses one.
///
/// # Errors
/// [`RenderError`] if the backend doesn't start.
pub fn run(backend: Backend, adapter: Option<&str>, truths: &[Truth], extent: Extent) -> Result<Run, RenderError> {
    let mut session = Session::start(backend, adapter)?;
    let mut checked: Vec<Checked> = truths.iter().map(|truth| session.check(truth)).collect();
    expect(session.info(), extent, &mut checked);
    Ok(Run { info: session.info().clone(), note: session.note, checked })
}

/// Starts the Vulkan backend with validation, whose messages become errors of the calls. Where validation doesn't start
/// but the backend does, returns a note beside the renderer.
///
/// # Errors
/// [`RenderError`] if the backend doesn't start, or validation doesn't and `SURFEL_REQUIRE` names it.
pub fn start_ash(options: surfel_ash::Options) -> Result<(surfel_ash::Renderer, Option<String>), RenderError> {
    match surfel_ash::Renderer::new(options.clone().with_validation(true)) {
        Ok(renderer) => Ok((renderer, None)),
        Err(error) if is_required("validation") => Err(error),
        Err(error) => {
            let renderer = surfel_ash::Renderer::new(options.with_validation(false))?;
            Ok((renderer, Some(format!("not validated: {error}"))))
        }
    }
}

/// True if `SURFEL_REQUIRE`, a list separated by commas, names `what`: then nothing of it may be skipped.
pub fn is_required(what: &str) -> bool {
    std::env::var("SURFEL_REQUIRE").is_ok_and(|list| list.split(',').any(|word| word.trim() == what))
}

/// Messages of validation layers, which wgpu passes to the `log` crate.
static MESSAGES: Mutex<Vec<String>> = Mutex::new(Vec::new());

struct Listener;

impl log::Log for Listener {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= log::Level::Warn && metadata.target().starts_with("wgpu")
    }
    fn log(&self, record: &log::Record<'_>) {
        let text = record.args().to_string();
        // naga's debug information names WGSL as its source language, which layers of before 2023 don't know. What a
        // message is about follows it as a record of its own.
        let is_known = text.contains("Invalid source language operand: 10") || text.trim().starts_with("objects:");
        if self.enabled(record.metadata()) && !is_known {
            let message = format!("{} {}", record.target(), record.args());
            MESSAGES.lock().unwrap_or_else(PoisonError::into_inner).push(message);
        }
    }
    fn flush(&self) {}
}

/// Keeps what wgpu and the layers below it say from now on.
pub fn listen() {
    // Whoever came first has installed it already.
    if log::set_logger(&Listener).is_ok() {
        log::set_max_level(log::LevelFilter::Warn);
    }
}

/// What was said since [`listen`] and was not taken yet.
pub fn take_messages() -> Vec<String> {
    std::mem::take(&mut *MESSAGES.lock().unwrap_or_else(PoisonError::into_inner))
}
