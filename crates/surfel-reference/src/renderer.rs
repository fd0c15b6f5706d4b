//! Renderer of the backend `reference`, which uploads scenes and draws frames on its own threads.

use crate::scene::ResidentScene;
use crate::{frame, gaussians};
use surfel_model::{EdgeAa, MAX_LOD_ERROR_PX, Scene, Settings};
use surfel_render::{Capabilities, Frame, Identity, Pass, Planes, RenderError, RendererInfo, Stats, View, plan};

const CAPABILITIES: Capabilities = Capabilities::everything("reference");

/// Options of a [`Renderer`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Options {
    /// Number of threads; 0 uses the environment variable `RAYON_NUM_THREADS`, or as many threads as there are cores.
    pub threads: usize,
}

impl Options {
    surfel_model::setters! {
        with_threads threads: usize,
    }
}

/// Stack size of each rendering thread, in bytes. Unoptimised code needs several times the default of two megabytes.
const STACK_BYTES: usize = 8 << 20;

/// The renderer of the f64 reference backend.
pub struct Renderer {
    info: RendererInfo,
    pool: rayon::ThreadPool,
}

impl Renderer {
    surfel_render::renderer_methods!(ResidentScene);

    /// Creates a renderer with its own threads.
    ///
    /// # Errors
    /// [`RenderError::Threads`] if threads can't be started.
    pub fn new(options: Options) -> Result<Self, RenderError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(options.threads)
            .stack_size(STACK_BYTES)
            .build()
            .map_err(|e| RenderError::Threads { backend: "reference", message: e.to_string() })?;
        // Waits until every thread has run once, so that callers can measure the memory that threads occupy from their
        // start.
        pool.broadcast(|_| ());
        let info = RendererInfo {
            backend: "reference",
            adapter: "f64, brute force".into(),
            driver: format!("surfel {}", env!("CARGO_PKG_VERSION")),
            threads: pool.current_num_threads(),
            capabilities: CAPABILITIES,
        };
        Ok(Self { info, pool })
    }

    /// Renders a supersampled image: averages `samples`×`samples` samples per pixel, without a pre-filter. The result
    /// is the ground truth that filters approximate.
    ///
    /// # Errors
    /// Errors of [`surfel_render::Renderer::render_into`]. Also [`RenderError::Model`] for more samples than an image
    /// may have ([`surfel_model::MAX_IMAGE_PIXELS`]), and [`RenderError::Unsupported`] for the planes `index`, `label`,
    /// `position`, `alpha`, `median_depth` and `distortion`, which aren't averaged.
    pub fn render_supersampled(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        samples: u32,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let fine_view = view.supersampled(samples)?;
        // Nodes of an octree are selected for the image's pixels, not for the samples.
        let lod_error_px = (settings.lod_error_px * f64::from(samples)).min(MAX_LOD_ERROR_PX);
        let settings = settings.with_prefilter_radius_px(0.0).with_edge_aa(EdgeAa::Off).with_lod_error_px(lod_error_px);
        let refused = [
            (planes.index || planes.label || planes.position, "a plane of what is nearest (index, label, position)"),
            (
                planes.alpha || planes.median_depth || planes.distortion,
                "a plane of trained Gaussians (alpha, median_depth, distortion)",
            ),
        ];
        if let Some((_, feature)) = refused.into_iter().find(|(is_asked, _)| *is_asked) {
            return Err(RenderError::Unsupported {
                backend: "reference",
                feature,
                found_where: "is asked for of an image averaged from samples".into(),
                advice: "leave out the samples, or those planes: their values aren't averaged",
            });
        }
        // Colours are averaged before they are encoded.
        let of_samples = planes.with_margin(false).with_color(planes.shows_color()).with_rgba8(false);
        let mut fine = Frame::default();
        let stats = surfel_render::Renderer::render_into(self, scene, &fine_view, &settings, of_samples, &mut fine)?;
        crate::supersample::average(&fine, samples, of_samples.with_rgba8(planes.rgba8), frame);
        frame.encode(planes);
        Ok(stats)
    }
}

impl Renderer {
    /// Returns, for tests, all candidates for the nearest splat or polygon in each pixel of the view's region, nearest
    /// first. Their depths are within the fraction `relative` of the minimum. Empty pixels have none.
    ///
    /// # Errors
    /// Errors of [`surfel_render::Renderer::render_into`].
    #[doc(hidden)]
    pub fn nearest_candidates(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        relative: f64,
    ) -> Result<Vec<Vec<Identity>>, RenderError> {
        let plan = plan(&scene.summary, view, settings, Planes::COLOR.with_index(true), &CAPABILITIES)?;
        Ok(self.pool.install(|| frame::candidates(scene, view, &plan, relative)))
    }
}

impl surfel_render::Renderer for Renderer {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        &self.info
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        ResidentScene::of(scene)
    }

    fn render_into(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let plan = plan(&scene.summary, view, settings, planes, &CAPABILITIES)?;
        let draw = if plan.has(Pass::Gaussians) { gaussians::render } else { frame::render };
        let stats = self.pool.install(|| draw(scene, view, &plan, frame, self.info.threads));
        frame.encode(planes);
        Ok(stats)
    }
}
