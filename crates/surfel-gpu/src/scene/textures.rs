//! Textures of polygons, in the layout of the shaders' `texels`.

use std::sync::Arc;
use surfel_model::{Mesh, Mipmaps, Texture};
use surfel_shaders::layout;

/// Buffer of all textures; each is stored once, with its mipmaps.
#[derive(Clone, Debug, Default)]
pub(crate) struct TextureBuffer {
    /// Words of the buffer: the linear values of the 256 sRGB-encoded byte values as f32, then the textures. Empty
    /// without textures.
    pub words: Vec<u32>,
    /// Textures that the buffer contains, each with its offset in words, so that none is stored twice.
    found: Vec<(Arc<Texture>, u32)>,
}

impl TextureBuffer {
    /// Returns the offset of a mesh's texture in `words`, and appends the texture if it is new. Returns
    /// `layout::ABSENT` for a mesh without a texture, texture coordinates, or enough texels.
    pub(crate) fn add(&mut self, mesh: &Mesh) -> u32 {
        let Some(texture) = mesh.texture.as_ref().filter(|t| mesh.uvs.is_some() && is_whole(t)) else {
            return layout::ABSENT;
        };
        if let Some((_, at)) = self.found.iter().find(|(other, _)| Arc::ptr_eq(other, texture)) {
            return *at;
        }
        if self.words.is_empty() {
            let decoded = |c: u32| surfel_math::srgb::decode(f64::from(c) / 255.0) as f32;
            self.words.extend((0..256).map(|c| decoded(c).to_bits()));
        }
        let at = self.words.len() as u32;
        let mipmaps = Mipmaps::new(texture.clone());
        self.words.extend([texture.width, texture.height, mipmaps.levels().count() as u32]);
        let texels = texture.width as usize * texture.height as usize;
        self.words.extend(texture.srgba8.iter().take(texels).map(|&t| u32::from_le_bytes(t)));
        for level in mipmaps.levels() {
            self.words.extend(level.iter().flat_map(|&[r, g, b, _]| [r, g, b]).map(f32::to_bits));
        }
        self.found.push((texture.clone(), at));
        at
    }
}

/// True if the texture has texels, and as many as its size requires. Other textures are drawn white.
fn is_whole(texture: &Texture) -> bool {
    let texels = texture.width as usize * texture.height as usize;
    texels > 0 && texture.srgba8.len() >= texels
}
