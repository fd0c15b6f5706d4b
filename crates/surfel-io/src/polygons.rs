//! Triangulation of polygons.
//!
//! A polygon becomes the triangle fan about its first corner if the fan is inside the polygon, as for every convex one.
//! Other polygons, such as walls with doors, are cut by ear clipping (Meisters 1975, "Polygons have ears"). Ear
//! clipping removes a corner whose triangle with its two neighbours contains no other corner, until three corners
//! remain. A polygon that crosses itself has no inside and becomes a fan.

use glam::{DVec2, DVec3};

/// Largest number of corners of a polygon that is cut by ear clipping; larger ones become fans. Time grows with the
/// square, up to some tenths of a second at this limit.
const MAX_CORNERS: usize = 10_000;
/// Largest area of a triangle, relative to its polygon's area, that may face backward or be cut off as flat. Rounded
/// coordinates of collinear corners cause such triangles.
const FLAT: f64 = 1e-6;
/// Maximum number of passes of ear clipping over a polygon's corners. Between passes, flat corners are removed, which
/// blocked the previous pass.
const ROUNDS: usize = 8;

/// Marker in `Triangulator::before` for a corner that was cut off.
const NONE: u32 = u32::MAX;

/// A triangulator, whose buffers are reused from polygon to polygon.
#[derive(Default)]
pub(crate) struct Triangulator {
    corners: Vec<DVec3>,
    /// Corners projected along the axis nearest to the polygon's normal, counter-clockwise. Coordinates aren't rounded
    /// by this projection.
    flat: Vec<DVec2>,
    /// Previous corner of each corner among the remaining ones; [`NONE`] for a corner that was cut off.
    before: Vec<u32>,
    /// Next corner of each corner among the remaining ones.
    after: Vec<u32>,
    /// Corners that were not convex when the current pass of ear clipping began. No other corner becomes non-convex.
    blunt: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl Triangulator {
    /// Triangulates a polygon. Returns triangles as indices into `polygon`, two fewer than corners and in the polygon's
    /// winding order; none for fewer than three corners. `position` returns a corner's position, or `None` if it has
    /// none.
    pub(crate) fn cut(&mut self, polygon: &[u32], position: impl Fn(u32) -> Option<DVec3>) -> &[[u32; 3]] {
        let n = polygon.len();
        self.fan(n);
        if (4..=MAX_CORNERS).contains(&n) {
            self.corners.clear();
            self.corners.extend(polygon.iter().map_while(|i| position(*i)));
            let normal = newell(&self.corners);
            if self.corners.len() == n && normal.is_finite() && !self.fan_is_inside(normal) && !self.cut_ears(normal) {
                self.fan(n);
            }
        }
        &self.triangles
    }

    /// Sets the triangles to the fan about the first of `n` corners.
    fn fan(&mut self, n: usize) {
        self.triangles.clear();
        self.triangles.extend((2..n as u32).map(|i| [0, i - 1, i]));
    }

    /// True if all triangles of the fan about the first corner face as the polygon does, with the normal `normal`, or
    /// are flat ([`FLAT`]). The triangles then don't overlap either: the whole polygon is visible from its first
    /// corner.
    fn fan_is_inside(&self, normal: DVec3) -> bool {
        let least = -FLAT * normal.length_squared();
        let [first, ref others @ ..] = self.corners[..] else { return true };
        others.windows(2).all(|w| (w[0] - first).cross(w[1] - first).dot(normal) >= least)
    }

    /// Sets the triangles by ear clipping. Returns false if it fails, as for polygons that cross themselves.
    fn cut_ears(&mut self, normal: DVec3) -> bool {
        let axis = normal.abs().max_position();
        let (u, v) = if normal[axis] > 0.0 { (axis + 1, axis + 2) } else { (axis + 2, axis + 1) };
        self.flat.clear();
        self.flat.extend(self.corners.iter().map(|p| DVec2::new(p[u % 3], p[v % 3])));
        let n = self.flat.len() as u32;
        self.before.clear();
        self.before.extend((0..n).map(|i| (i + n - 1) % n));
        self.after.clear();
        self.after.extend((0..n).map(|i| (i + 1) % n));
        self.triangles.clear();
        let flat = FLAT * normal[axis].abs();
        self.cut_spikes(flat);
        for _ in 0..ROUNDS {
            let left = self.clip_ears_once();
            if let [a, b, c] = left[..] {
                self.triangles.push([a, b, c]);
                return self.turn(b) >= -flat;
            }
            if self.cut_flat(&left, flat) == 0 {
                return false;
            }
        }
        false
    }

    /// Clips ears until there is none or three corners remain; returns the remaining corners.
    fn clip_ears_once(&mut self) -> Vec<u32> {
        let mut to_try = self.left();
        self.blunt = to_try.iter().copied().filter(|i| self.turn(*i) <= 0.0).collect();
        let mut next = 0;
        while let Some(&at) = to_try.get(next)
            && self.triangles.len() + 3 < self.flat.len()
        {
            next += 1;
            if self.is_left(at) && self.is_ear(at) {
                // Only the neighbours of a clipped ear may have become ears.
                to_try.extend(self.remove(at));
            }
        }
        self.left()
    }

    fn left(&self) -> Vec<u32> {
        (0..self.flat.len() as u32).filter(|i| self.is_left(*i)).collect()
    }

    fn is_left(&self, i: u32) -> bool {
        self.before[i as usize] != NONE
    }

    /// Returns twice the signed area of the triangle of a remaining corner and its neighbours; negative where the
    /// corner is reflex.
    fn turn(&self, i: u32) -> f64 {
        let [a, b, c] = self.triangle(i).map(|i| self.flat[i as usize]);
        turn(a, b, c)
    }

    fn triangle(&self, i: u32) -> [u32; 3] {
        [self.before[i as usize], i, self.after[i as usize]]
    }

    /// True if a corner is an ear: it is convex, and its triangle with its neighbours contains no other corner. Only
    /// non-convex corners need to be tested.
    fn is_ear(&self, i: u32) -> bool {
        let [a, b, c] = self.triangle(i).map(|i| self.flat[i as usize]);
        if turn(a, b, c) <= 0.0 {
            return false;
        }
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        let is_in = |p: DVec2| {
            p.cmpge(lo).all()
                && p.cmple(hi).all()
                && ![a, b, c].contains(&p)
                && turn(a, b, p) >= 0.0
                && turn(b, c, p) >= 0.0
                && turn(c, a, p) >= 0.0
        };
        !self.blunt.iter().any(|j| is_in(self.flat[*j as usize]) && self.is_left(*j) && self.turn(*j) <= 0.0)
    }

    /// Cuts off a corner: its triangle with its neighbours is added. Returns the neighbours.
    fn remove(&mut self, i: u32) -> [u32; 2] {
        let [before, at, after] = self.triangle(i);
        self.triangles.push([before, at, after]);
        self.after[before as usize] = after;
        self.before[after as usize] = before;
        self.before[at as usize] = NONE;
        [before, after]
    }

    /// Cuts off corners at which the outline turns back onto itself, and duplicate corners. `flat` is the largest
    /// doubled area of a triangle that may be cut off.
    fn cut_spikes(&mut self, flat: f64) {
        let mut at = 0;
        for _ in 0..2 * self.flat.len() {
            let [before, _, after] = self.triangle(at);
            let [a, b, c] = self.triangle(at).map(|i| self.flat[i as usize]);
            let is_spike = (a - b).dot(c - b) >= 0.0 && turn(a, b, c).abs() <= flat;
            if is_spike && self.triangles.len() + 3 < self.flat.len() {
                self.remove(at);
                at = before;
            } else {
                at = after;
            }
        }
    }

    /// Cuts off those of the corners `left` whose triangle has at most the doubled area `flat`, as long as more than
    /// three remain. Returns their number.
    fn cut_flat(&mut self, left: &[u32], flat: f64) -> usize {
        let mut count = 0;
        for &i in left {
            if self.triangles.len() + 3 < self.flat.len() && self.turn(i).abs() <= flat {
                self.remove(i);
                count += 1;
            }
        }
        count
    }
}

/// Returns the normal of a polygon with twice its area as length. The polygon needn't be planar (Newell's method).
fn newell(corners: &[DVec3]) -> DVec3 {
    let Some((first, others)) = corners.split_first() else { return DVec3::ZERO };
    others.windows(2).map(|w| (w[0] - first).cross(w[1] - first)).sum()
}

/// Returns twice the signed area of a triangle, positive if counter-clockwise. The sign is exact as long as differences
/// of coordinates are exact, as they are for f32 coordinates.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let (u, v) = (b - a, c - a);
    let (left, right) = (u.x * v.y, u.y * v.x);
    let difference = left - right;
    if difference.abs() > 4.0 * f64::EPSILON * (left.abs() + right.abs()) {
        return difference;
    }
    difference + (u.x.mul_add(v.y, -left) - u.y.mul_add(v.x, -right))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(corners: &[DVec3]) -> Vec<[u32; 3]> {
        let polygon: Vec<u32> = (0..corners.len() as u32).collect();
        Triangulator::default().cut(&polygon, |i| corners.get(i as usize).copied()).to_vec()
    }

    /// Places a polygon in a tilted plane, at a distance from the origin proportional to its size.
    fn tilted(flat: &[[f64; 2]], scale: f64) -> Vec<DVec3> {
        let (u, v) = (DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.64, 0.6, 0.48));
        flat.iter().map(|[x, y]| (u * *x + v * *y + DVec3::new(3.0, 5.0, -7.0)) * scale).collect()
    }

    fn fan(n: u32) -> Vec<[u32; 3]> {
        (2..n).map(|i| [0, i - 1, i]).collect()
    }

    /// Asserts that all triangles face as the polygon does and have its area in sum: none overlaps, none is outside.
    fn assert_exact(flat: &[[f64; 2]], name: &str) {
        for scale in [1e-15, 1.0, 1e15] {
            // From every corner, in both winding orders.
            for start in 0..flat.len() {
                for reversed in [false, true] {
                    let mut flat = flat.to_vec();
                    flat.rotate_left(start);
                    if reversed {
                        flat.reverse();
                    }
                    let corners = tilted(&flat, scale);
                    let triangles = cut(&corners);
                    let normal = newell(&corners);
                    let area = |t: &[u32; 3]| {
                        let [a, b, c] = t.map(|i| corners[i as usize]);
                        (b - a).cross(c - a)
                    };
                    let total: f64 = triangles.iter().map(|t| area(t).length()).sum();
                    let error = total / normal.length() - 1.0;
                    assert!(error.abs() < 1e-6, "{name} from {start} at {scale}, {reversed}: {error}");
                    let mut seen = vec![false; flat.len()];
                    triangles.iter().flatten().for_each(|i| seen[*i as usize] = true);
                    assert!(seen.iter().all(|s| *s) && triangles.len() == flat.len() - 2, "{name}: {triangles:?}");
                }
            }
        }
    }

    const L: [[f64; 2]; 6] = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];

    #[test]
    fn concave_polygons_are_filled_exactly() {
        assert_exact(&L, "L");
        let notch = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.5, 3.0], [2.0, 0.5], [1.5, 3.0], [0.0, 3.0]];
        assert_exact(&notch, "notch");
        let wall = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.1], [3.0, 2.1], [3.0, 0.0], [8.0, 0.0], [8.0, 3.0], [0.0, 3.0]];
        assert_exact(&wall, "wall with a door");
        assert_exact(&[[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]], "quad with a reflex corner");
        let comb = (0..40).map(|i| [f64::from(i), if i % 2 == 0 { 0.0 } else { 9.0 }]);
        let comb: Vec<[f64; 2]> = comb.chain([[39.0, 10.0], [0.0, 10.0]]).collect();
        assert_exact(&comb, "comb");
        let arm = |radius: f64| {
            move |i: i32| [f64::from(i) * 0.3].map(|t| [(radius + t) * t.cos(), (radius + t) * t.sin()])[0]
        };
        let spiral: Vec<[f64; 2]> = (0..60).map(arm(2.0)).chain((0..60).rev().map(arm(1.0))).collect();
        assert_exact(&spiral, "spiral");
    }

    #[test]
    fn corners_in_line_and_twice_there_are_no_obstacle() {
        let in_line: Vec<[f64; 2]> = (0..L.len())
            .flat_map(|i| {
                let ([ax, ay], [bx, by]) = (L[i], L[(i + 1) % L.len()]);
                [0.0, 0.25, 0.7].map(|t| [ax + t * (bx - ax), ay + t * (by - ay)])
            })
            .collect();
        assert_exact(&in_line, "corners in line");
        let twice: Vec<[f64; 2]> = L.iter().flat_map(|p| [*p, *p]).collect();
        assert_exact(&twice, "corners twice");
        // A window, connected to the wall's outline by a cut there and back.
        let window = [
            [0.0, 0.0],
            [6.0, 0.0],
            [6.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [2.0, 1.0],
            [2.0, 3.0],
            [4.0, 3.0],
            [4.0, 1.0],
            [2.0, 1.0],
        ];
        assert_exact(&window, "window");
        // A spike that leaves a side and returns on itself.
        assert_exact(&[[0.0, 0.0], [2.0, 0.0], [2.0, -1.0], [2.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 0.5]], "spike");
    }

    #[test]
    fn convex_and_crossing_polygons_are_fans() {
        for n in 3..12 {
            let round = |i: u32| [f64::from(i), 0.3].map(|x| x * std::f64::consts::TAU / f64::from(n));
            let flat: Vec<[f64; 2]> = (0..n).map(|i| [round(i)[0].cos(), round(i)[0].sin()]).collect();
            assert_eq!(cut(&tilted(&flat, 1.0)), fan(n), "{n} corners");
        }
        // A saddle; a fan about either diagonal is valid.
        let saddle = [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.4), DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.0, 1.0, 0.4)];
        assert_eq!(cut(&saddle), fan(4));
        assert_eq!(cut(&tilted(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], 1.0)), fan(4), "bow tie");
        assert_eq!(cut(&tilted(&[[0.0, 0.0], [3.0, 3.0], [3.0, 0.0], [0.0, 1.0]], 1.0)), fan(4), "uneven bow tie");
        let hook = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [1.0, -2.0], [-1.0, 3.0]];
        assert_eq!(cut(&tilted(&hook, 1.0)), fan(5), "crosses itself");
    }

    #[test]
    fn what_has_no_plane_or_no_place_is_a_fan() {
        assert_eq!(cut(&[DVec3::ZERO; 5]), fan(5));
        assert_eq!(cut(&[0.0, 2.0, 1.0, 3.0].map(|x| DVec3::X * x)), fan(4));
        let mut corners = tilted(&L, 1.0);
        corners[3].x = f64::NAN;
        assert_eq!(cut(&corners), fan(6));
        assert_eq!(cut(&tilted(&L, 1e200)), fan(6), "too large for a normal");
        assert_eq!(Triangulator::default().cut(&[0, 1, 2, 9], |i| (i < 3).then_some(DVec3::ONE)), fan(4));
        assert_eq!(Triangulator::default().cut(&[0, 1], |_| None), fan(2));
    }

    #[test]
    fn signs_of_areas_are_exact_where_their_products_cancel() {
        for m in (0..100).map(|k| f64::from(1 << 30) + f64::from(k)) {
            // m² − (m − 1)(m + 1) is 1, from products of 60 bits.
            let (u, v) = (DVec2::new(m, m - 1.0), DVec2::new(m + 1.0, m));
            assert_eq!([turn(DVec2::ZERO, u, v), turn(DVec2::ZERO, v, u)], [1.0, -1.0], "{m}");
            assert_eq!(turn(DVec2::ZERO, u, u * 3.0), 0.0, "{m}");
        }
    }

    #[test]
    fn many_corners_take_no_longer_than_their_square() {
        let n = MAX_CORNERS as i32;
        // No tooth's ears block another, but all have to be tested.
        let comb = (0..n - 2).map(|i| [f64::from(i), if i % 2 == 0 { 0.0 } else { 9.0 }]);
        let comb: Vec<[f64; 2]> = comb.chain([[f64::from(n), 10.0], [0.0, 10.0]]).collect();
        let corners = tilted(&comb, 1.0);
        assert!(cut(&corners) != fan(n as u32));
        let longer: Vec<DVec3> = corners.iter().copied().chain([DVec3::new(3.0, 5.0, -7.0)]).collect();
        assert_eq!(cut(&longer), fan(n as u32 + 1));
    }
}
