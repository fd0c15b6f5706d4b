//! Files of Surfel: splats, points and meshes in; pictures and splats out; scene files both ways.
//!
//! * [`load`]: PLY (Surfel's splat profile, points, meshes, 2D and 3D Gaussian splats), OBJ, STL, glTF and GLB,
//!   XYZ and PTS, Surfel's octrees.
//! * [`save_splat_ply`]: a splat cloud, without loss; [`save_hybrid`]: an octree of splats and polygons.
//! * [`save_png`], [`save_exr`], [`read_image`]: the planes of a frame.
//! * [`scene_file`]: scene and camera files.
//! * [`atomic::write`]: any file, whole or not at all.
//!
//! Every reader takes hostile input: no panic, no endless loop, and no more memory than a small multiple of the
//! file's size (images and glTF instances: fixed limits). Each function `save_…` has a twin `write_…` for sinks.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod ascii;
pub mod atomic;
mod color;
mod columns;
mod container;
mod error;
mod files;
mod gaussians;
mod gltf;
mod images;
mod load;
mod mesh_build;
mod obj;
mod ply;
mod points;
pub mod scene_file;
mod stl;
mod texture;

pub use container::{save_hybrid, write_hybrid};
pub use error::{IoError, Location, Problem};
pub use images::{
    BitDepth, ExrOptions, Planes, PlanesView, PngOptions, read_image, read_image_bytes, save_exr, save_png, write_exr,
    write_png,
};
pub use load::{Content, Format, LoadOptions, Loaded, load, load_bytes};
pub use ply::{PlyEncoding, save_splat_ply, write_splat_ply};
pub use texture::load_matcap;
