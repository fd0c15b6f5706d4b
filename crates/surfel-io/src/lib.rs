//! Files of Surfel: splats, points and meshes in; images and splats out; scene files both ways.
//!
//! * [`load`]: PLY (Surfel's splat profile, points, meshes, 2D and 3D Gaussian splats), OBJ, STL, glTF and GLB,
//!   LAS, LAZ, COPC and E57, XYZ and PTS, Surfel's octrees.
//! * [`save_splat_ply`]: a splat cloud, without loss; [`save_octree`]: an octree of splats and polygons.
//! * [`save_png`], `save_exr` (feature `exr`), `save_jpeg` (feature `jpeg`), [`read_image`]: the planes of a frame.
//! * [`scene_file`]: scene and camera files.
//! * [`atomic::write`]: any file, whole or not at all.
//!
//! Every reader takes hostile input: no panic, no endless loop, and no more memory than a small multiple of the
//! file's size (images, compressed glTF meshes and glTF instances: fixed limits). Each function `save_…` has a twin
//! `write_…` for sinks.
//!
//! Each family of formats is a Cargo feature: `obj`, `stl`, `points`, `las`, `laz`, `e57`, `gltf`, `draco`, `meshopt`,
//! `jpeg`, `webp`, `exr`; all are on by default. Without them PLY, octrees, PNG and scene files remain, and a file of a format that
//! isn't built is refused with the name of its feature.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod ascii;
pub mod atomic;
mod color;
mod columns;
mod content;
mod context;
#[cfg(feature = "e57")]
mod e57;
mod error;
mod files;
mod format;
mod gaussians;
#[cfg(feature = "gltf")]
mod gltf;
mod images;
#[cfg(feature = "las")]
mod las;
mod load;
#[cfg(any(feature = "obj", feature = "gltf"))]
mod materials;
#[cfg(feature = "obj")]
mod obj;
mod octree;
mod ply;
#[cfg(feature = "points")]
mod points;
pub mod scene_file;
#[cfg(feature = "stl")]
mod stl;
#[cfg(any(feature = "las", feature = "e57"))]
mod survey;

pub use content::{Content, LoadOptions};
pub use error::{IoError, Location, Problem};
pub use format::Format;
#[cfg(feature = "exr")]
pub use images::exr::{ExrOptions, save_exr, write_exr};
#[cfg(feature = "jpeg")]
pub use images::jpeg_writer::{JpegOptions, save_jpeg, write_jpeg};
pub use images::planes::{Planes, PlanesView};
pub use images::png::{BitDepth, PngOptions, save_png, write_png};
pub use images::texture::load_matcap;
pub use images::{read_image, read_image_bytes};
pub use load::{Loaded, load, load_bytes};
pub use octree::{save_octree, write_octree};
pub use ply::encoding::PlyEncoding;
pub use ply::write::{save_splat_ply, write_splat_ply};
