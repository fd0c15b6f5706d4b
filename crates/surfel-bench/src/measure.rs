//! Measurement of frames: draws all scenes in alternation, several times.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Instant;

use surfel_backend::{Backend, BackendOptions, BackendScene};
use surfel_cpu::{SimdLevel, Storage};
use surfel_model::Settings;
use surfel_render::{Frame, Planes, Renderer, View};

use crate::machine::{Machine, busy_ms};
use crate::report::{BackendFacts, FillRate, Report, Row, Samples, Subject};
use crate::scenes::{Case, Loaded, Source};
use crate::{Arguments, Failure, Simd};

/// Default number of frames of each scene and thread count.
const RUNS: usize = 11;
/// Default number of frames of each scene and thread count with `--quick`.
const QUICK_RUNS: usize = 5;

/// Parameters of a measurement.
pub(crate) struct Plan {
    backend: crate::Backend,
    adapter: Option<String>,
    simd: SimdLevel,
    quantised: bool,
    threads: Vec<usize>,
    runs: usize,
    models: PathBuf,
    images: Option<PathBuf>,
}

impl Plan {
    pub(crate) fn new(arguments: &Arguments) -> Self {
        let on_cpu = is_on_cpu(arguments.backend);
        let runs = if arguments.quick { QUICK_RUNS } else { RUNS };
        Self {
            backend: arguments.backend,
            adapter: arguments.adapter.clone(),
            simd: match arguments.simd {
                Simd::Best => SimdLevel::Best,
                Simd::Avx2 => SimdLevel::Avx2,
            },
            quantised: arguments.storage == "16",
            // The number of threads of a GPU can't be set.
            threads: if on_cpu { arguments.threads.clone() } else { vec![0] },
            runs: arguments.runs.unwrap_or(runs).max(1),
            models: arguments.models.clone(),
            images: arguments.images.clone(),
        }
    }

    fn start(&self, threads: usize) -> Result<Backend, Failure> {
        if self.backend == crate::Backend::Cpu {
            let storage = if self.quantised { Storage::Quantised } else { Storage::F32 };
            let options = surfel_cpu::Options::default();
            let options = options.with_threads(threads).with_simd(self.simd).with_storage(storage);
            return Ok(Backend::Cpu(surfel_cpu::Renderer::new(options)?));
        }
        let options = BackendOptions::default().with_threads(threads).with_quantised(self.quantised);
        let options = options.with_adapter(self.adapter.clone());
        Ok(Backend::by_name(self.backend.name(), &options)?)
    }
}

/// True for backends whose number of threads this program sets. GPU backends on software Vulkan don't count, because
/// their threads can't be set.
fn is_on_cpu(backend: crate::Backend) -> bool {
    matches!(backend, crate::Backend::Cpu | crate::Backend::Reference)
}

/// Scene that is uploaded and ready to be drawn.
struct Ready {
    /// Index of the scene's source among the uploaded ones.
    upload: usize,
    view: View,
    settings: Settings,
    /// Measurements of the scene, one entry per number of threads.
    samples: Vec<Samples>,
}

/// Draws all scenes with every number of threads of the plan, and returns the report of their times.
pub(crate) fn all(plan: &Plan, cases: &[Case]) -> Result<Report, Failure> {
    let machine = Machine::this();
    let mut backends = plan.threads.iter().map(|&n| plan.start(n)).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = backends.first_mut() else {
        return Err("no thread count is given, expected at least one".into());
    };
    let facts = BackendFacts {
        name: first.info().backend.to_owned(),
        adapter: first.info().adapter.clone(),
        driver: first.info().driver.clone(),
        is_software: first.is_software(),
    };
    let fill_rates = fill_rates(first, FILL_RATE_SIDE_PX)?;
    let (uploads, mut ready) = prepare(plan, cases, first)?;
    // Each pixel format has its own frame, so that no case pays for planes that another case has left in the frame.
    let mut frames = [Frame::default(), Frame::default()];
    let counted = Planes::COLOR.with_weight(true).with_fragments(true);
    // The first round warms up pipelines, memory pages and clock rates. It also counts: weights show which pixels are
    // covered, and some backends count fragments only on request.
    for round in 0..=plan.runs {
        for (case, ready) in cases.iter().zip(&mut ready) {
            if std::io::stderr().is_terminal() {
                eprint!("\rround {round} of {}: {:16}\r", plan.runs, case.name);
            }
            for (i, backend) in backends.iter_mut().enumerate() {
                let scene = &uploads[ready.upload];
                let planes = if round == 0 { counted } else { case.planes };
                let frame = &mut frames[usize::from(planes.rgba8)];
                let (start, busy) = (Instant::now(), busy_ms());
                let stats = backend.render_into(scene, &ready.view, &ready.settings, planes, frame)?;
                let ms = start.elapsed().as_secs_f64() * 1e3;
                let busy = busy_ms().zip(busy).map(|(end, start)| end - start);
                let samples = &mut ready.samples[i];
                if round > 0 {
                    samples.frames_ms.push(ms);
                    samples.busy_ms.extend(busy.filter(|_| is_on_cpu(plan.backend)));
                    samples.stats.push(stats);
                    continue;
                }
                samples.covered_px = frame.weight().iter().filter(|&&weight| weight > 0.0).count() as u64;
                samples.fragments = stats.fragments;
                if let Some(folder) = plan.images.as_ref().filter(|_| i == 0) {
                    std::fs::create_dir_all(folder)?;
                    let path = folder.join(format!("{}.png", case.name));
                    surfel_io::save_png(&path, true, &frame.planes(), &Default::default())?;
                }
            }
        }
    }
    let mut rows = Vec::new();
    for (case, ready) in cases.iter().zip(ready) {
        for (backend, samples) in backends.iter().zip(ready.samples) {
            let subject = Subject {
                scene: case.name.to_owned(),
                about: case.about.to_owned(),
                shader: format!("{:?}", case.shader).to_lowercase(),
                threads: backend.info().threads,
                size: ready.view.size,
            };
            rows.push(Row::new(subject, samples));
        }
    }
    Ok(Report::new(machine, facts, fill_rates, rows))
}

/// Side of the targets with which fill rates are measured, in pixels.
const FILL_RATE_SIDE_PX: u32 = 1024;

/// Measures the GPU's fill rates in square targets of side `side_px`, in pixels. Returns an empty list for backends
/// that don't use a GPU.
#[cfg_attr(
    not(any(feature = "wgpu", feature = "ash")),
    allow(clippy::unnecessary_wraps, unused_variables, reason = "without GPUs")
)]
pub(crate) fn fill_rates(backend: &mut Backend, side_px: u32) -> Result<Vec<FillRate>, Failure> {
    #[cfg(any(feature = "wgpu", feature = "ash"))]
    macro_rules! measured {
        ($renderer:expr) => {
            $renderer
                .fill_rates(side_px)?
                .into_iter()
                .map(|rate| FillRate { name: rate.probe.name().to_owned(), fragments_per_s: rate.fragments_per_s })
                .collect()
        };
    }
    Ok(match backend {
        #[cfg(feature = "wgpu")]
        Backend::Wgpu(renderer) => measured!(renderer),
        #[cfg(feature = "ash")]
        Backend::Ash(renderer) => measured!(renderer),
        _ => Vec::new(),
    })
}

/// Loads and uploads every source once. Backends of one kind share the uploads.
fn prepare(plan: &Plan, cases: &[Case], backend: &mut Backend) -> Result<(Vec<BackendScene>, Vec<Ready>), Failure> {
    let mut sources: Vec<Source> = Vec::new();
    for case in cases {
        if !sources.contains(&case.source) {
            sources.push(case.source);
        }
    }
    let mut uploads = Vec::new();
    let mut ready: Vec<Option<Ready>> = cases.iter().map(|_| None).collect();
    for source in sources {
        // The loaded scene is dropped right after its upload.
        let loaded: Loaded = source.load(&plan.models)?;
        for (case, ready) in cases.iter().zip(&mut ready).filter(|(case, _)| case.source == source) {
            *ready = Some(Ready {
                upload: uploads.len(),
                view: View::new(&case.camera(&loaded))?,
                settings: case.settings(&loaded),
                samples: vec![Samples::default(); plan.threads.len()],
            });
        }
        uploads.push(backend.upload(&loaded.scene)?);
    }
    Ok((uploads, ready.into_iter().flatten().collect()))
}
