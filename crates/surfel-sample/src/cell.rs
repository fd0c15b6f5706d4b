//! The Voronoi cell of a point among its neighbours in the tangent plane.
//!
//! A surface closes where every splat covers its own cell, so the cell's farthest corner is the least radius that
//! can work, and its second moments say how the sampling is stretched.

use glam::Vec2;

/// Neighbours that a cell is built among at most.
pub(crate) const MOST_IN_CELL: usize = 64;
/// Corners of a square and one more for each neighbour.
const MOST_CORNERS: usize = MOST_IN_CELL + 5;
/// Corners that are computed side by side, and room for a whole number of them.
const LANES: usize = 8;
const ROOM: usize = MOST_CORNERS.next_multiple_of(LANES);

/// Corners counter-clockwise, as columns; zeros, which nothing cuts off, fill the last lanes up.
#[derive(Clone, Debug)]
struct Corners {
    x: [f32; ROOM],
    y: [f32; ROOM],
    /// Whether the edge that starts there is a bisector.
    is_bisector: [bool; ROOM],
}

impl Corners {
    const NONE: Self = Self { x: [0.0; ROOM], y: [0.0; ROOM], is_bisector: [false; ROOM] };

    #[inline]
    fn at(&self, i: usize) -> Vec2 {
        Vec2::new(self.x[i], self.y[i])
    }

    #[inline]
    fn set(&mut self, i: usize, at: Vec2, is_bisector: bool) {
        (self.x[i], self.y[i], self.is_bisector[i]) = (at.x, at.y, is_bisector);
    }

    /// Fills up what follows the last of `len` corners.
    #[inline]
    fn fill(&mut self, len: usize) {
        for i in len..len.next_multiple_of(LANES) {
            (self.x[i], self.y[i]) = (0.0, 0.0);
        }
    }
}

/// A convex polygon around the origin, clipped by bisectors. Kept between cells.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    /// Its corners, and room for those that a clip leaves.
    buffers: [Corners; 2],
    /// Which of the two they are in.
    current: usize,
    len: usize,
    /// How far each corner is beyond a bisector.
    beyond: [f32; ROOM],
}

impl Default for Cell {
    fn default() -> Self {
        Self { buffers: [Corners::NONE; 2], current: 0, len: 0, beyond: [0.0; ROOM] }
    }
}

impl Cell {
    /// The cell of the origin among at most [`MOST_IN_CELL`] `neighbours`, nearest first, within a square of
    /// half-width 1.
    pub(crate) fn build(&mut self, neighbours: &[Vec2]) {
        self.current = 0;
        self.len = 4;
        for (i, (x, y)) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].into_iter().enumerate() {
            self.buffers[0].set(i, Vec2::new(x, y), false);
        }
        self.buffers[0].fill(4);
        let mut reach2 = 2.0;
        for n in neighbours {
            let square = n.length_squared();
            // Neither this bisector nor any later one reaches the cell.
            if square >= 4.0 * reach2 {
                break;
            }
            if self.clip(*n, 0.5 * square) {
                reach2 = self.reach2();
            }
        }
    }

    /// Square of the distance of the farthest corner.
    #[inline]
    fn reach2(&self) -> f32 {
        let Corners { x, y, .. } = self.corners_now();
        let (xs, ys) = (x.as_chunks::<LANES>().0, y.as_chunks::<LANES>().0);
        let mut farthest = [0.0_f32; LANES];
        for (x, y) in xs.iter().zip(ys).take(self.len.div_ceil(LANES)) {
            for i in 0..LANES {
                let square = x[i] * x[i] + y[i] * y[i];
                farthest[i] = if square > farthest[i] { square } else { farthest[i] };
            }
        }
        farthest.into_iter().fold(0.0, f32::max)
    }

    #[inline]
    fn corners_now(&self) -> &Corners {
        &self.buffers[self.current]
    }

    /// Each corner, and whether the edge that starts there is a bisector.
    #[inline]
    fn polygon(&self) -> impl DoubleEndedIterator<Item = (Vec2, bool)> + Clone {
        let corners = self.corners_now();
        (0..self.len).map(|i| (corners.at(i), corners.is_bisector[i]))
    }

    /// Cuts off the part that is nearer to `n` than to the origin; `half` is half of its square. False if there is no
    /// such part.
    #[inline]
    fn clip(&mut self, n: Vec2, half: f32) -> bool {
        if half == 0.0 || self.len == MOST_CORNERS {
            return false;
        }
        let len = self.len;
        let [a, b] = &mut self.buffers;
        let (from, to) = if self.current == 0 { (&*a, b) } else { (&*b, a) };
        let lanes = from.x.as_chunks::<LANES>().0.iter().zip(from.y.as_chunks::<LANES>().0);
        let lanes = lanes.zip(self.beyond.as_chunks_mut::<LANES>().0).take(len.div_ceil(LANES));
        let mut is_cut = [false; LANES];
        for ((x, y), beyond) in lanes {
            for i in 0..LANES {
                beyond[i] = x[i] * n.x + y[i] * n.y - half;
                is_cut[i] |= beyond[i] > 0.0;
            }
        }
        if is_cut == [false; LANES] {
            return false;
        }
        let mut kept = 0;
        for i in 0..len {
            let next = if i + 1 == len { 0 } else { i + 1 };
            let (da, db) = (self.beyond[i], self.beyond[next]);
            // What isn't kept is written over.
            to.set(kept, from.at(i), from.is_bisector[i]);
            kept += usize::from(da <= 0.0);
            if (da <= 0.0) != (db <= 0.0) {
                let at = from.at(i) + (from.at(next) - from.at(i)) * (da / (da - db));
                // Leaving, the bisector begins; entering, the edge goes on.
                to.set(kept, at, da <= 0.0 || from.is_bisector[i]);
                kept += 1;
            }
        }
        to.fill(kept);
        (self.len, self.current) = (kept, 1 - self.current);
        true
    }

    /// True when bisectors bound the cell all around.
    pub(crate) fn is_closed(&self) -> bool {
        self.corners_now().is_bisector[..self.len].iter().all(|is_bisector| *is_bisector)
    }

    /// Corners where two bisectors meet.
    pub(crate) fn corners(&self) -> impl Iterator<Item = Vec2> {
        let before = self.polygon().next_back().into_iter().chain(self.polygon());
        self.polygon().zip(before).filter(|(c, before)| c.1 && before.1).map(|(c, _)| c.0)
    }

    /// Distance of the farthest of [`Cell::corners`], 0 when there is none.
    pub(crate) fn reach(&self) -> f32 {
        self.corners().map(Vec2::length_squared).fold(0.0, f32::max).sqrt()
    }

    /// Area, and the second moments xx, xy, yy about the centroid divided by the area.
    pub(crate) fn moments(&self) -> (f32, [f32; 3]) {
        let (mut area, mut first, mut second) = (0.0, Vec2::ZERO, [0.0; 3]);
        for i in 0..self.len {
            let (a, b) = (self.corners_now().at(i), self.corners_now().at(if i + 1 == self.len { 0 } else { i + 1 }));
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

#[cfg(test)]
mod tests {
    use super::*;

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
        cell.build(&grid(0.1, 0.4));
        assert!(cell.is_closed());
        let (area, [xx, xy, yy]) = cell.moments();
        // A rectangle's variances are side² / 12. Tolerances are 1e-6 of what is measured: some ten roundings of f32.
        assert!((area - 0.04).abs() < 4e-8 && (xx - 0.01 / 12.0).abs() < 1e-9, "{area} {xx}");
        assert!((yy - 0.16 / 12.0).abs() < 1e-8 && xy.abs() < 1e-8, "{yy} {xy}");
        let reach = cell.reach();
        assert!((reach - 0.0425_f32.sqrt()).abs() < 1e-7, "{reach}");
    }

    #[test]
    fn cell_at_a_border_is_open_but_knows_its_inner_corners() {
        let mut cell = Cell::default();
        let inner: Vec<Vec2> = grid(0.1, 0.1).into_iter().filter(|p| p.x <= 0.0).collect();
        cell.build(&inner);
        assert!(!cell.is_closed());
        // A diagonal neighbour's bisector may touch a corner and leave it there twice.
        let mut corners: Vec<Vec2> = cell.corners().collect();
        corners.dedup_by(|a, b| a.distance(*b) < 1e-7);
        assert_eq!(corners.len(), 2, "{corners:?}");
        for c in corners {
            assert!((c - Vec2::new(-0.05, 0.05_f32.copysign(c.y))).length() < 1e-7, "{c}");
        }
    }

    #[test]
    fn cells_among_the_most_neighbours_on_a_circle_have_a_corner_for_each() {
        let at = |i: usize| Vec2::from_angle(i as f32 / MOST_IN_CELL as f32 * std::f32::consts::TAU) * 0.5;
        let mut cell = Cell::default();
        cell.build(&(0..MOST_IN_CELL).map(at).collect::<Vec<_>>());
        assert!(cell.is_closed());
        // The bisectors of a regular polygon: a disk of radius ¼, but for its corners.
        let radius = 0.25 / (std::f32::consts::PI / MOST_IN_CELL as f32).cos();
        assert!((cell.reach() - radius).abs() < 1e-6 && cell.corners().count() >= MOST_IN_CELL);
    }
}
