//! Why an image could not be made.

use surfel_model::ModelError;

/// Errors that every backend shares.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The scene, view or settings break a rule of the model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The scene or settings ask for something that this version, or this backend, doesn't draw.
    #[error("{feature} {found_where}, which backend '{backend}' does not draw yet; {advice}")]
    Unsupported {
        /// The backend's name.
        backend: &'static str,
        /// What is asked for.
        feature: &'static str,
        /// Where it was found.
        found_where: String,
        /// What to do.
        advice: &'static str,
    },
    /// Coverage needs every cloud's interior weight.
    #[error(
        "object {object} has no interior weight, which edge antialiasing, the A-buffer and meshes among splats need; \
         estimate it (surfel_sample::interior_weight) or set material.interior_weight"
    )]
    NoInteriorWeight {
        /// Index of the object.
        object: usize,
    },
    /// The planes `index` and `label` need the rows of every cloud.
    #[error(
        "object {object} has no rows, which the planes index and label show: give it some by Scene::number_rows before \
         the upload; the splats of an octree stand for many points and have none, so draw what it was made of instead"
    )]
    NoRows {
        /// Index of the object.
        object: usize,
    },
    /// More memory than the limit would be needed.
    #[error("the frame needs {needed} bytes, more than the {limit} allowed; render it by --region")]
    TooLarge {
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// The device's memory doesn't hold the scene.
    #[error(
        "{backend}: the scene needs {needed} bytes of device memory, and {available} are there: {} too few; store it \
         in 16 bits (--storage 16), draw fewer splats, or choose --backend cpu",
        needed.saturating_sub(*available)
    )]
    SceneTooLarge {
        /// The backend's name.
        backend: &'static str,
        /// Bytes needed: of splats, textures and what is drawn of them.
        needed: u64,
        /// Bytes that may be used, or that were used when the memory ended.
        available: u64,
    },
    /// The system gives no more threads, or no memory for their stacks.
    #[error("{backend}: can't start threads: {message}")]
    Threads {
        /// The backend's name.
        backend: &'static str,
        /// The system's message.
        message: String,
    },
    /// The backend failed.
    #[error("{backend}: {message}")]
    Backend {
        /// The backend's name.
        backend: &'static str,
        /// What it said.
        message: String,
    },
}
