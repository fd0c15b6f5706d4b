//! GPU backends, if there is an adapter; otherwise a printed note. Tests share renderers, one after another.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, Once, OnceLock, PoisonError};
use surfel_conformance::backends::{is_required, listen, start_ash, take_messages};
use surfel_conformance::expectations::Extent;
use surfel_conformance::harness::{Checked, Truth, check_all};
use surfel_gpu::GpuPath;
use surfel_model::{Scene, Settings, Storage};
use surfel_render::{Frame, Planes, RenderError, Renderer, RendererInfo, Stats, UploadProgress, View};

/// Idle renderers with their options. They outlive a test, since building pipelines takes longer than most tests draw.
type Pool<R, O> = Mutex<Vec<(O, R)>>;

/// Renderer that returns to its pool when it is dropped. If a test panics, its renderer is dropped for good.
pub(crate) struct Pooled<R: 'static, O: 'static> {
    renderer: Option<(O, R)>,
    pool: &'static Pool<R, O>,
}

pub(crate) type Ash = Pooled<surfel_ash::Renderer, surfel_ash::Options>;
pub(crate) type Wgpu = Pooled<surfel_wgpu::Renderer, surfel_wgpu::Options>;

impl<R, O: PartialEq> Pooled<R, O> {
    /// Returns an idle renderer with these options, or starts one.
    fn new(pool: &'static Pool<R, O>, options: O, start: impl FnOnce(&O) -> Option<R>) -> Option<Self> {
        let idle = {
            let mut pool = pool.lock().unwrap_or_else(PoisonError::into_inner);
            let found = pool.iter().position(|(other, _)| *other == options);
            found.map(|i| pool.swap_remove(i))
        };
        let renderer = match idle {
            Some(renderer) => renderer,
            None => {
                let renderer = start(&options)?;
                (options, renderer)
            }
        };
        Some(Self { renderer: Some(renderer), pool })
    }
}

impl<R, O> Deref for Pooled<R, O> {
    type Target = R;

    fn deref(&self) -> &R {
        &self.renderer.as_ref().expect("it is taken by drop alone").1
    }
}

impl<R, O> DerefMut for Pooled<R, O> {
    fn deref_mut(&mut self) -> &mut R {
        &mut self.renderer.as_mut().expect("it is taken by drop alone").1
    }
}

impl<R, O> Drop for Pooled<R, O> {
    fn drop(&mut self) {
        if let (Some(renderer), false) = (self.renderer.take(), std::thread::panicking()) {
            self.pool.lock().unwrap_or_else(PoisonError::into_inner).push(renderer);
        }
    }
}

impl<R: Renderer, O> Renderer for Pooled<R, O> {
    type Scene = R::Scene;

    fn info(&self) -> &RendererInfo {
        (**self).info()
    }

    fn upload(&mut self, scene: &Scene) -> Result<R::Scene, RenderError> {
        (**self).upload(scene)
    }

    fn upload_reporting(
        &mut self,
        scene: &Scene,
        progress: &mut dyn FnMut(UploadProgress),
    ) -> Result<R::Scene, RenderError> {
        (**self).upload_reporting(scene, progress)
    }

    fn update(&mut self, resident: &mut R::Scene, scene: &Scene) -> Result<bool, RenderError> {
        (**self).update(resident, scene)
    }

    fn render_into(
        &mut self,
        scene: &R::Scene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        (**self).render_into(scene, view, settings, planes, frame)
    }
}

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

/// Returns the Vulkan backend, validated if the validation layer is installed: its messages are errors of the calls.
pub(crate) fn ash() -> Option<Ash> {
    ash_as(surfel_ash::Options::default())
}

/// Returns the validated Vulkan backend with limits and a kind of storage.
pub(crate) fn ash_with(limits: surfel_ash::Limits, storage: Storage) -> Option<Ash> {
    ash_as(surfel_ash::Options::default().with_limits(limits).with_storage(storage))
}

/// Returns the validated Vulkan backend on one path.
pub(crate) fn ash_by(path: GpuPath) -> Option<Ash> {
    ash_as(surfel_ash::Options::default().with_path(path))
}

fn ash_as(options: surfel_ash::Options) -> Option<Ash> {
    static POOL: Pool<surfel_ash::Renderer, surfel_ash::Options> = Mutex::new(Vec::new());
    static SAID: Once = Once::new();
    Pooled::new(&POOL, options, |options| {
        let (renderer, note) = started("ash", start_ash(options.clone()))?;
        if let Some(note) = note {
            SAID.call_once(|| println!("note: {note}"));
        }
        Some(renderer)
    })
}

/// Returns the wgpu backend, validated if the validation layer is installed.
pub(crate) fn wgpu() -> Option<Wgpu> {
    wgpu_as(surfel_wgpu::Options::default())
}

/// Returns the validated wgpu backend with limits and a kind of storage.
pub(crate) fn wgpu_with(limits: surfel_wgpu::Limits, storage: Storage) -> Option<Wgpu> {
    wgpu_as(surfel_wgpu::Options::default().with_limits(limits).with_storage(storage))
}

/// Returns the validated wgpu backend on one path.
pub(crate) fn wgpu_by(path: GpuPath) -> Option<Wgpu> {
    wgpu_as(surfel_wgpu::Options::default().with_path(path))
}

/// Returns the validated wgpu backend that translates its shaders from WGSL.
pub(crate) fn wgpu_by_wgsl() -> Option<Wgpu> {
    wgpu_as(surfel_wgpu::Options::default().with_wgsl(true))
}

fn wgpu_as(options: surfel_wgpu::Options) -> Option<Wgpu> {
    static POOL: Pool<surfel_wgpu::Renderer, surfel_wgpu::Options> = Mutex::new(Vec::new());
    listen();
    Pooled::new(&POOL, options.with_validation(true), |options| {
        started("wgpu", surfel_wgpu::Renderer::new(options.clone()))
    })
}

/// Starts a validated wgpu backend outside of the pool. Dropping it destroys its device.
pub(crate) fn unpooled_wgpu() -> Option<surfel_wgpu::Renderer> {
    unpooled_wgpu_by(GpuPath::Auto)
}

/// Starts a validated wgpu backend on one path outside of the pool.
pub(crate) fn unpooled_wgpu_by(path: GpuPath) -> Option<surfel_wgpu::Renderer> {
    listen();
    let options = surfel_wgpu::Options::default().with_path(path).with_validation(true);
    started("wgpu", surfel_wgpu::Renderer::new(options))
}

/// Starts the Vulkan backend on one path outside of the pool, validated if the validation layer is installed.
pub(crate) fn unpooled_ash_by(path: GpuPath) -> Option<surfel_ash::Renderer> {
    started("ash", start_ash(surfel_ash::Options::default().with_path(path))).map(|(renderer, _)| renderer)
}

/// Returns the backend's images of every scene with their reports, drawn once per process for each backend name.
pub(crate) fn every_scene(renderer: &mut impl Renderer) -> &'static [Checked] {
    static ASH: OnceLock<Vec<Checked>> = OnceLock::new();
    static WGPU: OnceLock<Vec<Checked>> = OnceLock::new();
    let drawn = if renderer.info().backend == "ash" { &ASH } else { &WGPU };
    drawn.get_or_init(|| check_all(renderer, Truth::of_every_scene().unwrap(), Extent::EveryScene))
}
