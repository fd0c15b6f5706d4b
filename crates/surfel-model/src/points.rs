//! Point clouds: positions without extent, before splats are made of them.

use crate::{Column3, ExtraColumn, ModelError, Up, column::retain};
use glam::DVec3;

/// Points with what a scanner or a file gave for each of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// World offset of the positions, in object units.
    pub origin: DVec3,
    /// Positions relative to `origin`.
    pub positions: Column3,
    /// Normals, not necessarily of unit length; zero or non-finite means unknown.
    pub normals: Option<Column3>,
    /// Linear RGB.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Alpha in [0, 1].
    pub alphas: Option<Vec<f32>>,
    /// Properties that Surfel doesn't interpret.
    pub extras: Vec<ExtraColumn>,
    /// Which axis the file says is up.
    pub up: Option<Up>,
    /// Comment lines of the file.
    pub comments: Vec<String>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True when there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Checks that all columns have the same length.
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] naming the first column that hasn't.
    pub fn check_columns(&self) -> Result<(), ModelError> {
        let expected = self.len();
        let columns = [
            ("normals", self.normals.as_ref().map(Column3::len)),
            ("colors", self.colors.as_ref().map(Vec::len)),
            ("alphas", self.alphas.as_ref().map(Vec::len)),
            ("extras", self.extras.iter().map(|e| e.values.len()).find(|&n| n != expected)),
        ];
        match columns.into_iter().find_map(|(name, len)| Some((name, len.filter(|&n| n != expected)?))) {
            Some((column, found)) => Err(ModelError::ColumnLength { column, found, expected }),
            None => Ok(()),
        }
    }

    /// Drops points whose position is not finite and returns how many there were. Colours and alphas that
    /// are not finite become white and opaque, normals that are not finite become zero (unknown).
    pub fn drop_non_finite(&mut self) -> usize {
        let keep: Vec<bool> = (0..self.len()).map(|i| self.positions.get(i).is_finite()).collect();
        let dropped = keep.iter().filter(|k| !**k).count();
        if dropped > 0 {
            self.retain(&keep);
        }
        if let Some(colors) = &mut self.colors {
            for c in colors.iter_mut().flatten().filter(|c| !c.is_finite()) {
                *c = 1.0;
            }
        }
        if let Some(alphas) = &mut self.alphas {
            for a in alphas.iter_mut() {
                *a = if a.is_finite() { a.clamp(0.0, 1.0) } else { 1.0 };
            }
        }
        dropped
    }

    /// Keeps the points whose flag is set.
    pub fn retain(&mut self, keep: &[bool]) {
        self.positions.retain(keep);
        if let Some(c) = &mut self.normals {
            c.retain(keep);
        }
        if let Some(c) = &mut self.colors {
            retain(c, keep);
        }
        if let Some(c) = &mut self.alphas {
            retain(c, keep);
        }
        for e in &mut self.extras {
            e.values.retain(keep);
        }
    }
}
