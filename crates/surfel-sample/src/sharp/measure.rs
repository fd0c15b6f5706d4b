//! Distances between clipped splats and the mesh from which they were made.

use super::clip::ClippedSplat;
use crate::boxes::Boxes;
use crate::distances::closest;
use crate::mesh::geometry::Geometry;
use crate::parallel::map_tasks;
use glam::DVec3;
use surfel_math::V2;
use surfel_math::clip::Clip;

/// Maximum number of points of the mesh at which distances to the splats are measured.
const MESH_SAMPLES: usize = 40_000;
/// Number of points per splat, evenly spread over its disk ([`spiral`]), at which distances to the mesh are measured.
const SPLAT_SAMPLES: usize = 24;

/// Errors of splats relative to their mesh; distances are in object units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SharpErrors {
    /// Mean and largest distance from points on the visible parts of splats, up to 24 per splat, to the mesh.
    pub splats_to_mesh: [f64; 2],
    /// Mean and largest distance from points on the mesh (the centroids of up to 40,000 triangles) to the visible parts
    /// of splats. Distances are upper bounds where no splat covers the point.
    pub mesh_to_splats: [f64; 2],
    /// Mean angle between a splat's normal and the normal of the nearest triangle, over the points of
    /// [`Self::splats_to_mesh`], in degrees.
    pub normal_deg: f64,
}

impl SharpErrors {
    /// Prefix of the comment that stores the errors in a file.
    pub const PREFIX: &str = "sharp errors: ";

    /// Formats the errors as a line for a file's header, which `surfel info` prints.
    pub fn comment(&self) -> String {
        let ([a, b], [c, d]) = (self.splats_to_mesh, self.mesh_to_splats);
        let distances = format!("splats to mesh {a:.3e} (largest {b:.3e}), mesh to splats {c:.3e} (largest {d:.3e})");
        format!("{}{distances}, normals {:.2} degrees", Self::PREFIX, self.normal_deg)
    }
}

/// Point of a mesh that is nearest to a query point.
struct Foot {
    /// Distance from the query point to the nearest point.
    distance: f64,
    /// Triangle that contains the nearest point; 0 if the mesh has no triangles.
    face: usize,
    barycentric: [f64; 3],
}

/// Sum and maximum of the deviations of splats' sample points from a mesh.
#[derive(Clone, Copy, Default)]
struct Deviation {
    /// Sum of the sample points' distances from the mesh.
    distances: f64,
    largest: f64,
    /// Sum of the angles between the normals of splat and mesh at the sample points, in degrees.
    degrees: f64,
    /// Number of sample points that were measured.
    count: usize,
}

impl Deviation {
    fn add(&mut self, other: &Self) {
        self.distances += other.distances;
        self.largest = self.largest.max(other.largest);
        self.degrees += other.degrees;
        self.count += other.count;
    }
}

/// Spatial index of a mesh's triangles.
pub(crate) struct MeshIndex<'a> {
    geometry: &'a Geometry<'a>,
    faces: Vec<usize>,
    boxes: Boxes,
}

impl<'a> MeshIndex<'a> {
    pub(crate) fn new(geometry: &'a Geometry<'a>) -> Self {
        let faces: Vec<usize> = (0..geometry.areas.len()).filter(|f| geometry.areas[*f] > 0.0).collect();
        let shapes: Vec<[DVec3; 3]> = faces.iter().map(|f| geometry.corners(*f)).collect();
        Self { geometry, boxes: Boxes::new(&shapes), faces }
    }

    /// Returns the point of the mesh nearest to `p`.
    fn nearest(&self, p: DVec3) -> Foot {
        let at = |i: usize| closest(p, self.geometry.corners(self.faces[i]));
        let (distance, i) = self.boxes.nearest(p, |i| at(i).0);
        match self.faces.get(i) {
            Some(face) => Foot { distance, face: *face, barycentric: at(i).1 },
            None => Foot { distance: f64::INFINITY, face: 0, barycentric: [1.0, 0.0, 0.0] },
        }
    }

    /// Returns the distance of a point from the mesh, positive on the outer side of the nearest triangle, negative
    /// behind it.
    pub(crate) fn signed_distance(&self, p: DVec3) -> f64 {
        let Foot { distance, face, barycentric: [a, b, c] } = self.nearest(p);
        let [x, y, z] = self.geometry.corners(face);
        let out = (p - (x * a + y * b + z * c)).dot(self.geometry.normals[face]);
        distance.copysign(out)
    }

    /// Returns the index of the triangle nearest to a point; 0 if the mesh has no triangles.
    pub(crate) fn face(&self, p: DVec3) -> u32 {
        self.nearest(p).face as u32
    }

    /// Returns the colour of the mesh, linear RGB and opacity, at the point nearest to `p`.
    pub(crate) fn color(&self, geometry: &Geometry, p: DVec3) -> [f32; 4] {
        let foot = self.nearest(p);
        geometry.color(foot.face, foot.barycentric)
    }

    /// Measures the distances in both directions, and the angles between normals.
    pub(crate) fn errors(&self, splats: &[ClippedSplat]) -> SharpErrors {
        let clips: Vec<Option<Clip<f64>>> = splats.iter().map(clip_of).collect();
        let forward = map_tasks(splats.len(), |i| {
            let (splat, clip) = (&splats[i], &clips[i]);
            let normal = surfel_math::basis::unit(splat.s.cross(splat.t));
            let mut deviation = Deviation::default();
            for uv in spiral(SPLAT_SAMPLES).filter(|uv| clip.is_none_or(|c| c.keeps(*uv))) {
                let foot = self.nearest(splat.center + splat.s * uv.x + splat.t * uv.y);
                let cosine = normal.dot(self.geometry.normals[foot.face]).clamp(-1.0, 1.0);
                deviation.add(&Deviation {
                    distances: foot.distance,
                    largest: foot.distance,
                    degrees: cosine.acos().to_degrees(),
                    count: 1,
                });
            }
            deviation
        });
        let mut total = Deviation::default();
        forward.iter().for_each(|of_splat| total.add(of_splat));
        let count = total.count.max(1) as f64;

        let splat_index = SplatIndex::new(splats);
        let step = self.faces.len().div_ceil(MESH_SAMPLES).max(1);
        let back = map_tasks(self.faces.len().div_ceil(step), |i| {
            let [a, b, c] = self.geometry.corners(self.faces[i * step]);
            splat_index.distance(a + ((b - a) + (c - a)) / 3.0, &|| ())
        });
        let largest = back.iter().fold(0.0f64, |a, b| a.max(*b));
        SharpErrors {
            splats_to_mesh: [total.distances / count, total.largest],
            mesh_to_splats: [back.iter().sum::<f64>() / back.len().max(1) as f64, largest],
            normal_deg: total.degrees / count,
        }
    }
}

/// Spatial index of clipped splats.
struct SplatIndex<'a> {
    splats: &'a [ClippedSplat],
    clips: Vec<Option<Clip<f64>>>,
    boxes: Boxes,
}

impl<'a> SplatIndex<'a> {
    fn new(splats: &'a [ClippedSplat]) -> Self {
        let clips: Vec<Option<Clip<f64>>> = splats.iter().map(clip_of).collect();
        let around = |(splat, clip): (&ClippedSplat, &Option<Clip<f64>>)| hull(splat, clip.as_ref());
        let boxes = Boxes::new(&splats.iter().zip(&clips).map(around).collect::<Vec<_>>());
        Self { splats, clips, boxes }
    }

    /// Returns the distance of a point to the visible part of the nearest splat. Calls `seen` for each splat compared.
    fn distance(&self, p: DVec3, seen: &impl Fn()) -> f64 {
        let distance = |i: usize| {
            seen();
            distance_to(&self.splats[i], self.clips[i].as_ref(), p)
        };
        self.boxes.nearest(p, distance).0
    }
}

fn clip_of(splat: &ClippedSplat) -> Option<Clip<f64>> {
    let columns =
        surfel_model::ClipColumns { curves: splat.curve.map(|c| vec![c]), lines: Some(vec![splat.lines]), modes: None };
    columns.clip(0, surfel_model::ClipPolicy::Exact)
}

/// Maximum number of corners of the polygon around a splat's visible part: a square clipped by four lines.
const HULL_CORNERS: usize = 8;

/// Returns the corners of a polygon around the visible part of a splat: the square around its disk, clipped by its
/// lines but not by its curve. Corners may repeat; all are the splat's centre if nothing is visible. A sliver's disk
/// may be thousands of times as wide as its visible part, so that the squares of crossing slivers would all overlap.
fn hull(splat: &ClippedSplat, clip: Option<&Clip<f64>>) -> [DVec3; HULL_CORNERS] {
    /// Tolerance for rounding when a line clips the square, relative to the line's coefficients.
    const SLACK: f64 = 1e-9;
    let mut corners: Vec<V2<f64>> =
        [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].map(|(u, v)| V2::new(u, v)).into();
    // The lines of these splats are combined by "and", and their coefficients are at most 1.
    for line in clip.iter().flat_map(|clip| &clip.lines) {
        let inside = |p: V2<f64>| line.at(p) + SLACK;
        let next = corners.iter().cycle().skip(1);
        let edges = corners.iter().zip(next).map(|(p, q)| ((*p, inside(*p)), (*q, inside(*q))));
        corners = edges
            .flat_map(|((p, at_p), (q, at_q))| {
                let crossing = ((at_p < 0.0) != (at_q < 0.0)).then(|| p + (q - p) * (at_p / (at_p - at_q)));
                (at_p >= 0.0).then_some(p).into_iter().chain(crossing)
            })
            .collect();
    }
    let at = |uv: &V2<f64>| splat.center + splat.s * uv.x + splat.t * uv.y;
    let last = corners.last().map_or(splat.center, at);
    std::array::from_fn(|i| corners.get(i).map_or(last, at))
}

/// Returns points evenly spread over the unit disk, along a spiral (Vogel 1979).
fn spiral(count: usize) -> impl Iterator<Item = V2<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let radius = ((i as f64 + 0.5) / count as f64).sqrt();
        let (sin, cos) = (golden * i as f64).sin_cos();
        V2::new(radius * cos, radius * sin)
    })
}

/// Returns the distance of a point to the visible part of a splat. If the foot of the perpendicular on the splat's
/// plane is visible, the result is exact. Otherwise the result is an upper bound: the distance to a visible point on
/// the segment that leads to the foot from the nearest visible point of [`spiral`]. The result is infinite if no point
/// of the spiral is visible.
fn distance_to(splat: &ClippedSplat, clip: Option<&Clip<f64>>, p: DVec3) -> f64 {
    let d = p - splat.center;
    let foot = V2::new(d.dot(splat.s) / splat.s.length_squared(), d.dot(splat.t) / splat.t.length_squared());
    let keeps = |uv: V2<f64>| clip.is_none_or(|c| c.keeps(uv));
    let at = |uv: V2<f64>| splat.s * uv.x + splat.t * uv.y;
    if foot.length() <= 1.0 && keeps(foot) {
        return (d - at(foot)).length();
    }
    let to_foot = |uv: V2<f64>| (foot - uv).length();
    let nearest = spiral(SPLAT_SAMPLES).filter(|uv| keeps(*uv)).min_by(|a, b| to_foot(*a).total_cmp(&to_foot(*b)));
    let Some(inside) = nearest else { return f64::INFINITY };
    let way = |share: f64| inside + (foot - inside) * share;
    let (mut lo, mut hi) = (0.0, 1.0);
    for _ in 0..20 {
        let middle = 0.5 * (lo + hi);
        if way(middle).length() <= 1.0 && keeps(way(middle)) { lo = middle } else { hi = middle }
    }
    (d - at(way(lo))).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;
    use surfel_model::{Column3, Mesh};

    /// Counts the splats that a point on each of a fan's slivers is compared with, in total.
    fn work_of_fan(count: u32) -> usize {
        let rim = |i: u32| {
            let (sin, cos) = (6.2 * f64::from(i) / f64::from(count)).sin_cos();
            DVec3::new(cos, sin, 0.0)
        };
        let positions: Vec<DVec3> = std::iter::once(DVec3::ZERO).chain((0..=count).map(rim)).collect();
        let triangles = (0..count).map(|i| [0, i + 1, i + 2]).collect();
        let mesh = Mesh { positions: Column3::from_f64(&positions), triangles, ..Mesh::default() };
        let (cloud, _) =
            crate::sharp_splats_from_mesh(&mesh, &crate::SharpOptions::default(), &crate::NoProgress).unwrap();
        let splats: Vec<ClippedSplat> = (0..cloud.len())
            .map(|i| {
                let (s, t) = cloud.axes(i);
                let lines = cloud
                    .data()
                    .clips
                    .as_ref()
                    .and_then(|c| c.lines.as_ref())
                    .map_or([surfel_model::NO_LINE; 4], |l| l[i]);
                ClippedSplat { center: cloud.center(i), s, t, curve: None, lines, is_cut_back: false }
            })
            .collect();
        let geometry = Geometry::new(&mesh);
        let index = MeshIndex::new(&geometry);
        let asked = Cell::new(0);
        let back = SplatIndex::new(&splats);
        for face in 0..index.faces.len() {
            let [a, b, c] = geometry.corners(index.faces[face]);
            back.distance(a + ((b - a) + (c - a)) / 3.0, &|| asked.set(asked.get() + 1));
        }
        asked.get()
    }

    #[test]
    fn hull_holds_the_visible_part_and_little_else() {
        let mut random = crate::mesh::random::Random::new(4);
        let mut number = || random.unit() as f32 * 2.0 - 1.0;
        for count in (0..=4).cycle().take(200) {
            let mut lines = [surfel_model::NO_LINE; 4];
            for line in lines.iter_mut().take(count) {
                *line = surfel_model::ClipLine { a: number(), b: number(), c: 0.5 * number() };
            }
            let splat = ClippedSplat { s: DVec3::X * 2.0, t: DVec3::Y * 3.0, lines, ..ClippedSplat::default() };
            let clip = clip_of(&splat);
            let corners = hull(&splat, clip.as_ref()).map(|p| V2::new(p.x / 2.0, p.y / 3.0));
            let keeps = |uv: V2<f64>| {
                lines[..count].iter().all(|l| f64::from(l.a) * uv.x + f64::from(l.b) * uv.y + f64::from(l.c) >= -1e-8)
            };
            let seen: Vec<V2<f64>> = spiral(500).filter(|uv| clip.is_none_or(|c| c.keeps(*uv))).collect();
            assert!(seen.is_empty() || corners.iter().all(|corner| keeps(*corner)), "{lines:?}");
            // Visible points are left of every edge.
            for (p, q) in corners.iter().zip(corners.iter().cycle().skip(1)) {
                let edge = *q - *p;
                assert!(seen.iter().all(|s| edge.x * (s.y - p.y) - edge.y * (s.x - p.x) >= -1e-9), "{lines:?}");
            }
        }
    }

    #[test]
    fn work_of_a_fan_is_nearly_linear() {
        let work = [500, 1000, 2000].map(work_of_fan);
        assert!(work[1] as f64 <= 2.3 * work[0] as f64 && work[2] as f64 <= 2.3 * work[1] as f64, "{work:?}");
        assert!(work[2] < 20 * 2000, "{work:?}");
    }
}
