//! Triangle meshes.

use crate::{Column3, ExtraColumn, ModelError, SeeThroughTextures, Texture, Up};
use glam::DVec3;
use std::collections::HashMap;
use std::sync::Arc;

/// Meaning of a surface's alpha (glTF's `alphaMode`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored: the surface is opaque.
    Opaque,
    /// The surface exists, and is opaque, where alpha is at least `cutoff`.
    Mask {
        /// Smallest alpha at which the surface exists. Below it, the surface is cut away.
        cutoff: f32,
    },
    /// Alpha is the opacity of the surface.
    #[default]
    Blend,
}

impl AlphaMode {
    /// Returns the opacity of a surface point with this alpha; 0 where a mask cuts the surface away.
    pub fn opacity(self, alpha: f32) -> f32 {
        match self {
            Self::Opaque => 1.0,
            Self::Mask { cutoff } => f32::from(alpha >= cutoff),
            Self::Blend => alpha,
        }
    }
}

/// Material of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshMaterial {
    /// Base-colour texture for the mesh's `uvs`, multiplied with the mesh's colours and alphas; `None` without a
    /// texture.
    pub texture: Option<Arc<Texture>>,
    /// Meaning of the alpha, which is the product of the texture's alpha and the mesh's `alphas`.
    pub alpha: AlphaMode,
    /// Normal map: shading normals with more detail than the mesh's own. `None` uses the mesh's own normals.
    pub normal_map: Option<NormalMap>,
}

/// Normal map: an image of shading normals in a triangle's own axes, which are right and up in the image, and out of
/// the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    /// Image at the mesh's texture coordinates `uvs`. A component of a normal is 2·level/255 − 1, for the image's 8-bit
    /// levels.
    pub image: Arc<Texture>,
    /// Factor on the components of the normals along right and up, which makes the relief stronger or weaker.
    pub scale: f32,
}

impl NormalMap {
    /// Returns the normal at the texture coordinates `uv`, with the components right, up and out, of about unit length.
    pub fn sample(&self, uv: [f32; 2]) -> [f32; 3] {
        let [x, y, z, _] = self.image.sample_numbers(uv).map(|v| 2.0 * v - 1.0);
        [x * self.scale, y * self.scale, z]
    }
}

/// Materials of a mesh, and the assignment of a material to each triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMaterials {
    /// Materials to which the indices in `of_triangle` refer.
    pub materials: Vec<MeshMaterial>,
    /// Index of each triangle's material in `materials`.
    pub of_triangle: Vec<u32>,
}

/// An indexed triangle mesh. Optional columns are `None` if the file doesn't have them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Origin of the positions in object space, in object units.
    pub origin: DVec3,
    /// Vertex positions relative to `origin`, in object units.
    pub positions: Column3,
    /// Corners of the triangles as indices of vertices, counter-clockwise when seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Normals in object space, of any length, one per vertex.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Linear RGB colours, one per vertex.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Alpha in [0, 1], one per vertex.
    pub alphas: Option<Vec<f32>>,
    /// Texture coordinates, one per vertex; (0, 0) is the texture's top left corner.
    pub uvs: Option<Vec<[f32; 2]>>,
    /// Base-colour texture for `uvs` shared by all triangles, multiplied with `colors`; `None` without a texture.
    pub texture: Option<Arc<Texture>>,
    /// Materials of the triangles; `None` if all share `texture`. Materials override `texture`.
    pub materials: Option<TriangleMaterials>,
    /// Properties of the vertices that Surfel doesn't interpret.
    pub vertex_extras: Vec<ExtraColumn>,
    /// Properties of the triangles that Surfel doesn't interpret.
    pub triangle_extras: Vec<ExtraColumn>,
    /// Up axis that the file states; `None` if it states none.
    pub up: Option<Up>,
    /// Comment lines of the file.
    pub comments: Vec<String>,
}

impl Mesh {
    /// Validates column lengths and indices, and that positions and colours are finite.
    ///
    /// # Errors
    /// [`ModelError::InvalidElements`] naming the first invalid element, [`ModelError::ColumnLength`] for a column of
    /// the wrong length.
    pub fn validate(&self) -> Result<(), ModelError> {
        let expected = self.positions.len();
        let columns = [
            ("normals", self.normals.as_ref().map(Vec::len)),
            ("colors", self.colors.as_ref().map(Vec::len)),
            ("alphas", self.alphas.as_ref().map(Vec::len)),
            ("uvs", self.uvs.as_ref().map(Vec::len)),
        ];
        for (column, found) in columns.into_iter().filter_map(|(c, n)| Some((c, n?))) {
            if found != expected {
                return Err(ModelError::ColumnLength { column, found, expected });
            }
        }
        let of_triangles = self.triangle_extras.iter().map(|extra| ("triangle_extras", extra, self.triangles.len()));
        let extras = self.vertex_extras.iter().map(|extra| ("vertex_extras", extra, expected)).chain(of_triangles);
        for (column, extra, expected) in extras {
            let found = extra.values.len();
            if found != expected {
                return Err(ModelError::ColumnLength { column, found, expected });
            }
        }
        let bad = |i: &usize| !self.positions.get(*i).is_finite();
        if let Some(index) = (0..expected).find(bad) {
            let count = (index..expected).filter(bad).count();
            return Err(ModelError::InvalidElements {
                what: "vertex",
                index,
                problem: "its position is not finite".into(),
                count,
                total: expected,
                advice: "remove them from the file",
            });
        }
        let bad = |i: &usize| self.colors.as_ref().is_some_and(|c| c[*i].iter().any(|c| !c.is_finite()));
        if let Some(index) = (0..expected).find(bad) {
            return Err(ModelError::InvalidElements {
                what: "vertex",
                index,
                problem: "its colour is not finite".into(),
                count: (index..expected).filter(bad).count(),
                total: expected,
                advice: "remove them from the file",
            });
        }
        let bad = |t: &&[u32; 3]| t.iter().any(|&i| i as usize >= expected);
        if let Some(index) = self.triangles.iter().position(|t| bad(&t)) {
            return Err(ModelError::InvalidElements {
                what: "triangle",
                index,
                problem: format!("it uses vertices {:?} of {expected}", self.triangles[index]),
                count: self.triangles.iter().filter(bad).count(),
                total: self.triangles.len(),
                advice: "the file is damaged",
            });
        }
        self.materials.as_ref().map_or(Ok(()), |m| m.validate(self.triangles.len()))
    }

    /// Returns the material of a triangle, by its index. Without [`Mesh::materials`], it is the shared texture, with
    /// alpha as opacity. An index out of range gives the default material.
    pub fn material(&self, triangle: usize) -> MaterialRef<'_> {
        match &self.materials {
            None => MaterialRef { texture: self.texture.as_ref(), alpha: AlphaMode::Blend, normal_map: None },
            Some(all) => {
                let own = all.of_triangle.get(triangle).and_then(|&i| all.materials.get(i as usize));
                own.map_or(MaterialRef::default(), |own| MaterialRef {
                    texture: own.texture.as_ref(),
                    alpha: own.alpha,
                    normal_map: own.normal_map.as_ref(),
                })
            }
        }
    }

    /// True if the mesh has texture coordinates and a texture.
    pub fn is_textured(&self) -> bool {
        self.uvs.is_some() && self.textures().next().is_some()
    }

    /// True if a triangle may be transparent: its material masks or blends it, and some alpha is below 1.
    pub fn is_see_through(&self) -> bool {
        let below_one = |alphas: &Vec<f32>| alphas.iter().any(|&a| a < 1.0);
        let of_vertices = self.alphas.as_ref().is_some_and(below_one);
        let mut see_through = SeeThroughTextures::default();
        let mut of = |texture: Option<&Arc<Texture>>, alpha: AlphaMode| {
            let mut in_texture = || self.uvs.is_some() && texture.is_some_and(|t| see_through.contains(t));
            match alpha {
                AlphaMode::Opaque => false,
                AlphaMode::Mask { cutoff } => cutoff > 0.0 && (of_vertices || in_texture()),
                AlphaMode::Blend => of_vertices || in_texture(),
            }
        };
        match &self.materials {
            None => of(self.texture.as_ref(), AlphaMode::Blend),
            Some(all) => all.materials.iter().any(|m| of(m.texture.as_ref(), m.alpha)),
        }
    }

    /// True if some material has a normal map.
    pub fn has_normal_maps(&self) -> bool {
        self.materials.as_ref().is_some_and(|all| all.materials.iter().any(|m| m.normal_map.is_some()))
    }

    /// Returns the textures of all materials, possibly with repetitions; without [`Mesh::materials`], the shared
    /// texture.
    pub fn textures(&self) -> impl Iterator<Item = &Arc<Texture>> {
        let materials = self.materials.as_ref();
        let shared = self.texture.as_ref().filter(|_| materials.is_none());
        shared
            .into_iter()
            .chain(materials.into_iter().flat_map(|all| &all.materials).filter_map(|m| m.texture.as_ref()))
    }

    /// Splits the mesh into meshes of one `texture` each, in the order of their first triangles, for drawing polygons.
    /// Triangles without a texture form a mesh of their own. Returns the mesh itself if it has no materials, if all
    /// triangles have its own `texture`, or if it is invalid.
    pub fn by_texture(self: &Arc<Self>) -> Vec<Arc<Self>> {
        let Some(all) = self.materials.as_ref().filter(|_| self.validate().is_ok()) else { return vec![self.clone()] };
        let texture_of = |triangle: &u32| {
            let material = all.of_triangle.get(*triangle as usize).and_then(|&i| all.materials.get(i as usize));
            material.and_then(|m| m.texture.as_ref()).filter(|_| self.uvs.is_some())
        };
        let address = |texture: Option<&Arc<Texture>>| texture.map(Arc::as_ptr);
        let mut parts: Vec<(Option<&Arc<Texture>>, Vec<u32>)> = Vec::new();
        let mut part_of: HashMap<Option<*const Texture>, usize> = HashMap::new();
        for triangle in 0..self.triangles.len() as u32 {
            let texture = texture_of(&triangle);
            let part = *part_of.entry(address(texture)).or_insert_with(|| {
                parts.push((texture, Vec::new()));
                parts.len() - 1
            });
            parts[part].1.push(triangle);
        }
        if let [(texture, _)] = parts[..]
            && address(texture) == address(self.texture.as_ref())
        {
            return vec![self.clone()];
        }
        let part = |(texture, triangles): (Option<&Arc<Texture>>, Vec<u32>)| {
            Arc::new(Self { texture: texture.cloned(), ..self.part(&triangles) })
        };
        parts.into_iter().map(part).collect()
    }

    /// Replaces the vertices by the vertices at `indices`, in that order; indices may repeat. Triangles don't change.
    pub fn select_vertices(&mut self, indices: &[u32]) {
        fn select<T: Copy>(column: &mut Option<Vec<T>>, indices: &[u32]) {
            if let Some(values) = column {
                *values = indices.iter().map(|i| values[*i as usize]).collect();
            }
        }
        self.positions = self.positions.select(indices);
        select(&mut self.normals, indices);
        select(&mut self.colors, indices);
        select(&mut self.alphas, indices);
        select(&mut self.uvs, indices);
        self.vertex_extras.iter_mut().for_each(|extra| extra.values = extra.values.select(indices));
    }

    /// Returns some of the triangles, by their indices, as a mesh with the vertices that they use. Materials, comments
    /// and uninterpreted properties are dropped.
    pub(crate) fn part(&self, triangles: &[u32]) -> Self {
        let mut used: Vec<u32> = Vec::new();
        let mut next = |i: u32| {
            used.push(i);
            used.len() as u32 - 1
        };
        let corners = triangles.iter().map(|i| self.triangles[*i as usize]);
        // A table of all vertices is worthwhile if the triangles are numerous enough.
        let chosen = if triangles.len() >= self.positions.len() / 64 {
            let mut new_index = vec![u32::MAX; self.positions.len()];
            let mut place = |i: u32| {
                let new = &mut new_index[i as usize];
                if *new == u32::MAX {
                    *new = next(i);
                }
                *new
            };
            corners.map(|corners| corners.map(&mut place)).collect()
        } else {
            let mut new_index: HashMap<u32, u32> = HashMap::new();
            let mut place = |i: u32| *new_index.entry(i).or_insert_with(|| next(i));
            corners.map(|corners| corners.map(&mut place)).collect()
        };
        let pick3 = |column: &Vec<[f32; 3]>| used.iter().map(|&i| column[i as usize]).collect();
        Self {
            origin: self.origin,
            positions: self.positions.select(&used),
            triangles: chosen,
            normals: self.normals.as_ref().map(pick3),
            colors: self.colors.as_ref().map(pick3),
            alphas: self.alphas.as_ref().map(|column| used.iter().map(|&i| column[i as usize]).collect()),
            uvs: self.uvs.as_ref().map(|column| used.iter().map(|&i| column[i as usize]).collect()),
            texture: self.texture.clone(),
            materials: None,
            up: self.up,
            ..Self::default()
        }
    }

    /// Reduces the mesh to one material. If all materials have the same texture, the mesh gets it, and the materials'
    /// alpha modes are lost. Otherwise the textures become colours and alphas of the vertices, and finer detail is
    /// lost. Alphas of vertices with masked or opaque materials are then replaced by the resulting opacity. A vertex
    /// gets the material of the first triangle that uses it. Normal maps are dropped.
    pub fn with_one_material(mut self) -> Self {
        let Some(all) = self.materials.take() else { return self };
        let mut textures: Vec<Option<&Arc<Texture>>> = all.materials.iter().map(|m| m.texture.as_ref()).collect();
        textures.dedup_by(|a, b| a.map(Arc::as_ptr) == b.map(Arc::as_ptr));
        if let [shared] = textures[..] {
            self.texture = shared.cloned();
            return self;
        }
        let vertices = self.positions.len();
        let mut colors = self.colors.take().unwrap_or_else(|| vec![[1.0; 3]; vertices]);
        let mut alphas = self.alphas.take().unwrap_or_else(|| vec![1.0; vertices]);
        let mut done = vec![false; vertices];
        for (triangle, &material) in self.triangles.iter().zip(&all.of_triangle) {
            let Some(material) = all.materials.get(material as usize) else { continue };
            for &i in triangle {
                let i = i as usize;
                if std::mem::replace(&mut done[i], true) {
                    continue;
                }
                if let (Some(texture), Some(uvs)) = (&material.texture, &self.uvs) {
                    let [r, g, b, a] = texture.sample(uvs[i]);
                    colors[i].iter_mut().zip([r, g, b]).for_each(|(c, t)| *c *= t);
                    alphas[i] *= a;
                }
                alphas[i] = material.alpha.opacity(alphas[i]);
            }
        }
        self.colors = Some(colors);
        self.alphas = alphas.iter().any(|&a| a < 1.0).then_some(alphas);
        Self { uvs: None, texture: None, ..self }
    }
}

/// Borrowed material of a triangle.
#[derive(Clone, Copy, Debug, Default)]
pub struct MaterialRef<'a> {
    /// Base-colour texture of the material; `None` without a texture.
    pub texture: Option<&'a Arc<Texture>>,
    /// Meaning of the material's alpha.
    pub alpha: AlphaMode,
    /// Normal map of the material; `None` without one.
    pub normal_map: Option<&'a NormalMap>,
}

impl TriangleMaterials {
    fn validate(&self, triangles: usize) -> Result<(), ModelError> {
        let found = self.of_triangle.len();
        if found != triangles {
            return Err(ModelError::ColumnLength { column: "materials", found, expected: triangles });
        }
        let bad = |i: &&u32| **i as usize >= self.materials.len();
        match self.of_triangle.iter().position(|i| bad(&i)) {
            None => Ok(()),
            Some(index) => Err(ModelError::InvalidElements {
                what: "triangle",
                index,
                problem: format!("it is of material {} of {}", self.of_triangle[index], self.materials.len()),
                count: self.of_triangle.iter().filter(bad).count(),
                total: found,
                advice: "the file is damaged",
            }),
        }
    }

    /// Returns the materials of some triangles, by their indices.
    #[must_use]
    pub fn select(&self, triangles: impl Iterator<Item = u32>) -> Self {
        let of_triangle = triangles.map(|i| self.of_triangle[i as usize]).collect();
        Self { materials: self.materials.clone(), of_triangle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn texel(color: [u8; 4]) -> Arc<Texture> {
        Arc::new(Texture { width: 1, height: 1, srgba8: vec![color] })
    }

    /// Returns four triangles around a point, with three materials and two textures.
    fn fan() -> Mesh {
        let (red, blue) = (texel([255, 0, 0, 255]), texel([0, 0, 255, 128]));
        let material =
            |texture: &Arc<Texture>, alpha| MeshMaterial { texture: Some(texture.clone()), alpha, normal_map: None };
        let mask = AlphaMode::Mask { cutoff: 0.75 };
        Mesh {
            positions: Column3::from_f32(vec![Vec3::ZERO, Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y]),
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]],
            uvs: Some((0..5).map(|i| [i as f32 / 8.0, 0.5]).collect()),
            materials: Some(TriangleMaterials {
                materials: vec![material(&red, AlphaMode::Blend), material(&blue, mask), material(&red, mask)],
                of_triangle: vec![1, 0, 2, 1],
            }),
            ..Mesh::default()
        }
    }

    #[test]
    fn opacity_is_what_the_mode_makes_of_alpha() {
        let mask = AlphaMode::Mask { cutoff: 0.5 };
        assert_eq!([0.0, 0.5, 1.0].map(|a| AlphaMode::Opaque.opacity(a)), [1.0; 3]);
        assert_eq!([0.0, 0.49, 0.5, 1.0, f32::NAN].map(|a| mask.opacity(a)), [0.0, 0.0, 1.0, 1.0, 0.0]);
        assert_eq!([0.0, 0.3, 1.0].map(|a| AlphaMode::default().opacity(a)), [0.0, 0.3, 1.0]);
    }

    #[test]
    fn parts_have_a_texture_each_and_together_all_triangles() {
        let mesh = Arc::new(fan());
        let parts = mesh.by_texture();
        let color = |m: &Mesh| m.texture.as_ref().map(|t| t.srgba8[0]);
        assert_eq!(parts.iter().map(|m| color(m)).collect::<Vec<_>>(), [0, 1].map(|i| color_of(&mesh, i)).to_vec());
        let corners = |m: &Mesh| {
            m.triangles.iter().map(|t| t.map(|i| m.positions.get(i as usize).to_array())).collect::<Vec<_>>()
        };
        let whole = corners(&mesh);
        assert_eq!(corners(&parts[0]), [whole[0], whole[3]]);
        assert_eq!(corners(&parts[1]), [whole[1], whole[2]]);
        // The second part lacks a vertex, and its texture coordinates were reduced with the other columns.
        assert_eq!(parts[1].uvs, Some(vec![[0.0, 0.5], [0.25, 0.5], [0.375, 0.5], [0.5, 0.5]]));
        assert!(parts.iter().all(|m| m.materials.is_none() && m.validate().is_ok()));
    }

    fn color_of(mesh: &Mesh, triangle: usize) -> Option<[u8; 4]> {
        mesh.material(triangle).texture.map(|t| t.srgba8[0])
    }

    #[test]
    fn a_mesh_of_one_texture_is_its_own_part() {
        let plain = Arc::new(Mesh { materials: None, ..fan() });
        assert!(Arc::ptr_eq(&plain.by_texture()[0], &plain));
        let mut mesh = fan();
        if let Some(all) = &mut mesh.materials {
            all.of_triangle = vec![0, 2, 0, 2];
        }
        mesh.texture = mesh.material(0).texture.cloned();
        let mesh = Arc::new(mesh);
        assert!(Arc::ptr_eq(&mesh.by_texture()[0], &mesh));
    }

    #[test]
    fn one_material_holds_the_textures_in_its_vertices() {
        let mesh = fan().with_one_material();
        assert!(mesh.validate().is_ok() && mesh.materials.is_none() && mesh.uvs.is_none());
        // Vertices 0, 1 and 2 are visited first by a triangle of the second material, whose alpha of ½ is cut.
        let (colors, alphas) = (mesh.colors.unwrap(), mesh.alphas.unwrap());
        assert_eq!((colors[0], colors[3]), ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]));
        assert_eq!(alphas, [0.0, 0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn materials_out_of_range_are_told() {
        let mut mesh = fan();
        mesh.materials.as_mut().unwrap().of_triangle[2] = 3;
        assert!(mesh.validate().unwrap_err().to_string().contains("triangle 2 is invalid: it is of material 3 of 3"));
        mesh.materials.as_mut().unwrap().of_triangle.pop();
        assert!(mesh.validate().unwrap_err().to_string().contains("'materials' has 3 values, expected 4"));
    }

    #[test]
    fn something_is_seen_through_only_where_alpha_counts() {
        let with = |alpha| {
            let material = MeshMaterial { texture: Some(texel([255, 255, 255, 128])), alpha, normal_map: None };
            let all = TriangleMaterials { materials: vec![material], of_triangle: vec![0; 4] };
            Mesh { materials: Some(all), ..fan() }
        };
        assert!(with(AlphaMode::Blend).is_see_through() && with(AlphaMode::Mask { cutoff: 0.5 }).is_see_through());
        assert!(!with(AlphaMode::Opaque).is_see_through() && !with(AlphaMode::Mask { cutoff: 0.0 }).is_see_through());
        assert!(!Mesh { uvs: None, ..with(AlphaMode::Blend) }.is_see_through());
        assert!(Mesh { uvs: None, alphas: Some(vec![0.5; 5]), ..with(AlphaMode::Blend) }.is_see_through());
    }

    #[test]
    fn vertices_are_selected_with_all_their_columns() {
        use crate::ExtraValues;
        let extra = |values| vec![ExtraColumn { name: "a".into(), values }];
        let mut mesh = Mesh {
            alphas: Some(vec![0.0, 0.25, 0.5, 0.75, 1.0]),
            vertex_extras: extra(ExtraValues::U8(vec![10, 11, 12, 13, 14])),
            ..fan()
        };
        mesh.validate().unwrap();
        let before = mesh.clone();
        mesh.select_vertices(&[4, 1, 1]);
        assert_eq!(mesh.positions.get(0), before.positions.get(4));
        assert_eq!(mesh.uvs.map(|uvs| uvs[2]), before.uvs.map(|uvs| uvs[1]));
        assert_eq!(mesh.alphas, Some(vec![1.0, 0.25, 0.25]));
        assert_eq!(mesh.vertex_extras, extra(ExtraValues::U8(vec![14, 11, 11])));
        for wrong in [
            Mesh { vertex_extras: extra(ExtraValues::U8(vec![1])), ..fan() },
            Mesh { triangle_extras: extra(ExtraValues::U8(vec![1; 99])), ..fan() },
        ] {
            assert!(wrong.validate().unwrap_err().to_string().contains("_extras"));
        }
    }
}
