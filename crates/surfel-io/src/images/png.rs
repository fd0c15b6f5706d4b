//! Writing PNG: sRGB-encoded straight alpha, 8 or 16 bits.

use super::planes::PlanesView;
use crate::atomic;
use crate::color::{nearest_8_bit, nearest_16_bit};
use crate::error::IoError;
use std::io::{self, Write};
use std::path::Path;

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
    /// Text chunks: keyword (1 to 79 ASCII characters) and text; `tEXt` for ASCII, else `iTXt`.
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
    let mut writer = start_png(out, [planes.width, planes.height], options)?;
    let data: Vec<u8> = match options.depth {
        BitDepth::Eight => to_srgb8(color).into_flattened(),
        BitDepth::Sixteen => color.iter().map(|&c| to_16_bit(c)).collect::<Vec<_>>().into_flattened(),
    };
    writer.write_image_data(&data).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}

/// Writes all of a PNG that comes before its pixels, which are RGBA.
pub(super) fn start_png<W: Write>(
    out: W,
    [width, height]: [u32; 2],
    options: &PngOptions,
) -> io::Result<png::Writer<W>> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(match options.depth {
        BitDepth::Eight => png::BitDepth::Eight,
        BitDepth::Sixteen => png::BitDepth::Sixteen,
    });
    // Fast compression takes a tenth of the default's time and makes files 1.2 to 2.5 times as large.
    encoder.set_compression(png::Compression::Fast);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    for (key, text) in &options.metadata {
        let key: String = key.chars().filter(|c| matches!(c, ' '..='~')).take(79).collect();
        let text = text.replace('\0', " ");
        // Every reader knows tEXt, whose characters are Latin-1.
        let ascii = text.is_ascii();
        let added = if ascii { encoder.add_text_chunk(key, text) } else { encoder.add_itxt_chunk(key, text) };
        added.map_err(io::Error::other)?;
    }
    encoder.write_header().map_err(io::Error::other)
}

/// As [`write_png`], to a file that appears whole or not at all.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`].
pub fn save_png(path: &Path, overwrite: bool, planes: &PlanesView<'_>, options: &PngOptions) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_png(out, planes, options))
}

/// Linear premultiplied colours as a PNG of 8 bits holds them: sRGB-encoded, straight alpha. NaN becomes 0.
pub fn to_srgb8(color: &[[f32; 4]]) -> Vec<[u8; 4]> {
    color.iter().map(|&c| to_8_bit(c)).collect()
}

fn straight([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    // A NaN fails the comparison, too: nothing can be divided by it.
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
