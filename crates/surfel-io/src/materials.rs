//! One mesh of a file's parts and their materials. Base colours become colours of the vertices, of which each belongs
//! to one material; textures and what alpha means stay the triangles' own.

use crate::columns::measured_positions;
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use glam::DVec3;
use std::sync::Arc;
use surfel_model::{AlphaMode, Column3, Mesh, MeshMaterial, NormalMap, SeeThroughTextures, Texture, TriangleMaterials};

/// Base colour of a part, and what its alpha means.
#[derive(Clone, Debug)]
pub(crate) struct Material {
    /// Linear RGB and straight alpha.
    pub(crate) factor: [f32; 4],
    /// Index into the file's textures.
    pub(crate) texture: Option<usize>,
    pub(crate) alpha: AlphaMode,
    /// Index into the file's textures, and its scale.
    pub(crate) normal_map: Option<(usize, f32)>,
}

impl Material {
    pub(crate) const WHITE: Self = Self { factor: [1.0; 4], texture: None, alpha: AlphaMode::Opaque, normal_map: None };
}

/// Vertices and triangles with a material each; all columns have one value a vertex.
#[derive(Default)]
pub(crate) struct Parts {
    pub(crate) positions: Vec<DVec3>,
    /// Every decimal of the positions is the file's own.
    pub(crate) exact: bool,
    pub(crate) normals: Option<Vec<[f32; 3]>>,
    pub(crate) uvs: Option<Vec<[f32; 2]>>,
    /// Linear RGB and alpha.
    pub(crate) colors: Option<Vec<[f32; 4]>>,
    pub(crate) materials_of: Vec<u32>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) comments: Vec<String>,
}

impl Context<'_> {
    /// One mesh of all parts. A material that isn't there is white and opaque.
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
        let tinted = parts.colors.is_some() || vertices().any(|i| material_of(i).factor != [1.0; 4]);
        let colors: Option<Vec<[f32; 4]>> = tinted.then(|| {
            let tint = |i: u32| {
                let (m, mut c) = (material_of(i), parts.colors.as_ref().map_or([1.0; 4], |c| c[i as usize]));
                c.iter_mut().zip(m.factor).for_each(|(c, f)| *c *= f);
                // What alpha says nothing about needs no column of it.
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
        // The last one is for what has none.
        let all: Vec<MeshMaterial> = materials.iter().chain([&Material::WHITE]).map(made_of).collect();
        let index_of = |t: &[u32; 3]| {
            let index = parts.materials_of.get(t[0] as usize).map_or(materials.len(), |&i| i as usize);
            index.min(materials.len()) as u32
        };
        let of_triangle: Vec<u32> = parts.triangles.iter().map(index_of).collect();
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
            up: None,
            comments: parts.comments,
        })
    }
}

/// The texture of all triangles if they share one, and the materials unless that texture says it all.
fn shared(all: TriangleMaterials, vertex_alphas: bool) -> (Option<Arc<Texture>>, Option<TriangleMaterials>) {
    let mut used = vec![false; all.materials.len()];
    all.of_triangle.iter().for_each(|&i| used[i as usize] = true);
    let mut in_use = all.materials.iter().zip(used).filter(|(_, used)| *used).map(|(m, _)| m);
    let Some(first) = in_use.next() else { return (None, None) };
    // Where nothing has an alpha below 1, all modes are alike.
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
