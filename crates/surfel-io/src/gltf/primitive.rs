//! Primitives: their attributes, converted to the model's types, in rest pose and in world space.

use super::buffers::Asset;
use super::document::out_of_range;
use super::draco::DracoMesh;
use super::materials::BaseColor;
use super::rest_pose::{Pose, add_displacements};
use crate::error::Problem;
use crate::gathered_points::{inverse_transpose, transform_normal};
use glam::DVec3;
use gltf::accessor::Dimensions;
use gltf::{Primitive, Semantic};
use surfel_model::{ExtraColumn, ExtraValues};

/// Maximum number of columns that are read from application-specific attributes of a scene. Other attributes are
/// ignored with a note.
pub(super) const MAX_CUSTOM_COLUMNS: usize = 64;

/// Source of a primitive's attributes: its accessors, or a mesh decompressed from it.
pub(super) struct Attributes<'a> {
    pub(super) asset: &'a Asset<'a>,
    pub(super) primitive: &'a Primitive<'a>,
    /// Index of the mesh that contains the primitive.
    pub(super) mesh: usize,
    pub(super) compressed: Option<&'a DracoMesh>,
}

/// A primitive's vertices in world space; each column has one value per vertex.
pub(super) struct Vertices {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Option<Vec<[f32; 3]>>,
    /// Vertex colours, in linear RGB and alpha.
    pub(super) colors: Option<Vec<[f32; 4]>>,
    pub(super) uvs: Option<Vec<[f32; 2]>>,
    /// True if the world transform of the first vertex mirrors, which reverses the winding order of triangles.
    pub(super) mirrored: bool,
}

impl Attributes<'_> {
    /// Returns the values of an attribute, `N` numbers per vertex; `None` if the primitive doesn't have it.
    pub(super) fn floats<const N: usize>(&self, semantic: &Semantic) -> Result<Option<Vec<[f32; N]>>, Problem> {
        let Some(accessor) = self.primitive.get(semantic) else { return Ok(None) };
        let name = semantic.to_string();
        match self.compressed.and_then(|mesh| mesh.floats(&name, accessor.normalized())) {
            Some(values) => Ok(Some(values)),
            None => self.asset.floats(&accessor).map(Some),
        }
    }

    /// Returns the values of an attribute that the crate `gltf` has no name for; `None` if the primitive doesn't have
    /// it.
    pub(super) fn named_floats<const N: usize>(&self, name: &str) -> Result<Option<Vec<[f32; N]>>, Problem> {
        let document = self.asset.document;
        let Some(index) = document.attribute(self.primitive, self.mesh, name) else { return Ok(None) };
        let accessors = document.gltf.accessors();
        let count = accessors.len();
        let accessor = document.gltf.accessors().nth(index);
        self.asset.floats(&accessor.ok_or_else(|| out_of_range("accessor", index, count))?).map(Some)
    }

    /// Returns the scalar ones among the primitive's first [`MAX_CUSTOM_COLUMNS`] application-specific attributes as
    /// columns. Also returns the names of the application-specific attributes that aren't read.
    pub(super) fn own_columns(&self, vertices: usize) -> Result<(Vec<ExtraColumn>, Vec<String>), Problem> {
        let document = self.asset.document;
        let (mut columns, mut left_out) = (Vec::new(), Vec::new());
        for (i, name) in document.custom_attributes(self.primitive, self.mesh).enumerate() {
            if i >= MAX_CUSTOM_COLUMNS {
                left_out.push(name.to_owned());
                continue;
            }
            let index = document.attribute(self.primitive, self.mesh, name).unwrap_or(usize::MAX);
            let accessor = document.gltf.accessors().nth(index);
            let count = document.gltf.accessors().len();
            let accessor = accessor.ok_or_else(|| out_of_range("accessor", index, count))?;
            let is_scalar = accessor.dimensions() == Dimensions::Scalar;
            let is_there = accessor.view().is_some() || accessor.sparse().is_some();
            let values = match self.compressed.and_then(|mesh| mesh.floats::<1>(name, accessor.normalized())) {
                Some(values) if is_scalar => values,
                None if is_scalar && is_there => self.asset.floats::<1>(&accessor)?,
                _ => {
                    left_out.push(name.to_owned());
                    continue;
                }
            };
            same_count(name, Some(values.len()), vertices)?;
            let values = ExtraValues::F32(values.into_iter().map(|[value]| value).collect());
            columns.push(ExtraColumn { name: name.to_owned(), values });
        }
        Ok((columns, left_out))
    }

    /// Returns the vertex indices of the primitive, in order.
    pub(super) fn corners(&self, vertices: usize) -> Result<Vec<u32>, Problem> {
        match (self.compressed, self.primitive.indices()) {
            (Some(mesh), _) => Ok(mesh.corners()),
            (None, Some(indices)) => self.asset.indices(&indices),
            (None, None) => Ok((0..vertices as u32).collect()),
        }
    }

    /// Adds the primitive's morph targets, multiplied by their weights, to `positions` and to the normals that the file
    /// stores. Returns these normals; `None` if the file stores none.
    pub(super) fn at_rest(&self, positions: &mut [[f32; 3]], weights: &[f32]) -> Result<Option<Normals>, Problem> {
        let mut normals = self.floats::<3>(&Semantic::Normals)?;
        let targets = self.primitive.morph_targets().zip(weights).filter(|(_, weight)| **weight != 0.0);
        for (target, &weight) in targets {
            if let Some(accessor) = target.positions() {
                let displacements = self.asset.floats::<3>(&accessor)?;
                same_count("a morph target", Some(displacements.len()), positions.len())?;
                add_displacements(positions, &displacements, weight);
            }
            if let (Some(normals), Some(accessor)) = (&mut normals, target.normals()) {
                add_displacements(normals, &self.asset.floats::<3>(&accessor)?, weight);
            }
        }
        Ok(normals)
    }

    /// Returns all attributes of the primitive's surface. `positions` and `normals` are in rest pose, from
    /// [`Self::at_rest`].
    pub(super) fn surface(
        &self,
        positions: Vec<[f32; 3]>,
        normals: Option<Normals>,
        base: Option<&BaseColor>,
    ) -> Result<Surface, Problem> {
        let n = positions.len();
        let colors = self.floats::<4>(&Semantic::Colors(0))?;
        let uvs = self.floats::<2>(&Semantic::TexCoords(base.map_or(0, |b| b.set)))?;
        same_count("NORMAL", normals.as_ref().map(Vec::len), n)?;
        same_count("COLOR_0", colors.as_ref().map(Vec::len), n)?;
        same_count("TEXCOORD", uvs.as_ref().map(Vec::len), n)?;
        let transform = base.and_then(|b| b.transform);
        let uvs = match (uvs, transform) {
            (Some(uvs), Some(transform)) => Some(uvs.into_iter().map(|uv| transform.apply(uv)).collect()),
            (uvs, _) => uvs,
        };
        Ok(Surface { positions, normals, colors, uvs })
    }
}

/// A primitive's vertices in its own space, in rest pose.
pub(super) struct Surface {
    positions: Vec<[f32; 3]>,
    normals: Option<Normals>,
    colors: Option<Vec<[f32; 4]>>,
    uvs: Option<Vec<[f32; 2]>>,
}

impl Surface {
    /// Returns the vertex colours, if there are any.
    pub(super) fn colors(&self) -> Option<&[[f32; 4]]> {
        self.colors.as_deref()
    }

    /// Transforms all vertices to world space.
    pub(super) fn place(&self, pose: &Pose) -> Vertices {
        Vertices {
            positions: world_positions(&self.positions, pose),
            normals: self.normals.as_ref().map(|normals| world_normals(normals, pose)),
            colors: self.colors.clone(),
            uvs: self.uvs.clone(),
            mirrored: pose.of_vertex(0).matrix3.determinant() < 0.0,
        }
    }
}

/// Normals of a primitive, one per vertex.
pub(super) type Normals = Vec<[f32; 3]>;

/// Transforms the positions of a primitive's vertices to world space.
pub(super) fn world_positions(positions: &[[f32; 3]], pose: &Pose) -> Vec<DVec3> {
    let place = |(i, p): (usize, &[f32; 3])| pose.of_vertex(i).transform_point3(DVec3::from(p.map(f64::from)));
    positions.iter().enumerate().map(place).collect()
}

fn world_normals(normals: &Normals, pose: &Pose) -> Normals {
    let rigid = match pose {
        Pose::Rigid(world) => Some(inverse_transpose(*world)),
        Pose::Skinned(_) => None,
    };
    let place = |(i, &n)| transform_normal(rigid.unwrap_or_else(|| inverse_transpose(pose.of_vertex(i))), n);
    normals.iter().enumerate().map(place).collect()
}

/// Checks that an attribute, if it exists, has as many values as there are positions.
pub(super) fn same_count(name: &str, found: Option<usize>, positions: usize) -> Result<(), Problem> {
    match found {
        Some(found) if found != positions => {
            Err(Problem::new(format!("{name} has {found} values")).expected(format!("{positions}, as POSITION")))
        }
        _ => Ok(()),
    }
}
