//! Materials: base colours, textures, and transforms of texture coordinates.

use super::buffers::Asset;
use super::document::{EMISSIVE_STRENGTH, UNLIT, WEBP};
use super::uri;
use super::wrap::Wrap;
use crate::context::Context;
use crate::error::quote;
use crate::materials::{Material, add_emission};
use crate::texture;
use serde_json::Value;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;
use surfel_model::{AlphaMode, Texture};

/// The materials of a document, and those of their textures that Surfel uses.
#[derive(Default)]
pub(super) struct Materials {
    pub(super) all: Vec<BaseColor>,
    /// Textures, to which materials refer by index. Each image occurs once.
    pub(super) textures: Vec<Arc<Texture>>,
}

/// A material's base colour, and the texture coordinates that its textures use.
pub(super) struct BaseColor {
    pub(super) material: Material,
    pub(super) transform: Option<TextureTransform>,
    /// Index n of the attribute `TEXCOORD_n` with the material's texture coordinates.
    pub(super) set: u32,
    /// Wrap modes of the material's textures along u and v.
    pub(super) wrap: [Wrap; 2],
}

/// Transform of texture coordinates: uv' = translate(offset) · rotate(−rotation) · scale(scale) · uv, with v downwards
/// and the rotation in radians.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct TextureTransform {
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
}

impl TextureTransform {
    /// Parses the extension `KHR_texture_transform`; all of its keys have defaults.
    fn of(extension: &Value) -> Self {
        let number = |key: &str, default: [f32; 2]| {
            let pair = extension.get(key).and_then(Value::as_array);
            let at = |i: usize| pair.and_then(|p| p.get(i)?.as_f64()).map_or(default[i], |v| v as f32);
            [at(0), at(1)]
        };
        let rotation = extension.get("rotation").and_then(Value::as_f64).unwrap_or(0.0) as f32;
        Self { offset: number("offset", [0.0; 2]), rotation, scale: number("scale", [1.0; 2]) }
    }

    pub(super) fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let (u, v) = (u * self.scale[0], v * self.scale[1]);
        let (sin, cos) = self.rotation.sin_cos();
        [cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]]
    }
}

impl Materials {
    /// Reads all materials of a document. A texture that can't be read is dropped with a note, as is a normal map or
    /// emissive texture with other texture coordinates than the colours. Without its texture, emission is dropped, too.
    pub(super) fn read(asset: &Asset<'_>, context: &mut Context<'_>) -> Self {
        let mut read = Self::default();
        let first_with_same_data = first_with_same_data(asset);
        let primitives = asset.document.gltf.meshes().flat_map(|mesh| mesh.primitives());
        let used: BTreeSet<usize> = primitives.filter_map(|primitive| primitive.material().index()).collect();
        // Exporters that never state the flag leave all materials single-sided, whatever their surfaces are.
        let states_sides = used.iter().any(|material| is_double_sided(asset, *material));
        let mut of_image: Vec<Option<Option<usize>>> = vec![None; first_with_same_data.len()];
        for (number, material) in asset.document.gltf.materials().enumerate() {
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
            let single_sided = states_sides && !is_double_sided(asset, number);
            let material = Material { factor, alpha, single_sided, ..Material::WHITE };
            let mut found = BaseColor { material, transform: None, set: 0, wrap: [Wrap::Repeat; 2] };
            // Uses the first image that can be read: a texture may have a newer format with an older one as fallback.
            let mut read_first = |images: Vec<usize>, context: &mut Context<'_>| {
                images.into_iter().find_map(|image| {
                    let image = *first_with_same_data.get(image)?;
                    *of_image.get_mut(image)?.get_or_insert_with(|| {
                        let image = read_image(asset, image, context)?;
                        read.textures.push(Arc::new(image));
                        Some(read.textures.len() - 1)
                    })
                })
            };
            if let Some(info) = info {
                let index = info.texture().index();
                let images = images_of(asset, &info.texture());
                if images.is_empty() {
                    context.note(texture::missing(&format!("texture {index}"), &why_empty(asset, index)));
                }
                found.material.texture = read_first(images, context);
                found.wrap = Wrap::of(&asset.document.raw, index);
                found.set = info.tex_coord();
                if let Some(t) = info.texture_transform() {
                    found.transform =
                        Some(TextureTransform { offset: t.offset(), rotation: t.rotation(), scale: t.scale() });
                    found.set = t.tex_coord().unwrap_or(found.set);
                }
            }
            let shown = asset.document.material(number).filter(|_| used.contains(&number));
            let emission = shown.map_or([0.0; 3], emission);
            if emission != [0.0; 3] {
                found.material.emission = emission;
                let map =
                    asset.document.material(number).and_then(|m| MapTexture::of(asset, m.get("emissiveTexture")?));
                if let Some(map) = map {
                    if found.shares_coordinates(&map) {
                        found.material.emission_map = read_first(map.images, context);
                    } else {
                        let what = "left out an emissive texture whose coordinates aren't the colours'";
                        context.note(what.to_owned());
                    }
                    // Without its image, the emissive part of the surface is unknown.
                    if found.material.emission_map.is_none() {
                        found.material.emission = [0.0; 3];
                    }
                }
            }
            if let Some(normals) = asset.document.normal_texture(number).and_then(|v| MapTexture::of(asset, v)) {
                if found.shares_coordinates(&normals) {
                    let image = read_first(normals.images, context);
                    found.material.normal_map = image.map(|image| (image, normals.scale));
                } else {
                    let what = "left out a normal map whose texture coordinates aren't the colours'";
                    context.note(what.to_owned());
                }
            }
            read.all.push(found);
        }
        let Self { all, textures } = &mut read;
        add_emission(all.iter_mut().map(|base| &mut base.material), textures, context);
        read
    }
}

impl BaseColor {
    /// True if `map` uses the same attribute and transform of texture coordinates as the material's other textures, as
    /// drawing requires. If the material has no colour or emissive texture yet, it adopts those of `map`, and its wrap
    /// modes.
    fn shares_coordinates(&mut self, map: &MapTexture) -> bool {
        if self.material.texture.is_none() && self.material.emission_map.is_none() {
            (self.set, self.transform, self.wrap) = (map.set, map.transform, map.wrap);
        }
        (self.set, self.transform) == (map.set, map.transform)
    }
}

/// True if a material states that its surfaces are visible from both sides.
fn is_double_sided(asset: &Asset<'_>, material: usize) -> bool {
    asset.document.material(material).and_then(|m| m.get("doubleSided")?.as_bool()) == Some(true)
}

/// Returns a material's emissive colour, linear: the factor times its strength, from 0 to 10⁶. Unlit materials show
/// only the base colour and return zeros.
fn emission(material: &Value) -> [f32; 3] {
    let extension = |name: &str| material.get("extensions").and_then(|all| all.get(name));
    if extension(UNLIT).is_some() {
        return [0.0; 3];
    }
    let strength = extension(EMISSIVE_STRENGTH).and_then(|e| e.get("emissiveStrength")?.as_f64()).unwrap_or(1.0);
    let factor = |k: usize| material.get("emissiveFactor").and_then(|all| all.get(k)?.as_f64()).unwrap_or(0.0);
    [0, 1, 2].map(|k| factor(k) * strength).map(|c| if c.is_finite() { c.clamp(0.0, 1e6) as f32 } else { 0.0 })
}

/// A normal map or emission texture of a material.
struct MapTexture {
    images: Vec<usize>,
    scale: f32,
    set: u32,
    transform: Option<TextureTransform>,
    wrap: [Wrap; 2],
}

impl MapTexture {
    /// Parses a reference to a texture, as unchecked JSON. Returns `None` if the texture doesn't exist or has no
    /// supported image.
    fn of(asset: &Asset<'_>, said: &Value) -> Option<Self> {
        let number = |of: &Value, key: &str| of.get(key).and_then(Value::as_u64).and_then(|v| u32::try_from(v).ok());
        let texture = asset.document.gltf.textures().nth(number(said, "index")? as usize)?;
        let images = images_of(asset, &texture);
        let scale = said.get("scale").and_then(Value::as_f64).filter(|v| v.is_finite()).unwrap_or(1.0) as f32;
        let extension = said.get("extensions").and_then(|all| all.get("KHR_texture_transform"));
        let set = extension.and_then(|e| number(e, "texCoord")).or_else(|| number(said, "texCoord")).unwrap_or(0);
        let (transform, wrap) = (extension.map(TextureTransform::of), Wrap::of(&asset.document.raw, texture.index()));
        (!images.is_empty()).then_some(Self { images, scale, set, transform, wrap })
    }
}

fn cutoff(material: &gltf::Material<'_>) -> f32 {
    material.alpha_cutoff().filter(|c| c.is_finite()).unwrap_or(0.5)
}

/// Returns, for each image, the index of the first image with the same URI and buffer view, so that each is decoded
/// once. Some exporters write one image per texture.
fn first_with_same_data(asset: &Asset<'_>) -> Vec<usize> {
    let images = &asset.document.gltf.as_json().images;
    let mut known = HashMap::with_capacity(images.len());
    let all = images.iter().enumerate();
    all.map(|(i, image)| *known.entry((&image.uri, image.buffer_view.map(|view| view.value()))).or_insert(i)).collect()
}

/// Returns the indices of a texture's images in order of preference: a WebP image, then the fallback.
fn images_of(asset: &Asset<'_>, texture: &gltf::Texture<'_>) -> Vec<usize> {
    let images = asset.document.gltf.as_json().images.len();
    let webp = asset.document.texture_extension(texture.index(), WEBP).and_then(|e| e.get("source")?.as_u64());
    let webp = webp.and_then(|image| usize::try_from(image).ok()).filter(|&image| image < images);
    let webp = webp.filter(|_| cfg!(feature = "webp"));
    webp.into_iter().chain(texture.source().map(|image| image.index())).collect()
}

/// Returns the reason, for a note, why a texture has no supported image.
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
    let name = image.uri.as_deref().filter(|u| !u.starts_with("data:"));
    let name = name.map_or_else(|| format!("image {index}"), str::to_owned);
    let decoded = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => uri::read(uri, &context.siblings).and_then(|bytes| context.textures.decode(&bytes, &name)),
        (None, Some(view)) => {
            asset.view_at(view.value()).map_err(|p| p.what).and_then(|bytes| context.textures.decode(bytes, &name))
        }
        (None, None) => Err("it has no data".into()),
    };
    match decoded {
        Ok(texture) => Some(texture),
        Err(why) => {
            context.note(texture::missing(&name, &why));
            None
        }
    }
}
