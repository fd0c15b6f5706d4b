//! A mesh's faces, welded vertices and smooth normals, in f64 relative to its origin.

use glam::DVec3;
use rayon::prelude::*;
use surfel_math::basis::unit;
use surfel_model::Mesh;

/// Cosine of the crease angle, 40°: faces that meet at a larger one don't share a smooth normal.
const CREASE_COS: f64 = 0.766_044_443_118_978;
/// A triangle has no area when it is thinner than this share of its longest edge: below it, its normal is made of
/// the rounding of f32 positions.
const THINNEST: f64 = 1e-9;

/// What the samplers ask of a mesh. Indices must be valid and positions finite.
pub(crate) struct Geometry<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) positions: Vec<DVec3>,
    /// Unit face normals; zero where a triangle has no area.
    pub(crate) normals: Vec<DVec3>,
    /// Areas; zero where the normal is.
    pub(crate) areas: Vec<f64>,
    /// Largest side of the bounds.
    pub(crate) extent: f64,
}

/// An edge of the surface between welded vertices, seen from one of its faces.
#[derive(Clone, Copy)]
struct Side {
    lo: u32,
    hi: u32,
    /// The corner (3·face + 0..3) that the edge starts at, in the face's own order.
    corner: u32,
    /// The face runs from `lo` to `hi`.
    forward: bool,
}

impl<'a> Geometry<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let positions: Vec<DVec3> = (0..mesh.positions.len()).map(|i| mesh.positions.get(i)).collect();
        let face = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            let (e, f, g) = (b - a, c - a, c - b);
            let longest = e.length_squared().max(f.length_squared()).max(g.length_squared());
            let cross = e.cross(f);
            let double = cross.length();
            // NaN (an overflow of huge coordinates) must count as no area too.
            if double > THINNEST * longest && double.is_finite() {
                (unit(cross), 0.5 * double)
            } else {
                (DVec3::ZERO, 0.0)
            }
        };
        let (normals, areas) = mesh.triangles.par_iter().map(face).unzip();
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in &positions {
            (lo, hi) = (lo.min(*p), hi.max(*p));
        }
        Self { mesh, normals, areas, extent: (hi - lo).max_element(), positions }
    }

    pub(crate) fn corners(&self, face: usize) -> [DVec3; 3] {
        self.mesh.triangles[face].map(|i| self.positions[i as usize])
    }

    pub(crate) fn total_area(&self) -> f64 {
        self.areas.iter().sum()
    }

    pub(crate) fn degenerate(&self) -> usize {
        self.areas.iter().filter(|a| **a == 0.0).count()
    }

    /// Area of the triangles that have an edge longer than `limit`.
    pub(crate) fn area_of_long_triangles(&self, limit: f64) -> f64 {
        let is_long = |face: usize| {
            let [a, b, c] = self.corners(face);
            a.distance(b).max(b.distance(c)).max(c.distance(a)) > limit
        };
        (0..self.areas.len()).filter(|f| is_long(*f)).map(|f| self.areas[f]).sum()
    }

    /// For each vertex the first vertex in the same place: files split vertices along texture seams.
    pub(crate) fn weld(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.positions.len() as u32).collect();
        let key = |i: u32| (self.positions[i as usize] + DVec3::ZERO).to_array().map(f64::to_bits);
        order.par_sort_unstable_by_key(|&i| (key(i), i));
        let mut first = vec![0; order.len()];
        let mut leader = 0;
        for (place, &i) in order.iter().enumerate() {
            if place == 0 || key(order[place - 1]) != key(i) {
                leader = i;
            }
            first[i as usize] = leader;
        }
        first
    }

    /// The corner angle of `face` at its corner 0..3.
    fn angle(&self, face: usize, corner: usize) -> f64 {
        let p = self.corners(face);
        let (a, b) = (p[(corner + 1) % 3] - p[corner], p[(corner + 2) % 3] - p[corner]);
        a.cross(b).length().atan2(a.dot(b))
    }

    /// Smooth unit normals of every corner, and the edges that are creases or borders (their two ends).
    ///
    /// Where the mesh has vertex normals, they are the answer. Else normals are averaged over the corners of a
    /// vertex, weighted by angle (Thürmer and Wüthrich 1998), across edges of at most 40° only.
    pub(crate) fn smooth(&self) -> (Vec<[DVec3; 3]>, Vec<[DVec3; 2]>) {
        let (corners, features) = self.smooth_corners(&self.weld());
        let own = |(face, smooth): (usize, [DVec3; 3])| {
            let Some(given) = &self.mesh.normals else { return smooth };
            let given = self.mesh.triangles[face].map(|i| unit(DVec3::from(given[i as usize].map(f64::from))));
            std::array::from_fn(|k| if given[k] == DVec3::ZERO { smooth[k] } else { given[k] })
        };
        (corners.into_par_iter().enumerate().map(own).collect(), features)
    }

    fn smooth_corners(&self, weld: &[u32]) -> (Vec<[DVec3; 3]>, Vec<[DVec3; 2]>) {
        let mut sides: Vec<Side> = Vec::with_capacity(3 * self.areas.len());
        for (face, t) in self.mesh.triangles.iter().enumerate() {
            if self.areas[face] == 0.0 {
                continue;
            }
            for k in 0..3 {
                let (a, b) = (weld[t[k] as usize], weld[t[(k + 1) % 3] as usize]);
                sides.push(Side { lo: a.min(b), hi: a.max(b), corner: (3 * face + k) as u32, forward: a < b });
            }
        }
        sides.par_sort_unstable_by_key(|s| (s.lo, s.hi, s.corner));
        // Groups of corners that share a normal.
        let mut group: Vec<u32> = (0..3 * self.areas.len() as u32).collect();
        let mut features = Vec::new();
        for edge in sides.chunk_by(|a, b| (a.lo, a.hi) == (b.lo, b.hi)) {
            match edge {
                [a, b] if a.forward != b.forward && self.is_smooth(a, b) => {
                    // The corner where one face's edge starts is where the other's ends.
                    join(&mut group, a.corner, next(b.corner));
                    join(&mut group, next(a.corner), b.corner);
                }
                _ => features.push([self.positions[edge[0].lo as usize], self.positions[edge[0].hi as usize]]),
            }
        }
        let mut sums = vec![DVec3::ZERO; group.len()];
        for face in (0..self.areas.len()).filter(|f| self.areas[*f] > 0.0) {
            for k in 0..3 {
                let root = find(&mut group, (3 * face + k) as u32);
                sums[root as usize] += self.angle(face, k) * self.normals[face];
            }
        }
        let corners = (0..self.areas.len()).map(|face| {
            std::array::from_fn(|k| {
                let n = unit(sums[find(&mut group, (3 * face + k) as u32) as usize]);
                if n == DVec3::ZERO { self.normals[face] } else { n }
            })
        });
        (corners.collect(), features)
    }

    fn is_smooth(&self, a: &Side, b: &Side) -> bool {
        self.normals[a.corner as usize / 3].dot(self.normals[b.corner as usize / 3]) >= CREASE_COS
    }

    /// Unit normals of the vertices, averaged over all their faces by angle and over vertices in the same place;
    /// the mesh's own where it has them. Zero for vertices of no face.
    pub(crate) fn vertex_normals(&self, weld: &[u32]) -> Vec<DVec3> {
        let mut sums = vec![DVec3::ZERO; weld.len()];
        for (face, t) in self.mesh.triangles.iter().enumerate() {
            for (k, i) in t.iter().enumerate() {
                if self.areas[face] > 0.0 {
                    sums[weld[*i as usize] as usize] += self.angle(face, k) * self.normals[face];
                }
            }
        }
        let own = |i: usize| self.mesh.normals.as_ref().map_or(DVec3::ZERO, |n| unit(DVec3::from(n[i].map(f64::from))));
        let normal =
            |(i, first): (usize, &u32)| if own(i) == DVec3::ZERO { unit(sums[*first as usize]) } else { own(i) };
        weld.iter().enumerate().map(normal).collect()
    }

    /// True when the mesh has colours or a texture.
    pub(crate) fn is_painted(&self) -> bool {
        let m = self.mesh;
        m.colors.is_some() || m.alphas.is_some() || (m.texture.is_some() && m.uvs.is_some())
    }

    /// Linear RGB and alpha at barycentric coordinates `b` of a face.
    pub(crate) fn color(&self, face: usize, b: [f64; 3]) -> [f32; 4] {
        let (t, b) = (self.mesh.triangles[face].map(|i| i as usize), b.map(|x| x as f32));
        let mix = |value: &dyn Fn(usize) -> f32| (0..3).map(|k| b[k] * value(t[k])).sum::<f32>();
        let mut color = [1.0; 4];
        if let Some(c) = &self.mesh.colors {
            for (channel, out) in color[..3].iter_mut().enumerate() {
                *out = mix(&|i| c[i][channel]);
            }
        }
        if let Some(a) = &self.mesh.alphas {
            color[3] = mix(&|i| a[i]);
        }
        if let (Some(texture), Some(uvs)) = (&self.mesh.texture, &self.mesh.uvs) {
            let texel = texture.sample([mix(&|i| uvs[i][0]), mix(&|i| uvs[i][1])]);
            color.iter_mut().zip(texel).for_each(|(c, t)| *c *= t);
        }
        color
    }
}

/// The next corner of the same face.
fn next(corner: u32) -> u32 {
    if corner % 3 == 2 { corner - 2 } else { corner + 1 }
}

fn find(group: &mut [u32], mut i: u32) -> u32 {
    while group[i as usize] != i {
        group[i as usize] = group[group[i as usize] as usize];
        i = group[i as usize];
    }
    i
}

fn join(group: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(group, a), find(group, b));
    group[a.max(b) as usize] = a.min(b);
}
