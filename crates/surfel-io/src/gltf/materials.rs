//! Materials: the base colour, its texture, and how texture coordinates are moved for it.

use super::buffers::Asset;
use super::document::WEBP;
use super::uri;
use crate::context::Context;
use crate::error::quote;
use crate::images::texture;
use crate::materials::Material;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_model::{AlphaMode, Texture};

/// What is read of a document's materials.
#[derive(Default)]
pub(super) struct Materials {
    pub(super) all: Vec<BaseColor>,
    /// The textures that materials refer to by index, each image once.
    pub(super) textures: Vec<Arc<Texture>>,
}

/// A material's base colour, and which texture coordinates it takes.
pub(super) struct BaseColor {
    pub(super) material: Material,
    pub(super) transform: Option<TextureTransform>,
    /// The number of the attribute `TEXCOORD_n`.
    pub(super) set: u32,
}

/// uv' = translate(offset) · rotate(−rotation) · scale(scale) · uv, v downwards.
#[derive(Clone, Copy)]
pub(super) struct TextureTransform {
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
}

impl TextureTransform {
    pub(super) fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let (u, v) = (u * self.scale[0], v * self.scale[1]);
        let (sin, cos) = self.rotation.sin_cos();
        [cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]]
    }
}

impl Materials {
    /// Reads all materials. A texture that can't be had is noted and left out.
    pub(super) fn read(asset: &Asset<'_>, context: &mut Context<'_>) -> Self {
        let mut read = Self::default();
        let first_alike = first_alike(asset);
        let mut of_image: Vec<Option<Option<usize>>> = vec![None; first_alike.len()];
        for material in asset.document.gltf.materials() {
            let pbr = material.pbr_metallic_roughness();
            let (mut factor, info) = match material.pbr_specular_glossiness() {
                Some(older) => (older.diffuse_factor(), older.diffuse_texture()),
                None => (pbr.base_color_factor(), pbr.base_color_texture()),
            };
            let alpha = match material.alpha_mode() {
                gltf::material::AlphaMode::Opaque => AlphaMode::Opaque,
                gltf::material::AlphaMode::Mask => AlphaMode::Mask { cutoff: cutoff(&material) },
                gltf::material::AlphaMode::Blend => AlphaMode::Blend,
            };
            if alpha == AlphaMode::Opaque {
                factor[3] = 1.0;
            }
            let mut found = BaseColor { material: Material { factor, texture: None, alpha }, transform: None, set: 0 };
            if let Some(info) = info {
                let index = info.texture().index();
                let images = images_of(asset, &info.texture());
                if images.is_empty() {
                    context.note(texture::missing(&format!("texture {index}"), &why_empty(asset, index)));
                }
                // The first that can be had: a texture may come in a newer format with an older one to fall back to.
                let read_one = |image: usize| {
                    let image = *first_alike.get(image)?;
                    *of_image.get_mut(image)?.get_or_insert_with(|| {
                        let image = read_image(asset, image, context)?;
                        read.textures.push(Arc::new(image));
                        Some(read.textures.len() - 1)
                    })
                };
                found.material.texture = images.into_iter().find_map(read_one);
                found.set = info.tex_coord();
                if let Some(t) = info.texture_transform() {
                    found.transform =
                        Some(TextureTransform { offset: t.offset(), rotation: t.rotation(), scale: t.scale() });
                    found.set = t.tex_coord().unwrap_or(found.set);
                }
            }
            read.all.push(found);
        }
        read
    }
}

fn cutoff(material: &gltf::Material<'_>) -> f32 {
    material.alpha_cutoff().filter(|c| c.is_finite()).unwrap_or(0.5)
}

/// For each image the first with the same data: some exporters write one for every texture.
fn first_alike(asset: &Asset<'_>) -> Vec<usize> {
    let images = &asset.document.gltf.as_json().images;
    let mut known = HashMap::with_capacity(images.len());
    let all = images.iter().enumerate();
    all.map(|(i, image)| *known.entry((&image.uri, image.buffer_view.map(|view| view.value()))).or_insert(i)).collect()
}

/// A texture's images, the best one first.
fn images_of(asset: &Asset<'_>, texture: &gltf::Texture<'_>) -> Vec<usize> {
    let images = asset.document.gltf.as_json().images.len();
    let webp = asset.document.texture_extension(texture.index(), WEBP).and_then(|e| e.get("source")?.as_u64());
    let webp = webp.and_then(|image| usize::try_from(image).ok()).filter(|&image| image < images);
    let webp = webp.filter(|_| cfg!(feature = "webp"));
    webp.into_iter().chain(texture.source().map(|image| image.index())).collect()
}

/// Why a texture has no image that this reader knows of.
fn why_empty(asset: &Asset<'_>, texture: usize) -> String {
    match asset.document.texture_extensions(texture).next() {
        Some(WEBP) if !cfg!(feature = "webp") => {
            "this build reads no WebP (Cargo feature \"webp\" of surfel-io)".into()
        }
        Some(name) => format!("PNG, JPEG and WebP are read, and it needs the extension {}", quote(name)),
        None => "it has no image".into(),
    }
}

fn read_image(asset: &Asset<'_>, index: usize, context: &mut Context<'_>) -> Option<Texture> {
    let image = asset.document.gltf.as_json().images.get(index)?;
    let decoded = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => uri::read(uri, &context.siblings).and_then(|bytes| context.textures.decode(&bytes)),
        (None, Some(view)) => {
            asset.view_at(view.value()).map_err(|p| p.what).and_then(|bytes| context.textures.decode(bytes))
        }
        (None, None) => Err("it has no data".into()),
    };
    match decoded {
        Ok(texture) => Some(texture),
        Err(why) => {
            let name = image.uri.as_deref().filter(|u| !u.starts_with("data:"));
            context.note(texture::missing(name.unwrap_or(&format!("image {index}")), &why));
            None
        }
    }
}
