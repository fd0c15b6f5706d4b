//! What every backend offers.

use crate::{Frame, Planes, RenderError, Stats, View};
use surfel_model::{Camera, Scene, Settings};

macro_rules! features {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// What only some backends draw.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum Feature {
            $($(#[$doc])* $name,)*
        }

        impl Feature {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];
        }
    };
}

features! {
    /// Edge antialiasing (§5).
    EdgeAntialiasing,
    /// Edges by samples (§5).
    EdgeSamples,
    /// Clip curves and lines (§7).
    Clips,
    /// Polygon meshes among splats (§6).
    Meshes,
    /// Depth-peeled transparency (§8).
    Peel,
    /// A-buffer transparency (§8).
    ABuffer,
    /// Shadow maps (§5).
    Shadows,
    /// The toon shader (§5).
    Toon,
    /// The shader `matcap` (§5).
    Matcap,
    /// Eye-dome lighting, the shader `edl` (§5).
    EyeDome,
    /// Trained Gaussians, drawn one over another (docs/gaussians.md).
    Gaussians,
    /// The decision margin plane.
    Margin,
}

/// What a backend can do, as far as planning depends on it: all [`Feature`]s but some. A new feature is expected of
/// every backend until the backend says that it lacks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Name used in messages and on the command line.
    pub backend: &'static str,
    /// What it doesn't draw.
    pub lacks: &'static [Feature],
}

impl Capabilities {
    /// Those of a backend that draws everything.
    pub const fn everything(backend: &'static str) -> Self {
        Self { backend, lacks: &[] }
    }

    /// True if the backend draws this.
    pub fn has(&self, feature: Feature) -> bool {
        !self.lacks.contains(&feature)
    }
}

/// How far an upload has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UploadProgress {
    /// Bytes of splats that the device has.
    pub done_bytes: u64,
    /// Bytes of splats that it will have.
    pub total_bytes: u64,
}

/// Who draws.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RendererInfo {
    /// Backend name: `reference`, `cpu`, `wgpu`, `ash`.
    pub backend: &'static str,
    /// The device, in its driver's words.
    pub adapter: String,
    /// Driver name and version.
    pub driver: String,
    /// Threads that a CPU backend uses; 0 for others.
    pub threads: usize,
    /// What it can do.
    pub capabilities: Capabilities,
}

/// Writes `upload` and `render` of [`Renderer`] as methods of a backend's own, so that callers of these two need not
/// import the trait. For this workspace's crates.
#[doc(hidden)]
#[macro_export]
macro_rules! renderer_methods {
    ($scene:ty) => {
        /// Makes a scene resident.
        ///
        /// # Errors
        /// [`RenderError`]($crate::RenderError) if the scene is invalid or can't be drawn by this backend.
        pub fn upload(&mut self, scene: &surfel_model::Scene) -> Result<$scene, $crate::RenderError> {
            $crate::Renderer::upload(self, scene)
        }

        /// Renders the whole image of a camera: its colour plane.
        /// [`Renderer::render_into`]($crate::Renderer::render_into) also gives other planes, regions and statistics,
        /// and reuses a frame's memory.
        ///
        /// # Errors
        /// [`RenderError`]($crate::RenderError) if the camera or settings are out of range or ask for what this backend
        /// doesn't draw.
        pub fn render(
            &mut self,
            scene: &$scene,
            camera: &surfel_model::Camera,
            settings: &surfel_model::Settings,
        ) -> Result<$crate::Frame, $crate::RenderError> {
            $crate::Renderer::render(self, scene, camera, settings)
        }
    };
}

/// The methods that every backend's `Renderer` has.
pub trait Renderer {
    /// Resident copy of a scene.
    type Scene;

    /// Who draws.
    fn info(&self) -> &RendererInfo;

    /// Makes a scene resident.
    ///
    /// # Errors
    /// [`RenderError`] if the scene is invalid or can't be drawn by this backend.
    fn upload(&mut self, scene: &Scene) -> Result<Self::Scene, RenderError>;

    /// As [`Renderer::upload`], and says from time to time how far it has come: of backends that copy to a device.
    ///
    /// # Errors
    /// As [`Renderer::upload`].
    fn upload_reporting(
        &mut self,
        scene: &Scene,
        _progress: &mut dyn FnMut(UploadProgress),
    ) -> Result<Self::Scene, RenderError> {
        self.upload(scene)
    }

    /// Renders the whole image of a camera: its colour plane. [`Renderer::render_into`] also gives other planes,
    /// regions and statistics, and reuses a frame's memory.
    ///
    /// # Errors
    /// [`RenderError`] if the camera or settings are out of range or ask for what this backend doesn't draw.
    fn render(&mut self, scene: &Self::Scene, camera: &Camera, settings: &Settings) -> Result<Frame, RenderError> {
        let mut frame = Frame::default();
        self.render_into(scene, &View::new(camera)?, settings, Planes::COLOR, &mut frame)?;
        Ok(frame)
    }

    /// Renders `planes` of the view's region into `frame`, whose memory is used again.
    ///
    /// # Errors
    /// [`RenderError`] if settings are out of range or ask for what this backend doesn't draw.
    fn render_into(
        &mut self,
        scene: &Self::Scene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError>;
}
