//! Creases and borders, and how splats near them are trimmed.

use crate::eigen::symmetric2;
use crate::tree::{KdTree, Nearest};
use glam::{DVec2, DVec3};
use surfel_math::basis::orthonormal;

/// How far a trimmed splat reaches past an edge, over its untrimmed radius. Enough for the next splats along the
/// edge to meet on it: see the test that no point of a cube is bare.
const OVERHANG: f64 = 0.2;
/// Where edges of different directions meet, an ellipse pressed flat twice is blunt and would leave the corner bare.
/// It is stretched until the corner has this ρ², where the disk itself covered the corner or nearly did: no sample
/// beyond the edges helps it there.
const CORNER_RHO2: f64 = 0.95;
/// Distance, over the radius, up to which that is done.
const CORNER_DISTANCE: f64 = 1.2;
/// Edges are of different directions from 30°.
const CORNER_COS: f64 = 0.866;
/// Edges seen at more than 30° from a splat's plane belong to another part of the surface.
const STEEPEST: f64 = 0.5;
/// Edge pieces looked at for one splat.
const MOST: usize = 24;

/// Feature edges, cut into pieces no longer than a splat's radius, so that the nearest can be found by their middles.
pub(crate) struct Features {
    tree: KdTree,
    pieces: Vec<[DVec3; 2]>,
    /// Half the length of the longest piece.
    half: f64,
}

impl Features {
    /// Cuts `edges` into pieces of about `length`, at most `most` of them above the number of edges.
    pub(crate) fn new(edges: &[[DVec3; 2]], length: f64, most: usize) -> Self {
        let total: f64 = edges.iter().map(|[a, b]| a.distance(*b)).sum();
        let length = length.max(total / most.max(1) as f64);
        let (mut pieces, mut half) = (Vec::with_capacity(edges.len()), 0.0_f64);
        for [a, b] in edges {
            let count = (a.distance(*b) / length).ceil().clamp(1.0, most.max(1) as f64) as usize;
            let at = |i: usize| a.lerp(*b, i as f64 / count as f64);
            pieces.extend((0..count).map(|i| [at(i), at(i + 1)]));
            half = half.max(0.5 * a.distance(*b) / count as f64);
        }
        let middles: Vec<DVec3> = pieces.iter().map(|[a, b]| 0.5 * (*a + *b)).collect();
        Self { tree: KdTree::new(&middles), pieces, half }
    }

    /// Half-axes (s, t), s × t along `normal`, of a disk at `p` trimmed to the edges near it; `None` where none is.
    pub(crate) fn trim(&self, p: DVec3, normal: DVec3, radius: f64) -> Option<(DVec3, DVec3)> {
        let mut found = Nearest::within(MOST, radius + self.half);
        self.tree.nearest(p, &mut found);
        let (u, v) = orthonormal(normal);
        // The ellipse {x: xᵀE⁻¹x ≤ 1} of the tangent plane as E = ssᵀ + ttᵀ: its extent along m is √(mᵀEm).
        let (mut xx, mut xy, mut yy) = (radius * radius, 0.0, radius * radius);
        let near: Vec<(DVec2, f64)> = found
            .items()
            .iter()
            .filter_map(|(_, slot)| {
                let [a, b] = self.pieces[self.tree.index(*slot as usize)];
                let (direction, distance) = facing(p, normal, a, b).filter(|f| f.1 < radius)?;
                Some((DVec2::new(direction.dot(u), direction.dot(v)).normalize_or_zero(), distance))
            })
            .collect();
        let first = *near.first()?;
        let corner = near.iter().find(|(m, _)| m.dot(first.0) < CORNER_COS).and_then(|second| meet(first, *second));
        let mut trimmed = false;
        for (m, distance) in near {
            let along = DVec2::new(xx * m.x + xy * m.y, xy * m.x + yy * m.y);
            let (extent2, limit) = (m.dot(along), distance + OVERHANG * radius);
            if limit * limit < extent2 {
                // Presses the ellipse flat along m and leaves the conjugate direction as it is.
                let k = (1.0 - limit * limit / extent2) / extent2;
                (xx, xy, yy) = (xx - k * along.x * along.x, xy - k * along.x * along.y, yy - k * along.y * along.y);
                trimmed = true;
            }
        }
        if let Some(q) = corner.filter(|q| trimmed && q.length() < CORNER_DISTANCE * radius) {
            let rho2 = (yy * q.x * q.x - 2.0 * xy * q.x * q.y + xx * q.y * q.y) / (xx * yy - xy * xy);
            if rho2 > CORNER_RHO2 {
                // By Sherman and Morrison, E + k·qqᵀ makes it ρ² / (1 + k·ρ²).
                let k = 1.0 / CORNER_RHO2 - 1.0 / rho2;
                (xx, xy, yy) = (xx + k * q.x * q.x, xy + k * q.x * q.y, yy + k * q.y * q.y);
            }
        }
        let ([large, small], d) = symmetric2(xx, xy, yy);
        // Two trims at a needle's tip may press it flat to nothing.
        let least = 0.1 * OVERHANG * radius;
        trimmed.then(|| {
            ((u * d.x + v * d.y) * large.sqrt().max(least), (v * d.x - u * d.y) * small.max(0.0).sqrt().max(least))
        })
    }
}

/// Where two lines meet, each given by its unit normal and its distance along it; `None` where they hardly do.
fn meet((m, d): (DVec2, f64), (n, e): (DVec2, f64)) -> Option<DVec2> {
    let det = m.perp_dot(n);
    (det.abs() > 0.1).then(|| DVec2::new(d * n.y - e * m.y, e * m.x - d * n.x) / det)
}

/// Unit direction and distance from `p` to the piece `a`–`b`, where the foot of the perpendicular lies on it and it
/// is in the tangent plane.
fn facing(p: DVec3, normal: DVec3, a: DVec3, b: DVec3) -> Option<(DVec3, f64)> {
    let edge = b - a;
    let length2 = edge.length_squared();
    let place = (p - a).dot(edge) / length2;
    // The ends overlap a little: a curved crease has gaps between its pieces' feet.
    if !(-0.05..=1.05).contains(&place) {
        return None;
    }
    let foot = a + place * edge - p;
    let distance = foot.length();
    if distance * distance < 1e-16 * length2 {
        return Some((normal.cross(edge).normalize_or_zero(), 0.0));
    }
    (foot.dot(normal).abs() <= STEEPEST * distance).then(|| (foot / distance, distance))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trim_presses_a_disk_flat_against_an_edge() {
        let edge = [DVec3::new(0.3, -5.0, 0.0), DVec3::new(0.3, 5.0, 0.0)];
        let features = Features::new(&[edge], 1.0, 1000);
        let (s, t) = features.trim(DVec3::ZERO, DVec3::Z, 1.0).unwrap();
        // Along the edge it keeps its radius 1, across it reaches 0.3 + OVERHANG.
        assert!((s.y.abs() - 1.0).abs() < 1e-14 && s.x.abs() < 1e-14, "{s}");
        assert!((t.x.abs() - 0.5).abs() < 1e-14 && t.y.abs() < 1e-14, "{t}");
        assert!(s.cross(t).z > 0.0);
        assert!(features.trim(DVec3::new(-0.6, 0.0, 0.0), DVec3::Z, 0.7).is_none());
        assert!(features.trim(DVec3::ZERO, DVec3::X, 1.0).is_none(), "an edge above the plane is no border of it");
    }

    #[test]
    fn trim_on_the_edge_itself_keeps_its_length() {
        let pieces: Vec<[DVec3; 2]> =
            (-20..20).map(|i| [DVec3::Y * f64::from(i) * 0.1, DVec3::Y * f64::from(i + 1) * 0.1]).collect();
        let (s, t) = Features::new(&pieces, 1.0, 1000).trim(DVec3::ZERO, DVec3::Z, 1.0).unwrap();
        assert!((s.length() - 1.0).abs() < 1e-12 && (t.length() - OVERHANG).abs() < 1e-12, "{s} {t}");
    }
}
