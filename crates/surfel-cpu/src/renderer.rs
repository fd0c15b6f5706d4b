//! The renderer: uploads scenes and draws frames.

use crate::frame::{self, FrameInputs, FramePools};
use crate::options::Options;
use crate::scene::numbers::SplatNumbers;
use crate::scene::resident::ResidentScene;
use crate::simd::level::Instructions;
use crate::threads::Threads;
use crate::tiles::driver::Tuning;
use surfel_model::{Scene, Settings, Storage};
use surfel_render::clock::Instant;
use surfel_render::{Capabilities, Feature, Frame, Pass, Planes, RenderError, RendererInfo, Stats, View, plan};

/// Capabilities of this backend, by which a plan rejects what the backend can't draw.
pub(crate) const CAPABILITIES: Capabilities = Capabilities { backend: "cpu", lacks: &[Feature::Margin, Feature::Sky] };

/// The CPU backend's renderer. It has its own thread pool and doesn't use the global one, except in WebAssembly, where
/// the caller's thread draws.
pub struct Renderer {
    info: RendererInfo,
    threads: Threads,
    instructions: Instructions,
    storage: Storage,
    tuning: Tuning,
    pools: FramePools,
}

impl Renderer {
    surfel_render::renderer_methods!(ResidentScene);

    /// Creates a renderer with these options.
    ///
    /// # Errors
    /// [`RenderError::Threads`] if threads can't be started, [`RenderError::Backend`] if the CPU lacks the
    /// instructions.
    pub fn new(options: Options) -> Result<Self, RenderError> {
        let threads = Threads::start(options.threads)?;
        let instructions = Instructions::new(options.simd).ok_or_else(|| RenderError::Backend {
            backend: "cpu",
            message: "this CPU has no AVX2; use the reference backend, or build with surfel-cpu's feature scalar"
                .into(),
        })?;
        let info = RendererInfo {
            backend: "cpu",
            adapter: instructions.name().into(),
            driver: format!("surfel {}", env!("CARGO_PKG_VERSION")),
            threads: threads.count(),
            capabilities: CAPABILITIES,
        };
        let (tuning, pools) = (Tuning::default(), FramePools::default());
        Ok(Self { info, threads, instructions, storage: options.storage, tuning, pools })
    }

    /// Sets how work is divided, for tests. The default is the fastest.
    #[doc(hidden)]
    pub fn set_tuning(&mut self, tuning: Tuning) {
        self.tuning = tuning;
    }

    /// Frees the buffers that are reused between frames. Call this after an image that is much larger than the next
    /// ones.
    pub fn release_memory(&mut self) {
        self.pools = FramePools::default();
    }
}

impl surfel_render::Renderer for Renderer {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        &self.info
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        scene.validate()?;
        self.threads.install(|| ResidentScene::new(scene, self.storage))
    }

    fn update(&mut self, resident: &mut ResidentScene, scene: &Scene) -> Result<bool, RenderError> {
        scene.validate()?;
        let is_same = resident.geometry.is_of(scene);
        if is_same {
            resident.update(scene);
        }
        Ok(is_same)
    }

    fn render_into(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let start = Instant::now();
        let mut plan = plan(&scene.summary, view, settings, planes, &CAPABILITIES)?;
        // Tiles encode colours as they write them, unless later passes need linear colours.
        plan.planes.color = planes.color || (planes.rgba8 && (plan.reach_px() > 0 || plan.has(Pass::Gaussians)));
        let slots: usize = scene.clouds.iter().map(|cloud| cloud.centers.len()).sum();
        if plan.has(Pass::Nearest) && slots > SplatNumbers::MAX_SLOTS {
            return Err(RenderError::Backend {
                backend: "cpu",
                message: format!("the planes index and label number {} splats at most", SplatNumbers::MAX_SLOTS),
            });
        }
        let mut stats = Stats::default().with_splats(plan.splats).with_threads(self.info.threads);
        stats.bytes_per_splat = scene.bytes() as f64 / (scene.summary.splats + scene.summary.balls).max(1) as f64;
        let (instructions, tuning, pools) = (self.instructions, self.tuning, &self.pools);
        let inputs = FrameInputs { instructions, tuning, pools, scene, view, plan: &plan };
        self.threads.install(|| frame::draw(&inputs, frame, &mut stats));
        match plan.has(Pass::Gaussians) {
            true => frame.encode(planes),
            false => frame.drop_color(planes),
        }
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }
}
