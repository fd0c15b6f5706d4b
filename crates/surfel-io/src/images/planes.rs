//! The planes of an image, which files are written from and read into.

use std::io;
use surfel_model::MAX_IMAGE_PIXELS;

/// The planes of an image, row by row from the top, one value a pixel; what isn't there costs nothing.
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
    /// Planes of whole numbers by their channels' names, such as `index`.
    pub whole: Vec<(String, Vec<u32>)>,
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

/// Borrowed [`Planes`]: what an image is written from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlanesView<'a> {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Linear premultiplied RGBA.
    pub color: Option<&'a [[f32; 4]]>,
    /// The same, sRGB-encoded in 8 bits, straight alpha: what a PNG of 8 bits is written from where it is there.
    pub rgba8: Option<&'a [[u8; 4]]>,
    /// View-space planar depth in world units; +∞ where nothing is.
    pub depth: Option<&'a [f32]>,
    /// World normal.
    pub normal: Option<&'a [[f32; 3]]>,
    /// Σw.
    pub weight: Option<&'a [f32]>,
    /// World positions; +∞ where nothing is. Files whose numbers are f32 hold them rounded, and read back as others.
    pub position: Option<&'a [[f64; 3]]>,
    /// Other planes by their channels' names.
    pub other: Vec<(&'a str, &'a [f32])>,
    /// Planes of whole numbers by their channels' names.
    pub whole: Vec<(&'a str, &'a [u32])>,
}

impl PlanesView<'_> {
    /// The number of pixels, if every plane has as many.
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
