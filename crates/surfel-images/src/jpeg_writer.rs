//! Writing of JPEG images: baseline, sRGB-encoded, without chroma subsampling, blended onto a background.

use crate::planes::PlanesView;
use jpeg_encoder::{Encoder, ImageBuffer, JpegColorType, SamplingFactor, rgb_to_ycbcr};
use std::io::{self, Write};
use std::path::Path;
use surfel_files::atomic;
use surfel_files::error::IoError;
use surfel_math::srgb::nearest_8_bit;

/// Maximum width or height of a JPEG, in pixels.
const MAX_SIDE: u32 = 65_535;

/// Options for writing a JPEG.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JpegOptions {
    /// Quality from 1 (worst) to 100, on the scale of the Independent JPEG Group's library. The default is 92.
    pub quality: u8,
    /// Background colour in linear RGB. A JPEG has no alpha, so that `color + (1 - alpha) * background` is written.
    pub background: [f32; 3],
}

impl Default for JpegOptions {
    fn default() -> Self {
        Self { quality: 92, background: [0.0; 3] }
    }
}

/// Writes the colour plane as JPEG: 8 bits, sRGB-encoded, 4:4:4, blended onto the background. A colour of NaN becomes
/// 0, and a pixel whose alpha is NaN shows the background.
///
/// # Errors
/// [`io::Error`] if there is no colour plane, its size is wrong, or a side has more than 65,535 pixels. Also
/// [`io::Error`] if the quality is out of its range, or `out` fails.
pub fn write_jpeg(out: &mut dyn Write, planes: &PlanesView<'_>, options: &JpegOptions) -> io::Result<()> {
    let invalid = |message: String| io::Error::new(io::ErrorKind::InvalidInput, message);
    let pixels = planes.pixels()?;
    let color = planes.color.filter(|c| c.len() == pixels);
    let color = color.ok_or_else(|| invalid("a JPEG needs a colour plane".to_owned()))?;
    let too_large = || {
        let (width, height) = (planes.width, planes.height);
        invalid(format!("{width}x{height} pixels, expected at most {MAX_SIDE} a side in a JPEG: write a PNG"))
    };
    let side = |pixels: u32| u16::try_from(pixels).map_err(|_| too_large());
    if !(1..=100).contains(&options.quality) {
        return Err(invalid(format!("a JPEG's quality is {}, expected 1 to 100", options.quality)));
    }
    let [width, height] = [side(planes.width)?, side(planes.height)?];
    let mut encoder = Encoder::new(out, options.quality);
    // Subsampled chroma would blur the sharp edges of coloured objects.
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    let written = encoder.encode_image(Blended { color, background: options.background, width, height });
    written.map_err(io::Error::other)
}

/// Colour plane as the encoder's source of rows. The simpler [`Encoder::encode`] would also compile code for eight
/// other kinds of images.
struct Blended<'a> {
    color: &'a [[f32; 4]],
    background: [f32; 3],
    width: u16,
    height: u16,
}

impl ImageBuffer for Blended<'_> {
    fn get_jpeg_color_type(&self) -> JpegColorType {
        JpegColorType::Ycbcr
    }

    fn width(&self) -> u16 {
        self.width
    }

    fn height(&self) -> u16 {
        self.height
    }

    fn fill_buffers(&self, y: u16, buffers: &mut [Vec<u8>; 4]) {
        let width = usize::from(self.width);
        for color in self.color.iter().skip(usize::from(y) * width).take(width) {
            let [r, g, b] = to_rgb(*color, self.background);
            let (luma, blue, red) = rgb_to_ycbcr(r, g, b);
            buffers.iter_mut().zip([luma, blue, red]).for_each(|(buffer, value)| buffer.push(value));
        }
    }
}

/// Writes a JPEG like [`write_jpeg`], to a file and atomically.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`].
pub fn save_jpeg(path: &Path, overwrite: bool, planes: &PlanesView<'_>, options: &JpegOptions) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_jpeg(out, planes, options))
}

fn to_rgb([r, g, b, a]: [f32; 4], background: [f32; 3]) -> [u8; 3] {
    // The comparison is false for NaN, so that a pixel without valid alpha shows only the background.
    let (color, behind) = if a > 0.0 { ([r, g, b], 1.0 - a.min(1.0)) } else { ([0.0; 3], 1.0) };
    std::array::from_fn(|c| nearest_8_bit(color[c] + behind * background[c]))
}
