//! Welded triangle surface, with creases and open edges chained into ridges (C12 §5, step 1).

use crate::mesh::geometry::Geometry;
use glam::DVec3;
use std::collections::HashMap;

/// Cosine of 45°, the largest angle by which a ridge may turn at a vertex. At a vertex with a sharper turn, the ridge
/// ends in a corner.
const SHARP_TURN_COS: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Mesh edge, as its two vertices in ascending order.
pub(crate) type Edge = (u32, u32);

pub(crate) fn edge(a: u32, b: u32) -> Edge {
    (a.min(b), a.max(b))
}

/// Constraint on moving a vertex during simplification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Vertex on no ridge, which may move over the surface.
    Smooth,
    /// Vertex inside a ridge, which may move along the ridge.
    Ridge,
    /// Fixed vertex, where ridges end, meet or turn sharply, or where a loop begins.
    Corner,
}

/// Piece of a ridge between two of its vertices, given by their indices in the ridge, with `from` < `to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Piece {
    pub ridge: u32,
    pub from: u32,
    pub to: u32,
}

/// Triangle surface with welded vertices and its ridges.
pub(crate) struct Surface {
    pub positions: Vec<DVec3>,
    pub faces: Vec<[u32; 3]>,
    pub kinds: Vec<Kind>,
    /// Piece of a ridge along each mesh edge that is a crease or open edge, by the edge's vertices.
    pub pieces: HashMap<Edge, Piece>,
    /// Smooth chains of creases and open edges, from corner to corner, as vertex indices. A loop starts and ends at the
    /// same corner.
    pub ridges: Vec<Vec<u32>>,
    /// Largest side of the surface's bounding box, in object units.
    pub extent: f64,
}

/// Returns the unit normal of a triangle; zero if it has no area.
pub(crate) fn normal_of([a, b, c]: [DVec3; 3]) -> DVec3 {
    surfel_math::basis::unit((b - a).cross(c - a))
}

impl Surface {
    /// Welds vertices in the same place, drops triangles without area, and finds the ridges. Ridges consist of edges at
    /// which faces meet at more than the crease angle, of open edges, and of edges with more than two faces or with
    /// inconsistent winding. `crease_cos` is the cosine of the crease angle.
    pub(crate) fn new(geometry: &Geometry, crease_cos: f64) -> Self {
        let weld = geometry.weld();
        let mut index = HashMap::new();
        let mut positions = Vec::new();
        let mut faces = Vec::new();
        for (face, t) in geometry.mesh.triangles.iter().enumerate() {
            if geometry.areas[face] == 0.0 {
                continue;
            }
            faces.push(t.map(|i| {
                *index.entry(weld[i as usize]).or_insert_with(|| {
                    positions.push(geometry.positions[i as usize]);
                    positions.len() as u32 - 1
                })
            }));
        }
        let mut surface = Self {
            kinds: vec![Kind::Smooth; positions.len()],
            positions,
            faces,
            pieces: HashMap::new(),
            ridges: Vec::new(),
            extent: geometry.extent,
        };
        surface.find_ridges(crease_cos);
        surface
    }

    pub(crate) fn corners(&self, face: [u32; 3]) -> [DVec3; 3] {
        face.map(|i| self.positions[i as usize])
    }

    /// Returns the points of a piece, in the ridge's order.
    pub(crate) fn line(&self, piece: &Piece) -> Vec<DVec3> {
        let vertices = &self.ridges[piece.ridge as usize][piece.from as usize..=piece.to as usize];
        vertices.iter().map(|v| self.positions[*v as usize]).collect()
    }

    /// Divides each triangle into four at the middles of its edges, `times` times in succession, and finds the ridges
    /// again.
    pub(crate) fn subdivide(&mut self, times: usize, crease_cos: f64) {
        for _ in 0..times {
            let mut middles = HashMap::new();
            let mut faces = Vec::with_capacity(4 * self.faces.len());
            for [a, b, c] in std::mem::take(&mut self.faces) {
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to)| {
                    *middles.entry(edge(from, to)).or_insert_with(|| {
                        let middle = 0.5 * (self.positions[from as usize] + self.positions[to as usize]);
                        self.positions.push(middle);
                        self.positions.len() as u32 - 1
                    })
                });
                faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
            self.faces = faces;
        }
        self.kinds = vec![Kind::Smooth; self.positions.len()];
        self.pieces.clear();
        self.ridges.clear();
        self.find_ridges(crease_cos);
    }

    fn find_ridges(&mut self, crease_cos: f64) {
        let mut sides: Vec<(Edge, bool, u32)> = Vec::with_capacity(3 * self.faces.len());
        for (face, [a, b, c]) in self.faces.iter().enumerate() {
            for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
                sides.push((edge(from, to), from < to, face as u32));
            }
        }
        sides.sort_unstable();
        let normal = |face: u32| normal_of(self.corners(self.faces[face as usize]));
        let is_smooth = |group: &[(Edge, bool, u32)]| match group {
            [a, b] => a.1 != b.1 && normal(a.2).dot(normal(b.2)) >= crease_cos,
            _ => false,
        };
        let features: Vec<Edge> = sides.chunk_by(|a, b| a.0 == b.0).filter(|g| !is_smooth(g)).map(|g| g[0].0).collect();
        let mut neighbours: HashMap<u32, Vec<u32>> = HashMap::new();
        for &(a, b) in &features {
            neighbours.entry(a).or_default().push(b);
            neighbours.entry(b).or_default().push(a);
        }
        for (&v, around) in &neighbours {
            let p = self.positions[v as usize];
            let is_straight = match around[..] {
                [a, b] => {
                    let (before, after) = (p - self.positions[a as usize], self.positions[b as usize] - p);
                    before.dot(after) >= SHARP_TURN_COS * before.length() * after.length()
                }
                _ => false,
            };
            self.kinds[v as usize] = if is_straight { Kind::Ridge } else { Kind::Corner };
        }
        // Chains from corners come first; the remaining ones are loops, which get a corner where they begin.
        let starts = |kinds: &[Kind]| -> Vec<Edge> {
            let from =
                |&(a, b): &Edge| [(a, b), (b, a)].into_iter().filter(|(v, _)| kinds[*v as usize] == Kind::Corner);
            features.iter().flat_map(from).collect()
        };
        for (start, next) in starts(&self.kinds) {
            self.chain(start, next, &neighbours);
        }
        for &(start, next) in &features {
            if !self.pieces.contains_key(&(start, next)) {
                self.kinds[start as usize] = Kind::Corner;
                self.chain(start, next, &neighbours);
            }
        }
    }

    fn chain(&mut self, start: u32, next: u32, neighbours: &HashMap<u32, Vec<u32>>) {
        if self.pieces.contains_key(&edge(start, next)) {
            return;
        }
        let ridge = self.ridges.len() as u32;
        let mut chain = vec![start];
        let (mut before, mut at) = (start, next);
        loop {
            let from = chain.len() as u32 - 1;
            self.pieces.insert(edge(before, at), Piece { ridge, from, to: from + 1 });
            chain.push(at);
            if self.kinds[at as usize] != Kind::Ridge {
                break;
            }
            let Some(&after) = neighbours.get(&at).and_then(|n| n.iter().find(|v| **v != before)) else { break };
            (before, at) = (at, after);
        }
        self.ridges.push(chain);
    }
}
