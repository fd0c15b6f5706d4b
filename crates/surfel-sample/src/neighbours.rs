//! Points in working coordinates, without duplicates, each with its nearest neighbours.

use crate::SampleError;
use crate::parallel::{for_chunks, map_each};
use crate::progress::{NoProgress, Progress};
use crate::tree::{KdTree, Nearest};
use glam::DVec3;
use rayon::prelude::*;

/// Points of a task.
const CHUNK: usize = 4096;
/// Positions are rounded to this many steps a working unit: far below what f32 data or any spacing can tell.
const SNAP: f64 = 4_294_967_296.0;

/// Distinct points, scaled into the unit cube so that no square over- or underflows, and their neighbours.
///
/// Everything is addressed by the tree's slots.
#[derive(Debug)]
pub(crate) struct Neighbours {
    pub(crate) tree: KdTree,
    /// The working origin, in object coordinates.
    pub(crate) center: DVec3,
    /// Object units of one working unit.
    pub(crate) scale: f64,
    /// Neighbours a point has in the table: fewer than asked for where the cloud is smaller.
    pub(crate) degree: usize,
    table: Vec<u32>,
    /// The slot of each input point.
    pub(crate) slot_of: Vec<u32>,
    /// The first input point of each slot.
    pub(crate) first_of: Vec<u32>,
}

impl Neighbours {
    /// Finds the `degree` nearest neighbours of each of the distinct `positions`.
    ///
    /// # Errors
    /// [`SampleError::NotFinite`] or [`SampleError::TooMany`].
    pub(crate) fn new(positions: &[DVec3], degree: usize, progress: &dyn Progress) -> Result<Self, SampleError> {
        let total = positions.len();
        SampleError::check_count("points", total)?;
        if let Some(index) = positions.iter().position(|p| !p.is_finite()) {
            let count = positions.iter().filter(|p| !p.is_finite()).count();
            return Err(SampleError::NotFinite { index, count, total });
        }
        progress.stage("neighbours", total as u64);
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in positions {
            (lo, hi) = (lo.min(*p), hi.max(*p));
        }
        // Halves first: hi − lo may overflow where neither does.
        let (center, half) = (0.5 * lo + 0.5 * hi, (0.5 * hi - 0.5 * lo).max_element());
        let scale = if half > 0.0 { half } else { 1.0 };
        // Points nearer to each other than 2⁻³² of the cloud count as one: dozens of them would see nobody else.
        // Adding zero turns −0 into 0, so that equal means equal in every bit.
        let snap = |p: &DVec3| ((*p - center) / scale * SNAP).round() / SNAP + DVec3::ZERO;
        let unit: Vec<DVec3> = map_each(total, &NoProgress, || (), |(), i| snap(&positions[i]));

        let mut order: Vec<u32> = (0..total as u32).collect();
        let key = |i: u32| unit[i as usize];
        order.par_sort_unstable_by(|&a, &b| {
            let (p, q) = (key(a), key(b));
            p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z)).then(a.cmp(&b))
        });
        let mut group_of = vec![0_u32; total];
        let (mut distinct, mut first): (Vec<DVec3>, Vec<u32>) = (Vec::new(), Vec::new());
        for &i in &order {
            if distinct.last() != Some(&key(i)) {
                distinct.push(key(i));
                first.push(i);
            }
            group_of[i as usize] = distinct.len() as u32 - 1;
        }
        drop((order, unit));

        let tree = KdTree::new(&distinct);
        drop(distinct);
        let mut slot_of_group = vec![0_u32; tree.len()];
        let mut first_of = vec![0_u32; tree.len()];
        for slot in 0..tree.len() {
            slot_of_group[tree.index(slot)] = slot as u32;
            first_of[slot] = first[tree.index(slot)];
        }
        let slot_of = group_of.into_iter().map(|g| slot_of_group[g as usize]).collect();
        let degree = degree.min(tree.len().saturating_sub(1));
        let mut table = vec![0_u32; degree * tree.len()];
        if degree > 0 {
            for_chunks(&mut table, degree * CHUNK, &|first, rows| {
                let mut found = Nearest::new(degree + 1);
                for (slot, row) in (first / degree..).zip(rows.chunks_mut(degree)) {
                    tree.nearest(tree.point(slot), &mut found);
                    // Points are distinct, so that the first is the point itself.
                    for (place, (_, neighbour)) in row.iter_mut().zip(&found.items()[1..]) {
                        *place = *neighbour;
                    }
                }
                progress.advance((rows.len() / degree) as u64);
            });
        }
        Ok(Self { tree, center, scale, degree, table, slot_of, first_of })
    }

    /// Number of distinct points.
    pub(crate) fn len(&self) -> usize {
        self.tree.len()
    }

    pub(crate) fn point(&self, slot: usize) -> DVec3 {
        self.tree.point(slot)
    }

    /// The neighbours of the point at `slot`, nearest first, without itself.
    pub(crate) fn of(&self, slot: usize) -> &[u32] {
        &self.table[slot * self.degree..(slot + 1) * self.degree]
    }

    /// More neighbours than the table has, into `wide`.
    pub(crate) fn widen(&self, slot: usize, found: &mut Nearest, wide: &mut Vec<u32>) {
        self.tree.nearest(self.point(slot), found);
        wide.clear();
        wide.extend(found.items().iter().skip(1).map(|f| f.1));
    }
}

/// Neighbours that a second look takes, where those of the table don't surround a point. 48 reach the adjacent
/// scan line up to a spacing ratio of 1:20.
pub(crate) const WIDE: usize = 48;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_lead_back_to_the_first_of_coincident_points() {
        let mut random = crate::mesh::random::Random::new(2);
        // A few hundred places for a thousand points, far from the origin.
        let mut level = || (random.unit() * 8.0).floor() - 1000.0;
        let positions: Vec<DVec3> = (0..1000).map(|_| DVec3::new(level(), level(), level())).collect();
        let cloud = Neighbours::new(&positions, 16, &NoProgress).unwrap();
        for (i, p) in positions.iter().enumerate() {
            let slot = cloud.slot_of[i] as usize;
            assert!((cloud.point(slot) * cloud.scale + cloud.center - *p).length() < 1e-6);
            let first = positions.iter().position(|q| q == p).unwrap();
            assert_eq!(cloud.first_of[slot] as usize, first);
        }
        for slot in 0..cloud.len() {
            let near = cloud.of(slot);
            assert_eq!(near.len(), 16);
            let distance = |j: u32| cloud.point(j as usize).distance(cloud.point(slot));
            assert!(near.iter().all(|j| *j as usize != slot) && near.is_sorted_by(|a, b| distance(*a) <= distance(*b)));
        }
    }

    #[test]
    fn points_closer_than_any_spacing_count_as_one() {
        let mut positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        positions.extend((0..100).map(|i| DVec3::splat(1e-13 * f64::from(i))));
        assert_eq!(Neighbours::new(&positions, 16, &NoProgress).unwrap().len(), 3);
    }
}
