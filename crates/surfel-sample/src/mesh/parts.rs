//! Division of a mesh's faces into parts of similar size. Sampling density and similar quantities are constant in a
//! part.

use super::geometry::Geometry;
use glam::DVec3;

/// Maximum number of times that the sides of a face are halved to divide it into parts.
const MAX_HALVINGS: f64 = 10.0;
/// Corners of a face at which its four parts are, in order, if its sides are halved; `None` is the part in the middle.
/// The part in the middle is second, so that every part but the first is adjacent to the part before it or to the one
/// in the middle.
const CORNERS: [Option<usize>; 4] = [Some(0), None, Some(1), Some(2)];
/// Index of the middle part in [`CORNERS`].
const MIDDLE: usize = 1;

/// Place on the surface: a face and barycentric coordinates.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    pub(crate) face: u32,
    pub(crate) barycentric: [f64; 3],
}

impl From<(u32, [f64; 3])> for Sample {
    fn from((face, barycentric): (u32, [f64; 3])) -> Self {
        Self { face, barycentric }
    }
}

impl Sample {
    /// Creates the sample at the position `place` on a face, or at the face's first corner if the face has no area.
    pub(crate) fn at(geometry: &Geometry, face: u32, place: DVec3) -> Self {
        let [a, ..] = geometry.corners(face as usize);
        let [u, v, w] = geometry.barycentric_change(face as usize, place - a).unwrap_or_default();
        Self { face, barycentric: [1.0 + u, v, w] }
    }

    /// Returns the position of the place, relative to the mesh's origin.
    pub(crate) fn place(&self, geometry: &Geometry) -> DVec3 {
        let [a, b, c] = geometry.corners(self.face as usize);
        // Relative to a corner, so that a triangle far from the origin is not distorted.
        a + (b - a) * self.barycentric[1] + (c - a) * self.barycentric[2]
    }
}

/// Division of faces into parts by repeated halving of their sides: 4ᵏ parts of equal area, similar to the face. Parts
/// of a face with neighbouring indices are close together, and mostly adjacent.
#[derive(Clone, Debug)]
pub(crate) struct Parts {
    /// Index of the first part of each face, followed by the number of all parts.
    first: Vec<u32>,
}

impl Parts {
    /// Divides faces into parts with about half the area of a square of side `side`; infinity leaves every face whole.
    /// For large meshes, `side` is enlarged, so that there are about `most` more parts than faces, and at most twice as
    /// many because of rounding.
    pub(crate) fn new(geometry: &Geometry, side: f64, most: usize) -> Self {
        let side = side.max((2.0 * geometry.total_area() / most as f64).sqrt());
        let mut first = vec![0];
        let mut sum = 0u32;
        for area in &geometry.areas {
            let halvings = ((2.0 * area).sqrt() / side).log2().round().clamp(0.0, MAX_HALVINGS) as u32;
            sum = sum.saturating_add(1 << (2 * halvings));
            first.push(sum);
        }
        Self { first }
    }

    /// Returns the number of parts.
    pub(crate) fn len(&self) -> usize {
        self.first.last().map_or(0, |n| *n as usize)
    }

    /// Returns the face of a part.
    pub(crate) fn face(&self, part: usize) -> usize {
        if self.len() + 1 == self.first.len() {
            return part;
        }
        self.first.partition_point(|first| *first as usize <= part) - 1
    }

    /// Returns the indices of a face's parts.
    pub(crate) fn of(&self, face: usize) -> std::ops::Range<usize> {
        self.first[face] as usize..self.first[face + 1] as usize
    }

    /// Returns the number of times that the sides of a face are halved.
    fn halvings(&self, face: usize) -> u32 {
        self.of(face).len().ilog2() / 2
    }

    /// Returns the area of a part.
    pub(crate) fn area(&self, geometry: &Geometry, part: usize) -> f64 {
        let face = self.face(part);
        geometry.areas[face] / self.of(face).len() as f64
    }

    /// Returns the index of the part that contains a place of a face.
    pub(crate) fn at(&self, sample: &Sample) -> usize {
        let (face, mut b) = (sample.face as usize, sample.barycentric);
        let mut part = 0;
        for _ in 0..self.halvings(face) {
            let corner = CORNERS.iter().position(|corner| corner.is_some_and(|k| b[k] >= 0.5));
            let child = corner.unwrap_or(MIDDLE);
            b = match CORNERS[child] {
                Some(k) => std::array::from_fn(|j| 2.0 * b[j] - f64::from(u8::from(j == k))),
                None => b.map(|b| 1.0 - 2.0 * b),
            };
            part = 4 * part + child;
        }
        self.of(face).start + part
    }

    /// Converts barycentric coordinates of a part to a place on the part's face.
    pub(crate) fn place(&self, part: usize, mut b: [f64; 3]) -> Sample {
        let face = self.face(part);
        let local = part - self.of(face).start;
        for halving in 0..self.halvings(face) {
            b = match CORNERS[local >> (2 * halving) & 3] {
                Some(k) => std::array::from_fn(|j| 0.5 * (b[j] + f64::from(u8::from(j == k)))),
                None => b.map(|b| 0.5 * (1.0 - b)),
            };
        }
        Sample { face: face as u32, barycentric: b }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Column3, Mesh};

    #[test]
    fn parts_tile_their_faces() {
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X * 1e-3, DVec3::Y * 1e-3];
        let triangles = vec![[0, 1, 2], [0, 3, 4]];
        let mesh = Mesh { positions: Column3::from_f64(&positions), triangles, ..Mesh::default() };
        let geometry = Geometry::new(&mesh);
        for n in [1, 2, 4, 64_u32] {
            let parts = Parts::new(&geometry, 1.1 / f64::from(n), 1 << 20);
            assert_eq!(parts.len(), (n * n + 1) as usize);
            assert_eq!((parts.face(0), parts.face(parts.len() - 1)), (0, 1));
            let sum: f64 = (0..parts.len()).map(|part| parts.area(&geometry, part)).sum();
            assert!((sum - geometry.total_area()).abs() < 1e-12);
            for part in 0..parts.len() {
                let mut middle = [0.0; 3];
                for b in [[0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.05, 0.05, 0.9]] {
                    let sample = parts.place(part, b);
                    assert_eq!(parts.at(&sample), part, "{n}: {sample:?}");
                    let b = sample.barycentric;
                    assert!(b.iter().all(|b| *b > 0.0) && (b.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                    middle.iter_mut().zip(b).for_each(|(m, b)| *m += b / 3.0);
                }
                let own = parts.place(part, [1.0 / 3.0; 3]).barycentric;
                assert!(own.iter().zip(middle).all(|(a, b)| (a - b).abs() < 1e-12));
            }
            // Corners and edges belong to some part of the face.
            for b in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.5, 0.5], [0.3, 0.7, 0.0]] {
                assert!(parts.of(0).contains(&parts.at(&Sample { face: 0, barycentric: b })));
            }
        }
        assert_eq!(Parts::new(&geometry, f64::INFINITY, 10).len(), 2);
        assert!(Parts::new(&geometry, 1e-9, 1000).len() <= 2002);
    }
}
