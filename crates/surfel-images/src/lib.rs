//! Readers and writers of images: frames as PNG, JPEG, EXR, NPZ or TIFF, films made of frames, and textures.
//!
//! Main types and functions, in reading order:
//!
//! 1. [`Planes`] owns the planes of an image (colours, depths, normals, …); [`PlanesView`] borrows them from a frame;
//! 2. [`read_image`] reads an image file's planes, [`read_image_bytes`] an image in memory;
//! 3. [`save_png`], `save_exr` (feature `exr`), `save_jpeg` (feature `jpeg`) and `save_npz` (feature `npz`) write
//!    planes to a file, completely or not at all. Each has a counterpart `write_…` that writes to a stream;
//! 4. [`stitch()`](stitch::stitch) combines tiles into one image, with only a few rows in memory;
//! 5. [`TextureDecoder`](texture::TextureDecoder) and [`load_matcap`](texture::load_matcap) read textures of meshes,
//!    and matcaps;
//! 6. [`film::FilmWriter`] encodes frames as animated PNG, GIF or MP4;
//! 7. [`color`] converts between the sRGB-encoded levels of files and linear values.
//!
//! ```
//! use std::path::Path;
//! use surfel_images::{PlanesView, PngOptions, read_image_bytes, write_png};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Linear premultiplied RGBA: an opaque red pixel, and a white one of half opacity.
//! let color = [[1.0, 0.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5]];
//! let planes = PlanesView { width: 2, height: 1, color: Some(&color), ..PlanesView::default() };
//! let mut png = Vec::new();
//! write_png(&mut png, &planes, &PngOptions::default())?;
//!
//! let read = read_image_bytes(&png, Path::new("pixels.png"))?;
//! assert_eq!((read.width, read.height), (2, 1));
//! assert_eq!(read.color.map(|color| color[0]), Some([1.0, 0.0, 0.0, 1.0]));
//! # Ok(())
//! # }
//! ```
//!
//! # Hostile input
//! Decoders accept hostile input: they never panic, and use no more memory than a fixed limit. An image in a format
//! whose feature is disabled is refused with the name of the feature.
//!
//! # Layer
//! The crate is between `surfel-files`, whose errors it returns, and `surfel-io`, which re-exports it. It also writes
//! the frames of `surfel-render`.
//!
//! # Features
//! All features are on by default. `jpeg` and `exr` read and write images, and `webp` reads images. `npz` writes planes
//! as NumPy archives, `tiff` writes stitched images, and `gif` writes films. PNG and MP4 are always available.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod color;
mod decode;
#[cfg(feature = "exr")]
mod exr;
pub mod film;
#[cfg(feature = "jpeg")]
mod jpeg_writer;
#[cfg(feature = "npz")]
mod npz;
mod planes;
mod png;
mod read;
mod reduce;
pub mod stitch;
pub mod texture;
#[cfg(feature = "tiff")]
mod tiff;

#[cfg(feature = "exr")]
pub use exr::{ExrOptions, save_exr, write_exr};
#[cfg(feature = "jpeg")]
pub use jpeg_writer::{JpegOptions, save_jpeg, write_jpeg};
#[cfg(feature = "npz")]
pub use npz::{save_npz, write_npz};
pub use planes::{Planes, PlanesView};
pub use png::{BitDepth, PngOptions, save_png, to_srgb8, write_png};
pub use read::{read_image, read_image_bytes};
