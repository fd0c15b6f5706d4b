//! Base-colour textures and matcaps: PNG, JPEG or WebP decoded to 8-bit texels.

use crate::decode::{can_hold, is_cut_jpeg, size_of};
use crate::reduce::decode_reduced;
use std::path::Path;
use surfel_files::error::{Fault, IoError, Problem, quote};
use surfel_files::input;
use surfel_model::{Matcap, Texture};

/// Maximum texture side, in texels.
const MAX_SIDE: u32 = 32_768;
/// Default limit of a texture's longer side, in texels; larger textures are reduced.
const DEFAULT_MAX_SIDE: u32 = 8192;
/// Maximum memory for decoding, in bytes.
const MAX_BYTES: usize = 1 << 30;

/// Decoder of the PNG, JPEG or WebP images of one file, with a limit for all of them together.
#[derive(Debug)]
pub struct TextureDecoder {
    texels_left: u64,
    /// Maximum side of a texture that isn't reduced, in texels.
    max_side: u32,
    /// Number of reduced textures, and the first one's size before and after.
    reduced: Option<(usize, [u32; 4])>,
    /// Number of truncated JPEG textures, which are drawn as far as they go, and the name of the first.
    cut: Option<(usize, String)>,
}

impl TextureDecoder {
    /// Creates a decoder for one file's textures. Textures whose longer side exceeds `max_side` texels (`None`: 8192)
    /// are reduced.
    pub fn new(max_side: Option<u32>) -> Self {
        let max_side = max_side.unwrap_or(DEFAULT_MAX_SIDE).max(1);
        Self { texels_left: MAX_BYTES as u64 / 4, max_side, reduced: None, cut: None }
    }

    /// Returns notes about the decoded images.
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

    /// Decodes a PNG, JPEG or WebP image; `name` is for notes. A texture larger than the limit is reduced.
    ///
    /// # Errors
    /// A message with the reason, if the bytes are no such image, or the file's images exceed their common memory
    /// limit.
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

    /// Counts the texels of a converted texture against the file's limit; returns false if they exceed it.
    pub fn spend(&mut self, texels: u64) -> bool {
        let left = self.texels_left.checked_sub(texels);
        self.texels_left = left.unwrap_or(self.texels_left);
        left.is_some()
    }
}

/// Reads a matcap: an image (PNG, JPEG or WebP) of a lit sphere.
///
/// # Errors
/// [`IoError::System`] if the file can't be read, [`IoError::Invalid`] if it isn't such an image, [`IoError::Model`] if
/// it has no texels or more than 2048 per side.
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

/// Returns the note about a texture that isn't used.
pub fn missing(name: &str, why: &str) -> String {
    let why: String = why.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("left out the texture {}: {why}", quote(name))
}
