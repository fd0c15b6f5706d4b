//! Machine part with sharp, curved creases: a block with a round hole and a round boss.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Write as _;

/// Number of segments of a quarter of a circle. Each side of the block's square cells has as many.
const QUARTER: usize = 16;
/// Radius of the hole, in units of half a cell's side.
const HOLE_RADIUS: f64 = 0.5;
/// Radius of the boss, in units of half a cell's side.
const BOSS_RADIUS: f64 = 0.6;
/// Height of the boss above the block, in units of half a cell's side.
const BOSS_HEIGHT: f64 = 0.7;
/// Height of the block, in units of half a cell's side.
const BLOCK_HEIGHT: f64 = 1.0;

type Point = [f64; 3];

/// Triangle mesh with shared vertices. Corners are counter-clockwise as seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct TriangleMesh {
    pub(super) vertices: Vec<Point>,
    pub(super) triangles: Vec<[usize; 3]>,
    /// Index of each vertex, by its rounded coordinates.
    known: BTreeMap<[i64; 3], usize>,
}

/// Returns the mesh of the machine part. Its up axis is y. The block is on the plane y = 0 and extends from (−2, 0, −1)
/// to (2, 1, 1).
pub(super) fn part() -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    // The block consists of two cells: one with the hole, one with the boss.
    let (left, right) = (-1.0, 1.0);
    let (low, high) = (0.0, BLOCK_HEIGHT);
    let hole = |y: f64| circle(left, y, HOLE_RADIUS);
    let boss = |y: f64| circle(right, y, BOSS_RADIUS);
    mesh.strip(&square(left, high), &hole(high));
    mesh.strip(&square(right, high), &boss(high));
    mesh.strip(&hole(low), &square(left, low));
    mesh.fan([right, low, 0.0], &square(right, low), false);
    // The wall of the hole faces inward, the wall of the boss outward.
    mesh.strip(&hole(high), &hole(low));
    mesh.strip(&boss(high), &boss(high + BOSS_HEIGHT));
    mesh.fan([right, high + BOSS_HEIGHT, 0.0], &boss(high + BOSS_HEIGHT), true);
    // The sides of the block, except where the two cells touch.
    for center in [left, right] {
        let (bottom, top) = (square(center, low), square(center, high));
        for i in 0..bottom.len() {
            let j = (i + 1) % bottom.len();
            if bottom[i][0] != 0.0 || bottom[j][0] != 0.0 {
                mesh.quad(bottom[i], bottom[j], top[j], top[i]);
            }
        }
    }
    mesh
}

/// Returns the points of a circle, counter-clockwise as seen from above (+y). From the circle's centre, the first point
/// is in the direction x = z.
fn circle(center_x: f64, y: f64, radius: f64) -> Vec<Point> {
    let point = |i: usize| {
        let angle = -0.25 * PI + FRAC_PI_2 * i as f64 / QUARTER as f64;
        [center_x + radius * angle.cos(), y, -radius * angle.sin()]
    };
    (0..4 * QUARTER).map(point).collect()
}

/// Returns the points of the outline of a square of side 2, beginning at the corner with x = z = 1 relative to its
/// centre. The points are at the same angles as those of the circle.
fn square(center_x: f64, y: f64) -> Vec<Point> {
    let point = |i: usize| {
        let along = (i % QUARTER) as f64 / QUARTER as f64 * 2.0 - 1.0;
        let (x, z) = match i / QUARTER {
            0 => (1.0, -along),
            1 => (-along, -1.0),
            2 => (-1.0, along),
            _ => (along, 1.0),
        };
        [center_x + x, y, z]
    };
    (0..4 * QUARTER).map(point).collect()
}

impl TriangleMesh {
    /// Returns the index of the vertex at `p`, and adds the vertex if it is new.
    fn vertex(&mut self, p: Point) -> usize {
        let key = p.map(|x| (x * 1e6).round() as i64);
        *self.known.entry(key).or_insert_with(|| {
            self.vertices.push(p);
            self.vertices.len() - 1
        })
    }

    fn triangle(&mut self, a: Point, b: Point, c: Point) {
        let corners = [a, b, c].map(|p| self.vertex(p));
        self.triangles.push(corners);
    }

    fn quad(&mut self, a: Point, b: Point, c: Point, d: Point) {
        self.triangle(a, b, c);
        self.triangle(a, c, d);
    }

    /// Adds a strip of triangles between two loops of equal length. Its outside is the side from which `outer` runs
    /// counter-clockwise around `inner`.
    fn strip(&mut self, outer: &[Point], inner: &[Point]) {
        for i in 0..outer.len() {
            let j = (i + 1) % outer.len();
            self.quad(outer[i], outer[j], inner[j], inner[i]);
        }
    }

    /// Adds a fan of triangles between a point and a loop. The fan faces up if `from_above` is true, otherwise down.
    fn fan(&mut self, center: Point, rim: &[Point], from_above: bool) {
        for i in 0..rim.len() {
            let j = (i + 1) % rim.len();
            let (a, b) = if from_above { (rim[i], rim[j]) } else { (rim[j], rim[i]) };
            self.triangle(center, a, b);
        }
    }

    pub(super) fn to_obj(&self) -> String {
        let mut text = String::from("# block with a round hole and a round boss; sharp, curved creases\no part\n");
        for [x, y, z] in &self.vertices {
            // Writing to a string can't fail.
            let _ = writeln!(text, "v {x:.7} {y:.7} {z:.7}");
        }
        for [a, b, c] in &self.triangles {
            let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn part_is_watertight_and_consistently_wound() {
        let mesh = part();
        let mut edges: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for [a, b, c] in &mesh.triangles {
            for edge in [(*a, *b), (*b, *c), (*c, *a)] {
                *edges.entry(edge).or_default() += 1;
            }
        }
        for (&(a, b), &count) in &edges {
            assert_eq!((count, edges.get(&(b, a))), (1, Some(&1)), "{:?} {:?}", mesh.vertices[a], mesh.vertices[b]);
        }
        // Euler's formula for a solid with one hole through it: V − E + F = 0.
        assert_eq!(mesh.vertices.len() + mesh.triangles.len(), edges.len() / 2);
    }

    #[test]
    fn part_encloses_the_volume_of_block_less_hole_plus_boss() {
        let mesh = part();
        let six_volumes: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| mesh.vertices[i]);
                a[0] * (b[1] * c[2] - b[2] * c[1])
                    + a[1] * (b[2] * c[0] - b[0] * c[2])
                    + a[2] * (b[0] * c[1] - b[1] * c[0])
            })
            .sum();
        let n = (4 * QUARTER) as f64;
        let disk = |r: f64| 0.5 * n * r * r * (2.0 * PI / n).sin();
        let expected = 8.0 * BLOCK_HEIGHT - disk(HOLE_RADIUS) * BLOCK_HEIGHT + disk(BOSS_RADIUS) * BOSS_HEIGHT;
        assert!((six_volumes / 6.0 - expected).abs() < 1e-12, "{} {expected}", six_volumes / 6.0);
    }

    #[test]
    fn part_has_no_triangle_without_area() {
        let mesh = part();
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.vertices[i]);
            let (u, v): (Point, Point) = (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
            let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            assert!(cross.iter().map(|x| x * x).sum::<f64>().sqrt() > 1e-4, "{t:?}");
        }
    }
}
