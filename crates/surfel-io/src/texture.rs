//! Base-colour textures.

use crate::error::{Fault, Problem};
use crate::{IoError, files};
use image::{ImageReader, Limits};
use std::io::Cursor;
use std::path::Path;
use surfel_model::{Matcap, Texture};

/// Largest texture side, in texels.
const MAX_SIDE: u32 = 32_768;
/// Most memory that decoding may take, in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// Limits for decoding an image that may claim any size.
pub(crate) fn limits(max_side: u32, max_bytes: u64) -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(max_side);
    limits.max_image_height = Some(max_side);
    limits.max_alloc = Some(max_bytes);
    limits
}

/// True if `bytes` bytes of PNG or JPEG can hold that many pixels: decoders allocate by the header's word.
///
/// Deflate packs at most 1032 bytes into one, which is 8256 pixels of one bit; JPEG less.
pub(crate) fn can_hold(bytes: usize, width: u32, height: u32) -> bool {
    u64::from(width) * u64::from(height) <= bytes as u64 * 8256 + (1 << 16)
}

/// Decodes PNG or JPEG images of one file, as long as they stay within what it may use together.
#[derive(Debug)]
pub(crate) struct Decoder {
    texels_left: u64,
}

impl Decoder {
    /// A decoder for one file's textures.
    pub(crate) fn new() -> Self {
        Self { texels_left: MAX_BYTES / 4 }
    }

    /// Decodes an image, or says why not.
    pub(crate) fn decode(&mut self, bytes: &[u8]) -> Result<Texture, String> {
        let open = || ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string());
        let (width, height) = open()?.into_dimensions().map_err(|e| e.to_string())?;
        let texels = u64::from(width) * u64::from(height);
        if !can_hold(bytes.len(), width, height) {
            return Err(format!("{} bytes can't hold its {width}x{height} texels", bytes.len()));
        }
        if texels > self.texels_left {
            return Err(format!("its {width}x{height} texels are more than the file's textures may have together"));
        }
        let mut reader = open()?;
        reader.limits(limits(MAX_SIDE, MAX_BYTES));
        let image = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
        self.texels_left -= texels;
        let (width, height) = image.dimensions();
        let srgba8 = image.as_raw().chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]).collect();
        Ok(Texture { width, height, srgba8 })
    }
}

/// Reads an image (PNG or JPEG) of a lit ball.
///
/// # Errors
/// [`IoError`] if the file can't be read, holds no such image, or one without texels or of more than 2048 a side.
pub fn load_matcap(path: &Path) -> Result<Matcap, IoError> {
    let bytes = files::read(path, MAX_BYTES)?;
    let image = Decoder::new().decode(&bytes).map_err(|why| {
        Fault::from(Problem::new(format!("is no image: {why}")).expected("a PNG or JPEG of a lit ball")).of(path)
    })?;
    Matcap::new(&image).map_err(|source| IoError::Model { path: path.to_path_buf(), source })
}

/// The note about a texture that isn't used.
pub(crate) fn missing(name: &str, why: &str) -> String {
    let why: String = why.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("left out the texture {}: {why}", crate::error::quote(name))
}
