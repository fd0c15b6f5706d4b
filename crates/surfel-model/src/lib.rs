//! The data model of Surfel: splat clouds, point clouds, meshes, materials, cameras, lights, scenes
//! and render settings.
//!
//! Data is validated once, where it is built ([`SplatCloud::new`], [`Scene::validate`]); everything
//! downstream relies on that. Nothing here reads files or draws.

mod camera;
mod clip;
mod cloud;
mod column;
mod error;
mod hybrid;
mod light;
mod matcap;
mod mesh;
mod morton;
mod points;
mod range;
mod scene;
mod settings;
mod texture;
mod up;

pub use camera::{Camera, MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE, Projection};
pub use clip::{ClipColumns, ClipCurve, ClipLine, ClipMode, NO_LINE};
pub use cloud::{CloudData, OnInvalid, Repaired, Shape, SplatCloud};
pub use column::{Column3, ExtraColumn, ExtraValues};
pub use error::ModelError;
pub use hybrid::{Hybrid, HybridNode, Transition};
pub use light::Light;
pub use matcap::Matcap;
pub use mesh::Mesh;
pub use points::PointCloud;
pub use scene::{Cull, Geometry, Material, Object, ObjectFile, Scene, SceneFile};
pub use settings::{Accumulate, ClipPolicy, DepthTolerance, Filter, Mapping, Settings, Shader, Transparency};
pub use texture::{Mipmaps, Texture};
pub use up::Up;
