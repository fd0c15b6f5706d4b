//! Interface of all backends.

use crate::{Frame, Planes, RenderError, Stats, View};
use surfel_model::{Camera, Scene, Settings};

macro_rules! features {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Feature that only some backends support. A plan rejects scenes and settings that need a feature the backend
        /// lacks.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum Feature {
            $($(#[$doc])* $name,)*
        }

        impl Feature {
            /// All features, in the order of declaration.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];
        }
    };
}

features! {
    /// Edge antialiasing by coverage (rendering model §5).
    EdgeAntialiasing,
    /// Edge antialiasing by samples (rendering model §5).
    EdgeSamples,
    /// Clips, which cut splats along curves and lines (rendering model §7).
    Clips,
    /// Polygon meshes among splats (rendering model §6).
    Meshes,
    /// Transparency by depth peeling: layers drawn front to back (rendering model §8).
    Peel,
    /// Transparency by an A-buffer, which stores all layers of a pixel (rendering model §8).
    ABuffer,
    /// Shadow maps (rendering model §5).
    Shadows,
    /// The shader `toon`: light in steps, and outlines (rendering model §5).
    Toon,
    /// The shader `matcap`: colours from the image of a lit sphere (rendering model §5).
    Matcap,
    /// The shader `edl`: eye-dome lighting, by depth alone (rendering model §5).
    EyeDome,
    /// Trained Gaussians, drawn one over another (docs/gaussians.md).
    Gaussians,
    /// Balls and dots: spheres, and disks parallel to the image, as splats (rendering model §11).
    Balls,
    /// Light of a sky that isn't stored in the splats (rendering model §12); no backend supports it.
    Sky,
    /// The plane `margin`, which marks pixels that other backends may draw differently.
    Margin,
}

/// Features of a backend, by which a plan rejects what the backend can't draw: all [`Feature`]s except those it lacks.
/// Every backend must support a new feature unless it declares that it lacks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Name of the backend in messages and on the command line.
    pub backend: &'static str,
    /// Features that the backend doesn't support.
    pub lacks: &'static [Feature],
}

impl Capabilities {
    /// Returns the capabilities of a backend that supports every feature except [`Feature::Sky`], which no backend
    /// supports.
    pub const fn everything(backend: &'static str) -> Self {
        Self { backend, lacks: &[Feature::Sky] }
    }

    /// True if the backend supports a feature.
    pub fn has(&self, feature: Feature) -> bool {
        !self.lacks.contains(&feature)
    }
}

/// Progress of an upload to a device, in bytes of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UploadProgress {
    /// Number of bytes of splats that are already on the device.
    pub done_bytes: u64,
    /// Number of bytes of splats to upload in total.
    pub total_bytes: u64,
}

/// Description of a rendering backend and its device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RendererInfo {
    /// Name of the backend: `reference`, `cpu`, `wgpu`, `ash`.
    pub backend: &'static str,
    /// Name of the device, as its driver reports it.
    pub adapter: String,
    /// Driver name and version.
    pub driver: String,
    /// Number of threads of a CPU backend; 0 for others.
    pub threads: usize,
    /// Features that the backend supports.
    pub capabilities: Capabilities,
}

/// Defines `upload` and `render` of [`Renderer`] as inherent methods of a backend, so that callers of these two need
/// not import the trait. Only for this workspace's crates.
#[doc(hidden)]
#[macro_export]
macro_rules! renderer_methods {
    ($scene:ty) => {
        /// Uploads a scene, which stays resident in the backend's memory.
        ///
        /// # Errors
        /// Errors of [`Renderer::upload`]($crate::Renderer::upload).
        pub fn upload(&mut self, scene: &surfel_model::Scene) -> Result<$scene, $crate::RenderError> {
            $crate::Renderer::upload(self, scene)
        }

        /// Renders the colour plane of a camera's whole image. [`Renderer::render_into`]($crate::Renderer::render_into)
        /// also renders other planes, regions and statistics, and reuses a frame's memory.
        ///
        /// # Errors
        /// Errors of [`Renderer::render`]($crate::Renderer::render).
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

/// Interface of a rendering backend, which uploads scenes and renders frames.
pub trait Renderer {
    /// Scene that is resident in the backend's memory, as `upload` returns it.
    type Scene;

    /// Returns a description of the backend.
    fn info(&self) -> &RendererInfo;

    /// Uploads a scene, which stays resident in the backend's memory.
    ///
    /// # Errors
    /// [`RenderError::Model`] if the scene is invalid, [`RenderError::SceneTooLarge`] if it exceeds the device's
    /// memory, [`RenderError::Backend`] if the device fails.
    fn upload(&mut self, scene: &Scene) -> Result<Self::Scene, RenderError>;

    /// Uploads like [`Renderer::upload`]. Backends that copy to a device report their progress from time to time.
    ///
    /// # Errors
    /// Same as [`Renderer::upload`].
    fn upload_reporting(
        &mut self,
        scene: &Scene,
        _progress: &mut dyn FnMut(UploadProgress),
    ) -> Result<Self::Scene, RenderError> {
        self.upload(scene)
    }

    /// Replaces the matrices, materials, lights, ambient light, background and matcap of a resident scene by those of
    /// `scene`, without copying splats. Returns false and changes nothing in three cases: `scene` has other objects,
    /// its geometry isn't shared with the resident scene by `Arc`, or this backend can't update. `scene` must then be
    /// uploaded.
    ///
    /// # Errors
    /// [`RenderError::Model`] if the scene is invalid.
    fn update(&mut self, _resident: &mut Self::Scene, _scene: &Scene) -> Result<bool, RenderError> {
        Ok(false)
    }

    /// Renders the colour plane of a camera's whole image. [`Renderer::render_into`] also renders other planes, regions
    /// and statistics, and reuses a frame's memory.
    ///
    /// # Errors
    /// [`RenderError::Model`] if the camera is out of range; otherwise as [`Renderer::render_into`].
    fn render(&mut self, scene: &Self::Scene, camera: &Camera, settings: &Settings) -> Result<Frame, RenderError> {
        let mut frame = Frame::default();
        self.render_into(scene, &View::new(camera)?, settings, Planes::COLOR, &mut frame)?;
        Ok(frame)
    }

    /// Renders `planes` of the view's region into `frame`, whose memory is reused.
    ///
    /// # Errors
    /// - [`RenderError::Model`] for settings out of range;
    /// - [`RenderError::Unsupported`] for a feature that this backend doesn't support;
    /// - [`RenderError::NoInteriorWeight`] and [`RenderError::NoRows`] for clouds without the data that the settings or
    ///   planes need;
    /// - [`RenderError::Backend`] if the device fails.
    fn render_into(
        &mut self,
        scene: &Self::Scene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError>;
}
