//! Exact distances of points to a point cloud or a mesh.

use crate::boxes::Boxes;
use crate::parallel::map_each;
use crate::progress::Progress;
use glam::DVec3;

/// Spatial index of points or triangles for exact distance queries.
///
/// ```
/// use surfel_model::glam::DVec3;
/// use surfel_sample::{Distances, NoProgress};
/// let floor = Distances::to_triangles(vec![[DVec3::ZERO, DVec3::X * 9.0, DVec3::Y * 9.0]]);
/// assert_eq!(floor.of(&[DVec3::new(1.0, 1.0, 0.5)], &NoProgress), [0.5]);
/// let corner = Distances::to_points(vec![DVec3::ZERO]);
/// assert_eq!(corner.of(&[DVec3::new(3.0, 0.0, 4.0)], &NoProgress), [5.0]);
/// ```
pub struct Distances {
    shapes: Shapes,
    boxes: Boxes,
}

enum Shapes {
    Points(Vec<[DVec3; 1]>),
    Triangles(Vec<[DVec3; 3]>),
}

impl Distances {
    /// Builds the index of points.
    pub fn to_points(points: Vec<DVec3>) -> Self {
        let points: Vec<[DVec3; 1]> = points.into_iter().map(|p| [p]).collect();
        let boxes = Boxes::new(&points);
        Self { shapes: Shapes::Points(points), boxes }
    }

    /// Builds the index of triangles, given by their corners.
    pub fn to_triangles(triangles: Vec<[DVec3; 3]>) -> Self {
        let boxes = Boxes::new(&triangles);
        Self { shapes: Shapes::Triangles(triangles), boxes }
    }

    /// Returns the distance of each point to the nearest point or triangle of the index; infinite if the index is
    /// empty.
    pub fn of(&self, points: &[DVec3], progress: &dyn Progress) -> Vec<f64> {
        progress.stage("measuring distances", points.len() as u64);
        map_each(points.len(), progress, || (), |(), i| self.of_point(points[i]))
    }

    fn of_point(&self, p: DVec3) -> f64 {
        match &self.shapes {
            Shapes::Points(points) => self.boxes.nearest(p, |i| p.distance(points[i][0])).0,
            Shapes::Triangles(triangles) => self.boxes.nearest(p, |i| closest(p, triangles[i]).0).0,
        }
    }
}

/// Returns the distance of a point to a triangle, and the barycentric coordinates of the triangle's nearest point
/// (Ericson, Real-Time Collision Detection, §5.1.5).
pub(crate) fn closest(p: DVec3, [a, b, c]: [DVec3; 3]) -> (f64, [f64; 3]) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let barycentric = if d1 <= 0.0 && d2 <= 0.0 {
        [1.0, 0.0, 0.0]
    } else if d3 >= 0.0 && d4 <= d3 {
        [0.0, 1.0, 0.0]
    } else if d6 >= 0.0 && d5 <= d6 {
        [0.0, 0.0, 1.0]
    } else if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        [1.0 - v, v, 0.0]
    } else if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        [1.0 - w, 0.0, w]
    } else if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        [0.0, 1.0 - w, w]
    } else {
        let sum = va + vb + vc;
        [va / sum, vb / sum, vc / sum]
    };
    let nearest = a + ab * barycentric[1] + ac * barycentric[2];
    (p.distance(nearest), barycentric)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;
    use crate::mesh::random::Random;

    /// Returns the distance of a point to a triangle by a dense search over its area.
    fn searched(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
        const STEPS: u32 = 400;
        let share = |i: u32| f64::from(i) / f64::from(STEPS);
        let rows = (0..=STEPS).flat_map(|i| (0..=STEPS - i).map(move |j| (share(i), share(j))));
        rows.map(|(u, v)| p.distance(a + (b - a) * u + (c - a) * v)).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn distances_are_those_of_brute_force() {
        let mut random = Random::new(3);
        let mut place = |scale: f64| DVec3::new(random.unit(), random.unit(), random.unit()) * scale;
        let points: Vec<DVec3> = (0..3000).map(|_| place(1.0)).collect();
        // Small triangles, some of which are points or segments.
        let triangles: Vec<[DVec3; 3]> = (0..1500)
            .map(|i| {
                let (a, b, c) = (place(1.0), place(0.1), place(0.1));
                let flat = if i % 50 == 0 { 0.0 } else { 1.0 };
                [a, a + b * flat, a + if i % 75 == 0 { b * 2.0 } else { c }]
            })
            .collect();
        let asked: Vec<DVec3> = (0..500).map(|_| place(1.4) - DVec3::splat(0.2)).collect();
        let to_points = Distances::to_points(points.clone()).of(&asked, &NoProgress);
        let to_triangles = Distances::to_triangles(triangles.clone()).of(&asked, &NoProgress);
        for (i, p) in asked.iter().enumerate() {
            let least = points.iter().map(|q| p.distance(*q)).fold(f64::INFINITY, f64::min);
            assert_eq!(to_points[i], least);
            let least = triangles.iter().map(|t| closest(*p, *t).0).fold(f64::INFINITY, f64::min);
            assert_eq!(to_triangles[i], least);
        }
        for (p, triangle) in asked.iter().zip(&triangles).take(20) {
            let (exact, found) = (closest(*p, *triangle).0, searched(*p, *triangle));
            assert!(exact <= found + 1e-12 && found - exact < 1e-3, "{exact} {found}");
        }
        assert_eq!(Distances::to_points(Vec::new()).of(&[DVec3::ZERO], &NoProgress), [f64::INFINITY]);
    }
}
