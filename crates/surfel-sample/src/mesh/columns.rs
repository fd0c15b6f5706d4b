//! Evaluation of a mesh's vertex and triangle columns at the splats made from the mesh.

use crate::parallel::map_each;
use crate::progress::NoProgress;
use glam::DVec3;
use std::ops::Range;
use surfel_model::{ExtraValues, Mesh, SplatCloud};

/// Maximum number of triangles in a leaf of the bounding-box tree.
const LEAF: usize = 4;
/// Distance, relative to the mesh's extent, whose square is added to the squared distance between a splat and a
/// triangle that faces away from it. Of two triangles in the same place, as on thin plates, the one that faces like the
/// splat is thus nearer.
const SAME_PLACE: f64 = 1e-6;
/// Triangle index that stands for no triangle.
const NONE: u32 = u32::MAX;

/// Places on a mesh that are nearest to the splats made from it, at which the mesh's columns are evaluated.
#[derive(Clone, Debug, Default)]
pub struct MeshPlaces {
    /// Nearest triangle of each splat, or [`NONE`] if an isolated vertex is nearest or the mesh is empty.
    triangles: Vec<u32>,
    /// Vertices of each splat's nearest triangle; an isolated vertex three times if that is nearest.
    corners: Vec<[u32; 3]>,
    /// Barycentric coordinates of the nearest place in each splat's nearest triangle.
    barycentric: Vec<[f32; 3]>,
}

impl MeshPlaces {
    /// Finds the place on the mesh nearest to each splat's centre. Vertices without triangles count as places too.
    pub fn new(mesh: &Mesh, cloud: &SplatCloud) -> Self {
        let tree = Tree::new(mesh);
        let found = map_each(cloud.len(), &NoProgress, Vec::new, |stack: &mut Vec<u32>, i| {
            tree.nearest(cloud.center(i) - mesh.origin, cloud.normal(i), stack)
        });
        let mut places = Self::default();
        for (triangle, barycentric) in found {
            places.triangles.push(if triangle < mesh.triangles.len() as u32 { triangle } else { NONE });
            places.corners.push(tree.corners.get(triangle as usize).copied().unwrap_or_default());
            places.barycentric.push(barycentric.map(|b| b as f32));
        }
        places
    }

    /// Evaluates a column of the vertices at the splats, interpolated over triangles. The result is f64 if the column
    /// is, else f32.
    pub fn interpolated(&self, column: &ExtraValues) -> ExtraValues {
        let value = |(corners, barycentric): (&[u32; 3], &[f32; 3])| {
            let values = corners.map(|i| column.get(i as usize));
            let terms = values.iter().zip(barycentric).filter(|(_, b)| **b > 0.0);
            terms.map(|(value, b)| value * f64::from(*b)).sum::<f64>()
        };
        let values = self.corners.iter().zip(&self.barycentric).map(value);
        match column {
            ExtraValues::F64(_) => ExtraValues::F64(values.collect()),
            _ => ExtraValues::F32(values.map(|value| value as f32).collect()),
        }
    }

    /// Evaluates a column of the vertices at the splats; each splat gets the value of the nearest corner of its nearest
    /// triangle.
    pub fn of_nearest_vertices(&self, column: &ExtraValues, mesh: &Mesh) -> ExtraValues {
        let nearest = |(corners, barycentric): (&[u32; 3], &[f32; 3])| {
            let places = corners.map(|i| mesh.positions.get(i as usize));
            let at: DVec3 = places.iter().zip(barycentric).map(|(p, b)| *p * f64::from(*b)).sum();
            let [a, b, c] = places.map(|p| p.distance_squared(at));
            corners[if a <= b && a <= c { 0 } else { 1 + usize::from(c < b) }]
        };
        column.select(&self.corners.iter().zip(&self.barycentric).map(nearest).collect::<Vec<_>>())
    }

    /// Evaluates a column of the triangles at the splats. Splats at vertices without triangles get the value NaN, for
    /// which the whole column becomes f64.
    pub fn of_triangles(&self, column: &ExtraValues) -> ExtraValues {
        if !self.triangles.contains(&NONE) {
            return column.select(&self.triangles);
        }
        let value = |i: &u32| if *i == NONE { f64::NAN } else { column.get(*i as usize) };
        ExtraValues::F64(self.triangles.iter().map(value).collect())
    }
}

/// Bounding-box tree of the triangles that have an area. A vertex without such triangles is stored as a triangle of one
/// point.
struct Tree {
    corners: Vec<[u32; 3]>,
    places: Vec<[DVec3; 3]>,
    order: Vec<u32>,
    nodes: Vec<Node>,
    /// Squared distance that is added for triangles that face away from the splat, so that triangles that face like it
    /// are preferred in the same place.
    away: f64,
}

struct Node {
    low: DVec3,
    high: DVec3,
    /// Range of the leaf's triangles in [`Tree::order`]. For other nodes, it has the indices of the two children.
    holds: Range<u32>,
    is_leaf: bool,
}

impl Tree {
    fn new(mesh: &Mesh) -> Self {
        let mut is_used = vec![false; mesh.positions.len()];
        let place = |i: &u32| mesh.positions.get(*i as usize);
        let mut corners = mesh.triangles.clone();
        let mut order = Vec::new();
        for (i, triangle) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = std::array::from_fn(|k| place(&triangle[k]));
            if (b - a).cross(c - a).length_squared() > 0.0 {
                order.push(i as u32);
                triangle.iter().for_each(|i| is_used[*i as usize] = true);
            }
        }
        for vertex in (0..mesh.positions.len() as u32).filter(|i| !is_used[*i as usize]) {
            order.push(corners.len() as u32);
            corners.push([vertex; 3]);
        }
        let places: Vec<[DVec3; 3]> = corners.iter().map(|t| std::array::from_fn(|k| place(&t[k]))).collect();
        let mut tree = Self { corners, places, order, nodes: Vec::new(), away: 0.0 };
        let count = tree.order.len() as u32;
        if count > 0 {
            let (low, high) = tree.bounds(0..count);
            tree.nodes.push(Node { low, high, holds: 0..count, is_leaf: true });
            tree.away = (SAME_PLACE * (high - low).max_element()).powi(2);
        }
        let mut next = 0;
        while next < tree.nodes.len() {
            tree.divide(next);
            next += 1;
        }
        tree
    }

    fn bounds(&self, triangles: Range<u32>) -> (DVec3, DVec3) {
        let all = self.order[triangles.start as usize..triangles.end as usize].iter();
        let places = all.flat_map(|i| self.places[*i as usize]);
        places.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
    }

    /// Divides a node with many triangles along its longest side, at the median.
    fn divide(&mut self, node: usize) {
        let Node { low, high, ref holds, .. } = self.nodes[node];
        let holds = holds.clone();
        if holds.len() <= LEAF {
            return;
        }
        let axis = (high - low).max_position();
        let middle = holds.start + holds.len() as u32 / 2;
        let places = &self.places;
        let key = |i: &u32| places[*i as usize].iter().map(|p| p[axis]).sum::<f64>();
        let part = &mut self.order[holds.start as usize..holds.end as usize];
        part.select_nth_unstable_by((middle - holds.start) as usize, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        let first = self.nodes.len() as u32;
        for holds in [holds.start..middle, middle..holds.end] {
            let (low, high) = self.bounds(holds.clone());
            self.nodes.push(Node { low, high, holds, is_leaf: true });
        }
        self.nodes[node].holds = first..first + 2;
        self.nodes[node].is_leaf = false;
    }

    /// Returns the index in [`Self::corners`] of the triangle nearest to a splat's centre, and the barycentric
    /// coordinates of the nearest place in it. The index is [`NONE`] if the tree is empty.
    fn nearest(&self, at: DVec3, normal: DVec3, stack: &mut Vec<u32>) -> (u32, [f64; 3]) {
        let mut best = (f64::INFINITY, NONE, [1.0, 0.0, 0.0]);
        let distance = |node: u32| {
            let Node { low, high, .. } = self.nodes[node as usize];
            (at - at.clamp(low, high)).length_squared()
        };
        stack.clear();
        stack.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(next) = stack.pop() {
            if distance(next) >= best.0 {
                continue;
            }
            let Node { ref holds, is_leaf, .. } = self.nodes[next as usize];
            if !is_leaf {
                let [a, b] = [holds.start, holds.start + 1];
                // The nearer child is visited first.
                stack.extend(if distance(a) <= distance(b) { [b, a] } else { [a, b] });
                continue;
            }
            for triangle in &self.order[holds.start as usize..holds.end as usize] {
                let corners = self.places[*triangle as usize];
                let barycentric = nearest_place(at, corners);
                let place: DVec3 = corners.iter().zip(barycentric).map(|(p, b)| *p * b).sum();
                let faces_away = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(normal) < 0.0;
                let far = place.distance_squared(at) + if faces_away { self.away } else { 0.0 };
                if far < best.0 {
                    best = (far, *triangle, barycentric);
                }
            }
        }
        (best.1, best.2)
    }
}

/// Returns the barycentric coordinates of the place on a triangle nearest to a point (Ericson 2004, §5.1.5).
fn nearest_place(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let scale = 1.0 / (va + vb + vc);
    let (v, w) = (vb * scale, vc * scale);
    if v.is_finite() && w.is_finite() { [1.0 - v - w, v, w] } else { [1.0, 0.0, 0.0] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::random::Random;
    use crate::mesh::{MeshMethod, MeshOptions, splats_from_mesh};
    use surfel_model::Column3;

    /// Returns a bent sheet of n×n squares over the unit square, with as many faces that face down.
    fn sheet(n: u32) -> Mesh {
        let at = |i: u32| f64::from(i) / f64::from(n);
        let place = |i: u32| {
            let (x, y) = (at(i % (n + 1)), at(i / (n + 1)));
            DVec3::new(x, y, 0.1 * x * y)
        };
        let positions: Vec<DVec3> = (0..(n + 1) * (n + 1)).map(place).collect();
        let square = |i: u32| {
            let a = i / n * (n + 1) + i % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        let up: Vec<[u32; 3]> = (0..n * n).flat_map(square).collect();
        let down = up.iter().map(|[a, b, c]| [*a, *c, *b]);
        let triangles = up.iter().copied().chain(down).collect();
        Mesh { origin: DVec3::splat(1e5), positions: Column3::from_f64(&positions), triangles, ..Mesh::default() }
    }

    #[test]
    fn the_nearest_place_is_the_nearest_of_all() {
        let mut random = Random::new(5);
        let mut point = || DVec3::new(random.unit(), random.unit(), random.unit());
        let positions: Vec<DVec3> = (0..90).map(|_| point()).collect();
        let triangles = (0..29).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = Mesh { positions: Column3::from_f64(&positions), triangles, ..Mesh::default() };
        let tree = Tree::new(&mesh);
        for _ in 0..500 {
            let at = point() * 1.4 - 0.2;
            let (triangle, barycentric) = tree.nearest(at, DVec3::ZERO, &mut Vec::new());
            let place = |t: usize, b: [f64; 3]| -> DVec3 { tree.places[t].iter().zip(b).map(|(p, b)| *p * b).sum() };
            let found = place(triangle as usize, barycentric).distance(at);
            // Brute force: many places of each triangle, and the three vertices without triangles.
            let steps =
                || (0..=20).flat_map(|i| (0..=20 - i).map(move |j| [i, j, 20 - i - j].map(|b| f64::from(b) / 20.0)));
            let least = (0..tree.corners.len()).flat_map(|t| steps().map(move |b| (t, b)));
            let least = least.map(|(t, b)| place(t, b).distance(at)).fold(f64::INFINITY, f64::min);
            assert!(found <= least + 1e-12 && found > least - 0.1, "{found} {least}");
        }
    }

    #[test]
    fn splats_have_the_values_of_their_mesh_by_every_method() {
        let mesh = sheet(12);
        let vertices = 0..mesh.positions.len();
        let x = ExtraValues::F32(vertices.clone().map(|i| mesh.positions.get(i).x as f32).collect());
        let label = ExtraValues::U8(vertices.map(|i| u8::from(mesh.positions.get(i).y > 0.5)).collect());
        let half = mesh.triangles.len() / 2;
        let side = ExtraValues::U8((0..mesh.triangles.len()).map(|i| u8::from(i >= half)).collect());
        for method in [MeshMethod::PerFace, MeshMethod::PerVertex, MeshMethod::Count(3000), MeshMethod::Detail] {
            let (cloud, _) = splats_from_mesh(&mesh, &MeshOptions::new(method), &NoProgress).unwrap();
            let places = MeshPlaces::new(&mesh, &cloud);
            let values = places.interpolated(&x);
            let labels = places.of_nearest_vertices(&label, &mesh);
            let sides = places.of_triangles(&side);
            for i in 0..cloud.len() {
                let at = cloud.center(i) - mesh.origin;
                assert!((values.get(i) - at.x).abs() < 1e-3, "{method:?} {i}: {} at {at}", values.get(i));
                if (at.y - 0.5 - 0.5 / 12.0).abs() > 1e-3 {
                    assert_eq!(labels.get(i), f64::from(u8::from(at.y > 0.5 + 0.5 / 12.0)), "{method:?} {at}");
                }
                if method != MeshMethod::PerVertex {
                    assert_eq!(sides.get(i), f64::from(u8::from(cloud.normal(i).z < 0.0)), "{method:?} {at}");
                }
            }
        }
    }

    #[test]
    fn vertices_without_triangles_have_values_and_no_triangle_s() {
        let mut mesh = sheet(1);
        let mut positions: Vec<DVec3> = (0..4).map(|i| mesh.positions.get(i)).collect();
        positions.push(DVec3::new(0.5, 0.5, 9.0));
        mesh.positions = Column3::from_f64(&positions);
        let normals = [[0.0, 0.0, 1.0_f32]; 2];
        let centers = [[0.5, 0.5, 9.0], [0.9, 0.1, 0.0]].map(|p: [f64; 3]| p.map(|c| (c + 1e5) as f32));
        let cloud = SplatCloud::disks(&centers, &normals, &[1.0_f32; 2]).unwrap();
        let places = MeshPlaces::new(&mesh, &cloud);
        let values = places.interpolated(&ExtraValues::F64(vec![1.0, 2.0, 3.0, 4.0, 5.0]));
        assert!(values.get(0) == 5.0 && (1.0..3.0).contains(&values.get(1)), "{values:?}");
        let of_triangles = places.of_triangles(&ExtraValues::I32(vec![7, 8, 9, 10]));
        assert!(of_triangles.get(0).is_nan() && of_triangles.get(1) == 7.0, "{of_triangles:?}");
    }
}
