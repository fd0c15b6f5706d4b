//! MTL material libraries: base colour, opacity and base-colour texture.

use crate::ascii::{Lines, number, words};
use crate::error::quote;
use crate::load::Context;
use crate::mesh_build::Material;
use crate::texture;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_model::Texture;

/// Most textures that one file may bring, which bounds the memory for them.
const MAX_TEXTURES: usize = 64;

struct Entry {
    color: [f32; 3],
    alpha: f32,
    map: Option<String>,
}

/// The materials of `names` (name → index) and their textures; empty if none of them says anything. Whatever is
/// missing is noted, and white.
pub(super) fn resolve(
    libraries: &[String],
    names: &HashMap<String, u32>,
    context: &mut Context<'_>,
) -> (Vec<Material>, Vec<Arc<Texture>>) {
    let mut entries: HashMap<String, Entry> = HashMap::new();
    let mut known: Vec<&String> = Vec::new();
    for library in libraries {
        if known.contains(&library) || known.len() >= MAX_TEXTURES {
            continue;
        }
        known.push(library);
        match context.beside.read(library) {
            Ok(bytes) => parse(&bytes, folder_of(library), &mut entries),
            Err(why) => context.note(format!("left out the material library {}: {why}", quote(library))),
        }
    }
    let mut materials = vec![Material::WHITE; names.len()];
    let mut textures: Vec<Arc<Texture>> = Vec::new();
    let mut loaded: HashMap<&str, Option<usize>> = HashMap::new();
    let mut in_order: Vec<(&String, u32)> = names.iter().map(|(name, &i)| (name, i)).collect();
    in_order.sort_unstable_by_key(|&(_, i)| i);
    for (name, i) in in_order {
        let Some(entry) = entries.get(name) else {
            continue;
        };
        let image = entry.map.as_deref().and_then(|map| {
            if let Some(&index) = loaded.get(map) {
                return index;
            }
            let result = if textures.len() < MAX_TEXTURES {
                context.beside.read(map).and_then(|bytes| context.textures.decode(&bytes))
            } else {
                Err(format!("there are more than {MAX_TEXTURES}"))
            };
            let index = match result {
                Ok(texture) => {
                    textures.push(Arc::new(texture));
                    Some(textures.len() - 1)
                }
                Err(why) => {
                    context.note(texture::missing(map, &why));
                    None
                }
            };
            loaded.insert(map, index);
            index
        });
        // Many exporters write a black Kd beside a texture and mean the texture.
        let [r, g, b] = if image.is_some() && entry.color == [0.0; 3] { [1.0; 3] } else { entry.color };
        if let Some(material) = materials.get_mut(i as usize) {
            *material = Material { factor: [r, g, b, entry.alpha], texture: image };
        }
    }
    if materials.iter().all(|m| m.texture.is_none() && m.factor == [1.0; 4]) {
        materials.clear();
    }
    (materials, textures)
}

/// The folder that a library's path names, with its separator: its textures lie relative to it.
fn folder_of(library: &str) -> &str {
    &library[..library.rfind(['/', '\\']).map_or(0, |at| at + 1)]
}

fn parse(bytes: &[u8], folder: &str, entries: &mut HashMap<String, Entry>) {
    let mut current: Option<String> = None;
    for (_, line) in Lines::new(bytes) {
        let mut words = words(line);
        let Some(keyword) = words.next() else { continue };
        let rest = super::rest_of(line, keyword);
        if keyword == b"newmtl" {
            entries.insert(rest.clone(), Entry { color: [1.0; 3], alpha: 1.0, map: None });
            current = Some(rest);
            continue;
        }
        let Some(entry) = current.as_ref().and_then(|name| entries.get_mut(name)) else { continue };
        let mut fraction = || words.next().and_then(number).filter(|v| v.is_finite()).map(|v| v.clamp(0.0, 1.0) as f32);
        match keyword {
            b"Kd" => {
                if let Some(r) = fraction() {
                    // One number stands for three.
                    let g = fraction().unwrap_or(r);
                    entry.color = [r, g, fraction().unwrap_or(g)];
                }
            }
            b"d" => entry.alpha = fraction().unwrap_or(1.0),
            b"Tr" => entry.alpha = 1.0 - fraction().unwrap_or(0.0),
            b"map_Kd" => {
                let map = without_options(&rest);
                let is_whole = std::path::Path::new(&map).is_absolute();
                entry.map = Some(if is_whole { map } else { format!("{folder}{map}") });
            }
            _ => {}
        }
    }
}

/// The file name of a map statement, which options such as `-s 1 1 1` may precede.
fn without_options(statement: &str) -> String {
    if !statement.starts_with('-') {
        return statement.to_owned();
    }
    let mut rest = statement;
    while let Some(option) = rest.strip_prefix('-') {
        rest = option.trim_start_matches(|c: char| !c.is_whitespace()).trim_start();
        while let Some((word, after)) = rest.split_once(char::is_whitespace) {
            if word.parse::<f64>().is_err() && word != "on" && word != "off" {
                break;
            }
            rest = after.trim_start();
        }
    }
    rest.to_owned()
}
