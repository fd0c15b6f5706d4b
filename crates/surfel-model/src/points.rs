//! Point clouds: positions without extent, from which splats are made.

use crate::{
    Column3, ExtraColumn, ModelError, Up,
    column::{retain, retain_rows},
    morton,
};
use glam::DVec3;
use std::collections::HashMap;

/// Points with the attributes that a scanner or a file provided. Optional columns are `None` if the file doesn't have
/// them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Origin of the positions in object space, in object units.
    pub origin: DVec3,
    /// Positions relative to `origin`, in object units, one per point.
    pub positions: Column3,
    /// Normals, one per point, not necessarily of unit length; zero or non-finite means unknown.
    pub normals: Option<Column3>,
    /// Linear RGB colours, one per point.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Alpha in [0, 1], one per point.
    pub alphas: Option<Vec<f32>>,
    /// Radii stored in the file, in object units, one per point. A value that isn't positive and finite means unknown.
    pub radii: Option<Vec<f32>>,
    /// Row of each point in the input; `None` if no point was dropped.
    pub rows: Option<Vec<u32>>,
    /// Columns of the file that Surfel doesn't interpret.
    pub extras: Vec<ExtraColumn>,
    /// Up axis that the file states; `None` if it states none.
    pub up: Option<Up>,
    /// Position of the scanner that measured the points, in the coordinates of the points (with `origin` added); `None`
    /// if unknown.
    pub viewpoint: Option<DVec3>,
    /// Comment lines of the file.
    pub comments: Vec<String>,
}

impl PointCloud {
    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Returns the smallest and the largest corner of the axis-aligned box around the points, in object space; `None`
    /// if there are no points.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let first = self.origin + self.positions.high().first().map(|_| self.positions.get(0))?;
        Some((0..self.len()).fold((first, first), |(lo, hi), i| {
            let p = self.origin + self.positions.get(i);
            (lo.min(p), hi.max(p))
        }))
    }

    /// Validates that all columns have the same length.
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] naming the first column of a different length.
    pub fn check_columns(&self) -> Result<(), ModelError> {
        let expected = self.len();
        let columns = [
            ("normals", self.normals.as_ref().map(Column3::len)),
            ("colors", self.colors.as_ref().map(Vec::len)),
            ("alphas", self.alphas.as_ref().map(Vec::len)),
            ("radii", self.radii.as_ref().map(Vec::len)),
            ("rows", self.rows.as_ref().map(Vec::len)),
            ("extras", self.extras.iter().map(|e| e.values.len()).find(|&n| n != expected)),
        ];
        match columns.into_iter().find_map(|(name, len)| Some((name, len.filter(|&n| n != expected)?))) {
            Some((column, found)) => Err(ModelError::ColumnLength { column, found, expected }),
            None => Ok(()),
        }
    }

    /// Drops points whose position is not finite and returns their number. A colour component or alpha that is not
    /// finite becomes 1; the other alphas are clamped to [0, 1].
    pub fn drop_non_finite(&mut self) -> usize {
        let finite = |i: usize| self.positions.get(i).is_finite();
        let mut dropped = 0;
        if !(0..self.len()).all(finite) {
            let keep: Vec<bool> = (0..self.len()).map(finite).collect();
            dropped = keep.iter().filter(|k| !**k).count();
            self.retain(&keep);
        }
        if let Some(colors) = &mut self.colors {
            for c in colors.iter_mut().flatten().filter(|c| !c.is_finite()) {
                *c = 1.0;
            }
        }
        if let Some(alphas) = &mut self.alphas {
            for a in alphas.iter_mut() {
                *a = if a.is_finite() { a.clamp(0.0, 1.0) } else { 1.0 };
            }
        }
        dropped
    }

    /// Drops the points at exactly (0, 0, 0), which depth cameras and scanners write for "no return". Points are
    /// dropped only if there are more than `most` of them and other points remain. Returns the number of dropped
    /// points.
    pub fn drop_at_origin(&mut self, most: usize) -> usize {
        let keep: Vec<bool> = (0..self.len()).map(|i| self.origin + self.positions.get(i) != DVec3::ZERO).collect();
        let dropped = keep.iter().filter(|k| !**k).count();
        if dropped <= most || dropped == self.len() {
            return 0;
        }
        self.retain(&keep);
        dropped
    }

    /// Drops points that have the exact position of at least `most` points before them, and returns the number of
    /// dropped points.
    pub fn drop_coincident(&mut self, most: usize) -> usize {
        // Adding zero makes both zeros equal.
        let place = |i: usize| (self.positions.get(i) + 0.0).to_array().map(f64::to_bits);
        // Most clouds have no such points. An array of one-byte counters, indexed by a hash of the position, detects
        // this quickly.
        let slots = self.len().next_power_of_two().clamp(1 << 10, 1 << 24);
        let slot = |place: [u64; 3]| {
            let mix = |sum: u64, bits: u64| (sum ^ bits).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(31);
            (place.into_iter().fold(0, mix) >> 7) as usize & (slots - 1)
        };
        let mut counters = vec![0_u8; slots];
        for i in 0..self.len() {
            let counter = &mut counters[slot(place(i))];
            *counter = counter.saturating_add(1);
        }
        // The counters saturate at 255.
        let few = most.min(254) as u8;
        if counters.iter().all(|count| *count <= few) {
            return 0;
        }
        let mut in_place: HashMap<[u64; 3], usize> = HashMap::new();
        let mut is_kept = |i: usize| {
            let place = place(i);
            if counters[slot(place)] <= few {
                return true;
            }
            let count = in_place.entry(place).or_default();
            *count += 1;
            *count <= most
        };
        let keep: Vec<bool> = (0..self.len()).map(&mut is_kept).collect();
        let dropped = keep.iter().filter(|keep| !**keep).count();
        if dropped > 0 {
            self.retain(&keep);
        }
        dropped
    }

    /// Reduces the cloud to at most `most` points (at least 1), in their order, and returns the number of dropped
    /// points.
    ///
    /// One point of each run of neighbours along a Morton curve is retained. Relative densities are thus preserved, no
    /// place becomes empty, and scan lines cause no pattern. Positions must be finite.
    pub fn thin(&mut self, most: usize) -> usize {
        let (n, most) = (self.len(), most.max(1));
        if n <= most {
            return 0;
        }
        let order = morton::order(n, |i| self.positions.get(i));
        let mut keep = vec![false; n];
        for run in 0..most {
            // The middle of the run, because its ends are next to those of its neighbours.
            let middle = ((2 * run as u128 + 1) * n as u128 / (2 * most as u128)) as usize;
            keep[order[middle] as usize] = true;
        }
        self.retain(&keep);
        n - most
    }

    /// Drops the points whose flag is false, and records the input rows of the others.
    pub fn retain(&mut self, keep: &[bool]) {
        retain_rows(&mut self.rows, keep);
        self.positions.retain(keep);
        if let Some(c) = &mut self.normals {
            c.retain(keep);
        }
        if let Some(c) = &mut self.colors {
            retain(c, keep);
        }
        if let Some(c) = &mut self.alphas {
            retain(c, keep);
        }
        if let Some(c) = &mut self.radii {
            retain(c, keep);
        }
        for e in &mut self.extras {
            e.values.retain(keep);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_without_a_return_are_dropped_if_they_are_many_and_not_all() {
        let cloud = |origin: DVec3, zeros: usize, others: usize| {
            let at = |i: usize| if i < zeros { -origin } else { DVec3::X - origin };
            let positions: Vec<DVec3> = (0..zeros + others).map(at).collect();
            PointCloud { origin, positions: Column3::from_f64(&positions), ..PointCloud::default() }
        };
        for origin in [DVec3::ZERO, DVec3::new(1024.0, 0.0, -8.0)] {
            let dropped = |zeros, others| {
                let mut points = cloud(origin, zeros, others);
                (points.drop_at_origin(16), points.len())
            };
            assert_eq!((dropped(16, 3), dropped(17, 3), dropped(17, 0)), ((0, 19), (17, 3), (0, 17)));
        }
    }

    #[test]
    fn coincident_points_beyond_a_number_are_dropped() {
        let cloud = |places: &[DVec3]| PointCloud {
            origin: DVec3::X,
            positions: Column3::from_f64(places),
            colors: Some((0..places.len()).map(|i| [i as f32, 0.0, 0.0]).collect()),
            ..PointCloud::default()
        };
        // Three places, with 5,000, 300 and 16 points, among other, single points; zeros of both signs are one place.
        let place = |i: usize| match i % 10 {
            0..5 => DVec3::new(0.0, 1.0, if i.is_multiple_of(2) { 0.0 } else { -0.0 }),
            5 if i / 10 < 300 => DVec3::splat(7.5),
            6 if i / 10 < 16 => DVec3::splat(1e-30),
            _ => DVec3::new(i as f64, -1.0, 0.5),
        };
        let places: Vec<DVec3> = (0..10_000).map(place).collect();
        for most in [1, 16, 299, 300] {
            let mut points = cloud(&places);
            let dropped = points.drop_coincident(most);
            let left = |count: usize| count.saturating_sub(most);
            assert_eq!(dropped, left(5000) + left(300) + left(16), "{most}");
            // The first points of a place remain, in their order, with their columns.
            let kept: Vec<usize> = points.colors.iter().flatten().map(|c| c[0] as usize).collect();
            assert!(kept.is_sorted() && kept[..1] == [0] && points.check_columns().is_ok());
            assert!(kept.iter().enumerate().all(|(i, k)| points.positions.get(i) == places[*k]));
            assert_eq!(points.drop_coincident(most), 0);
        }
        assert_eq!(cloud(&[]).drop_coincident(16), 0);
    }

    #[test]
    fn thinned_points_are_those_asked_for_and_leave_no_place_out() {
        // Lines of 40 points, denser along x than along y, as a scanner writes them.
        let at = |i: usize| DVec3::new((i % 40) as f64, (i / 40) as f64 * 4.0, 0.0);
        let all: Vec<DVec3> = (0..400).map(at).collect();
        let colors = (0..400).map(|i| [i as f32, 0.0, 0.0]).collect();
        let cloud = PointCloud { positions: Column3::from_f64(&all), colors: Some(colors), ..PointCloud::default() };
        for most in [1, 7, 100, 399] {
            let mut thin = cloud.clone();
            assert_eq!((thin.thin(most), thin.len()), (400 - most, most));
            // All columns are reduced together, and in order.
            let kept: Vec<usize> = thin.colors.iter().flatten().map(|c| c[0] as usize).collect();
            assert!(kept.is_sorted() && kept.iter().enumerate().all(|(i, k)| thin.positions.get(i) == all[*k]));
        }
        let mut thin = cloud.clone();
        thin.thin(100);
        let kept: Vec<DVec3> = (0..100).map(|i| thin.positions.get(i)).collect();
        // Each point has four times the space: 4 x 4 instead of 1 x 4. A run of four may extend across a jump of the
        // curve.
        let farthest = all.iter().map(|p| kept.iter().map(|k| k.distance(*p)).fold(f64::INFINITY, f64::min));
        let farthest = farthest.fold(0.0, f64::max);
        assert!(farthest < 8.0, "{farthest}");
        assert_eq!((cloud.clone().thin(400), cloud.clone().thin(4000)), (0, 0));
    }
}
