//! Textures and matcaps: PNG, JPEG or WebP images, decoded to 8-bit texels.

use crate::decode::{can_hold, is_cut_jpeg, size_of};
use crate::reduce::decode_reduced;
use std::path::Path;
use surfel_files::error::{Fault, IoError, Problem, quote};
use surfel_files::input;
use surfel_model::{Matcap, Texture};

/// Largest width or height of an image that is decoded as a texture, in texels. Larger images are refused.
const MAX_SIDE: u32 = 32_768;
/// Default maximum width or height of a texture, in texels. Larger images are reduced to it.
const DEFAULT_MAX_SIDE: u32 = 8192;
/// Maximum memory for decoding an image, in bytes. It also limits all textures of a mesh file together, at four bytes a
/// texel.
const MAX_BYTES: usize = 1 << 30;

/// Decoder for the PNG, JPEG and WebP images of one mesh file, with a common limit on their texels.
#[derive(Debug)]
pub struct TextureDecoder {
    texels_left: u64,
    /// Maximum width or height of a texture in texels; larger images are reduced to it.
    max_side: u32,
    /// Number of images that were reduced, and width and height in texels of the first one before and after; `None` if
    /// no image was reduced.
    reduced: Option<(usize, [u32; 4])>,
    /// Number of truncated JPEG images, whose missing pixels the decoder filled, and the name of the first one; `None`
    /// if no image was truncated.
    cut: Option<(usize, String)>,
}

impl TextureDecoder {
    /// Creates a decoder for the textures of one file. Images with a side of more than `max_side` texels are reduced;
    /// `None` means 8192.
    pub fn new(max_side: Option<u32>) -> Self {
        let max_side = max_side.unwrap_or(DEFAULT_MAX_SIDE).max(1);
        Self { texels_left: MAX_BYTES as u64 / 4, max_side, reduced: None, cut: None }
    }

    /// Returns notes for the user about images that were reduced or truncated.
    pub fn told(&self) -> Vec<String> {
        let reduced = self.reduced.map(|(count, [w, h, to_w, to_h])| {
            let which = if count == 1 { "a texture".to_owned() } else { format!("{count} textures, the first") };
            let limit = self.max_side;
            format!("reduced {which} of {w}x{h} texels to {to_w}x{to_h} (`max_texture={limit}` texels a side)")
        });
        let cut = self.cut.as_ref().map(|(count, name)| match count {
            1 => format!("the texture {} is cut off: the rest of it is filled up", quote(name)),
            _ => format!("{count} textures are cut off, the first of them {}: the rest is filled up", quote(name)),
        });
        reduced.into_iter().chain(cut).collect()
    }

    /// Decodes a PNG, JPEG or WebP image. An image larger than the limit is reduced. Notes use `name`.
    ///
    /// # Errors
    /// A message with the reason, if the bytes aren't an image in these formats. Also a message if a side has more than
    /// 32,768 texels, or if the images of the file exceed their common limit.
    pub fn decode(&mut self, bytes: &[u8], name: &str) -> Result<Texture, String> {
        let (width, height) = size_of(bytes)?;
        let texels = u64::from(width) * u64::from(height);
        if !can_hold(bytes, width, height) {
            return Err(format!("{} bytes can't hold its {width}x{height} texels", bytes.len()));
        }
        if texels > self.texels_left || width > MAX_SIDE || height > MAX_SIDE {
            return Err(format!("its {width}x{height} texels are more than the file's textures may have together"));
        }
        let factor = width.max(height).div_ceil(self.max_side).max(1);
        let texture = decode_reduced(bytes, MAX_BYTES, [width.div_ceil(factor), height.div_ceil(factor)])?;
        self.texels_left -= texels;
        if is_cut_jpeg(bytes) {
            let (count, first) = self.cut.take().unwrap_or_else(|| (0, name.to_owned()));
            self.cut = Some((count + 1, first));
        }
        if factor > 1 {
            let first = [width, height, texture.width, texture.height];
            let (count, first) = self.reduced.map_or((0, first), |(count, first)| (count, first));
            self.reduced = Some((count + 1, first));
        }
        Ok(texture)
    }

    /// Subtracts the texels of a converted texture from the number that the file's textures may still have. Returns
    /// false, and subtracts nothing, if `texels` exceeds that number.
    pub fn spend(&mut self, texels: u64) -> bool {
        let left = self.texels_left.checked_sub(texels);
        self.texels_left = left.unwrap_or(self.texels_left);
        left.is_some()
    }
}

/// Reads a matcap: an image of a lit sphere, as PNG, JPEG or WebP.
///
/// # Errors
/// [`IoError::System`] if the file can't be read, [`IoError::Invalid`] if it isn't an image in these formats, or is a
/// truncated JPEG. [`IoError::Model`] if it has no texels or more than 2048 per side.
pub fn load_matcap(path: &Path) -> Result<Matcap, IoError> {
    let bytes = input::read(path, MAX_BYTES as u64)?;
    let image = TextureDecoder::new(None).decode(&bytes, "").and_then(|image| match is_cut_jpeg(&bytes) {
        true => Err("it is cut off".to_owned()),
        false => Ok(image),
    });
    let image = image.map_err(|why| {
        Fault::from(Problem::new(format!("is no image: {why}")).expected("a PNG, JPEG or WebP of a lit sphere"))
            .of(path)
    })?;
    Matcap::new(&image).map_err(|source| IoError::Model { path: path.to_path_buf(), source })
}

/// Returns a note that a texture is ignored, for the reason `why`.
pub fn missing(name: &str, why: &str) -> String {
    let why: String = why.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("left out the texture {}: {why}", quote(name))
}
