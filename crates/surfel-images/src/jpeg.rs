//! Decoding of JPEG, baseline and progressive, to 8-bit texels.

use crate::decode::{Decoded, Samples, texels};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

type Decoder<'a> = JpegDecoder<ZCursor<&'a [u8]>>;

/// Opens a decoder and reads the headers; also returns width and height.
fn open(bytes: &[u8]) -> Result<(Decoder<'_>, u32, u32), String> {
    // The caller limits the size. These limits never apply: a header has 16 bits per side.
    let options = DecoderOptions::default().set_strict_mode(false).set_max_width(65_535).set_max_height(65_535);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("it has no size")?;
    Ok((decoder, width as u32, height as u32))
}

/// Returns width and height from the header.
pub(super) fn size_of(bytes: &[u8]) -> Result<(u32, u32), String> {
    open(bytes).map(|(_, width, height)| (width, height))
}

/// Decodes an image whose size has been checked.
pub(super) fn decode(bytes: &[u8]) -> Result<Decoded, String> {
    let (mut decoder, width, height) = open(bytes)?;
    let grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let (space, channels) = if grey { (ColorSpace::Luma, 1) } else { (ColorSpace::RGB, 3) };
    decoder.set_options(decoder.options().jpeg_set_out_colorspace(space));
    let data = decoder.decode().map_err(|e| e.to_string())?;
    let expected = width as usize * height as usize;
    let texels = texels(&data, channels, u8::MAX);
    if texels.len() != expected {
        return Err(format!("it has {} texels instead of {expected}", texels.len()));
    }
    Ok(Decoded { width, height, samples: Samples::Eight(texels) })
}
