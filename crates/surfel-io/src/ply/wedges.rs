//! Texture coordinates per face corner (wedges), as MeshLab writes them: vertices are split where corners differ.

use super::mesh::place;
use super::table::Lists;
use crate::polygons::Triangulator;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_model::{AlphaMode, Column3, Mesh, MeshMaterial, Texture, TriangleMaterials};

/// Texture coordinates of the corners of triangles, and the textures of these triangles. The triangles were cut from
/// the polygons of a mesh.
pub(super) struct Wedges {
    /// Texture coordinates of each triangle's corners, with v downwards; `None` for polygons without coordinates.
    coordinates: Vec<Option<[[f32; 2]; 3]>>,
    /// Texture index of each triangle; `u32::MAX` if the file states no valid one.
    textures: Vec<u32>,
}

impl Wedges {
    /// Converts the texture coordinates and texture indices of polygons to those of triangles. `corners` has the vertex
    /// indices of each polygon, and `positions` the position of each vertex. Polygons beyond the end of `coordinates`
    /// are left out. Without `textures`, all triangles have texture 0.
    pub(super) fn new(
        (corners, positions): (&Lists<u32>, &Column3),
        coordinates: &Lists<f32>,
        textures: Option<&[f64]>,
    ) -> Self {
        let mut wedges = Self { coordinates: Vec::new(), textures: Vec::new() };
        let mut cutter = Triangulator::default();
        for (face, (polygon, uvs)) in corners.iter().zip(coordinates.iter()).enumerate() {
            let is_whole = uvs.len() == 2 * polygon.len();
            let texture = textures.map_or(0.0, |all| all.get(face).copied().unwrap_or(-1.0));
            // PLY has v upwards, as OpenGL; the model has it downwards, as images.
            let at = |k: usize| [uvs[2 * k], 1.0 - uvs[2 * k + 1]];
            for triangle in cutter.cut(polygon, |i| place(positions, i)) {
                wedges.coordinates.push(is_whole.then(|| triangle.map(|corner| at(corner as usize))));
                wedges.textures.push(if (0.0..1e9).contains(&texture) { texture as u32 } else { u32::MAX });
            }
        }
        wedges
    }

    /// Adds texture coordinates and textures to a mesh. The triangles of these wedges must be the first of the mesh, in
    /// the same order. A vertex whose corners have different texture coordinates or textures is duplicated. A mesh with
    /// invalid vertex indices stays unchanged.
    pub(super) fn split(&self, mesh: &mut Mesh, textures: &[Option<Arc<Texture>>]) {
        if mesh.triangles.iter().flatten().any(|i| *i as usize >= mesh.positions.len()) {
            return;
        }
        let mut known: HashMap<(u32, u32, [u32; 2]), u32> = HashMap::with_capacity(mesh.positions.len());
        let (mut sources, mut uvs) = (Vec::new(), Vec::new());
        let mut of_triangle = Vec::with_capacity(mesh.triangles.len());
        for (i, triangle) in mesh.triangles.iter_mut().enumerate() {
            let shown = self.coordinates.get(i).copied().flatten();
            let texture = self.textures.get(i).filter(|t| shown.is_some() && (**t as usize) < textures.len());
            let texture = texture.map_or(textures.len() as u32, |t| *t);
            let shown = shown.unwrap_or_default();
            for (vertex, uv) in triangle.iter_mut().zip(shown) {
                *vertex = *known.entry((*vertex, texture, uv.map(f32::to_bits))).or_insert_with(|| {
                    sources.push(*vertex);
                    uvs.push(uv);
                    sources.len() as u32 - 1
                });
            }
            of_triangle.push(texture);
        }
        mesh.uvs = None;
        mesh.select_vertices(&sources);
        mesh.uvs = Some(uvs);
        match textures {
            [one] if of_triangle.iter().all(|t| *t == 0) => mesh.texture.clone_from(one),
            _ => {
                let material = |texture: &Option<Arc<Texture>>| MeshMaterial {
                    texture: texture.clone(),
                    alpha: AlphaMode::Blend,
                    normal_map: None,
                };
                // The last material is for triangles without a texture.
                let materials = textures.iter().chain([&None]).map(material).collect();
                mesh.materials = Some(TriangleMaterials { materials, of_triangle });
            }
        }
    }
}
