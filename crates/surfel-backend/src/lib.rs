//! All rendering backends in one enum, and the selection of the fastest one that works on this machine.
//!
//! Main types, in reading order:
//!
//! 1. [`Backend`]: a backend that has been started. [`Backend::auto`] starts the fastest one, [`Backend::by_name`] one
//!    by its name;
//! 2. [`BackendScene`]: a scene in a backend's memory, with the stored light of its sky;
//! 3. [`BackendOptions`]: threads, adapter, storage and GPU path;
//! 4. [`backends`]: returns all backends, with their availability on this machine.
//!
//! ```
//! use surfel_backend::Backend;
//! use surfel_model::{Camera, Scene, Settings, SplatCloud};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let disk = SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?;
//! let mut backend = Backend::auto()?;
//! let resident = backend.upload(&Scene::from(disk))?;
//! let camera = Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [64, 64]);
//! let frame = backend.render(&resident, &camera, &Settings::default())?;
//! assert_eq!(frame.color()[32 * 64 + 32][3], 1.0); // alpha at the centre of the disk
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate is above the backends and `surfel-light`, and below all packages that draw. It opens no file.
//!
//! # Features
//! Each of `cpu`, `reference`, `wgpu` and `ash` enables the backend of this name. At least one is required.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

use glam::DAffine3;
#[cfg(feature = "ash")]
pub use surfel_ash::GpuPath;
use surfel_light::{LightError, LightOptions, LitGround, LitScene, light_scene};
#[cfg(any(feature = "cpu", feature = "wgpu", feature = "ash"))]
use surfel_model::Storage;
use surfel_model::{Ground, Material, Object, Scene, Settings, Shader, Sky};
pub use surfel_render::BackendError;
use surfel_render::{
    Capabilities, Frame, Planes, RenderError, Renderer, RendererInfo, SceneGeometry, SceneSummary, Stats,
    UploadProgress, View, unsupported,
};
#[cfg(all(feature = "wgpu", not(feature = "ash")))]
pub use surfel_wgpu::GpuPath;

#[cfg(not(any(feature = "cpu", feature = "wgpu", feature = "ash", feature = "reference")))]
compile_error!("Surfel draws by a backend: build it with one at least of its features cpu, wgpu, ash and reference");

/// Names of all backends, fastest first, which is the order in which automatic selection tries them. `reference`, the
/// slowest, is last.
const NAMES: [&str; 4] = ["ash", "wgpu", "cpu", "reference"];
/// Names of the backends that are enabled in this build.
const BUILT: &[&str] = &[
    #[cfg(feature = "ash")]
    "ash",
    #[cfg(feature = "wgpu")]
    "wgpu",
    #[cfg(feature = "cpu")]
    "cpu",
    #[cfg(feature = "reference")]
    "reference",
];

/// Returns the name of the Cargo feature of Surfel's programs that enables a backend.
fn feature_of(name: &'static str) -> &'static str {
    match name {
        "ash" | "wgpu" => "gpu",
        other => other,
    }
}

/// Options for starting a backend.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct BackendOptions {
    /// Number of threads of a CPU backend; 0 uses as many as the machine has.
    pub threads: usize,
    /// Part of the name of the adapter to use, in upper or lower case; `None` accepts any adapter. A CPU backend fails
    /// to start unless its adapter name ([`RendererInfo::adapter`]), such as `AVX2`, contains the text.
    pub adapter: Option<String>,
    /// True if splats are stored as 16-bit numbers, relative to the bounds of their chunk (up to 256 neighbouring
    /// splats). This takes half the memory or less, with a measured error (docs/accuracy.md). The reference backend
    /// ignores the option.
    pub quantised: bool,
    /// Way in which the backends wgpu and ash draw: by compute shaders or by raster hardware. CPU backends ignore the
    /// option.
    #[cfg(any(feature = "wgpu", feature = "ash"))]
    pub path: GpuPath,
}

impl BackendOptions {
    /// Sets the part of the adapter's name, in upper or lower case; `None` accepts any adapter.
    #[must_use]
    pub fn with_adapter(mut self, adapter: impl Into<Option<String>>) -> Self {
        self.adapter = adapter.into();
        self
    }

    surfel_model::setters! {
        with_threads threads: usize,
        with_quantised quantised: bool,
    }

    #[cfg(any(feature = "wgpu", feature = "ash"))]
    surfel_model::setters! {
        with_path path: GpuPath,
    }

    /// Returns the storage format of splats.
    #[cfg(any(feature = "cpu", feature = "wgpu", feature = "ash"))]
    fn storage(&self) -> Storage {
        if self.quantised { Storage::Quantised } else { Storage::F32 }
    }
}

/// Backend that has been started.
#[non_exhaustive]
pub enum Backend {
    /// GPU backend through raw Vulkan.
    #[cfg(feature = "ash")]
    Ash(Box<surfel_ash::Renderer>),
    /// GPU backend through wgpu.
    #[cfg(feature = "wgpu")]
    Wgpu(Box<surfel_wgpu::Renderer>),
    /// CPU backend, with SIMD on all threads.
    #[cfg(feature = "cpu")]
    Cpu(surfel_cpu::Renderer),
    /// Reference backend: the rendering model in executable form, exact and slow.
    #[cfg(feature = "reference")]
    Reference(surfel_reference::Renderer),
}

/// Scene resident in a [`Backend`], with the stored light of its sky.
pub struct BackendScene {
    resident: Resident,
    /// Parts of the scene on which the stored light of its sky depends; `None` without a sky. A changed scene with the
    /// same parts reuses the light.
    light: Option<StoredLightKey>,
    /// Ground with its stored light, and the scene's background in linear premultiplied RGBA, which is drawn behind the
    /// ground; `None` without a ground.
    ground: Option<(LitGround, [f32; 4])>,
}

/// Parts of a scene on which the stored light of its sky depends. They are compared to detect whether the light of a
/// changed scene is the same.
#[derive(Clone, Debug)]
struct StoredLightKey {
    geometry: SceneGeometry,
    sky: Option<Sky>,
    ground: Option<Ground>,
    /// Background as the scene states it.
    background: [f64; 4],
    /// Matrix from object to world space, and material, of each object.
    objects: Vec<(DAffine3, Material)>,
}

impl StoredLightKey {
    /// Copies the parts of a scene.
    fn of(scene: &Scene) -> Self {
        let objects = scene.objects.iter().map(|object| (object.world_from_object, object.material)).collect();
        let (sky, ground, background) = (scene.sky.clone(), scene.ground, scene.background);
        Self { geometry: SceneGeometry::of(scene), sky, ground, background, objects }
    }

    /// True if the light of `scene` would be the same as that stored for these parts.
    fn is_of(&self, scene: &Scene) -> bool {
        let of = |object: &Object| (object.world_from_object, object.material);
        self.geometry.is_of(scene)
            && (&self.sky, self.ground, self.background) == (&scene.sky, scene.ground, scene.background)
            && self.objects.iter().copied().eq(scene.objects.iter().map(of))
    }
}

/// Scene in the memory of the backend that draws it, one variant per backend.
enum Resident {
    /// Scene of the ash backend, in the memory of a Vulkan device.
    #[cfg(feature = "ash")]
    Ash(Box<<surfel_ash::Renderer as Renderer>::Scene>),
    /// Scene of the wgpu backend, in the memory of a wgpu device.
    #[cfg(feature = "wgpu")]
    Wgpu(Box<<surfel_wgpu::Renderer as Renderer>::Scene>),
    /// Scene of the CPU backend.
    #[cfg(feature = "cpu")]
    Cpu(<surfel_cpu::Renderer as Renderer>::Scene),
    /// Scene of the reference backend.
    #[cfg(feature = "reference")]
    Reference(<surfel_reference::Renderer as Renderer>::Scene),
}

/// Availability of a backend on this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackendInfo {
    /// Name of the backend.
    pub name: &'static str,
    /// Description of the renderer, or the reason why the backend isn't available on this machine or in this build.
    pub state: Result<RendererInfo, String>,
    /// Cargo feature that would enable the backend; `None` if it is enabled.
    pub missing_feature: Option<&'static str>,
}

/// Returns all backends with their availability on this machine, fastest first. To find out, each backend of this build
/// is started.
pub fn backends() -> Vec<BackendInfo> {
    let info = |name| {
        let (state, missing_feature) = match Backend::by_name(name, &BackendOptions::default()) {
            Ok(backend) => (Ok(backend.info().clone()), None),
            Err(BackendError::NotBuilt { feature, .. }) => {
                let reason = format!("not built into this program (cargo build --release --features {feature})");
                (Err(reason), Some(feature))
            }
            Err(error) => (Err(error.to_string()), None),
        };
        BackendInfo { name, state, missing_feature }
    };
    NAMES.into_iter().map(info).collect()
}

/// Result of choosing a backend automatically: the selected one, and the reasons why faster ones were rejected.
pub struct Chosen {
    /// Selected backend.
    pub backend: Backend,
    /// Reason why each faster backend of this build was rejected, as text that begins with the backend's name.
    pub rejected: Vec<String>,
}

impl Backend {
    surfel_render::renderer_methods!(BackendScene);

    /// Starts the fastest backend that works on this machine, with default options, whatever scene it will draw.
    ///
    /// # Errors
    /// Errors of [`Backend::choose`].
    pub fn auto() -> Result<Self, BackendError> {
        Self::by_name("auto", &BackendOptions::default())
    }

    /// Frees memory that the CPU backend would reuse for later frames; does nothing in other backends. Useful after an
    /// image that is much larger than the next ones.
    pub fn release_memory(&mut self) {
        #[cfg(feature = "cpu")]
        #[allow(irrefutable_let_patterns, reason = "the only backend of the smallest build")]
        if let Self::Cpu(renderer) = self {
            renderer.release_memory();
        }
    }

    /// Starts the fastest backend that works on this machine and supports the scene, settings and planes.
    ///
    /// # Errors
    /// Errors of [`Backend::choose`].
    pub fn auto_for(
        scene: &Scene,
        settings: &Settings,
        planes: Planes,
        options: &BackendOptions,
    ) -> Result<Self, BackendError> {
        Ok(Self::choose(options, refusals(scene, settings, planes))?.backend)
    }

    /// Starts the fastest backend that works on this machine and for which `refuses` returns `None`. `refuses` returns
    /// the reason why a backend can't be used. GPU backends that run in software on the CPU are skipped, unless the
    /// options name an adapter. `reference` is tried last, and without asking `refuses`.
    ///
    /// # Errors
    /// [`BackendError`] of the last backend that was tried, or of the first whose threads can't be started.
    pub fn choose(
        options: &BackendOptions,
        mut refuses: impl FnMut(&Capabilities) -> Option<String>,
    ) -> Result<Chosen, BackendError> {
        let mut rejected = Vec::new();
        for &name in BUILT.iter().filter(|&&name| name != "reference") {
            if !has_device_for(name) {
                rejected.push(format!("{name}: this machine has no GPU"));
                continue;
            }
            // Starting a device takes time, so that known capabilities are checked first.
            if let Some(reason) = capabilities_of(name).and_then(|capabilities| refuses(&capabilities)) {
                rejected.push(format!("{name}: {reason}"));
                continue;
            }
            let reason = match Self::by_name(name, options) {
                // The reference backend would need as many threads, and would draw for hours if they start a moment
                // later.
                Err(error @ BackendError::NoStart { source: RenderError::Threads { .. }, .. }) => return Err(error),
                Err(error) => error.to_string(),
                Ok(backend) => {
                    let info = backend.info();
                    match refuses(&info.capabilities) {
                        Some(reason) => reason,
                        None if backend.is_software() && options.adapter.is_none() => {
                            format!("{} computes on the CPU", info.adapter)
                        }
                        None => return Ok(Chosen { backend, rejected }),
                    }
                }
            };
            rejected.push(format!("{name}: {reason}"));
        }
        Ok(Chosen { backend: Self::by_name("reference", options)?, rejected })
    }

    /// Starts a backend by its name: `cpu`, `wgpu`, `ash` or `reference`, or `auto` for the fastest one that works.
    ///
    /// # Errors
    /// [`BackendError::Unknown`], [`BackendError::NotBuilt`], [`BackendError::NoAdapter`] or [`BackendError::NoStart`].
    pub fn by_name(name: &str, options: &BackendOptions) -> Result<Self, BackendError> {
        match name {
            "auto" => Ok(Self::choose(options, |_| None)?.backend),
            #[cfg(feature = "ash")]
            "ash" => Self::ash(options),
            #[cfg(feature = "wgpu")]
            "wgpu" => Self::wgpu(options),
            #[cfg(feature = "cpu")]
            "cpu" => Self::cpu(options),
            #[cfg(feature = "reference")]
            "reference" => Self::reference(options),
            _ => Err(match NAMES.into_iter().find(|known| *known == name) {
                Some(name) => BackendError::NotBuilt { name, feature: feature_of(name), available: BUILT.join(", ") },
                None => BackendError::Unknown { name: name.to_owned() },
            }),
        }
    }

    /// Starts the ash backend.
    #[cfg(feature = "ash")]
    fn ash(options: &BackendOptions) -> Result<Self, BackendError> {
        let start =
            surfel_ash::Options::default().with_adapter(options.adapter.clone()).with_storage(options.storage());
        let start = surfel_ash::Renderer::new(start.with_path(options.path));
        let renderer = start.map_err(|source| BackendError::NoStart { name: "ash", source })?;
        Ok(Self::Ash(Box::new(renderer)))
    }

    /// Starts the wgpu backend.
    #[cfg(feature = "wgpu")]
    fn wgpu(options: &BackendOptions) -> Result<Self, BackendError> {
        let start =
            surfel_wgpu::Options::default().with_adapter(options.adapter.clone()).with_storage(options.storage());
        let start = surfel_wgpu::Renderer::new(start.with_path(options.path));
        let renderer = start.map_err(|source| BackendError::NoStart { name: "wgpu", source })?;
        Ok(Self::Wgpu(Box::new(renderer)))
    }

    /// Starts the CPU backend.
    #[cfg(feature = "cpu")]
    fn cpu(options: &BackendOptions) -> Result<Self, BackendError> {
        let start = surfel_cpu::Options::default().with_threads(options.threads).with_storage(options.storage());
        let start = surfel_cpu::Renderer::new(start);
        let renderer = start.map_err(|source| BackendError::NoStart { name: "cpu", source })?;
        check_adapter(renderer.info(), options)?;
        Ok(Self::Cpu(renderer))
    }

    /// Starts the reference backend.
    #[cfg(feature = "reference")]
    fn reference(options: &BackendOptions) -> Result<Self, BackendError> {
        let start = surfel_reference::Renderer::new(surfel_reference::Options::default().with_threads(options.threads));
        let renderer = start.map_err(|source| BackendError::NoStart { name: "reference", source })?;
        check_adapter(renderer.info(), options)?;
        Ok(Self::Reference(renderer))
    }

    /// True if the backend is a GPU backend whose adapter is software, such as lavapipe or WARP.
    pub fn is_software(&self) -> bool {
        match self {
            #[cfg(feature = "ash")]
            Self::Ash(renderer) => renderer.is_software(),
            #[cfg(feature = "wgpu")]
            Self::Wgpu(renderer) => renderer.is_software(),
            #[cfg(feature = "cpu")]
            Self::Cpu(_) => false,
            #[cfg(feature = "reference")]
            Self::Reference(_) => false,
        }
    }

    /// True if the backend can render several samples per pixel, which only `reference` can.
    pub fn can_supersample(&self) -> bool {
        self.info().backend == "reference"
    }

    /// Renders an image with `samples`×`samples` unfiltered samples per pixel, and averages them; with `None`, an
    /// ordinary image. The region with all of its samples must be within the limits of an image
    /// ([`surfel_model::MAX_IMAGE_PIXELS`]).
    ///
    /// # Errors
    /// Errors of [`Renderer::render`]; [`RenderError::Unsupported`] if [`Backend::can_supersample`] is false, and for
    /// the planes `index`, `label` and `position`, which have no mean.
    pub fn render_sampled(
        &mut self,
        scene: &BackendScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        samples: Option<u32>,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let Some(samples) = samples else { return self.render_into(scene, view, settings, planes, frame) };
        self.render_supersampled(scene, view, settings, planes, samples, frame)
    }

    /// Renders an image with `samples`×`samples` unfiltered samples per pixel.
    #[cfg_attr(not(feature = "reference"), expect(unused_variables, reason = "no other backend supersamples"))]
    fn render_supersampled(
        &mut self,
        scene: &BackendScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        samples: u32,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let (settings, drawn) = (&scene.settings(settings), scene.planes(planes));
        let stats = match (self, &scene.resident) {
            #[cfg(feature = "reference")]
            (Self::Reference(renderer), Resident::Reference(scene)) => {
                renderer.render_supersampled(scene, view, settings, drawn, samples, frame)
            }
            #[allow(unreachable_patterns, reason = "a program with one backend has no other's scenes")]
            (backend, _) if !backend.can_supersample() => Err(RenderError::Unsupported {
                backend: backend.info().backend,
                feature: "supersampling",
                found_where: "is asked for".to_owned(),
                advice: "use backend 'reference'",
            }),
            #[allow(unreachable_patterns, reason = "a program with one backend has no other's scenes")]
            (backend, _) => Err(wrong_backend_error(backend)),
        }?;
        scene.draw_ground(view, planes, frame);
        Ok(stats)
    }

    /// Uploads a scene whose colours already contain the light of its sky.
    fn upload_stored(
        &mut self,
        scene: &Scene,
        progress: &mut dyn FnMut(UploadProgress),
    ) -> Result<Resident, RenderError> {
        match self {
            #[cfg(feature = "ash")]
            Self::Ash(renderer) => {
                renderer.upload_reporting(scene, progress).map(|scene| Resident::Ash(Box::new(scene)))
            }
            #[cfg(feature = "wgpu")]
            Self::Wgpu(renderer) => {
                renderer.upload_reporting(scene, progress).map(|scene| Resident::Wgpu(Box::new(scene)))
            }
            #[cfg(feature = "cpu")]
            Self::Cpu(renderer) => renderer.upload_reporting(scene, progress).map(Resident::Cpu),
            #[cfg(feature = "reference")]
            Self::Reference(renderer) => renderer.upload_reporting(scene, progress).map(Resident::Reference),
        }
    }
}

impl BackendScene {
    /// Returns the settings with which the scene is drawn. With stored light, the shader `phong` is replaced by
    /// `unlit`.
    fn settings(&self, settings: &Settings) -> Settings {
        match (&self.light, settings.shader) {
            (Some(_), Shader::Phong) => settings.with_shader(Shader::Unlit),
            _ => *settings,
        }
    }

    /// Returns the planes that the backend must draw so that all requested planes can be returned. A scene with a
    /// ground also needs linear colours, because the ground is drawn behind them.
    fn planes(&self, planes: Planes) -> Planes {
        let has_ground = self.ground.is_some() && planes.shows_color();
        planes.with_color(planes.color || has_ground)
    }

    /// Draws ground and background behind the colours of a frame that was drawn without them. Does nothing if the scene
    /// has no ground.
    fn draw_ground(&self, view: &View, planes: Planes, frame: &mut Frame) {
        let Some((ground, background)) = self.ground.as_ref().filter(|_| planes.shows_color()) else { return };
        ground.draw_behind(view, *background, frame.color_mut());
        if planes.rgba8 {
            frame.encode(planes);
        }
    }
}

/// Returns the summary of a scene as a [`Backend`] stores it, with the light of its sky in the colours.
pub fn summary_of(scene: &Scene) -> SceneSummary {
    SceneSummary { has_sky: false, ..SceneSummary::of(scene) }
}

/// Returns a function to pass to [`Backend::choose`]. The function returns the reason why a backend with the given
/// capabilities can't draw the scene with the settings and planes, or `None` if it can.
pub fn refusals(
    scene: &Scene,
    settings: &Settings,
    planes: Planes,
) -> impl Fn(&Capabilities) -> Option<String> + use<> {
    let (summary, settings) = (summary_of(scene), *settings);
    move |capabilities| unsupported(&summary, &settings, planes, capabilities).map(|missing| missing.to_string())
}

/// Returns the capabilities of a backend without starting it, or `None` if they depend on the device.
fn capabilities_of(name: &str) -> Option<Capabilities> {
    match name {
        #[cfg(feature = "ash")]
        "ash" => Some(surfel_ash::CAPABILITIES),
        #[cfg(feature = "wgpu")]
        "wgpu" => Some(surfel_wgpu::CAPABILITIES),
        _ => None,
    }
}

/// True unless the backend needs a GPU and the machine has none. Starting the backend would then find a software device
/// at best. Only Linux machines are examined; on others the result is true.
fn has_device_for(name: &str) -> bool {
    if name == "cpu" || !cfg!(target_os = "linux") {
        return true;
    }
    let has = |path: &str| std::path::Path::new(path).exists();
    // Kernel drivers: DRM, NVIDIA's own, the GPU of Windows below WSL, and drivers of phones.
    ["/dev/dri", "/dev/nvidiactl", "/dev/dxg", "/dev/kgsl-3d0", "/dev/mali0"].into_iter().any(has)
}

/// Returns the error to report if the light of a scene's sky can't be computed or stored.
fn not_lit(backend: &Backend, error: LightError) -> RenderError {
    match error {
        LightError::Model(error) => error.into(),
        other => RenderError::Backend { backend: backend.info().backend, message: other.to_string() },
    }
}

/// Returns the error to report if a scene that another backend uploaded is drawn with `backend`.
fn wrong_backend_error(backend: &Backend) -> RenderError {
    let message = "the scene was uploaded to another backend: upload it to this one".to_owned();
    RenderError::Backend { backend: backend.info().backend, message }
}

/// Returns an error if the options name an adapter that isn't this CPU backend's.
#[cfg(any(feature = "cpu", feature = "reference"))]
fn check_adapter(info: &RendererInfo, options: &BackendOptions) -> Result<(), BackendError> {
    match &options.adapter {
        Some(wanted) if !info.adapter.to_lowercase().contains(&wanted.to_lowercase()) => {
            Err(BackendError::NoAdapter { name: info.backend, wanted: wanted.clone(), found: info.adapter.clone() })
        }
        _ => Ok(()),
    }
}

impl Renderer for Backend {
    type Scene = BackendScene;

    fn info(&self) -> &RendererInfo {
        match self {
            #[cfg(feature = "ash")]
            Self::Ash(renderer) => renderer.info(),
            #[cfg(feature = "wgpu")]
            Self::Wgpu(renderer) => renderer.info(),
            #[cfg(feature = "cpu")]
            Self::Cpu(renderer) => renderer.info(),
            #[cfg(feature = "reference")]
            Self::Reference(renderer) => renderer.info(),
        }
    }

    fn upload(&mut self, scene: &Scene) -> Result<BackendScene, RenderError> {
        self.upload_reporting(scene, &mut |_| {})
    }

    fn upload_reporting(
        &mut self,
        scene: &Scene,
        progress: &mut dyn FnMut(UploadProgress),
    ) -> Result<BackendScene, RenderError> {
        let lit = light_scene(scene, &LightOptions::default()).map_err(|e| not_lit(self, e))?;
        let LitScene { scene: lit, ground } = lit;
        let resident = self.upload_stored(&lit, progress)?;
        let [r, g, b, a] = scene.background;
        let ground = ground.map(|ground| (ground, [r * a, g * a, b * a, a].map(|c| c as f32)));
        let light = scene.sky.is_some().then(|| StoredLightKey::of(scene));
        Ok(BackendScene { resident, light, ground })
    }

    fn update(&mut self, resident: &mut BackendScene, scene: &Scene) -> Result<bool, RenderError> {
        if scene.sky.is_some() || resident.light.is_some() {
            return Ok(resident.light.as_ref().is_some_and(|light| light.is_of(scene)));
        }
        match (self, &mut resident.resident) {
            #[cfg(feature = "ash")]
            (Self::Ash(renderer), Resident::Ash(resident)) => renderer.update(resident, scene),
            #[cfg(feature = "wgpu")]
            (Self::Wgpu(renderer), Resident::Wgpu(resident)) => renderer.update(resident, scene),
            #[cfg(feature = "cpu")]
            (Self::Cpu(renderer), Resident::Cpu(resident)) => renderer.update(resident, scene),
            #[cfg(feature = "reference")]
            (Self::Reference(renderer), Resident::Reference(resident)) => renderer.update(resident, scene),
            #[allow(unreachable_patterns, reason = "a program with one backend has no other")]
            _ => Ok(false),
        }
    }

    fn render_into(
        &mut self,
        scene: &BackendScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let (settings, drawn) = (&scene.settings(settings), scene.planes(planes));
        let stats = match (self, &scene.resident) {
            #[cfg(feature = "reference")]
            (Self::Reference(renderer), Resident::Reference(scene)) => {
                renderer.render_into(scene, view, settings, drawn, frame)
            }
            #[cfg(feature = "cpu")]
            (Self::Cpu(renderer), Resident::Cpu(scene)) => renderer.render_into(scene, view, settings, drawn, frame),
            #[cfg(feature = "ash")]
            (Self::Ash(renderer), Resident::Ash(scene)) => renderer.render_into(scene, view, settings, drawn, frame),
            #[cfg(feature = "wgpu")]
            (Self::Wgpu(renderer), Resident::Wgpu(scene)) => renderer.render_into(scene, view, settings, drawn, frame),
            #[allow(unreachable_patterns, reason = "a program with one backend has no other's scenes")]
            (backend, _) => Err(wrong_backend_error(backend)),
        }?;
        scene.draw_ground(view, planes, frame);
        Ok(stats)
    }
}
