//! Readers and writers of Surfel's files. Splats, points and meshes are read; images and splats are written; scene
//! files are read and written.
//!
//! Main functions and types, in reading order:
//!
//! * [`load()`] and [`load_bytes`] read a file as [`Loaded`], whose [`Content`] is splats, points, a mesh, an octree or
//!   trained Gaussians: PLY (Surfel's splat profile, points, meshes, 2D and 3D Gaussian splats), OBJ, OFF, STL, glTF
//!   and GLB, Draco, 3D Tiles of points, LAS, LAZ, COPC, E57, PCD, XYZ, PTS and PTX, COLMAP points, NumPy arrays, rows
//!   of numbers without a header, Gaussian splats as SPLAT, SPZ and SOG, Surfel's octrees; and all of these with gzip.
//!   [`LoadOptions`] control how files are read; [`Format`] lists the formats.
//! * [`save_splat_ply`] writes a splat cloud without loss; [`save_octree`] an octree of splats and polygons.
//! * [`save_png`], `save_exr` (feature `exr`), `save_jpeg` (feature `jpeg`) and `save_npz` (feature `npy`) write the
//!   planes of a frame ([`PlanesView`]); [`read_image`] reads them ([`Planes`]). All are re-exported from
//!   `surfel-images`.
//! * [`film::FilmWriter`] writes films as animated PNG, GIF (feature `gif`) or MP4, which ffmpeg encodes.
//! * `write_geotiffs` (feature `geotiff`) writes georeferenced images, tile by tile.
//! * [`scene_file`] reads and writes scene and camera files; [`camera_path`] reads the cameras of a film; [`cameras`]
//!   reads cameras of other programs.
//! * `copc` (feature `laz`) reads parts of COPC files, and writes them.
//! * [`IoError`] names the file, the place in it, and what was expected; [`atomic::write`] writes any file, complete or
//!   not at all. Both are re-exported from `surfel-files`.
//!
//! Each function `save_…`, which writes a file, has a twin `write_…`, which writes to any [`std::io::Write`].
//!
//! ```
//! use std::path::Path;
//! use surfel_io::{Content, LoadOptions, PlyEncoding, load_bytes, write_splat_ply};
//! use surfel_model::SplatCloud;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let cloud = SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.5])?;
//! let mut bytes = Vec::new();
//! write_splat_ply(&mut bytes, &cloud, PlyEncoding::Ascii)?;
//!
//! let loaded = load_bytes(&bytes, None, Path::new("disk.ply"), &LoadOptions::default())?;
//! assert!(matches!(loaded.content, Content::Splats(splats) if splats.len() == 1));
//! # Ok(())
//! # }
//! ```
//!
//! # Hostile input
//! Every reader accepts hostile input: no panic, no endless loop, and no more memory than a small multiple of the
//! file's size. Images, compressed files and meshes, and glTF instances have fixed limits instead.
//!
//! # Layer
//! The crate depends on `surfel-model`, whose types it returns, and on `surfel-files` and `surfel-images`, which it
//! re-exports. It converts no points to splats: `surfel-sample` does, and `surfel-load` combines the two.
//!
//! # Features
//! Each family of formats is a Cargo feature. PLY, octrees, PNG and scene files need none. A file of a format that
//! isn't built in is refused with the name of its feature. All features but `zstd` are on by default.
//!
//! | feature | formats |
//! | --- | --- |
//! | `obj`, `off`, `stl` | meshes of the same names |
//! | `gltf`, `draco`, `meshopt` | glTF, GLB and 3D Tiles; Draco files and glTF's Draco meshes; glTF's meshopt buffers |
//! | `points` | points as text (XYZ, TXT, CSV, ASC, PTS, PTX) and COLMAP points |
//! | `pcd`, `npy`, `e57` | PCD; NPY and NPZ, also as images; E57 |
//! | `las`, `laz` | LAS; LAZ and COPC |
//! | `gaussians` | SPLAT, SPZ and SOG (with `webp`) |
//! | `zstd` | SPZ of version 4 |
//! | `jpeg`, `webp`, `exr` | JPEG and EXR images, read and written; WebP images, read |
//! | `geotiff` | GeoTIFF images, written |
//! | `gif` | GIF films, written |

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod ascii;
mod bytes;
pub mod camera_path;
pub mod cameras;
#[cfg(feature = "points")]
mod colmap_points;
#[cfg(feature = "laz")]
mod column_file;
mod column_roles;
mod columns;
mod content;
mod context;
mod crs;
#[cfg(any(feature = "npy", feature = "pcd"))]
mod depth_image;
#[cfg(feature = "draco")]
mod drc;
#[cfg(feature = "e57")]
mod e57;
mod face_colors;
mod format;
#[cfg(feature = "gltf")]
mod gathered_points;
mod gaussians;
#[cfg(feature = "geotiff")]
mod geotiff;
#[cfg(feature = "gltf")]
mod gltf;
mod gzip;
#[cfg(feature = "las")]
mod las;
mod load;
mod loaded;
#[cfg(any(feature = "obj", feature = "gltf"))]
mod materials;
#[cfg(feature = "npy")]
mod npy;
#[cfg(feature = "obj")]
mod obj;
mod octree;
#[cfg(feature = "off")]
mod off;
#[cfg(feature = "pcd")]
mod pcd;
mod ply;
mod point_columns;
#[cfg(feature = "las")]
mod point_count;
#[cfg(feature = "points")]
mod points;
mod polygons;
#[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
mod raw_rows;
mod rows;
pub mod scene_file;
#[cfg(feature = "gaussians")]
mod sog;
#[cfg(feature = "gaussians")]
mod splat_rows;
#[cfg(feature = "gaussians")]
mod spz;
#[cfg(feature = "stl")]
mod stl;
mod strided;
#[cfg(any(feature = "las", feature = "e57"))]
mod survey;
#[cfg(feature = "points")]
mod text_rows;
#[cfg(feature = "gltf")]
mod tileset;
mod wkt;
mod words;
#[cfg(any(feature = "gaussians", feature = "npy"))]
mod zip;

pub use content::{Content, LoadOptions};
pub use crs::{Crs, IN_DEGREES};
pub use format::Format;
#[cfg(feature = "geotiff")]
pub use geotiff::{GeoImage, GeoSamples, GeoTiles, write_geotiffs};
#[cfg(feature = "laz")]
pub use las::copc;
#[cfg(feature = "las")]
pub use las::survey_points;
pub use load::{PointSurvey, load, load_bytes, names_geometry, survey};
pub use loaded::Loaded;
pub use octree::{save_octree, write_octree};
pub use ply::encoding::PlyEncoding;
pub use ply::write::{save_splat_ply, write_splat_ply};
#[cfg(feature = "las")]
pub use point_count::PointCount;
#[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
pub use raw_rows::check_columns;
pub use surfel_files::{HostFile, RegularFile, set_host_file};
pub use surfel_files::{IoError, Location, Problem, ShowPath, ShownPath, is_obeyed};
pub use surfel_files::{atomic, input, lines, programs};
pub(crate) use surfel_files::{error, input as files};
pub use surfel_images::film;
pub use surfel_images::stitch::{ImageHeader, Samples, Tile, read_image_header, stitch};
pub use surfel_images::texture::load_matcap;
pub use surfel_images::{BitDepth, PngOptions, save_png, to_srgb8, write_png};
#[cfg(feature = "exr")]
pub use surfel_images::{ExrOptions, save_exr, write_exr};
#[cfg(feature = "jpeg")]
pub use surfel_images::{JpegOptions, save_jpeg, write_jpeg};
pub use surfel_images::{Planes, PlanesView, read_image, read_image_bytes};
pub(crate) use surfel_images::{color, texture};
#[cfg(feature = "npy")]
pub use surfel_images::{save_npz, write_npz};
pub use words::{byte_size, counted};
