//! Which program draws: one enum over all backends that are built in.

use surfel_model::{Scene, Settings};
use surfel_render::{Frame, Planes, RenderError, Renderer, RendererInfo, Stats, View};

/// Names of backends, fastest first; `reference` is last.
const NAMES: [&str; 4] = ["ash", "wgpu", "cpu", "reference"];

/// What is asked of a backend when it starts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BackendOptions {
    /// Threads of a CPU backend; 0: as many as the machine has.
    pub threads: usize,
    /// A part of the adapter's name, in any case; `None`: any adapter.
    pub adapter: Option<String>,
}

/// Why there is no such backend here.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BackendError {
    /// A known backend that this program was built without.
    #[error("backend '{name}' is not built into this program; it has: {available}")]
    NotBuilt {
        /// Its name.
        name: String,
        /// Those that are.
        available: String,
    },
    /// A name that no backend has.
    #[error("there is no backend '{name}', expected one of auto, cpu, wgpu, ash, reference")]
    Unknown {
        /// The name.
        name: String,
    },
    /// The backend runs, but not on such an adapter.
    #[error("backend '{name}' has no adapter called '{wanted}'; it found: {found}")]
    NoAdapter {
        /// The backend's name.
        name: &'static str,
        /// The part of a name that was asked for.
        wanted: String,
        /// The adapter there is.
        found: String,
    },
    /// The backend is built in, but doesn't start.
    #[error("backend '{name}' does not start: {source}")]
    NoStart {
        /// Its name.
        name: &'static str,
        /// Why.
        source: RenderError,
    },
}

/// A backend, started.
#[non_exhaustive]
pub enum Backend {
    /// The rendering model in executable form: exact and slow.
    Reference(surfel_reference::Renderer),
}

/// A scene resident in a [`Backend`].
#[non_exhaustive]
pub enum BackendScene {
    /// In the reference renderer.
    Reference(<surfel_reference::Renderer as Renderer>::Scene),
}

/// What is known of a backend without drawing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackendInfo {
    /// Its name.
    pub name: &'static str,
    /// Who draws, or why it can't.
    pub state: Result<RendererInfo, String>,
}

/// All backends, fastest first, and whether they run on this machine.
pub fn backends() -> Vec<BackendInfo> {
    let state = |name| match Backend::by_name(name, &BackendOptions::default()) {
        Ok(backend) => Ok(backend.info().clone()),
        Err(BackendError::NotBuilt { .. }) => Err("not built into this program".to_owned()),
        Err(error) => Err(error.to_string()),
    };
    NAMES.into_iter().map(|name| BackendInfo { name, state: state(name) }).collect()
}

impl Backend {
    /// The fastest backend that works here, with default options.
    ///
    /// # Errors
    /// [`BackendError`] of the last one tried.
    pub fn auto() -> Result<Self, BackendError> {
        Self::by_name("auto", &BackendOptions::default())
    }

    /// Starts the backend `name`: `cpu`, `wgpu`, `ash`, `reference`, or `auto` for the fastest that works.
    ///
    /// # Errors
    /// [`BackendError`] if there is no such backend, or not here.
    pub fn by_name(name: &str, options: &BackendOptions) -> Result<Self, BackendError> {
        match name {
            "auto" | "reference" => Self::reference(options),
            _ if NAMES.contains(&name) => {
                Err(BackendError::NotBuilt { name: name.to_owned(), available: "reference".to_owned() })
            }
            _ => Err(BackendError::Unknown { name: name.to_owned() }),
        }
    }

    fn reference(options: &BackendOptions) -> Result<Self, BackendError> {
        let start = surfel_reference::Renderer::new(options.threads);
        let renderer = start.map_err(|source| BackendError::NoStart { name: "reference", source })?;
        if let Some(wanted) = &options.adapter {
            let found = &renderer.info().adapter;
            if !found.to_lowercase().contains(&wanted.to_lowercase()) {
                let (wanted, found) = (wanted.clone(), found.clone());
                return Err(BackendError::NoAdapter { name: "reference", wanted, found });
            }
        }
        Ok(Self::Reference(renderer))
    }

    /// True for the backend that can render with several samples a pixel.
    pub fn can_supersample(&self) -> bool {
        matches!(self, Self::Reference(_))
    }

    /// Renders with `samples`×`samples` unfiltered samples a pixel and averages them.
    ///
    /// # Errors
    /// As [`Renderer::render`]; [`RenderError::Unsupported`] where [`Backend::can_supersample`] is false.
    pub fn render_supersampled(
        &mut self,
        scene: &BackendScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        samples: u32,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        match (self, scene) {
            (Self::Reference(renderer), BackendScene::Reference(scene)) => {
                renderer.render_supersampled(scene, view, settings, planes, samples, frame)
            }
        }
    }
}

impl Renderer for Backend {
    type Scene = BackendScene;

    fn info(&self) -> &RendererInfo {
        match self {
            Self::Reference(renderer) => renderer.info(),
        }
    }

    fn upload(&mut self, scene: &Scene) -> Result<BackendScene, RenderError> {
        match self {
            Self::Reference(renderer) => renderer.upload(scene).map(BackendScene::Reference),
        }
    }

    fn render(
        &mut self,
        scene: &BackendScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        match (self, scene) {
            (Self::Reference(renderer), BackendScene::Reference(scene)) => {
                renderer.render(scene, view, settings, planes, frame)
            }
        }
    }
}
