//! Decoding of PNG, JPEG and WebP to RGBA texels by the crate `image`, within a memory limit.
//!
//! Palettes, grey levels and samples of fewer than eight bits are expanded; 16-bit samples are preserved. Colour
//! profiles are ignored: samples are interpreted as sRGB-encoded with straight alpha. Only the first frame of an
//! animated WebP is decoded.

use image::{ColorType, ImageDecoder, ImageError, Limits};
use std::error::Error as _;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Maximum memory, in bytes, for reading the header of a PNG, with all chunks before the pixels.
const MAX_HEADER_BYTES: usize = 64 << 20;

/// Decoded image, with pixels in rows from the top.
pub(super) struct Decoded {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) samples: Samples,
}

/// Pixels of an image as RGBA, in rows from the top, with 8 or 16 bits per channel.
pub(super) enum Samples {
    Eight(Vec<[u8; 4]>),
    Sixteen(Vec<[u16; 4]>),
}

pub(super) fn is_png(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x89PNG\r\n\x1a\n")
}

fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8, 0xff])
}

fn is_webp(bytes: &[u8]) -> bool {
    bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP")
}

/// True if the bytes begin as a PNG, JPEG or WebP. Some builds lack the decoder for JPEG or WebP.
pub(super) fn is_image(bytes: &[u8]) -> bool {
    is_png(bytes) || is_jpeg(bytes) || is_webp(bytes)
}

/// True if a JPEG is truncated: the file ends before the end-of-image marker.
pub(super) fn is_cut_jpeg(bytes: &[u8]) -> bool {
    if !is_jpeg(bytes) {
        return false;
    }
    let mut at = 2;
    loop {
        // Segments begin with one or more 0xff bytes. Other bytes here are pixels or garbage.
        let Some(marker) = bytes.get(at..).and_then(|rest| rest.iter().position(|b| *b == 0xff)) else { return true };
        at += marker;
        let Some(code) = bytes[at..].iter().position(|b| *b != 0xff) else { return true };
        at += code;
        match bytes[at] {
            0xd9 => return false,
            // These are a stuffed byte within pixels, and markers without a segment.
            0x00 | 0x01 | 0xd0..=0xd8 => at += 1,
            _ => {
                let Some(length) = bytes.get(at + 1..at + 3) else { return true };
                at += 1 + usize::from(u16::from_be_bytes([length[0], length[1]])).max(2);
            }
        }
    }
}

/// True if a file of this length can contain as many pixels as its header states. This check prevents a small hostile
/// file from making the decoder allocate much memory.
///
/// Deflate compresses at most 1032 bytes into one, which are 8256 pixels of one bit; JPEG compresses less. A WebP may
/// have no bits per pixel, so that 4096² pixels are accepted in addition, whatever the file's length. For PNG and JPEG,
/// 65,536 pixels are.
pub(super) fn can_hold(bytes: &[u8], width: u32, height: u32) -> bool {
    let free = if is_webp(bytes) { 1 << 24 } else { 1 << 16 };
    u64::from(width) * u64::from(height) <= bytes.len() as u64 * 8256 + free
}

/// Creates the decoder for an image and reads the header. Returns the reason if this fails.
fn open<'a>(bytes: &'a [u8], max_bytes: usize) -> Result<Box<dyn ImageDecoder + 'a>, String> {
    let input = Cursor::new(bytes);
    if is_png(bytes) {
        let mut limits = Limits::no_limits();
        limits.max_alloc = Some(max_bytes as u64);
        let decoder = image::codecs::png::PngDecoder::with_limits(input, limits).map_err(reason)?;
        return Ok(Box::new(decoder));
    }
    if is_jpeg(bytes) {
        #[cfg(feature = "jpeg")]
        return Ok(Box::new(image::codecs::jpeg::JpegDecoder::new(input).map_err(reason)?));
        #[cfg(not(feature = "jpeg"))]
        return Err("this build reads no JPEG (Cargo feature \"jpeg\" of surfel-io)".into());
    }
    if is_webp(bytes) {
        #[cfg(feature = "webp")]
        return Ok(Box::new(image::codecs::webp::WebPDecoder::new(input).map_err(reason)?));
        #[cfg(not(feature = "webp"))]
        return Err("this build reads no WebP (Cargo feature \"webp\" of surfel-io)".into());
    }
    Err("it is neither PNG nor JPEG nor WebP".into())
}

/// Returns the codec's own message, without the name of the format that the crate `image` adds.
fn reason(error: ImageError) -> String {
    error.source().map_or_else(|| error.to_string(), ToString::to_string)
}

/// Returns width and height in pixels from the header of an image, or the reason why they can't be read.
pub(super) fn size_of(bytes: &[u8]) -> Result<(u32, u32), String> {
    open(bytes, MAX_HEADER_BYTES).map(|decoder| decoder.dimensions())
}

/// Decodes an image, whose size the caller has checked. Returns the reason if it can't be decoded, or if its samples
/// take more than `max_bytes` bytes.
pub(super) fn decode(bytes: &[u8], max_bytes: usize) -> Result<Decoded, String> {
    let decoder = open(bytes, max_bytes)?;
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let size = usize::try_from(decoder.total_bytes()).ok().filter(|&size| size <= max_bytes);
    let mut data = vec![0; size.ok_or("its samples take more memory than they may")?];
    // Codecs are written for hostile input. If one panics nevertheless, the image is refused.
    let read = || decoder.read_image_boxed(&mut data).map_err(reason);
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| Err("it is damaged".into()))?;
    let channels = usize::from(color.channel_count());
    let samples = match color {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            let words: Vec<u16> = data.chunks_exact(2).map(|b| u16::from_ne_bytes([b[0], b[1]])).collect();
            Samples::Sixteen(texels(&words, channels, u16::MAX))
        }
        _ => Samples::Eight(texels(&data, channels, u8::MAX)),
    };
    Ok(Decoded { width, height, samples })
}

/// Converts samples of one to four channels (grey, grey and alpha, RGB, RGBA) to RGBA.
pub(super) fn texels<T: Copy>(samples: &[T], channels: usize, opaque: T) -> Vec<[T; 4]> {
    match channels {
        1 => samples.iter().map(|&grey| [grey, grey, grey, opaque]).collect(),
        2 => samples.as_chunks().0.iter().map(|&[grey, alpha]| [grey, grey, grey, alpha]).collect(),
        3 => samples.as_chunks().0.iter().map(|&[r, g, b]| [r, g, b, opaque]).collect(),
        _ => samples.as_chunks().0.to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
