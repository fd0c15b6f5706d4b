//! The data model of Surfel: splat clouds, point clouds, meshes, materials, cameras, lights, scenes and render
//! settings.
//!
//! Main types, in reading order:
//!
//! 1. [`SplatCloud`]: validated splats, made by [`SplatCloud::disks`], [`SplatCloud::ellipses`] or, from all columns
//!    ([`CloudData`]), by [`SplatCloud::new`];
//! 2. [`PointCloud`] and [`Mesh`]: points without extent and triangles, which `surfel-sample` converts to splats;
//!    [`GaussianCloud`] and [`Octree`]: trained Gaussians, and splats and polygons at several levels of detail;
//! 3. [`Scene`]: [`Object`]s with [`Geometry`] and [`Material`], [`Light`]s and a background;
//! 4. [`Camera`]: eye, target, [`Projection`] and image size;
//! 5. [`Settings`]: filter, shader, transparency and other choices of how a frame is drawn;
//! 6. [`SceneFile`]: all of these as a file describes them; [`ConvertOptions`]: how a file's geometry becomes splats;
//! 7. [`ModelError`]: the rule that data violate.
//!
//! Data is validated once, where it is built ([`SplatCloud::new`], [`Scene::validate`]), and everything downstream
//! relies on that.
//!
//! ```
//! use surfel_model::{Light, Scene, SplatCloud};
//! # fn main() -> Result<(), surfel_model::ModelError> {
//! let centers = [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]];
//! let (normals, radii) = ([[0.0, 0.0, 1.0]; 2], [0.6; 2]);
//! let colors = [[0.8, 0.2, 0.1], [0.1, 0.3, 0.8]]; // linear RGB
//! let cloud = SplatCloud::disks(&centers, &normals, &radii)?.with_colors(&colors)?;
//! let scene = Scene { lights: Some(vec![Light::directional([0.0, -1.0, -1.0])]), ..Scene::from(cloud) };
//! scene.validate()?;
//!
//! // A cloud with an invalid splat can't be constructed.
//! assert!(SplatCloud::disks(&centers, &normals, &[0.6, -1.0]).is_err());
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate lies above the formulas of `surfel-math` and below everything else: readers, samplers and renderers
//! exchange its types. It reads no files and draws nothing.
//!
//! # Features
//! `serde` makes the types of scene files serialisable. `rayon` checks and sorts splats on all threads.

mod ball_light;
mod camera;
mod camera_matrices;
mod choice;
mod chunk;
mod clip;
mod cloud;
mod color;
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
mod points_as;
mod range;
mod scene;
mod setters;
mod settings;
mod sky;
mod table_columns;
mod texture;
mod up;

pub use glam;

pub use ball_light::BallLight;
pub use camera::{Camera, MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE, Projection};
pub use choice::{Chosen, Classes, Returns, choose};
pub use chunk::{CHUNK_SPLATS, ChunkSpace, Storage, StoredSplat, chunks, stored_axes};
pub use clip::{ClipColumns, ClipCurve, ClipLine, ClipMode, NO_LINE};
pub use cloud::{CloudData, NO_LABEL, OnInvalid, Repaired, Shape, SplatCloud};
pub use color::Color;
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
pub use points_as::{DOT_PX, PointRadius, PointsAs};
pub use scene::{Cull, Geometry, Material, Object, ObjectFile, Scene, SceneFile};
pub use settings::{
    Accumulate, ClipPolicy, Composite, DepthTolerance, EdgeAa, Filter, MAX_LOD_ERROR_PX, Mapping, Settings, Shader,
    Sort, Transparency,
};
pub use sky::{Ground, GroundStyle, Sky, SkyArea};
pub use table_columns::{NumberFormat, TableColumn, TableColumns};
pub use texture::{MipmapCache, Mipmaps, SeeThroughTextures, Texture};
pub use up::Up;
