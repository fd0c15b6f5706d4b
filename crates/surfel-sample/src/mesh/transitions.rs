//! Transition splats: splats centred on the mesh edges between faces in different leaves of an octree. They hide the
//! change from splats to polygons, or to finer splats, along these edges (docs/decisions/014, after G06 §5.2).

use super::geometry::Geometry;
use crate::radii;
use glam::DVec3;
use std::collections::BTreeMap;
use surfel_math::basis::unit;

/// Cosine of 40°, the largest angle between faces at an edge that gets edge splats. At creases, the surface differs on
/// both sides anyway, and a splat centred on a crease would protrude.
const CREASE_COS: f64 = 0.766_044_443_118_978;

/// Largest mean number of edge splats per edge. This limit and [`FEW`] matter if edges reach far beyond the cubes of
/// their leaves, as in a fan; a watertight surface has about two per edge.
const MAX_ON_EDGE: u64 = 8;
/// Number of edge splats that every mesh may have, regardless of [`MAX_ON_EDGE`].
const FEW: u64 = 16_384;

/// Splat centred on a mesh edge between two leaves of the octree.
#[derive(Clone, Copy)]
pub(crate) struct EdgeSplat {
    pub(crate) center: DVec3,
    pub(crate) normal: DVec3,
    pub(crate) shading_normal: DVec3,
    pub(crate) radius: f64,
    pub(crate) color: [f32; 4],
}

/// Mesh edge between faces of two different leaves of the octree.
struct LeafEdge {
    /// Node indices of the two leaves, in ascending order.
    leaves: [u32; 2],
    face: u32,
    /// Corner (0 to 2) of the face at which the edge starts.
    corner: usize,
    /// Distance between the splats on the edge, in object units.
    spacing: f64,
    /// Unit normal of the splats on the edge: the mean of the two faces' normals.
    between: DVec3,
}

/// Edges shared by one pair of the octree's leaves, given by their ends, and the splats centred on these edges.
#[derive(Default)]
pub(crate) struct Shared {
    pub(crate) edges: Vec<[DVec3; 2]>,
    pub(crate) splats: Vec<EdgeSplat>,
}

/// Finds the edges shared by each pair of leaves, and makes splats on them; creases above 40° are left out. The result
/// is by pairs of leaf indices in ascending order. `spacing_of` returns the distance between a leaf's splats; the
/// smaller of both leaves' distances is used, or a larger one if an edge would get too many splats ([`MAX_ON_EDGE`]).
pub(crate) fn shared_edges(
    geometry: &Geometry,
    corner_normals: &[[DVec3; 3]],
    leaf_of_face: &[u32],
    spacing_of: impl Fn(u32) -> f64,
) -> BTreeMap<[u32; 2], Shared> {
    let weld = geometry.weld();
    // (welded ends, face, corner at which the edge starts).
    let mut sides: Vec<([u32; 2], u32, u8)> = Vec::new();
    for (face, t) in geometry.mesh.triangles.iter().enumerate().filter(|(face, _)| geometry.areas[*face] > 0.0) {
        for k in 0..3u8 {
            let (a, b) = (weld[t[usize::from(k)] as usize], weld[t[(usize::from(k) + 1) % 3] as usize]);
            if a != b {
                sides.push(([a.min(b), a.max(b)], face as u32, k));
            }
        }
    }
    sides.sort_unstable();
    let mut edges = Vec::new();
    for edge in sides.chunk_by(|a, b| a.0 == b.0) {
        let (_, face, corner) = edge[0];
        let leaf = |face: u32| leaf_of_face[face as usize];
        let Some((_, other, _)) = edge.iter().find(|side| leaf(side.1) != leaf(face)) else { continue };
        let normals = [face, *other].map(|f| geometry.normals[f as usize]);
        if normals[0].dot(normals[1]) < CREASE_COS {
            continue;
        }
        let leaves = [leaf(face).min(leaf(*other)), leaf(face).max(leaf(*other))];
        let spacing = spacing_of(leaves[0]).min(spacing_of(leaves[1]));
        let between = unit(normals[0] + normals[1]);
        edges.push(LeafEdge { leaves, face, corner: usize::from(corner), spacing, between });
    }
    let ends = |face: u32, k: usize| {
        let corners = geometry.corners(face as usize);
        [corners[k], corners[(k + 1) % 3]]
    };
    let count_of = |edge: &LeafEdge| {
        let [a, b] = ends(edge.face, edge.corner);
        ((b - a).length() / edge.spacing).ceil().max(1.0) as u64
    };
    let counts: Vec<u64> = edges.iter().map(count_of).collect();
    let most = most_each(&counts, FEW.max(MAX_ON_EDGE * counts.len() as u64));
    let mut shared: BTreeMap<[u32; 2], Shared> = BTreeMap::new();
    for (LeafEdge { leaves, face, corner: k, spacing, between }, count) in edges.into_iter().zip(counts) {
        let [a, b] = ends(face, k);
        // Fewer splats are larger.
        let (count, spacing) = if count > most { (most, (b - a).length() / most as f64) } else { (count, spacing) };
        let entry = shared.entry(leaves).or_default();
        entry.edges.push([a, b]);
        for i in 0..count {
            let along = (i as f64 + 0.5) / count as f64;
            let mut barycentric = [0.0; 3];
            (barycentric[k], barycentric[(k + 1) % 3]) = (1.0 - along, along);
            let smooth: DVec3 = corner_normals[face as usize].iter().zip(barycentric).map(|(n, b)| *n * b).sum();
            let smooth = if smooth.length() > 1e-6 { unit(smooth) } else { between };
            entry.splats.push(EdgeSplat {
                center: a + (b - a) * along,
                normal: between,
                shading_normal: smooth,
                radius: radii::DENSITY * spacing,
                color: geometry.color(face as usize, barycentric),
            });
        }
    }
    shared
}

/// Returns the largest number such that the sum of all counts, each reduced to at most that number, is at most `limit`.
/// The result is at least 1, and `u64::MAX` if no count needs reduction.
fn most_each(counts: &[u64], limit: u64) -> u64 {
    let mut sorted = counts.to_vec();
    sorted.sort_unstable();
    let mut left = limit;
    for (i, count) in sorted.iter().enumerate() {
        let share = left / (sorted.len() - i) as u64;
        if *count > share {
            return share.max(1);
        }
        left -= count;
    }
    u64::MAX
}

/// Returns the distance of a point from a segment.
pub(crate) fn distance_to_segment(p: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (p - (a + along * t)).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_limited_where_they_are_largest() {
        assert_eq!(most_each(&[1, 2, 3], 6), u64::MAX);
        assert_eq!(most_each(&[], 0), u64::MAX);
        assert_eq!(most_each(&[5, 5, 5], 1), 1);
        for limit in [10, 57, 300, 1000] {
            let counts: Vec<u64> = (0..40).map(|i| 1 + i * i % 97).collect();
            let most = most_each(&counts, limit);
            let sum = |most: u64| counts.iter().map(|c| (*c).min(most)).sum::<u64>();
            assert!(sum(most) <= limit.max(40), "{limit}: {most}");
            assert!(most == u64::MAX || sum(most + 1) > limit, "{limit}: {most}");
        }
    }
}
