//! Triangle meshes and textures.

use crate::{Column3, ModelError, Up};
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
    /// Checks columns' lengths, indices and that positions are finite.
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

/// A base-colour image, linear RGB with straight alpha.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// sRGB-encoded texels as the file has them, row by row from the top.
    pub srgba8: Vec<[u8; 4]>,
}

impl Texture {
    /// Bilinear sample at `uv` with repeat addressing: linear RGB and alpha.
    pub fn sample(&self, uv: [f32; 2]) -> [f32; 4] {
        if self.width == 0 || self.height == 0 || self.srgba8.len() < self.width as usize * self.height as usize {
            return [1.0; 4];
        }
        let wrap = |t: f32| if t.is_finite() { t - t.floor() } else { 0.0 };
        let (x, y) = (wrap(uv[0]) * self.width as f32 - 0.5, wrap(uv[1]) * self.height as f32 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let texel = |dx: i64, dy: i64| {
            let column = (x0 as i64 + dx).rem_euclid(i64::from(self.width)) as usize;
            let row = (y0 as i64 + dy).rem_euclid(i64::from(self.height)) as usize;
            let t = self.srgba8[row * self.width as usize + column];
            let linear = |c: u8| surfel_math::srgb::decode(f64::from(c) / 255.0) as f32;
            [linear(t[0]), linear(t[1]), linear(t[2]), f32::from(t[3]) / 255.0]
        };
        let corners = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        std::array::from_fn(|c| corners.iter().zip(weights).map(|(t, w)| t[c] * w).sum())
    }
}
