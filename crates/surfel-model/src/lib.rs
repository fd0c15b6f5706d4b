//! The data model of Surfel: splat clouds, point clouds, meshes, materials, cameras, lights, scenes
//! and render settings.
//!
//! Data is validated once, where it is built ([`SplatCloud::new`], [`Scene::validate`]); everything
//! downstream relies on that. Nothing here reads files or draws.

mod cloud;
mod column;
mod error;
mod mesh;
mod points;
mod scene;
mod settings;
mod up;

pub use cloud::{ClipColumns, ClipCurve, ClipLine, ClipMode, CloudData, OnInvalid, Repaired, Shape, SplatCloud};
pub use column::{Column3, ExtraColumn, ExtraValues};
pub use error::ModelError;
pub use mesh::{Mesh, Texture};
pub use points::PointCloud;
pub use scene::{
    Camera, Cull, Geometry, Light, MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE, Material, Object, ObjectFile, Projection, Scene,
    SceneFile,
};
pub use settings::{Accumulate, ClipPolicy, DepthTolerance, Filter, Mapping, Settings, Shader, Transparency};
pub use up::Up;
