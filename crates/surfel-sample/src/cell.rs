//! The Voronoi cell of a point among its neighbours in the tangent plane.
//!
//! A surface closes where every splat covers its own cell, so the cell's farthest corner is the least radius that
//! can work, and its second moments say how the sampling is stretched.

use glam::DVec2;

/// A convex polygon around the origin, clipped by bisectors. Buffers are kept between cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cell {
    /// Corners counter-clockwise, each with whether the edge that starts there is a bisector.
    corners: Vec<(DVec2, bool)>,
    spare: Vec<(DVec2, bool)>,
}

impl Cell {
    /// The cell of the origin among `neighbours`, within a square of half-width `limit`.
    pub(crate) fn build(&mut self, neighbours: &[DVec2], limit: f64) {
        self.corners.clear();
        for corner in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            self.corners.push((limit * DVec2::from(corner), false));
        }
        for n in neighbours {
            self.clip(*n);
        }
    }

    /// Cuts off the part that is nearer to `n` than to the origin.
    fn clip(&mut self, n: DVec2) {
        let half = 0.5 * n.length_squared();
        let beyond = |c: DVec2| c.dot(n) - half;
        if half == 0.0 || self.corners.iter().all(|c| beyond(c.0) <= 0.0) {
            return;
        }
        self.spare.clear();
        for (i, &(a, edge)) in self.corners.iter().enumerate() {
            let b = self.corners[(i + 1) % self.corners.len()].0;
            let (da, db) = (beyond(a), beyond(b));
            let crossing = a + (b - a) * (da / (da - db));
            match (da <= 0.0, db <= 0.0) {
                (true, true) => self.spare.push((a, edge)),
                (true, false) => self.spare.extend([(a, edge), (crossing, true)]),
                (false, true) => self.spare.push((crossing, edge)),
                (false, false) => {}
            }
        }
        std::mem::swap(&mut self.corners, &mut self.spare);
    }

    /// True when bisectors bound the cell all around.
    pub(crate) fn is_closed(&self) -> bool {
        self.corners.iter().all(|c| c.1)
    }

    /// Corners where two bisectors meet.
    pub(crate) fn corners(&self) -> impl Iterator<Item = DVec2> {
        let last = self.corners.last().is_some_and(|c| c.1);
        let before = std::iter::once(last).chain(self.corners.iter().map(|c| c.1));
        self.corners.iter().zip(before).filter(|(c, before)| c.1 && *before).map(|(c, _)| c.0)
    }

    /// Distance of the farthest of [`Cell::corners`], 0 when there is none.
    pub(crate) fn reach(&self) -> f64 {
        self.corners().map(DVec2::length).fold(0.0, f64::max)
    }

    /// Area, and the second moments xx, xy, yy about the centroid divided by the area.
    pub(crate) fn moments(&self) -> (f64, [f64; 3]) {
        let (mut area, mut first, mut second) = (0.0, DVec2::ZERO, [0.0; 3]);
        for (i, (a, _)) in self.corners.iter().enumerate() {
            let b = self.corners[(i + 1) % self.corners.len()].0;
            let double = a.perp_dot(b);
            area += 0.5 * double;
            first += (*a + b) * (double / 6.0);
            let quadratic = |i: usize, j: usize| 2.0 * (a[i] * a[j] + b[i] * b[j]) + a[i] * b[j] + a[j] * b[i];
            second[0] += double / 24.0 * quadratic(0, 0);
            second[1] += double / 24.0 * quadratic(0, 1);
            second[2] += double / 24.0 * quadratic(1, 1);
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

    fn grid(width: f64, height: f64) -> Vec<DVec2> {
        let mut all = Vec::new();
        for j in -2..=2 {
            for i in -2..=2 {
                all.push(DVec2::new(width * f64::from(i), height * f64::from(j)));
            }
        }
        all
    }

    #[test]
    fn cell_of_a_grid_is_its_rectangle() {
        let mut cell = Cell::default();
        cell.build(&grid(1.0, 4.0), 10.0);
        assert!(cell.is_closed());
        let (area, [xx, xy, yy]) = cell.moments();
        // A rectangle's variances are side² / 12.
        assert!((area - 4.0).abs() < 1e-13 && (xx - 1.0 / 12.0).abs() < 1e-13, "{area} {xx}");
        assert!((yy - 16.0 / 12.0).abs() < 1e-13 && xy.abs() < 1e-13, "{yy} {xy}");
        let reach = cell.reach();
        assert!((reach - 4.25_f64.sqrt()).abs() < 1e-13, "{reach}");
    }

    #[test]
    fn cell_at_a_border_is_open_but_knows_its_inner_corners() {
        let mut cell = Cell::default();
        let inner: Vec<DVec2> = grid(1.0, 1.0).into_iter().filter(|p| p.x <= 0.0).collect();
        cell.build(&inner, 10.0);
        assert!(!cell.is_closed());
        // A diagonal neighbour's bisector may touch a corner and leave it there twice.
        let mut corners: Vec<DVec2> = cell.corners().collect();
        corners.dedup_by(|a, b| a.distance(*b) < 1e-13);
        assert_eq!(corners.len(), 2, "{corners:?}");
        for c in corners {
            assert!((c - DVec2::new(-0.5, 0.5_f64.copysign(c.y))).length() < 1e-13, "{c}");
        }
    }
}
