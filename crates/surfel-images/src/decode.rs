//! Decoding of PNG, JPEG and WebP to RGBA texels, within a memory limit.
//!
//! Palettes, greys and samples of fewer than eight bits are expanded; 16-bit samples stay. No colour profile is
//! applied: samples are interpreted as sRGB-encoded, and alpha as straight.

use crate::color::{linear_of_8_bit, linear_of_16_bit};
use std::io::Cursor;
use surfel_math::srgb::nearest_8_bit;
use surfel_model::Texture;

/// A decoded image, row by row from the top.
pub(super) struct Decoded {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) samples: Samples,
}

/// RGBA of each texel, with the file's number of bits.
pub(super) enum Samples {
    Eight(Vec<[u8; 4]>),
    Sixteen(Vec<[u16; 4]>),
}

pub(super) fn is_png(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x89PNG\r\n\x1a\n")
}

pub(super) fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8, 0xff])
}

/// True if a JPEG ends within its pixels, before the end-of-image marker.
pub(super) fn is_cut_jpeg(bytes: &[u8]) -> bool {
    if !is_jpeg(bytes) {
        return false;
    }
    let mut at = 2;
    loop {
        // Segments begin with one or more 0xff bytes; other bytes are pixels or garbage.
        let Some(marker) = bytes.get(at..).and_then(|rest| rest.iter().position(|b| *b == 0xff)) else { return true };
        at += marker;
        let Some(code) = bytes[at..].iter().position(|b| *b != 0xff) else { return true };
        at += code;
        match bytes[at] {
            0xd9 => return false,
            // A stuffed byte of pixels, and markers without a segment.
            0x00 | 0x01 | 0xd0..=0xd8 => at += 1,
            _ => {
                let Some(length) = bytes.get(at + 1..at + 3) else { return true };
                at += 1 + usize::from(u16::from_be_bytes([length[0], length[1]])).max(2);
            }
        }
    }
}

pub(super) fn is_webp(bytes: &[u8]) -> bool {
    bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP")
}

/// True if the bytes are an image of a format that this module decodes, in some builds at least.
pub(super) fn is_image(bytes: &[u8]) -> bool {
    is_png(bytes) || is_jpeg(bytes) || is_webp(bytes)
}

/// True if an image file of this length can contain that many pixels: decoders allocate by the header's size.
///
/// Deflate packs at most 1032 bytes into one, which is 8256 pixels of one bit; JPEG packs less. WebP has a form without
/// any bits per pixel, so that up to 4096² pixels of one colour are accepted.
pub(super) fn can_hold(bytes: &[u8], width: u32, height: u32) -> bool {
    let free = if is_webp(bytes) { 1 << 24 } else { 1 << 16 };
    u64::from(width) * u64::from(height) <= bytes.len() as u64 * 8256 + free
}

/// Returns the width and height from the file's header, or the reason why there is none.
pub(super) fn size_of(bytes: &[u8]) -> Result<(u32, u32), String> {
    if is_png(bytes) {
        let reader = png::Decoder::new(Cursor::new(bytes)).read_info().map_err(|e| e.to_string())?;
        return Ok(reader.info().size());
    }
    if is_jpeg(bytes) {
        #[cfg(feature = "jpeg")]
        return super::jpeg::size_of(bytes);
        #[cfg(not(feature = "jpeg"))]
        return Err("this build reads no JPEG (Cargo feature \"jpeg\" of surfel-io)".into());
    }
    if is_webp(bytes) {
        #[cfg(feature = "webp")]
        return super::webp::size_of(bytes);
        #[cfg(not(feature = "webp"))]
        return Err("this build reads no WebP (Cargo feature \"webp\" of surfel-io)".into());
    }
    Err("it is neither PNG nor JPEG nor WebP".into())
}

/// Decodes an image whose size has been checked, or returns the reason why it can't be decoded.
pub(super) fn decode(bytes: &[u8], max_bytes: usize) -> Result<Decoded, String> {
    if is_png(bytes) {
        return decode_png(bytes, max_bytes);
    }
    #[cfg(feature = "webp")]
    if is_webp(bytes) {
        return super::webp::decode(bytes, max_bytes);
    }
    #[cfg(feature = "jpeg")]
    return super::jpeg::decode(bytes);
    #[cfg(not(feature = "jpeg"))]
    Err("this build reads no JPEG (Cargo feature \"jpeg\" of surfel-io)".into())
}

/// Decodes an image whose size has been checked, and reduces it to `width` × `height` texels, at most its own size.
/// Each texel is the mean light, not the mean level, of the pixels that it covers. A PNG that isn't interlaced is never
/// in memory as a whole.
pub(super) fn decode_reduced(bytes: &[u8], max_bytes: usize, [width, height]: [u32; 2]) -> Result<Texture, String> {
    if (width, height) == size_of(bytes)? {
        let image = decode(bytes, max_bytes)?;
        let srgba8 = match image.samples {
            Samples::Eight(texels) => texels,
            Samples::Sixteen(texels) => texels.into_iter().map(|t| t.map(nearest_8_of_16_bit)).collect(),
        };
        return Ok(Texture { width: image.width, height: image.height, srgba8 });
    }
    if is_png(bytes) {
        let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: max_bytes });
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
        if !reader.info().interlaced {
            let (from, (color, depth)) = (reader.info().size(), reader.output_color_type());
            let mut reducer = Reducer::new(from, [width, height]);
            while let Some(row) = reader.next_row().map_err(|e| e.to_string())? {
                if depth == png::BitDepth::Sixteen {
                    let row = row.data().chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]]));
                    let row: Vec<u8> = row.map(nearest_8_of_16_bit).collect();
                    reducer.row(&texels(&row, color.samples(), u8::MAX));
                } else {
                    reducer.row(&texels(row.data(), color.samples(), u8::MAX));
                }
            }
            return Ok(reducer.finish());
        }
    }
    let image = decode(bytes, max_bytes)?;
    let mut reducer = Reducer::new((image.width, image.height), [width, height]);
    match image.samples {
        Samples::Eight(texels) => texels.chunks(image.width.max(1) as usize).for_each(|row| reducer.row(row)),
        Samples::Sixteen(texels) => {
            let rows = texels.chunks(image.width.max(1) as usize);
            rows.for_each(|row| reducer.row(&row.iter().map(|t| t.map(nearest_8_of_16_bit)).collect::<Vec<_>>()));
        }
    }
    Ok(reducer.finish())
}

/// Rounds a 16-bit level to 8 bits.
fn nearest_8_of_16_bit(level: u16) -> u8 {
    ((u32::from(level) + 128) / 257) as u8
}

/// Reduces an image, row by row.
struct Reducer {
    /// Number of rows of the original image.
    height: u32,
    size: [u32; 2],
    /// First source column of each texel, followed by the end of the last texel's columns.
    starts: Vec<usize>,
    /// Number of rows read.
    read: u32,
    /// Sums of linear premultiplied colours, with their weights, for the current row.
    sums: Vec<([f32; 4], f32)>,
    done: Vec<[u8; 4]>,
}

impl Reducer {
    fn new(from: (u32, u32), size: [u32; 2]) -> Self {
        let (width, to) = (u64::from(from.0), u64::from(size[0].max(1)));
        let starts = (0..=to).map(|x| (x * width).div_ceil(to) as usize).collect();
        let sums = vec![Default::default(); size[0] as usize];
        Self { height: from.1, size, starts, read: 0, sums, done: Vec::new() }
    }

    fn row(&mut self, row: &[[u8; 4]]) {
        let table = linear_of_8_bit();
        for ((sum, count), ends) in self.sums.iter_mut().zip(self.starts.windows(2)) {
            let part = row.get(ends[0]..ends[1]).unwrap_or_default();
            for [r, g, b, a] in part {
                let a = f32::from(*a) / 255.0;
                sum[0] += table[usize::from(*r)] * a;
                sum[1] += table[usize::from(*g)] * a;
                sum[2] += table[usize::from(*b)] * a;
                sum[3] += a;
            }
            *count += part.len() as f32;
        }
        let of = |row: u32| u64::from(row) * u64::from(self.size[1]) / u64::from(self.height.max(1));
        self.read += 1;
        if self.read >= self.height || of(self.read) != of(self.read - 1) {
            for (sum, count) in &mut self.sums {
                let straight = |c: f32| if sum[3] > 0.0 { nearest_8_bit(c / sum[3]) } else { 0 };
                let alpha = (sum[3] / count.max(1.0) * 255.0 + 0.5) as u8;
                self.done.push([straight(sum[0]), straight(sum[1]), straight(sum[2]), alpha]);
                (*sum, *count) = Default::default();
            }
        }
    }

    /// Returns the image; missing rows are transparent.
    fn finish(mut self) -> Texture {
        let [width, height] = self.size;
        self.done.resize(width as usize * height as usize, [0; 4]);
        Texture { width, height, srgba8: self.done }
    }
}

fn decode_png(bytes: &[u8], max_bytes: usize) -> Result<Decoded, String> {
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: max_bytes });
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let (width, height) = reader.info().size();
    let (color, depth) = reader.output_color_type();
    let size = reader.output_buffer_size().filter(|&size| size <= max_bytes);
    let mut data = vec![0; size.ok_or("its samples take more memory than they may")?];
    reader.next_frame(&mut data).map_err(|e| e.to_string())?;
    let samples = if depth == png::BitDepth::Sixteen {
        let words: Vec<u16> = data.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
        Samples::Sixteen(texels(&words, color.samples(), u16::MAX))
    } else {
        Samples::Eight(texels(&data, color.samples(), u8::MAX))
    };
    Ok(Decoded { width, height, samples })
}

/// Returns keywords and texts of a PNG's `tEXt` and `iTXt` chunks before its pixels, in order of keyword; nothing for
/// other formats.
pub(super) fn texts(bytes: &[u8]) -> Vec<(String, String)> {
    if !is_png(bytes) {
        return Vec::new();
    }
    let Ok(reader) = png::Decoder::new(Cursor::new(bytes)).read_info() else { return Vec::new() };
    texts_of(reader.info())
}

/// Returns the texts of a PNG that has been read up to its pixels.
pub(super) fn texts_of(info: &png::Info<'_>) -> Vec<(String, String)> {
    let latin = info.uncompressed_latin1_text.iter().map(|c| (c.keyword.clone(), c.text.clone()));
    let utf8 = info.utf8_text.iter().filter_map(|c| Some((c.keyword.clone(), c.get_text().ok()?)));
    let mut texts: Vec<_> = latin.chain(utf8).collect();
    texts.sort();
    texts
}

/// Converts samples of one to four channels (grey, grey and alpha, RGB, RGBA) to RGBA.
pub(super) fn texels<T: Copy>(samples: &[T], channels: usize, opaque: T) -> Vec<[T; 4]> {
    let of = |t: &[T]| match *t {
        [grey] => [grey, grey, grey, opaque],
        [grey, alpha] => [grey, grey, grey, alpha],
        [r, g, b] => [r, g, b, opaque],
        [r, g, b, alpha, ..] => [r, g, b, alpha],
        [] => [opaque; 4],
    };
    samples.chunks_exact(channels.max(1)).map(of).collect()
}

/// Converts a texel of 8-bit levels to a linear premultiplied colour.
pub(super) fn linear_8_bit([r, g, b, a]: [u8; 4]) -> [f32; 4] {
    let table = linear_of_8_bit();
    premultiply([r, g, b].map(|c| table[usize::from(c)]), f32::from(a) / 255.0)
}

/// Converts a texel of 16-bit levels to a linear premultiplied colour.
pub(super) fn linear_16_bit([r, g, b, a]: [u16; 4]) -> [f32; 4] {
    let table = linear_of_16_bit();
    premultiply([r, g, b].map(|c| table[usize::from(c)]), f32::from(a) / 65_535.0)
}

fn premultiply([r, g, b]: [f32; 3], a: f32) -> [f32; 4] {
    [r * a, g * a, b * a, a]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(width: u32, height: u32, texels: &[[u8; 4]]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.write_header().unwrap().write_image_data(texels.as_flattened()).unwrap();
        bytes
    }

    #[test]
    fn a_jpeg_is_cut_off_that_lacks_the_marker_at_its_end() {
        // A segment that contains an end-of-image marker, as a thumbnail's does; pixels with a stuffed byte and a
        // restart marker.
        let head = b"\xff\xd8\xff\xe1\x00\x06\xff\xd8\xff\xd9\xff\xda\x00\x04\x01\x02";
        let whole = [&head[..], b"\x12\xff\x00\x34\xff\xd0\x56\xff\xff\xd9 and more"].concat();
        assert!(!is_cut_jpeg(&whole) && !is_cut_jpeg(b"no JPEG"));
        for end in 3..whole.len() - 9 {
            assert!(is_cut_jpeg(&whole[..end]), "{end}");
        }
    }

    #[test]
    fn reduced_images_are_means_of_light() {
        // Alternating black and white: half the light is level 188, not 128. A transparent texel has no colour.
        let (k, w, none) = ([0, 0, 0, 255], [255; 4], [255, 0, 0, 0]);
        let bytes = png(4, 2, &[k, w, k, none, w, k, none, k]);
        let small = decode_reduced(&bytes, 1 << 20, [2, 1]).unwrap();
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.srgba8, [[188, 188, 188, 255], [0, 0, 0, 128]]);
        // Sides that don't divide evenly must not change a uniform colour.
        let bytes = png(5, 3, &[w; 15]);
        for size in [[1, 1], [2, 2], [3, 1], [5, 3]] {
            let small = decode_reduced(&bytes, 1 << 20, size).unwrap();
            assert_eq!(small.srgba8, vec![w; (size[0] * size[1]) as usize], "{size:?}");
        }
        assert!(decode_reduced(&bytes[..bytes.len() - 20], 1 << 20, [2, 2]).is_err(), "a part of an image");
    }
}
