//! Writing of PNG images, sRGB-encoded with straight alpha in 8 or 16 bits, and reading of their text chunks.

use crate::color::nearest_16_bit;
use crate::decode::is_png;
use crate::planes::PlanesView;
use std::borrow::Cow;
use std::io::{self, Cursor, Write};
use std::path::Path;
use surfel_files::atomic;
use surfel_files::error::IoError;
use surfel_math::srgb::{encode_rgba8, straight};

/// Number of bits of a PNG's samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BitDepth {
    /// 8 bits per sample.
    #[default]
    Eight,
    /// 16 bits per sample.
    Sixteen,
}

/// Options for writing a PNG.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PngOptions {
    /// Number of bits per sample.
    pub depth: BitDepth,
    /// Text chunks, as keywords (1 to 79 ASCII characters) and texts. ASCII texts become `tEXt` chunks, others `iTXt`.
    pub metadata: Vec<(String, String)>,
}

/// Writes the colour plane as PNG: sRGB-encoded with straight alpha, and an sRGB chunk. NaN becomes 0. An 8-bit PNG is
/// written from the encoded plane (`rgba8`) if there is one.
///
/// # Errors
/// [`io::Error`] if there is no colour plane, its size is wrong, or `out` fails.
pub fn write_png(out: &mut dyn Write, planes: &PlanesView<'_>, options: &PngOptions) -> io::Result<()> {
    planes.pixels()?;
    let encoded = planes.rgba8.filter(|_| options.depth == BitDepth::Eight);
    let missing = || io::Error::new(io::ErrorKind::InvalidInput, "a PNG needs a colour plane");
    let color = if encoded.is_some() { &[] } else { planes.color.ok_or_else(missing)? };
    let mut writer = start_png(out, [planes.width, planes.height], options)?;
    let data: Cow<'_, [u8]> = match (encoded, options.depth) {
        (Some(encoded), _) => encoded.as_flattened().into(),
        (None, BitDepth::Eight) => to_srgb8(color).into_flattened().into(),
        (None, BitDepth::Sixteen) => color.iter().map(|&c| to_16_bit(c)).collect::<Vec<_>>().into_flattened().into(),
    };
    writer.write_image_data(&data).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}

/// Writes the beginning of an RGBA PNG up to its pixels: header and text chunks. Returns the writer for the pixels.
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
        // All readers support tEXt, whose characters are Latin-1.
        let ascii = text.is_ascii();
        let added = if ascii { encoder.add_text_chunk(key, text) } else { encoder.add_itxt_chunk(key, text) };
        added.map_err(io::Error::other)?;
    }
    encoder.write_header().map_err(io::Error::other)
}

/// Writes a PNG like [`write_png`], to a file and atomically.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`].
pub fn save_png(path: &Path, overwrite: bool, planes: &PlanesView<'_>, options: &PngOptions) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_png(out, planes, options))
}

/// Converts linear premultiplied colours to 8-bit sRGB with straight alpha, exactly as [`write_png`] does for an 8-bit
/// PNG. NaN becomes 0.
pub fn to_srgb8(color: &[[f32; 4]]) -> Vec<[u8; 4]> {
    color.iter().map(|&c| encode_rgba8(c)).collect()
}

fn to_16_bit(color: [f32; 4]) -> [u8; 8] {
    let [r, g, b, a] = straight(color);
    let [r, g, b] = [r, g, b].map(|c| nearest_16_bit(c).to_be_bytes());
    let a = ((a * 65_535.0 + 0.5) as u16).to_be_bytes();
    [r[0], r[1], g[0], g[1], b[0], b[1], a[0], a[1]]
}

/// Returns keywords and texts of a PNG's `tEXt` and `iTXt` chunks before its pixels, sorted by keyword. Returns nothing
/// for other formats.
pub(super) fn texts(bytes: &[u8]) -> Vec<(String, String)> {
    if !is_png(bytes) {
        return Vec::new();
    }
    let Ok(reader) = png::Decoder::new(Cursor::new(bytes)).read_info() else { return Vec::new() };
    texts_of(reader.info())
}

/// Returns keywords and texts of the text chunks that precede the pixels of a PNG, sorted by keyword.
pub(super) fn texts_of(info: &png::Info<'_>) -> Vec<(String, String)> {
    let latin = info.uncompressed_latin1_text.iter().map(|c| (c.keyword.clone(), c.text.clone()));
    let utf8 = info.utf8_text.iter().filter_map(|c| Some((c.keyword.clone(), c.get_text().ok()?)));
    let mut texts: Vec<_> = latin.chain(utf8).collect();
    texts.sort();
    texts
}
