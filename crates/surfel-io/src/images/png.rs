//! PNG: sRGB-encoded straight alpha, 8 or 16 bits.

use super::{Planes, PlanesView};
use crate::color::{linear_of_8_bit, linear_of_16_bit, nearest_8_bit, nearest_16_bit};
use crate::error::Problem;
use crate::{IoError, atomic, texture};
use image::{DynamicImage, ImageReader};
use std::io::{self, Cursor, Write};
use std::path::Path;
use surfel_model::{MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE};

/// Bits of a PNG's samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BitDepth {
    /// 8 bits.
    #[default]
    Eight,
    /// 16 bits.
    Sixteen,
}

/// How to write a PNG.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PngOptions {
    /// Bits a sample.
    pub depth: BitDepth,
    /// Text chunks: keyword (1 to 79 Latin-1 characters) and text.
    pub metadata: Vec<(String, String)>,
}

/// Writes the colour plane as PNG: sRGB-encoded, straight alpha, with an sRGB chunk. NaN becomes 0.
///
/// # Errors
/// [`io::Error`] if there is no colour plane, its size is wrong, or `out` fails.
pub fn write_png(out: &mut dyn Write, planes: &PlanesView<'_>, options: &PngOptions) -> io::Result<()> {
    let pixels = planes.pixels()?;
    let color = planes.color.filter(|c| c.len() == pixels);
    let color = color.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a PNG needs a colour plane"))?;
    let mut encoder = png::Encoder::new(out, planes.width, planes.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(match options.depth {
        BitDepth::Eight => png::BitDepth::Eight,
        BitDepth::Sixteen => png::BitDepth::Sixteen,
    });
    // Ten times as fast as the default (measured: 60 ms instead of 700 ms for 2 MP); files are 1.2 to 2.5 times as large.
    encoder.set_compression(png::Compression::Fast);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    for (key, text) in &options.metadata {
        let key: String = key.chars().filter(|c| matches!(c, ' '..='~')).take(79).collect();
        encoder.add_itxt_chunk(key, text.replace('\0', " ")).map_err(io::Error::other)?;
    }
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    let data: Vec<u8> = match options.depth {
        BitDepth::Eight => color.iter().map(|&c| to_8_bit(c)).collect::<Vec<_>>().into_flattened(),
        BitDepth::Sixteen => color.iter().map(|&c| to_16_bit(c)).collect::<Vec<_>>().into_flattened(),
    };
    writer.write_image_data(&data).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}

/// As [`write_png`], to a file that appears whole or not at all.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`].
pub fn save_png(path: &Path, overwrite: bool, planes: &PlanesView<'_>, options: &PngOptions) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_png(out, planes, options))
}

fn straight([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    // Also where alpha is NaN: nothing can be divided by it.
    if a > 0.0 { [r / a, g / a, b / a, a.min(1.0)] } else { [0.0; 4] }
}

fn to_8_bit(color: [f32; 4]) -> [u8; 4] {
    let [r, g, b, a] = straight(color);
    [nearest_8_bit(r), nearest_8_bit(g), nearest_8_bit(b), (a * 255.0 + 0.5) as u8]
}

fn to_16_bit(color: [f32; 4]) -> [u8; 8] {
    let [r, g, b, a] = straight(color);
    let [r, g, b] = [r, g, b].map(|c| nearest_16_bit(c).to_be_bytes());
    let a = ((a * 65_535.0 + 0.5) as u16).to_be_bytes();
    [r[0], r[1], g[0], g[1], b[0], b[1], a[0], a[1]]
}

pub(super) fn read(bytes: &[u8]) -> Result<Planes, Problem> {
    let problem = |e: &dyn std::fmt::Display| {
        let why: String = e.to_string().chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
        Problem::new(format!("can't be read as a picture: {why}")).help("copy or export the file again: it is damaged")
    };
    let open = || ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let (width, height) = open().map_err(|e| problem(&e))?.into_dimensions().map_err(|e| problem(&e))?;
    if u64::from(width) * u64::from(height) > MAX_IMAGE_PIXELS {
        let what = format!("is a picture of {width}x{height} pixels");
        return Err(Problem::new(what).expected(format!("at most {MAX_IMAGE_PIXELS} pixels")));
    }
    if !texture::can_hold(bytes.len(), width, height) {
        let what = format!("says that it has {width}x{height} pixels, but is {} bytes long", bytes.len());
        return Err(Problem::new(what).help("copy or export the file again: it is damaged"));
    }
    let mut reader = open().map_err(|e| problem(&e))?;
    // 16 bytes a pixel while decoding, and 16 for the result.
    reader.limits(texture::limits(MAX_IMAGE_SIDE, 8 << 30));
    let decoded = reader.decode().map_err(|e| problem(&e))?;
    let (width, height) = (decoded.width(), decoded.height());
    let premultiply = |[r, g, b, a]: [f32; 4]| [r * a, g * a, b * a, a];
    let sixteen = !matches!(
        decoded,
        DynamicImage::ImageLuma8(_)
            | DynamicImage::ImageLumaA8(_)
            | DynamicImage::ImageRgb8(_)
            | DynamicImage::ImageRgba8(_)
    );
    let color = if sixteen {
        let table = linear_of_16_bit();
        let of = |c: u16| table[usize::from(c)];
        let image = decoded.into_rgba16();
        let texels = image.as_raw().chunks_exact(4);
        texels.map(|t| premultiply([of(t[0]), of(t[1]), of(t[2]), f32::from(t[3]) / 65_535.0])).collect()
    } else {
        let table = linear_of_8_bit();
        let of = |c: u8| table[usize::from(c)];
        let image = decoded.into_rgba8();
        let texels = image.as_raw().chunks_exact(4);
        texels.map(|t| premultiply([of(t[0]), of(t[1]), of(t[2]), f32::from(t[3]) / 255.0])).collect()
    };
    Ok(Planes { width, height, color: Some(color), ..Planes::default() })
}
