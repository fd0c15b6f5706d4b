//! Errors of rendering.

use surfel_model::ModelError;

/// Errors of rendering that every backend may return.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The scene, view or settings break a rule of `surfel-model`, such as an allowed range.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The scene or settings need a feature that this version, or this backend, doesn't support.
    #[error("{feature} {found_where}, which backend '{backend}' does not draw yet; {advice}")]
    Unsupported {
        /// Name of the backend.
        backend: &'static str,
        /// Name of the feature.
        feature: &'static str,
        /// Part of the scene or settings that needs the feature.
        found_where: String,
        /// Advice to the user how to draw the scene without the feature.
        advice: &'static str,
    },
    /// A cloud has no interior weight, the typical sum of weights inside its surface
    /// ([`CloudData::interior_weight`](surfel_model::CloudData::interior_weight)), which coverage needs.
    #[error(
        "object {object} has no interior weight, which edge antialiasing, the A-buffer and meshes among splats need; \
         estimate it (surfel_sample::interior_weight) or set material.interior_weight"
    )]
    NoInteriorWeight {
        /// Index in the scene of the object whose cloud has no interior weight.
        object: usize,
    },
    /// A cloud has no rows (numbers of its splats in the input file), which the planes `index` and `label` need.
    #[error(
        "object {object} has no rows, which the planes index and label show: give it some by Scene::number_rows before \
         the upload; the splats of an octree stand for many points and have none, so draw what it was made of instead"
    )]
    NoRows {
        /// Index in the scene of the object whose cloud has no rows.
        object: usize,
    },
    /// The frame's planes need more memory than the limit.
    #[error("the frame needs {needed} bytes, more than the {limit} allowed; render it by `region`")]
    TooLarge {
        /// Number of bytes that the frame needs.
        needed: u64,
        /// Largest number of bytes that a frame may have.
        limit: u64,
    },
    /// The device's memory is too small for the scene.
    #[error(
        "{backend}: the scene needs {needed} bytes of device memory, and {available} are there: {} too few; store it \
         in 16 bits (`storage=16`), draw fewer splats, or choose `backend=cpu`",
        needed.saturating_sub(*available)
    )]
    SceneTooLarge {
        /// Name of the backend.
        backend: &'static str,
        /// Number of bytes needed for splats, textures and buffers for drawing.
        needed: u64,
        /// Number of bytes of device memory that may be used, or that were in use when the memory was exhausted.
        available: u64,
    },
    /// The system can't start more threads, or has no memory for their stacks.
    #[error("{backend}: can't start threads: {message}")]
    Threads {
        /// Name of the backend.
        backend: &'static str,
        /// Error message of the system.
        message: String,
    },
    /// The backend failed while drawing or uploading.
    #[error("{backend}: {message}")]
    Backend {
        /// Name of the backend.
        backend: &'static str,
        /// Error message of the backend.
        message: String,
    },
}

/// Reason why a requested backend isn't available.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BackendError {
    /// The backend exists, but this program was built without it.
    #[error(
        "backend '{name}' is not built into this program, which has {available}: build it with Cargo's feature \
         '{feature}', as in cargo build --release --features {feature}"
    )]
    NotBuilt {
        /// Name of the backend.
        name: &'static str,
        /// Cargo feature that builds the backend into the program.
        feature: &'static str,
        /// Names of the backends that are built in.
        available: String,
    },
    /// No backend has the requested name.
    #[error("there is no backend '{name}', expected one of auto, cpu, wgpu, ash, reference")]
    Unknown {
        /// Name of the backend that was asked for.
        name: String,
    },
    /// The backend runs, but has no adapter (device) with the requested name.
    #[error("backend '{name}' has no adapter called '{wanted}'; it found: {found}")]
    NoAdapter {
        /// Name of the backend.
        name: &'static str,
        /// Requested part of the adapter's name.
        wanted: String,
        /// Name of the adapter that the backend has instead.
        found: String,
    },
    /// The backend is built in, but failed to start.
    #[error("backend '{name}' does not start: {source}")]
    NoStart {
        /// Name of the backend.
        name: &'static str,
        /// Error with which the backend failed to start.
        source: RenderError,
    },
}
