//! Reading of image files.

use crate::color::{linear_8_bit, linear_16_bit};
use crate::decode::{Samples, can_hold, decode, is_image, size_of};
use crate::planes::Planes;
use std::path::Path;
use surfel_files::error::{Fault, IoError, Problem, quote};
use surfel_files::input;
use surfel_model::{MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE};

/// Largest size of an image file that is read, in bytes.
const MAX_FILE_BYTES: u64 = 4 << 30;
/// Maximum memory for the decoded pixels of an image, in bytes.
const MAX_DECODED_BYTES: usize = 8 << 30;

/// Reads an image: an EXR with all of its planes, or a PNG, JPEG or WebP as linear premultiplied colours. The metadata
/// are the texts of EXR attributes, or of PNG chunks before the pixels.
///
/// # Errors
/// [`IoError::System`] if the file can't be read; [`IoError::Invalid`] if it is damaged, too large, or of another
/// format.
pub fn read_image(path: &Path) -> Result<Planes, IoError> {
    read_image_bytes(&input::read(path, MAX_FILE_BYTES)?, path)
}

/// Reads an image from memory, like [`read_image`]. Error messages use `name` as the file's path.
///
/// # Errors
/// Errors of [`read_image`].
pub fn read_image_bytes(bytes: &[u8], name: &Path) -> Result<Planes, IoError> {
    let read = || {
        if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            #[cfg(feature = "exr")]
            return crate::exr::read(bytes);
            #[cfg(not(feature = "exr"))]
            return Err(Problem::not_built("OpenEXR", "exr"));
        } else if is_image(bytes) {
            read_color(bytes)
        } else {
            let found = quote(&bytes[..bytes.len().min(12)]);
            Err(Problem::new(format!("is not an image that can be read: it starts with {found}"))
                .expected("OpenEXR, PNG, JPEG or WebP"))
        }
    };
    read().map_err(|problem| Fault::from(problem).of(name))
}

/// Decodes a PNG, JPEG or WebP image into a colour plane.
fn read_color(bytes: &[u8]) -> Result<Planes, Problem> {
    let problem = |why: String| {
        let why: String = why.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
        Problem::new(format!("can't be read as an image: {why}")).help("copy or export the file again: it is damaged")
    };
    let (width, height) = size_of(bytes).map_err(problem)?;
    let side = MAX_IMAGE_SIDE;
    if u64::from(width) * u64::from(height) > MAX_IMAGE_PIXELS || width > side || height > side {
        let what = format!("is an image of {width}x{height} pixels");
        return Err(Problem::new(what).expected(format!("at most {MAX_IMAGE_PIXELS} pixels, {side} a side")));
    }
    if !can_hold(bytes, width, height) {
        let what = format!("says that it has {width}x{height} pixels, but is {} bytes long", bytes.len());
        return Err(Problem::new(what).help("copy or export the file again: it is damaged"));
    }
    let image = decode(bytes, MAX_DECODED_BYTES).map_err(problem)?;
    let color = match image.samples {
        Samples::Eight(texels) => texels.into_iter().map(linear_8_bit).collect(),
        Samples::Sixteen(texels) => texels.into_iter().map(linear_16_bit).collect(),
    };
    let metadata = crate::png::texts(bytes);
    Ok(Planes { width: image.width, height: image.height, color: Some(color), metadata, ..Planes::default() })
}
