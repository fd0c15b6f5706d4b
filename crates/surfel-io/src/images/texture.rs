//! Base-colour textures and matcaps: PNG, JPEG or WebP as texels of 8 bits.

use super::decode::{Samples, can_hold, decode, size_of};
use crate::error::{Fault, IoError, Problem, quote};
use crate::files;
use std::path::Path;
use surfel_model::{Matcap, Texture};

/// Largest texture side, in texels.
const MAX_SIDE: u32 = 32_768;
/// Most memory that decoding may take, in bytes.
const MAX_BYTES: usize = 1 << 30;

/// Decodes PNG, JPEG or WebP images of one file, as long as they stay within what it may use together.
#[derive(Debug)]
pub(crate) struct TextureDecoder {
    texels_left: u64,
}

impl TextureDecoder {
    /// A decoder for one file's textures.
    pub(crate) fn new() -> Self {
        Self { texels_left: MAX_BYTES as u64 / 4 }
    }

    /// Decodes an image, or says why not.
    pub(crate) fn decode(&mut self, bytes: &[u8]) -> Result<Texture, String> {
        let (width, height) = size_of(bytes)?;
        let texels = u64::from(width) * u64::from(height);
        if !can_hold(bytes, width, height) {
            return Err(format!("{} bytes can't hold its {width}x{height} texels", bytes.len()));
        }
        if texels > self.texels_left || width > MAX_SIDE || height > MAX_SIDE {
            return Err(format!("its {width}x{height} texels are more than the file's textures may have together"));
        }
        let image = decode(bytes, MAX_BYTES)?;
        self.texels_left -= texels;
        let srgba8 = match image.samples {
            Samples::Eight(texels) => texels,
            Samples::Sixteen(texels) => texels.into_iter().map(|t| t.map(nearest_8_of_16_bit)).collect(),
        };
        Ok(Texture { width: image.width, height: image.height, srgba8 })
    }
}

/// The nearest of 256 levels.
fn nearest_8_of_16_bit(level: u16) -> u8 {
    ((u32::from(level) + 128) / 257) as u8
}

/// Reads an image (PNG, JPEG or WebP) of a lit sphere.
///
/// # Errors
/// [`IoError`] if the file can't be read, holds no such image, or one without texels or of more than 2048 a side.
pub fn load_matcap(path: &Path) -> Result<Matcap, IoError> {
    let bytes = files::read(path, MAX_BYTES as u64)?;
    let image = TextureDecoder::new().decode(&bytes).map_err(|why| {
        Fault::from(Problem::new(format!("is no image: {why}")).expected("a PNG, JPEG or WebP of a lit sphere"))
            .of(path)
    })?;
    Matcap::new(&image).map_err(|source| IoError::Model { path: path.to_path_buf(), source })
}

/// The note about a texture that isn't used.
#[cfg_attr(not(any(feature = "gltf", feature = "obj")), allow(dead_code))]
pub(crate) fn missing(name: &str, why: &str) -> String {
    let why: String = why.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("left out the texture {}: {why}", quote(name))
}
