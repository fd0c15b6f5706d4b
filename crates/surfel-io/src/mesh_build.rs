//! Materials of a whole file into one mesh: a single texture stays one, several are baked into vertex colours.

use crate::columns::measured_positions;
use crate::error::Fault;
use crate::load::{Content, Context};
use glam::DVec3;
use std::sync::Arc;
use surfel_model::{Column3, Mesh, Texture};

/// Base colour of a part.
#[derive(Clone, Debug)]
pub(crate) struct Material {
    /// Linear RGB and straight alpha.
    pub(crate) factor: [f32; 4],
    /// Index into the file's textures.
    pub(crate) texture: Option<usize>,
}

impl Material {
    pub(crate) const WHITE: Self = Self { factor: [1.0; 4], texture: None };
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
    /// One mesh of all parts. A material that isn't there is white.
    pub(crate) fn parts(
        &mut self,
        parts: Parts,
        materials: &[Material],
        textures: &[Arc<Texture>],
    ) -> Result<Content, Fault> {
        let material = |i: u32| materials.get(i as usize).unwrap_or(&Material::WHITE);
        let mut used = vec![false; materials.len() + 1];
        for &i in &parts.materials_of {
            used[(i as usize).min(materials.len())] = true;
        }
        let used: Vec<&Material> = (0..).zip(&used).filter(|(_, used)| **used).map(|(i, _)| material(i)).collect();
        let mut kinds: Vec<Option<usize>> = used.iter().map(|m| m.texture.filter(|_| parts.uvs.is_some())).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let texture = if let [Some(one)] = kinds[..] { textures.get(one).cloned() } else { None };
        let textured = kinds.iter().flatten().count();
        let bake = texture.is_none() && textured > 0;
        if bake {
            self.note(format!(
                "baked {textured} textures into vertex colours, because parts of the mesh use different ones: detail between vertices is lost"
            ));
        }
        let tinted = parts.colors.is_some() || bake || used.iter().any(|m| m.factor != [1.0; 4]);
        let colors: Option<Vec<[f32; 4]>> = tinted.then(|| {
            (0..parts.positions.len())
                .map(|i| {
                    let m = parts.materials_of.get(i).map_or(&Material::WHITE, |&m| material(m));
                    let mut c = parts.colors.as_ref().map_or([1.0; 4], |c| c[i]);
                    multiply(&mut c, m.factor);
                    let image = m.texture.filter(|_| bake).and_then(|t| textures.get(t));
                    if let (Some(image), Some(uvs)) = (image, &parts.uvs) {
                        multiply(&mut c, image.sample(uvs[i]));
                    }
                    c
                })
                .collect()
        });
        let alphas = colors.as_ref().filter(|c| c.iter().any(|c| c[3] < 1.0));
        let alphas = alphas.map(|c| c.iter().map(|c| c[3].clamp(0.0, 1.0)).collect());
        // After baking, the coordinates belong to no texture.
        let uvs = if bake { None } else { parts.uvs };
        let (origin, positions) =
            if parts.exact { Column3::with_origin(&parts.positions) } else { measured_positions(&parts.positions) };
        self.mesh(Mesh {
            origin,
            positions,
            triangles: parts.triangles,
            normals: parts.normals,
            colors: colors.map(|c| c.iter().map(|c| [c[0], c[1], c[2]]).collect()),
            alphas,
            uvs,
            texture,
            up: None,
            comments: parts.comments,
        })
    }
}

fn multiply(color: &mut [f32; 4], by: [f32; 4]) {
    for (c, b) in color.iter_mut().zip(by) {
        *c *= b;
    }
}
