//! Pictures: the planes of a frame, written as PNG or EXR and read back.

mod exr;
mod png;

pub use self::exr::{ExrOptions, save_exr, write_exr};
pub use self::png::{BitDepth, PngOptions, save_png, write_png};

use crate::error::{Fault, Problem, quote};
use crate::{IoError, files};
use std::io;
use std::path::Path;
use surfel_model::MAX_IMAGE_PIXELS;

/// Largest image file that is read, in bytes.
const MAX_FILE_BYTES: u64 = 4 << 30;

/// The planes of a picture, row by row from the top, one value a pixel; what isn't there costs nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Planes {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Linear premultiplied RGBA.
    pub color: Option<Vec<[f32; 4]>>,
    /// View-space planar depth in world units; +∞ where nothing is.
    pub depth: Option<Vec<f32>>,
    /// World normal, unit length or zero.
    pub normal: Option<Vec<[f32; 3]>>,
    /// Σw.
    pub weight: Option<Vec<f32>>,
    /// Other planes by their channels' names, such as `mask`.
    pub other: Vec<(String, Vec<f32>)>,
    /// Text attributes, in the order of their names.
    pub metadata: Vec<(String, String)>,
}

impl Planes {
    /// Borrows all planes, to write them.
    pub fn view(&self) -> PlanesView<'_> {
        PlanesView {
            width: self.width,
            height: self.height,
            color: self.color.as_deref(),
            depth: self.depth.as_deref(),
            normal: self.normal.as_deref(),
            weight: self.weight.as_deref(),
            other: self.other.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect(),
        }
    }
}

/// Borrowed [`Planes`]: what a picture is written from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlanesView<'a> {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Linear premultiplied RGBA.
    pub color: Option<&'a [[f32; 4]]>,
    /// View-space planar depth in world units; +∞ where nothing is.
    pub depth: Option<&'a [f32]>,
    /// World normal.
    pub normal: Option<&'a [[f32; 3]]>,
    /// Σw.
    pub weight: Option<&'a [f32]>,
    /// Other planes by their channels' names.
    pub other: Vec<(&'a str, &'a [f32])>,
}

impl PlanesView<'_> {
    /// The number of pixels, if every plane has as many.
    fn pixels(&self) -> io::Result<usize> {
        let invalid = |message: String| Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels == 0 || pixels > MAX_IMAGE_PIXELS {
            return invalid(format!("a picture of {}x{} can't be written", self.width, self.height));
        }
        let pixels = pixels as usize;
        let lengths = [
            ("colour", self.color.map(<[_]>::len)),
            ("depth", self.depth.map(<[_]>::len)),
            ("normal", self.normal.map(<[_]>::len)),
            ("weight", self.weight.map(<[_]>::len)),
        ];
        let named = lengths.into_iter().filter_map(|(name, n)| Some((name, n?)));
        let others = self.other.iter().map(|(name, values)| (*name, values.len()));
        match named.chain(others).find(|&(_, n)| n != pixels) {
            Some((name, n)) => invalid(format!("the {name} plane has {n} pixels, the picture {pixels}")),
            None => Ok(pixels),
        }
    }
}

/// Reads a picture: EXR with all planes that it has, or PNG or JPEG as linear premultiplied colour.
///
/// # Errors
/// [`IoError`] if it can't be read, is damaged, too large, or of another format.
pub fn read_image(path: &Path) -> Result<Planes, IoError> {
    read_image_bytes(&files::read(path, MAX_FILE_BYTES)?, path)
}

/// As [`read_image`], from memory; `name` is for messages.
///
/// # Errors
/// As [`read_image`].
pub fn read_image_bytes(bytes: &[u8], name: &Path) -> Result<Planes, IoError> {
    let read = || {
        if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            exr::read(bytes)
        } else if bytes.starts_with(b"\x89PNG\r\n\x1a\n") || bytes.starts_with(&[0xff, 0xd8, 0xff]) {
            png::read(bytes)
        } else {
            let found = quote(&bytes[..bytes.len().min(12)]);
            Err(Problem::new(format!("is not a picture that can be read: it starts with {found}"))
                .expected("OpenEXR, PNG or JPEG"))
        }
    };
    read().map_err(|problem| Fault::from(problem).of(name))
}
