//! Triangle meshes.

use crate::{Column3, ModelError, Texture, Up};
use glam::DVec3;
use std::sync::Arc;

/// An indexed triangle mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// World offset of the positions, in object units.
    pub origin: DVec3,
    /// Vertex positions relative to `origin`.
    pub positions: Column3,
    /// Corners of the triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Vertex normals.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Linear RGB, one a vertex.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Alpha in [0, 1], one a vertex.
    pub alphas: Option<Vec<f32>>,
    /// Texture coordinates, (0, 0) the texture's top left corner, one a vertex.
    pub uvs: Option<Vec<[f32; 2]>>,
    /// Base-colour texture for `uvs`; multiplies `colors`.
    pub texture: Option<Arc<Texture>>,
    /// Which axis the file says is up.
    pub up: Option<Up>,
    /// Comment lines of the file.
    pub comments: Vec<String>,
}

impl Mesh {
    /// Checks columns' lengths, indices and that positions and colours are finite.
    ///
    /// # Errors
    /// [`ModelError`] naming the first offender.
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
        Ok(())
    }
}
