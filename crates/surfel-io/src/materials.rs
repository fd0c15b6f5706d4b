//! Merging of a file's parts and their materials into one mesh. Base colours become vertex colours, so that each vertex
//! belongs to one material; textures and alpha modes stay properties of triangles.

use crate::color::linear_of_8_bit;
use crate::columns::measured_positions;
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use crate::words::counted;
use glam::DVec3;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_math::srgb::nearest_8_bit;
use surfel_model::{
    AlphaMode, Column3, ExtraColumn, ExtraValues, Mesh, MeshMaterial, NormalMap, SeeThroughTextures, Texture,
    TriangleMaterials,
};

/// Name of the triangle column that is 1 for triangles visible only from outside, else 0. A mesh has it only if both
/// kinds occur.
const SINGLE_SIDED: &str = "single_sided";

/// Material of a part of a file: base colour, alpha mode, normal map and emission.
#[derive(Clone, Debug)]
pub(crate) struct Material {
    /// Base colour, in linear RGB and straight alpha.
    pub(crate) factor: [f32; 4],
    /// Index of the colour texture in the file's textures.
    pub(crate) texture: Option<usize>,
    pub(crate) alpha: AlphaMode,
    /// Index of the normal map in the file's textures, and the factor on its normals' components along right and up.
    pub(crate) normal_map: Option<(usize, f32)>,
    /// Emission in linear RGB, added to the colour independently of lighting.
    pub(crate) emission: [f32; 3],
    /// Index of the emission texture in the file's textures, which multiplies the emission.
    pub(crate) emission_map: Option<usize>,
    /// True if surfaces with the material are visible only from outside.
    pub(crate) single_sided: bool,
}

impl Material {
    pub(crate) const WHITE: Self = Self {
        factor: [1.0; 4],
        texture: None,
        alpha: AlphaMode::Opaque,
        normal_map: None,
        emission: [0.0; 3],
        emission_map: None,
        single_sided: false,
    };

    /// True if the material doesn't change the colours of vertices.
    pub(crate) fn is_plain(&self) -> bool {
        self.factor == [1.0; 4] && self.emission == [0.0; 3]
    }

    fn is_black(&self) -> bool {
        self.factor[..3] == [0.0; 3]
    }
}

/// Adds the emission of materials to their colours. If a material's colour or emission is textured, the sum becomes one
/// texture. If that would exceed the file's limit of texels, the emission is left out with a note. The sum is lit,
/// although emission shouldn't be; a note reports this.
pub(crate) fn add_emission<'a>(
    materials: impl Iterator<Item = &'a mut Material>,
    textures: &mut Vec<Arc<Texture>>,
    context: &mut Context<'_>,
) {
    let (mut added, mut left_out) = (0_u64, 0_u64);
    let mut known: HashMap<Emission, usize> = HashMap::new();
    // Many materials may share a large texture.
    let mut dark: HashMap<usize, bool> = HashMap::new();
    for material in materials {
        let is_dark = |i: usize| {
            *dark.entry(i).or_insert_with(|| {
                textures.get(i).is_none_or(|t: &Arc<Texture>| t.srgba8.iter().all(|t| t[..3] == [0; 3]))
            })
        };
        if material.emission == [0.0; 3] || material.emission_map.is_some_and(is_dark) {
            (material.emission, material.emission_map) = ([0.0; 3], None);
            continue;
        }
        if material.is_black() && material.alpha == AlphaMode::Opaque {
            material.texture = None;
        }
        // Emission without textures is added where colours become vertex colours.
        if material.texture.is_some() || material.emission_map.is_some() {
            let emission = Emission::of(material);
            let made = match known.get(&emission) {
                Some(made) => Some(*made),
                None => emission.texture(textures, context).map(|texture| {
                    textures.push(Arc::new(texture));
                    known.insert(emission, textures.len() - 1);
                    textures.len() - 1
                }),
            };
            (material.emission, material.emission_map) = ([0.0; 3], None);
            let Some(made) = made else {
                left_out += 1;
                continue;
            };
            material.texture = Some(made);
            material.factor = [1.0, 1.0, 1.0, material.factor[3]];
        }
        added += 1;
    }
    if added > 0 {
        context.note(format!("added the emissive colours of {} to their base colours", counted(added, "materials")));
    }
    if left_out > 0 {
        context.note(format!(
            "left out the emissive colours of {}: its textures are too many",
            counted(left_out, "materials")
        ));
    }
}

/// Base colour and emission of a material, whose sum becomes a texture. Materials with equal values share the texture.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Emission {
    texture: Option<usize>,
    /// Bits of the linear RGB that multiplies the base colour's texture.
    factor: [u32; 3],
    map: Option<usize>,
    emission: [u32; 3],
}

impl Emission {
    fn of(material: &Material) -> Self {
        let [r, g, b, _] = material.factor;
        Self {
            texture: material.texture,
            factor: [r, g, b].map(f32::to_bits),
            map: material.emission_map,
            emission: material.emission.map(f32::to_bits),
        }
    }

    /// Returns the sum of base colour and emission as a texture, of the size of the larger of the two textures. Returns
    /// `None` if it exceeds the file's limit of texels, or if neither is textured.
    fn texture(self, textures: &[Arc<Texture>], context: &mut Context<'_>) -> Option<Texture> {
        let [color, map] = [self.texture, self.map].map(|i| i.and_then(|i| textures.get(i)));
        let size = |t: &&Arc<Texture>| u64::from(t.width) * u64::from(t.height);
        let larger = [color, map].into_iter().flatten().max_by_key(size)?;
        if !context.textures.spend(size(&larger)) {
            return None;
        }
        let (width, height) = (larger.width, larger.height);
        let level = linear_of_8_bit();
        let texel = |of: Option<&Arc<Texture>>, x: u32, y: u32| {
            let nearest = |at: u32, from: u32, to: u32| u64::from(at) * u64::from(to) / u64::from(from.max(1));
            let at = |t: &Arc<Texture>| nearest(y, height, t.height) * u64::from(t.width) + nearest(x, width, t.width);
            of.and_then(|t| t.srgba8.get(at(t) as usize).copied()).unwrap_or([255; 4])
        };
        let [factor, emission] = [self.factor, self.emission].map(|bits| bits.map(f32::from_bits));
        let sum = |x: u32, y: u32| {
            let (own, glow) = (texel(color, x, y), texel(map, x, y));
            let linear = |k: usize| {
                let part = |texel: [u8; 4], factor: [f32; 3]| level[usize::from(texel[k])] * factor[k];
                part(own, factor) + part(glow, emission)
            };
            let [r, g, b] = [0, 1, 2].map(|k| nearest_8_bit(linear(k).min(1.0)));
            [r, g, b, own[3]]
        };
        let srgba8 = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| sum(x, y)).collect();
        Some(Texture { width, height, srgba8 })
    }
}

/// Vertices and triangles of all parts of a file. Each column of vertices has one value per vertex, and each vertex has
/// a material.
#[derive(Default)]
pub(crate) struct Parts {
    pub(crate) positions: Vec<DVec3>,
    /// True if the positions have all digits of the file. False if they were computed, so that their digits beyond f32
    /// are rounding errors.
    pub(crate) exact: bool,
    pub(crate) normals: Option<Vec<[f32; 3]>>,
    pub(crate) uvs: Option<Vec<[f32; 2]>>,
    /// Vertex colours, in linear RGB and alpha.
    pub(crate) colors: Option<Vec<[f32; 4]>>,
    pub(crate) materials_of: Vec<u32>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Further columns of the vertices, which Surfel doesn't interpret.
    pub(crate) extras: Vec<ExtraColumn>,
    pub(crate) comments: Vec<String>,
}

impl Context<'_> {
    /// Merges all parts into one mesh. A missing material is white and opaque.
    pub(crate) fn parts(
        &mut self,
        parts: Parts,
        materials: &[Material],
        textures: &[Arc<Texture>],
    ) -> Result<Content, Fault> {
        let material_of = |vertex: u32| {
            let index = parts.materials_of.get(vertex as usize);
            index.and_then(|&i| materials.get(i as usize)).unwrap_or(&Material::WHITE)
        };
        let vertices = || 0..parts.positions.len() as u32;
        let tinted = parts.colors.is_some() || vertices().any(|i| !material_of(i).is_plain());
        let colors: Option<Vec<[f32; 4]>> = tinted.then(|| {
            let tint = |i: u32| {
                let (m, mut c) = (material_of(i), parts.colors.as_ref().map_or([1.0; 4], |c| c[i as usize]));
                c.iter_mut().zip(m.factor).for_each(|(c, f)| *c *= f);
                if m.emission != [0.0; 3] {
                    c.iter_mut().zip(m.emission).for_each(|(c, e)| *c = (*c + e).min(1.0));
                }
                // An opaque material needs no alpha column.
                c[3] = if m.alpha == AlphaMode::Opaque { 1.0 } else { c[3].clamp(0.0, 1.0) };
                c
            };
            vertices().map(tint).collect()
        });
        let alphas = colors.as_ref().filter(|c| c.iter().any(|c| c[3] < 1.0));
        let alphas = alphas.map(|c| c.iter().map(|c| c[3]).collect());
        let texture_of =
            |m: &Material| m.texture.filter(|_| parts.uvs.is_some()).and_then(|t| textures.get(t)).cloned();
        let normal_map_of = |m: &Material| {
            let (image, scale) = m.normal_map.filter(|_| parts.uvs.is_some())?;
            Some(NormalMap { image: textures.get(image)?.clone(), scale })
        };
        let made_of =
            |m: &Material| MeshMaterial { texture: texture_of(m), alpha: m.alpha, normal_map: normal_map_of(m) };
        // The last material is for triangles without one.
        let all: Vec<MeshMaterial> = materials.iter().chain([&Material::WHITE]).map(made_of).collect();
        let index_of = |t: &[u32; 3]| {
            let index = parts.materials_of.get(t[0] as usize).map_or(materials.len(), |&i| i as usize);
            index.min(materials.len()) as u32
        };
        let of_triangle: Vec<u32> = parts.triangles.iter().map(index_of).collect();
        let is_single = |&i: &u32| u8::from(materials.get(i as usize).is_some_and(|m| m.single_sided));
        let single_sided: Vec<u8> = of_triangle.iter().map(is_single).collect();
        // The column is needed only if both kinds of triangles exist.
        let sides_differ = single_sided.contains(&0) && single_sided.contains(&1);
        let column = || ExtraColumn { name: SINGLE_SIDED.into(), values: ExtraValues::U8(single_sided) };
        let triangle_extras = sides_differ.then(column).into_iter().collect();
        let (texture, materials) = shared(TriangleMaterials { materials: all, of_triangle }, alphas.is_some());
        let (origin, positions) =
            if parts.exact { Column3::with_origin(&parts.positions) } else { measured_positions(&parts.positions) };
        self.mesh(Mesh {
            origin,
            positions,
            triangles: parts.triangles,
            normals: parts.normals,
            colors: colors.map(|c| c.iter().map(|c| [c[0], c[1], c[2]]).collect()),
            alphas,
            uvs: parts.uvs,
            texture,
            materials,
            vertex_extras: parts.extras,
            triangle_extras,
            comments: parts.comments,
            ..Mesh::default()
        })
    }
}

/// Returns the texture that all triangles share, or `None` if they differ or have none. Also returns the materials of
/// triangles, or `None` if the shared texture suffices.
fn shared(all: TriangleMaterials, vertex_alphas: bool) -> (Option<Arc<Texture>>, Option<TriangleMaterials>) {
    let mut used = vec![false; all.materials.len()];
    all.of_triangle.iter().for_each(|&i| used[i as usize] = true);
    let mut in_use = all.materials.iter().zip(used).filter(|(_, used)| *used).map(|(m, _)| m);
    let Some(first) = in_use.next() else { return (None, None) };
    // Without any alpha below 1, all alpha modes are equivalent.
    let mut see_through = SeeThroughTextures::default();
    let mut alphas_of = |m: &MeshMaterial| m.texture.as_ref().is_some_and(|t| see_through.contains(t));
    let mut plain = |m: &MeshMaterial| match m.alpha {
        _ if m.normal_map.is_some() => false,
        AlphaMode::Blend => true,
        AlphaMode::Opaque => !alphas_of(m),
        AlphaMode::Mask { cutoff } => cutoff <= 1.0 && !vertex_alphas && !alphas_of(m),
    };
    let same = |m: &MeshMaterial| m.texture.as_ref().map(Arc::as_ptr) == first.texture.as_ref().map(Arc::as_ptr);
    let (mut one_texture, mut all_plain) = (true, plain(first));
    for m in in_use {
        one_texture &= same(m);
        all_plain &= plain(m);
    }
    let texture = first.texture.clone().filter(|_| one_texture);
    let needed = !one_texture || !all_plain;
    (texture, needed.then_some(all))
}
