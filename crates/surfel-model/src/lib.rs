//! The data model of Surfel: splat clouds, point clouds, meshes, materials, cameras, lights, scenes
//! and render settings.
//!
//! Data is validated once, where it is built ([`SplatCloud::new`], [`Scene::validate`]), and everything downstream
//! relies on that. This crate reads no files and draws nothing.
//!
//! The feature `serde` makes the scene file's types serialisable; the feature `rayon` sorts on all threads.

mod camera;
mod choice;
mod chunk;
mod clip;
mod cloud;
mod column;
mod condition;
mod convert;
mod error;
mod gaussians;
mod light;
mod matcap;
mod mesh;
mod morton;
mod octree;
mod points;
mod range;
mod scene;
mod setters;
mod settings;
mod table_columns;
mod texture;
mod up;

pub use glam;

pub use camera::{Camera, MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE, Projection};
pub use choice::{Chosen, Classes, Returns, choose};
pub use chunk::{CHUNK_SPLATS, ChunkSpace, Storage, StoredSplat, chunks, stored_axes};
pub use clip::{ClipColumns, ClipCurve, ClipLine, ClipMode, NO_LINE};
pub use cloud::{CloudData, NO_LABEL, OnInvalid, Repaired, Shape, SplatCloud};
pub use column::{Column3, ExtraColumn, ExtraValues};
pub use condition::{Comparison, Condition, ConditionTerm};
pub use convert::{Colormap, ConvertOptions, Outliers, PointColors, SplatCount, TextureOption, TextureSampling};
pub use error::ModelError;
pub use gaussians::{GaussianCloud, GaussianData, GaussianKind};
pub use light::Light;
pub use matcap::Matcap;
pub use mesh::{AlphaMode, MaterialRef, Mesh, MeshMaterial, NormalMap, TriangleMaterials};
pub use octree::{Octree, OctreeNode, Transition};
pub use points::PointCloud;
pub use scene::{Cull, Geometry, Material, Object, ObjectFile, Scene, SceneFile};
pub use settings::{
    Accumulate, ClipPolicy, Composite, DepthTolerance, EdgeAa, Filter, MOST_LOD_ERROR_PX, Mapping, Settings, Shader,
    Sort, Transparency,
};
pub use table_columns::{NumberFormat, TableColumn, TableColumns};
pub use texture::{KnownMipmaps, Mipmaps, SeeThroughTextures, Texture};
pub use up::Up;
