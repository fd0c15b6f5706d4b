//! Planes of an image in memory, for reading and writing files.

use std::io;
use surfel_model::MAX_IMAGE_PIXELS;

/// Planes of an image, with one value per pixel in rows from the top. Planes that are missing take no memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Planes {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Colours of the pixels: linear premultiplied RGBA.
    pub color: Option<Vec<[f32; 4]>>,
    /// View-space planar depth of the surface in world units; +∞ at background pixels.
    pub depth: Option<Vec<f32>>,
    /// World-space shading normal, of unit length or zero.
    pub normal: Option<Vec<[f32; 3]>>,
    /// Sum of the splats' weights in each pixel, Σw.
    pub weight: Option<Vec<f32>>,
    /// Other planes by channel name, such as `mask`.
    pub other: Vec<(String, Vec<f32>)>,
    /// Integer planes by channel name, such as `index`.
    pub whole: Vec<(String, Vec<u32>)>,
    /// Text attributes of the file, sorted by name.
    pub metadata: Vec<(String, String)>,
}

impl Planes {
    /// Borrows all planes as a view, from which an image file can be written.
    pub fn view(&self) -> PlanesView<'_> {
        PlanesView {
            width: self.width,
            height: self.height,
            color: self.color.as_deref(),
            rgba8: None,
            depth: self.depth.as_deref(),
            normal: self.normal.as_deref(),
            weight: self.weight.as_deref(),
            position: None,
            other: self.other.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect(),
            whole: self.whole.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect(),
        }
    }
}

/// Borrowed planes of an image, for writing. See [`Planes`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlanesView<'a> {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Colours of the pixels: linear premultiplied RGBA.
    pub color: Option<&'a [[f32; 4]]>,
    /// Colour plane in 8 bits, sRGB-encoded with straight alpha. An 8-bit PNG is written from this plane if there is
    /// one.
    pub rgba8: Option<&'a [[u8; 4]]>,
    /// View-space planar depth in world units; +∞ at background pixels.
    pub depth: Option<&'a [f32]>,
    /// World-space normal, of unit length or zero.
    pub normal: Option<&'a [[f32; 3]]>,
    /// Sum of the splats' weights in each pixel, Σw.
    pub weight: Option<&'a [f32]>,
    /// World-space positions; +∞ at background pixels. EXR files store positions as f32, so they are rounded. When an
    /// EXR file is read, its positions are in [`Planes::other`].
    pub position: Option<&'a [[f64; 3]]>,
    /// Other planes by channel name, such as `mask`.
    pub other: Vec<(&'a str, &'a [f32])>,
    /// Integer planes by channel name, such as `index`.
    pub whole: Vec<(&'a str, &'a [u32])>,
}

impl PlanesView<'_> {
    /// Returns the number of pixels, width times height. Returns an error if this number is 0 or more than
    /// [`MAX_IMAGE_PIXELS`], or if a plane has another number of values.
    pub(super) fn pixels(&self) -> io::Result<usize> {
        let invalid = |message: String| Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels == 0 || pixels > MAX_IMAGE_PIXELS {
            return invalid(format!("an image of {}x{} can't be written", self.width, self.height));
        }
        let pixels = pixels as usize;
        let lengths = [
            ("colour", self.color.map(<[_]>::len)),
            ("encoded colour", self.rgba8.map(<[_]>::len)),
            ("depth", self.depth.map(<[_]>::len)),
            ("normal", self.normal.map(<[_]>::len)),
            ("weight", self.weight.map(<[_]>::len)),
            ("position", self.position.map(<[_]>::len)),
        ];
        let named = lengths.into_iter().filter_map(|(name, n)| Some((name, n?)));
        let others = self.other.iter().map(|(name, values)| (*name, values.len()));
        let whole = self.whole.iter().map(|(name, values)| (*name, values.len()));
        match named.chain(others).chain(whole).find(|&(_, n)| n != pixels) {
            Some((name, n)) => invalid(format!("the {name} plane has {n} pixels, the image {pixels}")),
            None => Ok(pixels),
        }
    }
}
