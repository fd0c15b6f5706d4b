//! A mesh's faces, welded vertices and smooth normals, in f64 relative to its origin.

use super::creases::Creases;
use crate::parallel::map_each;
use crate::progress::NoProgress;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::cell::LazyCell;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{AlphaMode, Mesh};

/// Cosine of the crease angle, 40°. Faces that meet at a larger angle don't share a smooth normal.
const CREASE_COS: f64 = 0.766_044_443_118_978;
/// Cosine of 0.02°, the largest angle between two normals that count as equal.
pub(crate) const SAME_NORMAL: f64 = 1.0 - 6e-8;
/// Cosine of 15°, the largest angle between faces at which splats don't end at the edge. Splats protrude there by less
/// than half the distance between them.
const BENT_COS: f64 = 0.965_925_826_289_068;
/// Smallest height of a triangle, relative to its longest edge, at which it has an area. The normal of a thinner
/// triangle would consist of the rounding of f32 positions.
const THINNEST: f64 = 1e-9;

/// Area of a mesh, relative to its squared extent, above which the mesh is searched for repeated triangles. A box has
/// at most six. Without the search, the splats of thousands of triangles in one place would all coincide.
const MANIFOLD: f64 = 8.0;

/// Mesh prepared for sampling: positions in f64, and normals and areas of its faces. Indices must be valid and
/// positions finite.
pub(crate) struct Geometry<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) positions: Vec<DVec3>,
    /// Unit normal of each face; zero for triangles without area.
    pub(crate) normals: Vec<DVec3>,
    /// Area of each face; zero where the normal is zero.
    pub(crate) areas: Vec<f64>,
    /// Largest side of the mesh's bounding box, in object units.
    pub(crate) extent: f64,
    /// Number of triangles with the corners and winding of an earlier one. Their areas and normals are set to zero. 0
    /// if the mesh wasn't searched for them ([`MANIFOLD`]).
    pub(crate) repeated: usize,
}

/// Side of an edge that belongs to one face: the edge's welded vertices `lo` < `hi`, and the face's own order of them.
#[derive(Clone, Copy)]
pub(super) struct Side {
    pub(super) lo: u32,
    pub(super) hi: u32,
    /// Corner (3·face + 0..3) at which the edge starts, in the face's own order.
    corner: u32,
    /// True if the face's own order runs from vertex `lo` to vertex `hi`.
    pub(super) forward: bool,
}

impl Side {
    pub(super) fn face(&self) -> usize {
        self.corner as usize / 3
    }
}

/// Reason why splats end at an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Open edge: there is no face on the other side.
    Open,
    /// Crease: faces meet at a large angle, or more than two meet, or their windings disagree.
    Crease,
    /// Bend of a smooth surface that is so strong that splats would protrude from the surface.
    Bend,
    /// Edge at which the surface continues in another part of an octree.
    Cut,
}

/// Edge at which the splats of one of its faces end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Border {
    /// Ends of the edge, with the face on the left when seen from outside.
    pub(crate) ends: [DVec3; 2],
    /// Corner (3·face + 0..3) at which the edge starts, and which thus gives the face.
    pub(crate) corner: u32,
    /// Index of the face on the other side; `None` unless there is exactly one.
    pub(crate) across: Option<u32>,
    pub(crate) kind: Kind,
}

impl Border {
    pub(super) fn face(&self) -> u32 {
        self.corner / 3
    }
}

/// Smooth normals of a mesh, and the borders at which splats end.
pub(crate) struct Smooth {
    /// Unit normals that shade the three corners of each face.
    pub(crate) corner_normals: Vec<[DVec3; 3]>,
    /// Number of edges that are creases or open.
    pub(crate) feature_edges: usize,
    /// Edges at which splats end, once for each face: creases, open edges, and bends of more than 15°.
    pub(crate) borders: Vec<Border>,
    /// Smooth region of each face, as the lowest index of a face in it; creases and open edges separate regions.
    pub(crate) regions: Vec<u32>,
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
        let faces = map_each(mesh.triangles.len(), &NoProgress, || (), |(), i| face(&mesh.triangles[i]));
        let (normals, areas) = faces.into_iter().unzip();
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in &positions {
            (lo, hi) = (lo.min(*p), hi.max(*p));
        }
        let mut geometry = Self { mesh, normals, areas, extent: (hi - lo).max_element(), repeated: 0, positions };
        if geometry.total_area() > MANIFOLD * geometry.extent * geometry.extent {
            geometry.drop_repeated();
        }
        geometry
    }

    /// Sets the area and normal of repeated triangles to zero. Such a triangle has the corners and winding of an
    /// earlier one.
    fn drop_repeated(&mut self) {
        let key = |face: usize| {
            let corners = self.corners(face).map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits));
            let first = (0..3).min_by_key(|k| corners[*k]).unwrap_or(0);
            [corners[first], corners[(first + 1) % 3], corners[(first + 2) % 3]]
        };
        let mut faces: Vec<u32> = (0..self.areas.len() as u32).filter(|f| self.areas[*f as usize] > 0.0).collect();
        faces.par_sort_unstable_by_key(|&face| (key(face as usize), face));
        let same = faces.windows(2).filter(|pair| key(pair[0] as usize) == key(pair[1] as usize));
        let repeated: Vec<usize> = same.map(|pair| pair[1] as usize).collect();
        self.repeated = repeated.len();
        for face in repeated {
            (self.normals[face], self.areas[face]) = (DVec3::ZERO, 0.0);
        }
    }

    pub(crate) fn corners(&self, face: usize) -> [DVec3; 3] {
        self.mesh.triangles[face].map(|i| self.positions[i as usize])
    }

    pub(crate) fn total_area(&self) -> f64 {
        self.areas.iter().sum()
    }

    pub(crate) fn degenerate(&self) -> usize {
        self.areas.iter().filter(|a| **a == 0.0).count() - self.repeated
    }

    /// Returns the area of the triangles that have an edge longer than `limit`.
    pub(crate) fn area_of_long_triangles(&self, limit: f64) -> f64 {
        let is_long = |face: usize| {
            let [a, b, c] = self.corners(face);
            a.distance(b).max(b.distance(c)).max(c.distance(a)) > limit
        };
        (0..self.areas.len()).filter(|f| is_long(*f)).map(|f| self.areas[f]).sum()
    }

    /// Returns, for each vertex, the first vertex in the same place: files split vertices along texture seams.
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

    /// Returns the angle of `face` at one of its corners (0 to 2), in radians.
    pub(crate) fn angle(&self, face: usize, corner: usize) -> f64 {
        let p = self.corners(face);
        let (a, b) = (p[(corner + 1) % 3] - p[corner], p[(corner + 2) % 3] - p[corner]);
        a.cross(b).length().atan2(a.dot(b))
    }

    /// Computes smooth unit normals of all corners; the edges at which splats end (creases, open edges, and bends of
    /// more than 15°); and the regions that creases and open edges separate.
    ///
    /// The mesh's vertex normals are used if it has any. If it has none, or where one is zero, normals are averaged
    /// over the faces at a vertex, weighted by angle (Thürmer and Wüthrich 1998). The mean includes faces across edges
    /// of at most 40°. If the mesh has no normals, it also includes faces across steeper edges that aren't creases by
    /// [`Creases::divide`].
    pub(crate) fn smooth(&self) -> Smooth {
        let smooth = self.smooth_corners(&self.weld());
        let Some(given) = &self.mesh.normals else { return smooth };
        let own = |face: usize| {
            let smooth = smooth.corner_normals[face];
            let given = self.mesh.triangles[face].map(|i| unit(DVec3::from(given[i as usize].map(f64::from))));
            std::array::from_fn(|k| if given[k] == DVec3::ZERO { smooth[k] } else { given[k] })
        };
        let corner_normals = map_each(smooth.corner_normals.len(), &NoProgress, || (), |(), face| own(face));
        Smooth { corner_normals, ..smooth }
    }

    fn smooth_corners(&self, weld: &[u32]) -> Smooth {
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
        // Union-find groups of corners that share a normal, and of faces in one region.
        let mut group: Vec<u32> = (0..3 * self.areas.len() as u32).collect();
        let mut regions: Vec<u32> = (0..self.areas.len() as u32).collect();
        let (mut borders, mut feature_edges) = (Vec::new(), 0);
        let normal = |side: &Side| self.normals[side.corner as usize / 3];
        // The corner where one face's edge starts is where the other's ends.
        let mut share_normals = |a: &Side, b: &Side| {
            join(&mut group, a.corner, next(b.corner));
            join(&mut group, next(a.corner), b.corner);
        };
        // Crease detection is needed only if the mesh has no normals of its own.
        let creases = self.mesh.normals.is_none().then(|| LazyCell::new(|| Creases::new(self, &sides)));
        for edge in edges(&sides) {
            match edge {
                [a, b] if a.forward != b.forward && self.is_smooth(a, b) => {
                    share_normals(a, b);
                    join(&mut regions, a.corner / 3, b.corner / 3);
                    if normal(a).dot(normal(b)) < BENT_COS {
                        borders.extend([self.border(a, Some(b), Kind::Bend), self.border(b, Some(a), Kind::Bend)]);
                    }
                }
                [a, b] => {
                    if a.forward != b.forward && creases.as_ref().is_some_and(|creases| !creases.divide(self, a, b)) {
                        share_normals(a, b);
                    }
                    borders.extend([self.border(a, Some(b), Kind::Crease), self.border(b, Some(a), Kind::Crease)]);
                    feature_edges += 1;
                }
                all => {
                    let kind = if all.len() == 1 { Kind::Open } else { Kind::Crease };
                    borders.extend(all.iter().map(|side| self.border(side, None, kind)));
                    feature_edges += 1;
                }
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
        let corner_normals = corners.collect();
        let regions: Vec<u32> = (0..regions.len() as u32).map(|face| find(&mut regions, face)).collect();
        Smooth { corner_normals, feature_edges, borders, regions }
    }

    /// Builds the border along an edge for the face at `side`; `across` is the side of the edge that belongs to the
    /// other face.
    fn border(&self, side: &Side, across: Option<&Side>, kind: Kind) -> Border {
        let corners = self.corners(side.corner as usize / 3);
        let k = side.corner as usize % 3;
        let across = across.map(|other| other.corner / 3);
        Border { ends: [corners[k], corners[(k + 1) % 3]], corner: side.corner, across, kind }
    }

    pub(super) fn is_smooth(&self, a: &Side, b: &Side) -> bool {
        self.cos(a, b) >= CREASE_COS
    }

    /// Returns the cosine of the angle between two faces' normals.
    pub(super) fn cos(&self, a: &Side, b: &Side) -> f64 {
        self.normals[a.face()].dot(self.normals[b.face()])
    }

    /// Returns unit normals of the vertices: the mesh's own, or, where that is missing or zero, the angle-weighted mean
    /// over all faces at the vertex's position. Zero for vertices without faces, and where the faces' normals cancel.
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

    /// True if the mesh has colours, alphas or a texture.
    pub(crate) fn is_painted(&self) -> bool {
        let m = self.mesh;
        m.colors.is_some() || m.alphas.is_some() || m.is_textured()
    }

    /// Applies the normal map to the smooth unit normal at barycentric coordinates `b` of a face. The map is averaged
    /// over nine samples in a square of side `extent` (in object units), or sampled once if that is 0. Samples beyond
    /// the face are replaced by the one at `b`. The image's axes follow the face's texture coordinates. Returns
    /// `smooth` if the face has no normal map, or no usable texture coordinates.
    pub(crate) fn mapped_normal(&self, face: usize, b: [f64; 3], smooth: DVec3, extent: f64) -> DVec3 {
        let (Some(map), Some(uvs)) = (self.mesh.material(face).normal_map, &self.mesh.uvs) else { return smooth };
        let Some((right, up)) = self.image_axes(face, smooth) else { return smooth };
        let t = self.mesh.triangles[face].map(|i| uvs[i as usize]);
        let at = |b: [f64; 3]| {
            let uv = [0, 1].map(|axis| (0..3).map(|k| b[k] as f32 * t[k][axis]).sum::<f32>());
            DVec3::from(map.sample(uv).map(f64::from))
        };
        let plane = orthonormal(self.normals[face]);
        let changes = (self.barycentric_change(face, plane.0), self.barycentric_change(face, plane.1));
        let mean = match changes {
            (Some(u), Some(v)) if extent > 0.0 => {
                let places = [-1.0, 0.0, 1.0].into_iter().flat_map(|y| [-1.0, 0.0, 1.0].map(|x| (x, y)));
                let about = places.map(|(x, y)| {
                    let at: [f64; 3] = std::array::from_fn(|k| b[k] + (x * u[k] + y * v[k]) * extent / 3.0);
                    if at.iter().all(|b| *b >= 0.0) { at } else { b }
                });
                about.map(at).sum::<DVec3>()
            }
            _ => at(b),
        };
        let mapped = unit(right * mean.x + up * mean.y + smooth * mean.z);
        if mapped == DVec3::ZERO { smooth } else { mapped }
    }

    /// Returns the right and up directions of the texture image on a face, as unit vectors perpendicular to a normal.
    /// `None` if the texture coordinates are missing or have no area.
    fn image_axes(&self, face: usize, normal: DVec3) -> Option<(DVec3, DVec3)> {
        let uvs = self.mesh.uvs.as_ref()?;
        let [a, b, c] = self.corners(face);
        let [p, q, r] = self.mesh.triangles[face].map(|i| DVec2::from(uvs[i as usize].map(f64::from)));
        let (e, f, g, h) = (b - a, c - a, q - p, r - p);
        let turns = g.perp_dot(h);
        let across = |v: DVec3| unit(v - normal * normal.dot(v));
        // (e h.y − f g.y)/turns is the change of position with u; the change with v points down.
        let right = across((e * h.y - f * g.y) * turns.signum());
        let down = (f * g.x - e * h.x) * turns.signum();
        let up = normal.cross(right);
        let up = if up.dot(down) > 0.0 { -up } else { up };
        (turns != 0.0 && right != DVec3::ZERO && right.is_finite()).then_some((right, up))
    }

    /// Returns the number of texels that a triangle shows; 0 without a texture.
    pub(crate) fn texels(&self, face: usize) -> f64 {
        let (Some(texture), Some(uvs)) = (self.mesh.material(face).texture, &self.mesh.uvs) else { return 0.0 };
        let at = |i: u32| DVec3::new(uvs[i as usize][0].into(), uvs[i as usize][1].into(), 0.0);
        let [a, b, c] = self.mesh.triangles[face].map(at);
        let area = 0.5 * (b - a).cross(c - a).length() * f64::from(texture.width) * f64::from(texture.height);
        if area.is_finite() { area } else { 0.0 }
    }

    /// Returns alpha at barycentric coordinates `b` of a face, regardless of the material's alpha mode.
    pub(crate) fn alpha(&self, face: usize, b: [f64; 3]) -> f32 {
        let t = self.mesh.triangles[face].map(|i| i as usize);
        let mix = |value: &dyn Fn(usize) -> f32| (0..3).map(|k| b[k] as f32 * value(t[k])).sum::<f32>();
        let own = self.mesh.alphas.as_ref().map_or(1.0, |a| mix(&|i| a[i]));
        match (self.mesh.material(face).texture, &self.mesh.uvs) {
            (Some(texture), Some(uvs)) => own * texture.sample([mix(&|i| uvs[i][0]), mix(&|i| uvs[i][1])])[3],
            _ => own,
        }
    }

    /// Returns the colour of a splat: the mean linear RGB and opacity around barycentric coordinates `b` of a face. The
    /// colour is the mean of nine samples in a square of side `extent` (in object units), weighted by their opacity;
    /// samples beyond the face are replaced by the one at `b`. The opacity is their mean only if the material blends,
    /// else the one at `b`. Without a texture, the one sample at `b` is used.
    pub(crate) fn color_about(&self, face: usize, b: [f64; 3], extent: f64) -> [f32; 4] {
        let own = self.color(face, b);
        let material = self.mesh.material(face);
        if material.texture.is_none() || self.mesh.uvs.is_none() {
            return own;
        }
        let along = orthonormal(self.normals[face]);
        let (Some(u), Some(v)) = (self.barycentric_change(face, along.0), self.barycentric_change(face, along.1))
        else {
            return own;
        };
        let (mut sum, mut plain) = ([0.0; 4], [0.0; 3]);
        for (x, y) in [-1.0, 0.0, 1.0].into_iter().flat_map(|y| [-1.0, 0.0, 1.0].map(|x| (x, y))) {
            let at: [f64; 3] = std::array::from_fn(|k| b[k] + (x * u[k] + y * v[k]) * extent / 3.0);
            // Beyond an edge, the surface belongs to another triangle, and perhaps to another part of the texture.
            let is_other = (x != 0.0 || y != 0.0) && at.iter().all(|b| *b >= 0.0);
            let [r, g, b, a] = if is_other { self.color(face, at) } else { own };
            sum.iter_mut().zip([r * a, g * a, b * a, a]).for_each(|(s, c)| *s += c);
            plain.iter_mut().zip([r, g, b]).for_each(|(s, c)| *s += c);
        }
        let [r, g, b, a] = sum;
        let [r, g, b] = if a > 0.0 { [r / a, g / a, b / a] } else { plain.map(|c| c / 9.0) };
        let opacity = if material.alpha == AlphaMode::Blend { a / 9.0 } else { own[3] };
        [r, g, b, opacity]
    }

    /// Returns the change of a face's barycentric coordinates when a point moves by the vector `along`; `None` if the
    /// face has no area.
    pub(crate) fn barycentric_change(&self, face: usize, along: DVec3) -> Option<[f64; 3]> {
        let [a, b, c] = self.corners(face);
        let (e, f) = (b - a, c - a);
        let (ee, ef, ff) = (e.dot(e), e.dot(f), f.dot(f));
        let (x, y) = (along.dot(e), along.dot(f));
        let scale = 1.0 / (ee * ff - ef * ef);
        let (v, w) = ((ff * x - ef * y) * scale, (ee * y - ef * x) * scale);
        (self.areas[face] > 0.0 && v.is_finite() && w.is_finite()).then_some([-v - w, v, w])
    }

    /// Returns linear RGB and opacity at barycentric coordinates `b` of a face. The opacity is 0 where an alpha mask
    /// cuts the surface.
    pub(crate) fn color(&self, face: usize, b: [f64; 3]) -> [f32; 4] {
        let t = self.mesh.triangles[face].map(|i| i as usize);
        let mix = |value: &dyn Fn(usize) -> f32| (0..3).map(|k| b[k] as f32 * value(t[k])).sum::<f32>();
        let mut color = [1.0; 4];
        if let Some(c) = &self.mesh.colors {
            for (channel, out) in color[..3].iter_mut().enumerate() {
                *out = mix(&|i| c[i][channel]);
            }
        }
        if let Some(a) = &self.mesh.alphas {
            color[3] = mix(&|i| a[i]);
        }
        let material = self.mesh.material(face);
        if let (Some(texture), Some(uvs)) = (material.texture, &self.mesh.uvs) {
            let uv = [mix(&|i| uvs[i][0]), mix(&|i| uvs[i][1])];
            let is_seen = material.alpha != AlphaMode::Opaque;
            let texel = if is_seen { texture.sample_by_alpha(uv) } else { texture.sample(uv) };
            color.iter_mut().zip(texel).for_each(|(c, t)| *c *= t);
        }
        color[3] = material.alpha.opacity(color[3]);
        color
    }
}

/// Groups the sides of edges ([`Side`]) by edge; the input must be sorted by edge.
pub(super) fn edges(sides: &[Side]) -> impl Iterator<Item = &[Side]> {
    sides.chunk_by(|a, b| (a.lo, a.hi) == (b.lo, b.hi))
}

/// Returns the next corner of the same face; a corner is 3·face + 0..3.
fn next(corner: u32) -> u32 {
    if corner % 3 == 2 { corner - 2 } else { corner + 1 }
}

pub(super) fn find(group: &mut [u32], mut i: u32) -> u32 {
    while group[i as usize] != i {
        group[i as usize] = group[group[i as usize] as usize];
        i = group[i as usize];
    }
    i
}

pub(super) fn join(group: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(group, a), find(group, b));
    group[a.max(b) as usize] = a.min(b);
}
