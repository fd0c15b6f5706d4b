//! Voronoi cell of a point among its neighbours in the tangent plane.
//!
//! A surface has no holes if every splat covers its own cell. The distance from the point to its cell's farthest corner
//! is therefore the smallest possible radius. The cell's second moments show by how much, and in which direction, the
//! points are spaced more widely.

use crate::lanes::{LANES, numbers};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, mask32x16, u32x16};
use glam::Vec2;

/// Largest number of neighbours from which a cell is built.
pub(crate) const MAX_IN_CELL: usize = 64;
/// Largest number of corners that a cell may have before it is clipped again. Four corners belong to the initial
/// square, each neighbour adds one, and one is spare.
const MAX_CORNERS: usize = MAX_IN_CELL + 5;
/// Capacity of the buffers for a cell's corners. It exceeds the number of corners by a half, because cutting one corner
/// off a polygon that rounding has bent may leave two.
const ROOM: usize = MAX_CORNERS + MAX_CORNERS / 2;

/// Voronoi cell of the origin: a convex polygon clipped by the bisectors between the origin and its neighbours. The
/// buffers are reused between cells.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    /// Coordinates x and y of the corners, counter-clockwise.
    x: [f32; ROOM],
    y: [f32; ROOM],
    /// One bit per corner, set if the edge from this corner to the next lies on a bisector, not on the initial square.
    bisectors: u128,
    len: usize,
}

impl Default for Cell {
    fn default() -> Self {
        Self { x: [0.0; ROOM], y: [0.0; ROOM], bisectors: 0, len: 0 }
    }
}

impl Cell {
    /// Builds the cell of the origin inside a square of half-width 1. Its at most [`MAX_IN_CELL`] neighbours are at
    /// (x, y), nearest first.
    #[inline(always)]
    pub(crate) fn build<S: Simd>(&mut self, simd: S, x: &[f32], y: &[f32]) {
        let mut few = Few::square(simd);
        let mut reach2 = 2.0;
        for (i, (nx, ny)) in x.iter().zip(y).enumerate() {
            let square = nx * nx + ny * ny;
            // This bisector and all later ones are too far away to meet the cell.
            if square >= 4.0 * reach2 {
                break;
            }
            match few.clip(simd, [*nx, *ny], 0.5 * square) {
                Clip::Missed => {}
                Clip::Cut(left) => {
                    few = left;
                    reach2 = few.reach2();
                }
                Clip::Other => {
                    self.store(&few);
                    return self.clip_by_all(&x[i..], &y[i..]);
                }
            }
        }
        self.store(&few);
    }

    #[inline(always)]
    fn store<S: Simd>(&mut self, few: &Few<S>) {
        if let (Some(x), Some(y)) = (self.x.first_chunk_mut(), self.y.first_chunk_mut()) {
            few.x.store_array(x);
            few.y.store_array(y);
        }
        (self.bisectors, self.len) = (u128::from(few.bisectors), few.len);
    }

    #[inline]
    fn at(&self, i: usize) -> Vec2 {
        Vec2::new(self.x[i], self.y[i])
    }

    fn clip_by_all(&mut self, x: &[f32], y: &[f32]) {
        for (x, y) in x.iter().zip(y) {
            let n = Vec2::new(*x, *y);
            self.clip(n, 0.5 * n.length_squared());
        }
    }

    /// Cuts off the part of the cell that is nearer to the neighbour `n` than to the origin, corner by corner. The cell
    /// may have any number of corners. `half` is half of the squared length of `n`.
    fn clip(&mut self, n: Vec2, half: f32) {
        let from = self.clone();
        let beyond = |i: usize| from.x[i] * n.x + from.y[i] * n.y - half;
        if half == 0.0 || from.len >= MAX_CORNERS || (0..from.len).all(|i| beyond(i) <= 0.0) {
            return;
        }
        (self.bisectors, self.len) = (0, 0);
        for i in 0..from.len {
            let next = if i + 1 == from.len { 0 } else { i + 1 };
            let (da, db) = (beyond(i), beyond(next));
            let is_bisector = from.bisectors >> i & 1 == 1;
            if da <= 0.0 {
                self.push(from.at(i), is_bisector);
            }
            if (da <= 0.0) != (db <= 0.0) {
                // Where the boundary leaves the half-plane, the bisector begins; where it enters, the edge continues.
                let crossing = from.at(i) + (from.at(next) - from.at(i)) * (da / (da - db));
                self.push(crossing, da <= 0.0 || is_bisector);
            }
        }
    }

    fn push(&mut self, at: Vec2, is_bisector: bool) {
        (self.x[self.len], self.y[self.len]) = (at.x, at.y);
        self.bisectors |= u128::from(is_bisector) << self.len;
        self.len += 1;
    }

    /// True if all edges of the cell lie on bisectors.
    pub(crate) fn is_closed(&self) -> bool {
        self.bisectors == (1 << self.len) - 1
    }

    /// Returns the corners at which two bisectors meet, without corners on the initial square.
    pub(crate) fn corners(&self) -> impl Iterator<Item = Vec2> {
        let mut both = match self.len {
            0 => 0,
            len => self.bisectors & (self.bisectors << 1 | self.bisectors >> (len - 1)),
        };
        std::iter::from_fn(move || {
            let lowest = (both != 0).then(|| self.at(both.trailing_zeros() as usize));
            both &= both.wrapping_sub(1);
            lowest
        })
    }

    /// Returns the distance from the origin to the farthest of [`Cell::corners`]; 0 if there are none.
    pub(crate) fn reach(&self) -> f32 {
        self.corners().map(Vec2::length_squared).fold(0.0, f32::max).sqrt()
    }

    /// Returns the cell's area, and its second moments xx, xy, yy about its centroid, divided by the area. All are 0
    /// for a cell without area.
    pub(crate) fn moments(&self) -> (f32, [f32; 3]) {
        let (mut area, mut first, mut second) = (0.0, Vec2::ZERO, [0.0; 3]);
        for i in 0..self.len {
            let (a, b) = (self.at(i), self.at(if i + 1 == self.len { 0 } else { i + 1 }));
            let double = a.perp_dot(b);
            area += 0.5 * double;
            first += (a + b) * (double / 6.0);
            let part = double / 24.0;
            second[0] += part * (2.0 * (a.x * a.x + b.x * b.x) + 2.0 * a.x * b.x);
            second[1] += part * (2.0 * (a.x * a.y + b.x * b.y) + a.x * b.y + a.y * b.x);
            second[2] += part * (2.0 * (a.y * a.y + b.y * b.y) + 2.0 * a.y * b.y);
        }
        if area <= 0.0 {
            return (0.0, [0.0; 3]);
        }
        let c = first / area;
        (area, [second[0] / area - c.x * c.x, second[1] / area - c.x * c.y, second[2] / area - c.y * c.y])
    }
}

/// Polygon with at most as many corners as SIMD lanes; lanes beyond the last corner repeat the first corner.
#[derive(Clone, Copy)]
struct Few<S: Simd> {
    x: f32x16<S>,
    y: f32x16<S>,
    bisectors: u32,
    len: usize,
}

/// Result of clipping a polygon by the bisector between the origin and a neighbour.
enum Clip<S: Simd> {
    /// Polygon unchanged, because the bisector doesn't meet it.
    Missed,
    Cut(Few<S>),
    /// No result: the polygon would get more corners than there are lanes, or rounding has bent it. It must be clipped
    /// corner by corner.
    Other,
}

impl<S: Simd> Few<S> {
    #[inline(always)]
    fn square(simd: S) -> Self {
        let (mut x, mut y) = ([-1.0; LANES], [-1.0; LANES]);
        (x[1], x[2], y[2], y[3]) = (1.0, 1.0, 1.0, 1.0);
        let [x, y] = [x, y].map(|c| f32x16::load_array(simd, c));
        Self { x, y, bisectors: 0, len: 4 }
    }

    /// Returns the squared distance from the origin to the farthest corner.
    #[inline(always)]
    fn reach2(&self) -> f32 {
        (self.x * self.x + self.y * self.y).reduce_max()
    }

    /// Clips like [`Cell::clip`], with bit-identical results, but with all corners in SIMD lanes.
    #[inline(always)]
    fn clip(&self, simd: S, n: [f32; 2], half: f32) -> Clip<S> {
        let Self { x, y, bisectors, len } = *self;
        let beyond = x * n[0] + y * n[1] - half;
        let all = u32::MAX >> (32 - len);
        let out = beyond.simd_gt(f32x16::splat(simd, 0.0)).to_bitmask() as u32 & all;
        if out == 0 || half == 0.0 {
            return Clip::Missed;
        }
        // The corners cut off form one run: find its first corner, and the first corner after it.
        let after_out = (out << 1 | out >> (len - 1)) & all;
        let (first, after) = (out & !after_out, after_out & !out);
        let kept = len - out.count_ones() as usize;
        if first.count_ones() != 1 || kept + 2 > LANES {
            return Clip::Other;
        }
        let (first, after) = (first.trailing_zeros(), after.trailing_zeros());
        let after = if after == 0 { len as u32 } else { after };
        // Edges that cross the bisector, as bits, and the lanes at which their crossings are inserted among the
        // remaining corners. The corners' order is preserved.
        let crossed = out ^ (out >> 1 | (out & 1) << (len - 1));
        let is_around = (first == 0 || first > after) && after < len as u32;
        let below = |bit: u32| bisectors & ((1 << bit) - 1);
        let (leaves, enters, stays) = if is_around {
            (kept as u32 + 1, 0, (bisectors >> after & ((1 << kept) - 1)) << 1)
        } else {
            (first, first + 1, below(first) | (bisectors >> after) << (first + 2))
        };
        let places = 1 << leaves | 1 << enters;
        // Where the boundary leaves the half-plane, the bisector begins; where it enters, the edge continues.
        let bisectors = stays | 1 << leaves | (bisectors >> (after - 1) & 1) << enters;

        let (x_next, y_next) = (x.slide::<1>(x), y.slide::<1>(y));
        let share = beyond / (beyond - beyond.slide::<1>(beyond));
        let bits = |bits: u32| mask32x16::from_bitmask(simd, u64::from(bits));
        let (crossed, places, kept_in) = (bits(crossed), bits(places), bits(all & !out));
        let is_one = numbers(simd, 0).simd_lt(u32x16::splat(simd, kept as u32 + 2));
        let x = merge(x, kept_in, x + (x_next - x) * share, crossed, places, is_one);
        let y = merge(y, kept_in, y + (y_next - y) * share, crossed, places, is_one);
        Clip::Cut(Self { x, y, bisectors, len: kept + 2 })
    }
}

/// Merges the lanes of `old` selected by `kept` with the lanes of `new` selected by `taken`, both in order. The lanes
/// of `new` go to the lanes `places`, and those of `old` to the others. Lanes outside of `used` repeat the first lane.
#[inline(always)]
fn merge<S: Simd>(
    old: f32x16<S>,
    kept: mask32x16<S>,
    new: f32x16<S>,
    taken: mask32x16<S>,
    places: mask32x16<S>,
    used: mask32x16<S>,
) -> f32x16<S> {
    let (old, new) = (old.compress(kept).expand(!places), new.compress(taken).expand(places));
    let merged = places.select(new, old);
    used.select(merged, f32x16::splat(merged.token(), merged[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::levels;
    use crate::mesh::random::Random;
    use fearless_simd::{Level, dispatch};

    fn build(cell: &mut Cell, neighbours: &[Vec2]) {
        build_by(Level::new(), cell, neighbours);
    }

    fn build_by(level: Level, cell: &mut Cell, neighbours: &[Vec2]) {
        let (x, y): (Vec<f32>, Vec<f32>) = neighbours.iter().map(|n| (n.x, n.y)).unzip();
        dispatch!(level, simd => cell.build(simd, &x, &y));
    }

    fn grid(width: f32, height: f32) -> Vec<Vec2> {
        let mut all = Vec::new();
        for j in -2..=2_i8 {
            for i in -2..=2_i8 {
                all.push(Vec2::new(width * f32::from(i), height * f32::from(j)));
            }
        }
        all.sort_by(|a, b| a.length().total_cmp(&b.length()));
        all
    }

    #[test]
    fn cell_of_a_grid_is_its_rectangle() {
        let mut cell = Cell::default();
        build(&mut cell, &grid(0.1, 0.4));
        assert!(cell.is_closed());
        let (area, [xx, xy, yy]) = cell.moments();
        // The variance of a rectangle's side is side² / 12. Tolerances are 1e-6 of the measured value: about ten
        // roundings of f32.
        assert!((area - 0.04).abs() < 4e-8 && (xx - 0.01 / 12.0).abs() < 1e-9, "{area} {xx}");
        assert!((yy - 0.16 / 12.0).abs() < 1e-8 && xy.abs() < 1e-8, "{yy} {xy}");
        let reach = cell.reach();
        assert!((reach - 0.0425_f32.sqrt()).abs() < 1e-7, "{reach}");
    }

    #[test]
    fn cell_at_a_border_is_open_but_knows_its_inner_corners() {
        let mut cell = Cell::default();
        let inner: Vec<Vec2> = grid(0.1, 0.1).into_iter().filter(|p| p.x <= 0.0).collect();
        build(&mut cell, &inner);
        assert!(!cell.is_closed());
        // A diagonal neighbour's bisector may touch a corner and duplicate it.
        let mut corners: Vec<Vec2> = cell.corners().collect();
        corners.dedup_by(|a, b| a.distance(*b) < 1e-7);
        assert_eq!(corners.len(), 2, "{corners:?}");
        for c in corners {
            assert!((c - Vec2::new(-0.05, 0.05_f32.copysign(c.y))).length() < 1e-7, "{c}");
        }
    }

    #[test]
    fn cells_among_the_most_neighbours_on_a_circle_have_a_corner_for_each() {
        let at = |i: usize| Vec2::from_angle(i as f32 / MAX_IN_CELL as f32 * std::f32::consts::TAU) * 0.5;
        let mut cell = Cell::default();
        build(&mut cell, &(0..MAX_IN_CELL).map(at).collect::<Vec<_>>());
        assert!(cell.is_closed());
        // The bisectors form a regular polygon: a disk of radius ¼, except at its corners.
        let radius = 0.25 / (std::f32::consts::PI / MAX_IN_CELL as f32).cos();
        assert!((cell.reach() - radius).abs() < 1e-6 && cell.corners().count() >= MAX_IN_CELL);
    }

    #[test]
    fn clips_by_lanes_are_those_made_corner_by_corner() {
        let mut random = Random::new(12);
        let corners = |cell: &Cell| {
            let bits = |i| [cell.x[i], cell.y[i]].map(f32::to_bits);
            ((0..cell.len).map(bits).collect::<Vec<_>>(), cell.bisectors)
        };
        for spread in [0.05, 0.5, 0.95] {
            for _ in 0..300 {
                let mut near: Vec<Vec2> = (0..24)
                    .map(|_| Vec2::from_angle(6.4 * random.unit() as f32) * (1.0 - spread * random.unit() as f32))
                    .collect();
                near.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
                let (mut lanes, mut plain) = (Cell::default(), Cell::default());
                build(&mut plain, &[]);
                for (i, n) in near.iter().enumerate() {
                    plain.clip(*n, 0.5 * n.length_squared());
                    for level in levels() {
                        build_by(level, &mut lanes, &near[..=i]);
                        assert_eq!(corners(&lanes), corners(&plain), "{level:?}");
                    }
                }
                assert!(lanes.len > 2);
            }
        }
    }

    #[test]
    fn bent_polygons_of_the_most_corners_have_room() {
        // Every other corner is beyond the bisector.
        let mut cell = Cell { len: MAX_CORNERS - 1, ..Cell::default() };
        for i in 0..cell.len {
            (cell.x[i], cell.y[i]) = (if i % 2 == 0 { 1.0 } else { -1.0 }, i as f32);
        }
        cell.clip(Vec2::X, 0.5);
        assert_eq!(cell.len, MAX_CORNERS - 1 + (MAX_CORNERS - 1) / 2);
        cell.clip(Vec2::X, 0.25);
        assert_eq!(cell.len, MAX_CORNERS - 1 + (MAX_CORNERS - 1) / 2);
    }
}
