//! Still images: frames as PNG, JPEG, EXR, NPZ or TIFF, and textures.
//!
//! * [`read_image`]: an image's planes; [`Planes`] owns them, [`PlanesView`] borrows them from a frame.
//! * [`save_png`], `save_exr` (feature `exr`), `save_jpeg` (feature `jpeg`), `save_npz` (feature `npz`): a frame's
//!   planes, whole or not at all. Each has a twin `write_…` for sinks.
//! * [`stitch`](stitch::stitch): one image of its tiles, without all of it in memory.
//! * [`TextureDecoder`](texture::TextureDecoder), [`load_matcap`](texture::load_matcap): textures of meshes, matcaps.
//! * [`color`]: sRGB-encoded levels of files and linear values.
//!
//! Decoders accept hostile input: no panic, and no more memory than a fixed limit. An image of a format that isn't
//! built is refused with the name of its feature.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod color;
mod decode;
#[cfg(feature = "exr")]
mod exr;
#[cfg(feature = "jpeg")]
mod jpeg;
#[cfg(feature = "jpeg")]
mod jpeg_writer;
#[cfg(feature = "npz")]
mod npz;
mod planes;
mod png;
mod read;
pub mod stitch;
pub mod texture;
#[cfg(feature = "tiff")]
mod tiff;
#[cfg(feature = "webp")]
mod webp;

#[cfg(feature = "exr")]
pub use exr::{ExrOptions, save_exr, write_exr};
#[cfg(feature = "jpeg")]
pub use jpeg_writer::{JpegOptions, save_jpeg, write_jpeg};
#[cfg(feature = "npz")]
pub use npz::{save_npz, write_npz};
pub use planes::{Planes, PlanesView};
pub use png::{BitDepth, PngOptions, save_png, to_srgb8, write_png};
pub use read::{read_image, read_image_bytes};
