//! Table with the nearest neighbours of every point.
//!
//! A *slot* is a point's place in the order of [`SortedPoints`], and a *grid step* is the unit of its coordinates.

use crate::SampleError;
use crate::nearest::Search;
use crate::parallel::for_chunks;
use crate::progress::Progress;
use crate::sorted::SortedPoints;
use glam::DVec3;

/// Number of points per parallel task.
const CHUNK: usize = 4096;

/// Distinct points and their nearest neighbours, addressed by slot (the place in sorted order).
#[derive(Debug)]
pub(crate) struct Neighbours {
    pub(crate) points: SortedPoints,
    /// Number of neighbours listed per point: fewer than requested if the cloud is too small.
    degree: usize,
    table: Vec<u32>,
    /// Slot of the distinct point to which each input point belongs.
    pub(crate) slot_of: Vec<u32>,
}

impl Neighbours {
    /// Finds the `degree` nearest neighbours of each of the distinct `positions`.
    ///
    /// # Errors
    /// [`SampleError::NotFinite`] if a position isn't finite, [`SampleError::TooMany`] for more points than indices
    /// address.
    pub(crate) fn new(positions: &[DVec3], degree: usize, progress: &dyn Progress) -> Result<Self, SampleError> {
        progress.stage("neighbours", positions.len() as u64);
        let points = SortedPoints::new(positions.len(), |i| positions[i])?;
        let slot_of = points.slots();
        let degree = degree.min(points.len().saturating_sub(1));
        let mut table = vec![0_u32; degree * points.len()];
        if degree > 0 {
            for_chunks(&mut table, degree * CHUNK, &|first, rows| {
                let mut search = Search::new(&points);
                for (slot, row) in (first / degree..).zip(rows.chunks_mut(degree)) {
                    row.copy_from_slice(search.nearest(slot, degree, 0.0).0);
                }
                progress.advance((rows.len() / degree) as u64);
            });
        }
        Ok(Self { points, degree, table, slot_of })
    }

    /// Returns the number of distinct points.
    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    /// Returns the position of a slot's point, in grid steps from the centre of all points.
    pub(crate) fn point(&self, slot: usize) -> DVec3 {
        self.points.point(slot)
    }

    /// Returns the neighbours of the point at `slot`, nearest first, without the point itself.
    pub(crate) fn of(&self, slot: usize) -> &[u32] {
        &self.table[slot * self.degree..(slot + 1) * self.degree]
    }
}
