//! The backends by name, with validation layers enabled.

use crate::expectations::Extent;
use crate::harness::{Checked, Report, Truth, check, expect};
use crate::scenes::Case;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use surfel_ash::GpuPath;
use surfel_render::{Frame, Planes, RenderError, Renderer, RendererInfo};

/// A backend that is compared with the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// The backend `surfel-cpu`.
    Cpu,
    /// The backend `surfel-wgpu`.
    Wgpu,
    /// The backend `surfel-ash`.
    Ash,
}

impl Backend {
    /// All backends.
    pub const ALL: [Self; 3] = [Self::Cpu, Self::Wgpu, Self::Ash];

    /// Returns the name of the backend on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Wgpu => "wgpu",
            Self::Ash => "ash",
        }
    }
}

/// Result of comparing a backend with the reference.
pub struct Run {
    /// Backend and adapter that drew the images.
    pub info: RendererInfo,
    /// Note that the backend's calls weren't validated, with the reason; `None` if they were, and for the backend
    /// `cpu`.
    pub note: Option<String>,
    /// Results of comparing the truths, in their order. A failure without an image follows for each unused expectation.
    pub checked: Vec<Checked>,
}

impl Run {
    /// True if nothing failed.
    pub fn is_ok(&self) -> bool {
        self.checked.iter().all(|c| c.report.is_ok())
    }
}

/// Options for starting a backend.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// Part of the adapter's name, in upper or lower case; `None` for any adapter.
    pub adapter: Option<&'a str>,
    /// True if validation layers check every call, if they are installed.
    pub validation: bool,
    /// GPU path: compute shaders or raster hardware.
    pub path: GpuPath,
    /// True if wgpu translates shaders from WGSL on Vulkan, too.
    pub wgsl: bool,
}

/// Frames of a case that was drawn several times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repeated {
    /// Names of the timed passes; empty if the backend times none.
    pub passes: Vec<String>,
    /// Hashes of each plane, one per frame, by the name of the plane.
    pub hashes: BTreeMap<String, Vec<String>>,
}

fn repeat<R: Renderer>(backend: &mut R, case: &Case, times: usize) -> Result<Repeated, RenderError> {
    let resident = backend.upload(&case.scene)?;
    let (mut frame, mut repeated) = (Frame::default(), Repeated::default());
    for _ in 0..times {
        let stats = backend.render_into(&resident, &case.view(), &case.settings, Planes::ALL, &mut frame)?;
        repeated.passes = stats.passes.iter().map(|pass| pass.name.to_owned()).collect();
        for (plane, hash) in surfel_bench::kit::plane_hashes(&frame) {
            repeated.hashes.entry(plane.to_owned()).or_default().push(hash);
        }
    }
    Ok(repeated)
}

/// A running backend.
pub struct Session {
    drawing: Drawing,
    note: Option<String>,
}

/// Renderer of a running backend.
enum Drawing {
    Cpu(Box<surfel_cpu::Renderer>),
    Wgpu(Box<surfel_wgpu::Renderer>),
    Ash(Box<surfel_ash::Renderer>),
}

impl Session {
    /// Starts a backend with validation. If the backend uses an adapter, the first one whose name contains `adapter` is
    /// selected.
    ///
    /// # Errors
    /// [`RenderError`] if the backend doesn't start.
    pub fn start(backend: Backend, adapter: Option<&str>) -> Result<Self, RenderError> {
        Self::start_as(backend, Start { adapter, validation: true, path: GpuPath::Auto, wgsl: false })
    }

    /// Starts a backend with the options in `start`.
    ///
    /// # Errors
    /// [`RenderError`] if the backend doesn't start.
    pub fn start_as(backend: Backend, start: Start<'_>) -> Result<Self, RenderError> {
        let adapter = start.adapter.map(str::to_owned);
        let drawing = match backend {
            Backend::Cpu => Drawing::Cpu(Box::new(surfel_cpu::Renderer::new(Default::default())?)),
            Backend::Wgpu => {
                if start.validation {
                    listen();
                }
                let options = surfel_wgpu::Options::default().with_adapter(adapter).with_validation(start.validation);
                let options = options.with_path(start.path).with_wgsl(start.wgsl);
                Drawing::Wgpu(Box::new(surfel_wgpu::Renderer::new(options)?))
            }
            Backend::Ash => {
                let options = surfel_ash::Options::default().with_adapter(adapter).with_path(start.path);
                if start.validation {
                    // With this option, a message of the validation layer is an error of the call.
                    let (renderer, note) = start_ash(options)?;
                    return Ok(Self { drawing: Drawing::Ash(Box::new(renderer)), note });
                }
                Drawing::Ash(Box::new(surfel_ash::Renderer::new(options.with_validation(false))?))
            }
        };
        let is_unchecked = !start.validation && backend != Backend::Cpu;
        Ok(Self { drawing, note: is_unchecked.then(|| "not validated".to_owned()) })
    }

    /// True if the backend draws through a graphics API whose device computes on the CPU; false for [`Backend::Cpu`].
    pub fn is_software(&self) -> bool {
        match &self.drawing {
            Drawing::Cpu(_) => false,
            Drawing::Wgpu(renderer) => renderer.is_software(),
            Drawing::Ash(renderer) => renderer.is_software(),
        }
    }

    /// Draws a case repeatedly.
    ///
    /// # Errors
    /// The backend's [`RenderError`].
    pub fn repeat(&mut self, case: &Case, times: usize) -> Result<Repeated, RenderError> {
        match &mut self.drawing {
            Drawing::Cpu(renderer) => repeat(renderer.as_mut(), case, times),
            Drawing::Wgpu(renderer) => repeat(renderer.as_mut(), case, times),
            Drawing::Ash(renderer) => repeat(renderer.as_mut(), case, times),
        }
    }

    /// Returns the backend and adapter of the session.
    pub fn info(&self) -> &RendererInfo {
        match &self.drawing {
            Drawing::Cpu(renderer) => renderer.info(),
            Drawing::Wgpu(renderer) => renderer.info(),
            Drawing::Ash(renderer) => renderer.info(),
        }
    }

    /// Draws a case with the backend and compares the result. A message of a validation layer is a failure.
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

/// Compares a backend with the reference. If the backend uses an adapter, the first one whose name contains `adapter`
/// is selected.
///
/// # Errors
/// [`RenderError`] if the backend doesn't start.
pub fn run(backend: Backend, adapter: Option<&str>, truths: &[Truth], extent: Extent) -> Result<Run, RenderError> {
    run_reporting(
        backend,
        Start { adapter, validation: true, path: GpuPath::Auto, wgsl: false },
        truths,
        extent,
        |_, _, _, _| (),
    )
}

/// Compares a backend with the reference like [`run`]. Passes the report and drawing time of each scene to `report` as
/// soon as the scene is compared.
///
/// # Errors
/// [`RenderError`] if the backend doesn't start.
pub fn run_reporting(
    backend: Backend,
    start: Start<'_>,
    truths: &[Truth],
    extent: Extent,
    mut report: impl FnMut(&mut Session, &Truth, &Report, Duration),
) -> Result<Run, RenderError> {
    let mut session = Session::start_as(backend, start)?;
    let mut checked = Vec::with_capacity(truths.len());
    for truth in truths {
        let begin = Instant::now();
        let one = session.check(truth);
        let time = begin.elapsed();
        // Expectations for a scene don't depend on other scenes.
        let mut known = vec![Checked { report: one.report.clone(), got: None }];
        expect(session.info(), Extent::SomeScenes, &mut known);
        report(&mut session, truth, &known[0].report, time);
        checked.push(one);
    }
    expect(session.info(), extent, &mut checked);
    Ok(Run { info: session.info().clone(), note: session.note, checked })
}

/// Starts the Vulkan backend with validation, whose messages become errors of the calls. If only validation can't be
/// started, starts the backend without it, and also returns a note.
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

/// True if the environment variable `SURFEL_REQUIRE`, a comma-separated list, contains `what`. Tests that need `what`
/// may then not be skipped.
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
        // Validation layers from before 2023 don't recognise WGSL, the source language in naga's debug information. The
        // objects of a message follow the message in a log record of their own.
        let is_known = text.contains("Invalid source language operand: 10") || text.trim().starts_with("objects:");
        if self.enabled(record.metadata()) && !is_known {
            let message = format!("{} {}", record.target(), record.args());
            MESSAGES.lock().unwrap_or_else(PoisonError::into_inner).push(message);
        }
    }
    fn flush(&self) {}
}

/// Starts recording warnings and errors of wgpu and of the layers below it, unless the process already has a logger.
pub fn listen() {
    // The logger may be installed already.
    if log::set_logger(&Listener).is_ok() {
        log::set_max_level(log::LevelFilter::Warn);
    }
}

/// Removes and returns the messages recorded since [`listen`] or the last call.
pub fn take_messages() -> Vec<String> {
    std::mem::take(&mut *MESSAGES.lock().unwrap_or_else(PoisonError::into_inner))
}
