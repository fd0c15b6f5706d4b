//! Decoding of WebP, lossy or lossless; only the first frame of an animation is decoded.

use crate::decode::{Decoded, Samples, texels};
use image_webp::WebPDecoder;
use std::io::Cursor;

fn decoder(bytes: &[u8]) -> Result<WebPDecoder<Cursor<&[u8]>>, String> {
    WebPDecoder::new(Cursor::new(bytes)).map_err(|e| e.to_string())
}

/// Returns width and height from the header.
pub(super) fn size_of(bytes: &[u8]) -> Result<(u32, u32), String> {
    decoder(bytes).map(|decoder| decoder.dimensions())
}

/// Decodes an image whose size has been checked, or returns the reason why that fails.
pub(super) fn decode(bytes: &[u8], max_bytes: usize) -> Result<Decoded, String> {
    let mut decoder = decoder(bytes)?;
    decoder.set_memory_limit(max_bytes);
    let (width, height) = decoder.dimensions();
    let channels = if decoder.has_alpha() { 4 } else { 3 };
    let size = decoder.output_buffer_size().filter(|&size| size <= max_bytes);
    let mut data = vec![0; size.ok_or("its samples take more memory than they may")?];
    // The decoder is written for hostile input. If it panics nevertheless, the image is refused.
    let read = || decoder.read_image(&mut data).map_err(|e| e.to_string());
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).unwrap_or_else(|_| Err("it is damaged".into()))?;
    Ok(Decoded { width, height, samples: Samples::Eight(texels(&data, channels, u8::MAX)) })
}
