//! Detection of edges that divide the shading of a mesh without normals. An edge above the crease angle is a crease if
//! it bends by more than 80°. It is also a crease if it is part of a line and either a plane ends there, or the edge
//! bends clearly more than the surface around it.

use super::geometry::{Geometry, SAME_NORMAL, Side, edges, find, join};

/// Cosine of 80°, the dihedral angle from which every edge is a crease.
const SHARP_COS: f64 = 0.173_648_177_666_930;
/// Smallest number of connected feature edges that form a line. A feature edge is open, above the crease angle, shared
/// by more than two faces, or between faces of opposite winding. Edges of shorter chains are creases only above
/// [`SHARP_COS`]'s angle, if the chain is a closed loop, or if one of its edges is [`LONG`].
const LINE: usize = 8;
/// Length, relative to the mesh's extent, above which a single feature edge forms a line.
const LONG: f64 = 1.0 / 16.0;
/// Smallest ratio of an edge's angle (between its faces' normals) to the largest angle at smooth edges nearby at which
/// the edge can be a crease. Sharper edges than [`SHARP_COS`] and edges of a plane are creases at any ratio. Where a
/// coarse mesh bends most, only some edges are above the crease angle, and the edges nearby are bent only slightly
/// less.
const CLEAR: f64 = 2.5;
/// Fraction of the mesh's area above which two coplanar faces together count as a plane.
const PLANE_AREA_FRACTION: f64 = 1.0 / 200.0;

/// Properties of a mesh's vertices and faces by which edges are classified as creases.
pub(super) struct Creases {
    /// Flag per vertex, true if the vertex is on a line of feature edges ([`LINE`]).
    line: Vec<bool>,
    /// Cosine, per face, of the largest bend (angle between adjacent faces) at the smooth edges of the face and of its
    /// neighbours.
    least: Vec<f64>,
    /// Flag per face, true if the face is part of a plane of several faces.
    planar: Vec<bool>,
}

impl Creases {
    /// Computes the properties of a mesh. `sides` are the edges of its faces, sorted by edge.
    pub(super) fn new(geometry: &Geometry, sides: &[Side]) -> Self {
        Self { line: lines(geometry, sides), least: least_cosines(geometry, sides), planar: planar(geometry, sides) }
    }

    /// True if an edge above the crease angle is a crease, so that the faces on its sides share no normals.
    pub(super) fn divide(&self, geometry: &Geometry, a: &Side, b: &Side) -> bool {
        let cosine = geometry.cos(a, b);
        let is_planar = || self.planar[a.face()] || self.planar[b.face()];
        let is_clear = || cosine.acos() >= CLEAR * self.least[a.face()].min(self.least[b.face()]).acos();
        cosine < SHARP_COS || self.line[a.lo as usize] && (is_planar() || is_clear())
    }
}

/// Returns a flag per vertex, true if the feature edges connected with the vertex form a line. Connected edges form a
/// line if they contain a closed loop, if they are at least [`LINE`] edges, or if one of them is [`LONG`]. A few short
/// feature edges occur where a coarse mesh bends most, and are no crease.
fn lines(geometry: &Geometry, sides: &[Side]) -> Vec<bool> {
    let mut group: Vec<u32> = (0..geometry.positions.len() as u32).collect();
    let is_feature = |edge: &&[Side]| !matches!(edge, [a, b] if a.forward != b.forward && geometry.is_smooth(a, b));
    let features: Vec<&[Side]> = edges(sides).filter(is_feature).collect();
    features.iter().for_each(|edge| join(&mut group, edge[0].lo, edge[0].hi));
    let root: Vec<u32> = (0..group.len() as u32).map(|vertex| find(&mut group, vertex)).collect();
    let (mut edges, mut vertices, mut is_long) = (vec![0; root.len()], vec![0; root.len()], vec![false; root.len()]);
    root.iter().for_each(|root| vertices[*root as usize] += 1);
    for edge in features {
        let [lo, hi] = [edge[0].lo, edge[0].hi].map(|vertex| vertex as usize);
        let root = root[lo] as usize;
        edges[root] += 1;
        is_long[root] |= geometry.positions[lo].distance(geometry.positions[hi]) > LONG * geometry.extent;
    }
    // A tree has one edge less than vertices.
    let is_line = |root: usize| edges[root] >= vertices[root].min(LINE) || is_long[root];
    root.iter().map(|root| is_line(*root as usize)).collect()
}

/// Returns a flag per face, true if the face is part of a plane: it is coplanar with at least two connected faces. One
/// suffices if both together exceed [`PLANE_AREA_FRACTION`] of the area. Constructed shapes have such planes; normals
/// shared across the planes' edges would vary all over them.
fn planar(geometry: &Geometry, sides: &[Side]) -> Vec<bool> {
    let mut group: Vec<u32> = (0..geometry.areas.len() as u32).collect();
    for edge in edges(sides) {
        if let [a, b] = edge
            && geometry.cos(a, b) >= SAME_NORMAL
        {
            join(&mut group, a.face() as u32, b.face() as u32);
        }
    }
    let root: Vec<u32> = (0..group.len() as u32).map(|face| find(&mut group, face)).collect();
    let mut of = vec![(0, 0.0); root.len()];
    for (root, area) in root.iter().zip(&geometry.areas) {
        let (faces, sum) = &mut of[*root as usize];
        (*faces, *sum) = (*faces + 1, *sum + area);
    }
    let large = PLANE_AREA_FRACTION * geometry.total_area();
    let is_plane = |(faces, area): (u32, f64)| faces > 2 || faces == 2 && area > large;
    root.into_iter().map(|root| is_plane(of[root as usize])).collect()
}

/// Returns, per face, the cosine of the largest bend (angle between adjacent faces) at the smooth edges of the face and
/// of its neighbours.
fn least_cosines(geometry: &Geometry, sides: &[Side]) -> Vec<f64> {
    let bends = || {
        edges(sides).filter_map(|edge| match edge {
            [a, b] if geometry.is_smooth(a, b) => Some(([a.face(), b.face()], geometry.cos(a, b))),
            _ => None,
        })
    };
    let mut own = vec![1.0_f64; geometry.areas.len()];
    bends().for_each(|(faces, cosine)| faces.into_iter().for_each(|face| own[face] = own[face].min(cosine)));
    let mut all = own.clone();
    for ([a, b], _) in bends() {
        (all[a], all[b]) = (all[a].min(own[b]), all[b].min(own[a]));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::geometry::{Kind, Smooth};
    use glam::{DVec2, DVec3};
    use surfel_model::{Column3, Mesh};

    /// True if all faces have the same normal at a vertex.
    fn has_one_normal(mesh: &Mesh, smooth: &Smooth, vertex: u32) -> bool {
        let corners = mesh.triangles.iter().zip(&smooth.corner_normals);
        let normals = corners.flat_map(|(t, n)| (0..3).filter(|k| t[*k] == vertex).map(|k| n[k]).collect::<Vec<_>>());
        normals.collect::<Vec<_>>().windows(2).all(|n| n[0].distance(n[1]) < 1e-9)
    }

    /// True if all faces at the middle vertex of a ridge have the same normal there. The ridge of `edges` edges is in
    /// the middle of a roof of `cells` squares along each side. The roof slopes down by `slope` on both sides and is
    /// blunt elsewhere.
    fn is_smooth_over_ridge(cells: u32, edges: u32, slope: f64) -> bool {
        let (middle, first) = (cells / 2, (cells - edges) / 2);
        let is_ridge = |i: u32, j: u32| i == middle && (first..=first + edges).contains(&j);
        let places = (0..=cells).flat_map(|j| (0..=cells).map(move |i| (i, j)));
        let height = |i: u32, j: u32| match i.abs_diff(middle) {
            0 if !is_ridge(i, j) => -0.9,
            far => -f64::from(far),
        };
        let place = |(i, j)| DVec3::new(f64::from(i), f64::from(j), slope * height(i, j));
        let positions: Vec<DVec3> = places.map(place).collect();
        let at = |i: u32, j: u32| j * (cells + 1) + i;
        let squares = (0..cells).flat_map(|j| (0..cells).map(move |i| (i, j)));
        let square = |(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        let triangles: Vec<[u32; 3]> = squares.flat_map(square).collect();
        let mesh = Mesh { positions: Column3::from_f64(&positions), triangles, ..Mesh::default() };
        let smooth = Geometry::new(&mesh).smooth();
        assert!(smooth.borders.iter().filter(|b| b.kind == Kind::Crease).count() >= 2 * edges as usize);
        let ridge = at(middle, first + edges / 2);
        has_one_normal(&mesh, &smooth, ridge)
    }

    /// True if all faces at a vertex in the middle of a strip have the same normal there. The strip turns by these
    /// angles from one facet to the next. Its vertices are raised by up to ten times `uneven`, so that facets aren't
    /// plane.
    fn is_smooth_over_middle(turns_deg: &[f64], uneven: f64) -> bool {
        const ROWS: u32 = 20;
        let (mut at, mut angle) = (DVec2::ZERO, 0.0_f64);
        let mut profile = vec![at];
        for turn in turns_deg.iter().chain([&0.0]) {
            at += DVec2::from_angle(angle);
            profile.push(at);
            angle += turn.to_radians();
        }
        let count = profile.len() as u32;
        let row = |j: u32| {
            let shaken = move |i: usize| uneven * f64::from((31 * i as u32 + 17 * j) * (i as u32 + 3 * j + 1) % 11);
            profile.iter().enumerate().map(move |(i, p)| DVec3::new(p.x, f64::from(j), p.y + shaken(i)))
        };
        let positions: Vec<DVec3> = (0..=ROWS).flat_map(row).collect();
        let squares = (0..ROWS).flat_map(|j| (0..count - 1).map(move |i| j * count + i));
        let triangles: Vec<[u32; 3]> =
            squares.flat_map(|a| [[a, a + 1, a + 1 + count], [a, a + 1 + count, a + count]]).collect();
        let mesh = Mesh { positions: Column3::from_f64(&positions), triangles, ..Mesh::default() };
        has_one_normal(&mesh, &Geometry::new(&mesh).smooth(), ROWS / 2 * count + count / 2)
    }

    #[test]
    fn an_edge_is_no_crease_where_the_surface_beside_it_bends_nearly_as_much() {
        for (turns, uneven, smooth) in [
            ([30.0, 44.0, 36.0], 0.005, true),
            ([30.0, 39.0, 36.0], 0.005, true),
            ([10.0, 44.0, 12.0], 0.005, false),
            ([30.0, 95.0, 36.0], 0.005, false),
            // Like a prism with eight sides.
            ([45.0, 45.0, 45.0], 0.0, false),
            // Like a bevel between planes.
            ([30.0, 44.0, 36.0], 0.0, false),
        ] {
            assert_eq!(is_smooth_over_middle(&turns, uneven), smooth, "{turns:?} {uneven}");
        }
    }

    #[test]
    fn a_few_short_edges_are_no_crease_unless_they_are_sharp() {
        // Slopes of 0.47 meet at 50°, slopes of 1 at 90°.
        for (cells, edges, slope, smooth) in
            [(40, 2, 0.47, true), (40, 4, 0.47, true), (40, 12, 0.47, false), (40, 2, 1.0, false), (8, 4, 0.47, false)]
        {
            assert_eq!(is_smooth_over_ridge(cells, edges, slope), smooth, "{cells} {edges} {slope}");
        }
    }
}
