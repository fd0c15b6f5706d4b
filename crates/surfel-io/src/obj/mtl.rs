//! Reader of MTL material libraries: base colours, opacities and their textures, and normal maps.

use super::names;
use crate::ascii::{Lines, number, words};
use crate::context::Context;
use crate::error::quote;
use crate::materials::{Material, add_emission};
use crate::texture;
use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;
use surfel_model::{AlphaMode, Texture};

/// Maximum number of textures that are read for a file, which limits their memory; further ones are left out with
/// notes. It also limits the number of material libraries; further ones are ignored.
const MAX_TEXTURES: usize = 64;

struct Entry {
    color: [f32; 3],
    alpha: f32,
    map: Option<String>,
    opacity_map: Option<String>,
    bumps: Option<Bumps>,
    emission: Option<[f32; 3]>,
    emission_map: Option<String>,
}

impl Default for Entry {
    fn default() -> Self {
        Self {
            color: [1.0; 3],
            alpha: 1.0,
            map: None,
            opacity_map: None,
            bumps: None,
            emission: None,
            emission_map: None,
        }
    }
}

/// A bump map of a material, which contains normals or heights.
struct Bumps {
    map: String,
    /// Factor of the bumps' height, from the option `-bm`.
    scale: f32,
    /// True if the statement's keyword says that the map contains normals. Otherwise its pixels decide.
    are_normals: bool,
}

/// Names of the images that make up a material's colour texture.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct ColorImages<'a> {
    color: Option<&'a str>,
    opacity: Option<&'a str>,
}

impl ColorImages<'_> {
    /// Combines both images to one texture, of the size of the first image that can be read. Returns `None` if neither
    /// can be read. Adds a note on each image that can't be read, also if `so_far`, the number of textures that were
    /// read before, has reached [`MAX_TEXTURES`].
    fn read(self, so_far: usize, context: &mut Context<'_>) -> Option<Texture> {
        let mut decode = |map: Option<&str>| {
            let map = map?;
            let result = if so_far < MAX_TEXTURES {
                read(map, context).and_then(|bytes| context.textures.decode(&bytes, map))
            } else {
                Err(format!("there are more than {MAX_TEXTURES}"))
            };
            result.map_err(|why| context.note(texture::missing(map, &why))).ok()
        };
        let color = decode(self.color);
        // Many materials state the same image for both. The opacity is then that image's alpha.
        let opacity = if self.opacity == self.color { None } else { decode(self.opacity) };
        match (color, opacity) {
            (Some(color), Some(opacity)) => Some(with_opacity(color, &opacity)),
            (None, Some(opacity)) => {
                let white = Texture { srgba8: vec![[255; 4]; opacity.srgba8.len()], ..opacity };
                Some(with_opacity(white, &opacity))
            }
            (color, None) => color,
        }
    }
}

/// Smallest mean excess of blue over red and green from which a bump map contains normals, in 8-bit levels. Normals
/// mostly have z ≥ 0.5, and their x and y average to about 0, so that the excess is at least 64. Height maps are grey.
const NORMALS_BLUE: f64 = 32.0;

/// True if an image seems to contain tangent-space normals rather than heights, by its excess of blue
/// ([`NORMALS_BLUE`]). Most programs write both as `map_Bump`.
fn shows_normals(image: &Texture) -> bool {
    let blue = |[r, g, b, _]: &[u8; 4]| f64::from(*b) - 0.5 * (f64::from(*r) + f64::from(*g));
    image.srgba8.iter().map(blue).sum::<f64>() > NORMALS_BLUE * image.srgba8.len() as f64
}

/// Returns `color` with the opacity of another texture: its alpha or, if it is opaque, its grey.
fn with_opacity(mut color: Texture, opacity: &Texture) -> Texture {
    let has_alpha = opacity.srgba8.iter().any(|t| t[3] < 255);
    let of = |[r, g, b, a]: [u8; 4]| {
        let grey = (u16::from(r) + u16::from(g) + u16::from(b)) / 3;
        if has_alpha { a } else { grey as u8 }
    };
    let nearest = |at: u32, from: u32, to: u32| (u64::from(at) * u64::from(to) / u64::from(from)) as usize;
    let (width, height) = (color.width, color.height);
    for (y, row) in (0..height).zip(color.srgba8.chunks_mut(width.max(1) as usize)) {
        let start = nearest(y, height, opacity.height) * opacity.width as usize;
        for (x, texel) in (0..width).zip(row) {
            let found = opacity.srgba8.get(start + nearest(x, width, opacity.width));
            texel[3] = found.map_or(255, |&texel| of(texel));
        }
    }
    color
}

/// Reads the materials of `names` (name → index) and their textures from material libraries. Returns the materials by
/// index, and the textures to which they refer. Materials that no library defines are white. If all materials are
/// plain, returns no materials. Libraries and textures that can't be read, and bump maps of heights, are left out with
/// notes.
pub(super) fn resolve(
    libraries: &[String],
    names: &HashMap<String, u32>,
    context: &mut Context<'_>,
) -> (Vec<Material>, Vec<Arc<Texture>>) {
    let mut entries: HashMap<String, Entry> = HashMap::new();
    let mut known: HashSet<String> = HashSet::new();
    let all: Vec<String> =
        libraries.iter().flat_map(|statement| names::libraries(statement, &context.siblings)).collect();
    for library in all {
        if known.len() >= MAX_TEXTURES || !known.insert(library.clone()) {
            continue;
        }
        match read(&library, context) {
            Ok(bytes) => parse(&bytes, folder_of(&library), &mut entries, context),
            Err(why) => context.note(format!(
                "left out the material library {}, so that what it says of colours and textures is not drawn: {why}",
                quote(&library)
            )),
        }
    }
    let mut materials = vec![Material::WHITE; names.len()];
    let mut textures: Vec<Arc<Texture>> = Vec::new();
    let mut loaded: HashMap<ColorImages<'_>, Option<usize>> = HashMap::new();
    let mut loaded_normals: HashMap<(&str, bool), Option<usize>> = HashMap::new();
    let mut in_order: Vec<(&String, u32)> = names.iter().map(|(name, &i)| (name, i)).collect();
    in_order.sort_unstable_by_key(|&(_, i)| i);
    for (name, i) in in_order {
        let Some(entry) = entries.get(name) else {
            continue;
        };
        let maps = ColorImages { color: entry.map.as_deref(), opacity: entry.opacity_map.as_deref() };
        let image = *loaded.entry(maps).or_insert_with(|| {
            textures.push(Arc::new(maps.read(textures.len(), context)?));
            Some(textures.len() - 1)
        });
        let normal_map = entry.bumps.as_ref().and_then(|bumps| {
            let image = *loaded_normals.entry((&bumps.map, bumps.are_normals)).or_insert_with(|| {
                let image = ColorImages { color: Some(&bumps.map), opacity: None }.read(textures.len(), context)?;
                if !bumps.are_normals && !shows_normals(&image) {
                    let name = quote(&bumps.map);
                    context.note(format!("left out the bump map {name}: it holds heights, expected normals"));
                    return None;
                }
                textures.push(Arc::new(image));
                Some(textures.len() - 1)
            });
            Some((image?, bumps.scale))
        });
        let emission_map = entry.emission_map.as_deref().filter(|_| entry.emission != Some([0.0; 3]));
        let emission_map = emission_map.and_then(|map| {
            *loaded.entry(ColorImages { color: Some(map), opacity: None }).or_insert_with(|| {
                textures.push(Arc::new(ColorImages { color: Some(map), opacity: None }.read(textures.len(), context)?));
                Some(textures.len() - 1)
            })
        });
        // A map without a factor is emitted unchanged; a missing map emits nothing.
        let emission = match (&entry.emission_map, emission_map) {
            (Some(_), None) => [0.0; 3],
            (Some(_), Some(_)) => entry.emission.unwrap_or([1.0; 3]),
            (None, _) => entry.emission.unwrap_or_default(),
        };
        // Many exporters write a black Kd together with a texture that should be visible.
        let [r, g, b] = if image.is_some() && entry.color == [0.0; 3] { [1.0; 3] } else { entry.color };
        if let Some(material) = materials.get_mut(i as usize) {
            let factor = [r, g, b, entry.alpha];
            let alpha = AlphaMode::Blend;
            *material =
                Material { factor, texture: image, alpha, normal_map, emission, emission_map, single_sided: false };
        }
    }
    add_emission(materials.iter_mut(), &mut textures, context);
    if materials.iter().all(|m| m.texture.is_none() && m.normal_map.is_none() && m.is_plain()) {
        materials.clear();
    }
    (materials, textures)
}

/// Reads a file by its name or, failing that, by its percent-decoded name, which some exporters require.
fn read(name: &str, context: &Context<'_>) -> Result<Vec<u8>, String> {
    context.siblings.read(name).or_else(|why| match names::decoded(name) {
        Some(decoded) => context.siblings.read(&decoded),
        None => Err(why),
    })
}

/// Returns the folder of a library's path, with its separator. Names of textures are relative to it.
fn folder_of(library: &str) -> &str {
    &library[..library.rfind(['/', '\\']).map_or(0, |at| at + 1)]
}

fn parse(bytes: &[u8], folder: &str, entries: &mut HashMap<String, Entry>, context: &mut Context<'_>) {
    let mut current: Option<String> = None;
    for (_, line) in Lines::new(bytes) {
        let mut words = words(line);
        let Some(keyword) = words.next() else { continue };
        let rest = super::rest_of(line, keyword);
        if keyword == b"newmtl" {
            entries.insert(rest.clone(), Entry::default());
            current = Some(rest);
            continue;
        }
        let Some(entry) = current.as_ref().and_then(|name| entries.get_mut(name)) else { continue };
        let mut fraction = || words.next().and_then(number).filter(|v| v.is_finite()).map(|v| v.clamp(0.0, 1.0) as f32);
        match keyword {
            b"Kd" | b"Ke" => {
                if let Some(r) = fraction() {
                    // A single number applies to all three channels.
                    let g = fraction().unwrap_or(r);
                    let color = [r, g, fraction().unwrap_or(g)];
                    if keyword == b"Kd" { entry.color = color } else { entry.emission = Some(color) }
                }
            }
            b"d" => entry.alpha = fraction().unwrap_or(1.0),
            // MeshLab and similar programs write the opacity here, and no material is meant to be invisible.
            b"Tr" => entry.alpha = fraction().map(|tr| 1.0 - tr).filter(|alpha| *alpha > 0.0).unwrap_or(1.0),
            b"map_Kd" => entry.map = Some(path_of(&rest, folder, context)),
            b"map_d" => entry.opacity_map = Some(path_of(&rest, folder, context)),
            b"map_Ke" => entry.emission_map = Some(path_of(&rest, folder, context)),
            // `norm` is certain to be normals; a second bump map may be heights.
            b"norm" | b"map_Norm" => entry.bumps = Some(bumps(&rest, folder, true, context)),
            b"map_Bump" | b"map_bump" | b"bump" if entry.bumps.as_ref().is_none_or(|b| !b.are_normals) => {
                entry.bumps = Some(bumps(&rest, folder, false, context));
            }
            _ => {}
        }
    }
}

/// Parses a statement such as `map_Bump -bm 0.5 FILE`.
fn bumps(statement: &str, folder: &str, are_normals: bool, context: &mut Context<'_>) -> Bumps {
    let mut words = statement.split_whitespace().skip_while(|word| *word != "-bm").skip(1);
    let scale = words.next().and_then(|word| word.parse().ok()).filter(|scale: &f32| scale.is_finite());
    Bumps { map: path_of(statement, folder, context), scale: scale.unwrap_or(1.0), are_normals }
}

/// Returns the path of the image that a statement such as `map_Kd` names, below `folder` unless the name is absolute.
/// Options that move or scale the texture are ignored with a note.
fn path_of(statement: &str, folder: &str, context: &mut Context<'_>) -> String {
    let path = |map: &str| if Path::new(map).is_absolute() { map.to_owned() } else { format!("{folder}{map}") };
    let found = names::map(statement, |map| names::exists(&path(map), &context.siblings));
    if let Some(moved) = found.moved {
        context.note(format!("ignored {} of the texture {}", quote(&moved), quote(found.name)));
    }
    path(found.name)
}
