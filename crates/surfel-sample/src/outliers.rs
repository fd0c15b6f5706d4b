//! Detection of a cloud's outliers.
//!
//! Statistical outlier removal ([Rusu 2008] §3.1.1, as in PCL, Open3D and PDAL) compares each point's mean distance to
//! its nearest neighbours with mean + n·σ over all points. A far stray point makes σ arbitrarily large, and a clean
//! cloud loses 2 to 5 % of its points. This module therefore uses the median and the median absolute deviation, both of
//! logarithms, which measure ratios of density. A limit of 3.5 such deviations is that of Iglewicz and Hoaglin (1993).
//!
//! A second rule compares each point with its own neighbours (like local outlier factors, Breunig et al. 2000). The
//! rule finds stray points near dense parts if the density varies too much for a global limit.
//!
//! [Rusu 2008]: https://doi.org/10.1016/j.robot.2008.08.005
//!
//! A *slot* is a point's place in the order of [`SortedPoints`], and a *grid step* is the unit of its coordinates.

use crate::class::ALONE;
use crate::median::spread;
use crate::nearest::{Search, distance2};
use crate::parallel::map_each;
use crate::sorted::SortedPoints;
use crate::{NoProgress, Progress, SampleError};
use glam::DVec3;
use surfel_model::PointCloud;

/// Number of nearest neighbours in a point's mean distance, as in PDAL's `filters.outlier`.
const NEIGHBOURS: usize = 8;
/// Number of distinct points from which rules 1 and 2 of [`outliers`] apply; in smaller clouds they find no outliers.
const MIN_POINTS: usize = 2 * NEIGHBOURS;
/// Distance from the cloud's centre beyond which a point is always an outlier, in units of the points' median distance
/// from it. A grid that contained such a point would have all other points in one cell.
const FARTHEST: f64 = 1e4;
/// Maximum number of points from which the cloud's centre and the median distance from it are computed.
const SAMPLE: usize = 1 << 20;

/// Finds the outliers of a point cloud: returns a flag per point, true for an outlier. Some points always remain.
///
/// Let d be a point's mean distance to its 8 nearest neighbours. Coincident points count as one, and points that rule 3
/// finds don't count. The point is an outlier if any of three rules applies:
/// 1. d is more than 8 times the cloud's median d, and ln d is more than 3.5 standard deviations above the median
///    (estimated from the median absolute deviation);
/// 2. d is more than 8 times the d of more than half of these 8 neighbours;
/// 3. the point is more than 10,000 times as far from the cloud's centre as half of all points are. Centre and distance
///    are medians over up to about a million points; no point is an outlier by this rule if the distance is 0.
///
/// Groups of nine or more stray points in one place are not found. In clouds of fewer than 16 distinct points, rules 1
/// and 2 find no outliers.
///
/// Sources: rule 1 is statistical outlier removal (Rusu et al. 2008, §3.1.1) with median and median absolute deviation
/// in place of mean and σ; rule 2 follows local outlier factors (Breunig et al. 2000); rule 3 is our own.
///
/// # Errors
/// [`SampleError::NotFinite`] and [`SampleError::TooMany`], as [`crate::splats_from_points`].
pub fn outliers(points: &PointCloud, progress: &dyn Progress) -> Result<Vec<bool>, SampleError> {
    let position = |i: usize| points.positions.get(i);
    let count = points.len();
    progress.stage("outliers", count as u64);
    let mut found = far(count, &position);
    let near: Vec<u32> = (0..count as u32).filter(|i| !found[*i as usize]).collect();
    let sorted = SortedPoints::new(near.len(), |i| position(near[i] as usize))?;
    if sorted.len() >= MIN_POINTS {
        let distances = distances(&sorted);
        let limit = spread(distances.len(), |i| distances[i]).map_or(f64::INFINITY, |spread| spread.most(ALONE));
        let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
        let is_alone = |search: &mut Search<'_>, slot: usize| {
            let own = f64::from(distances[slot]);
            let closer = |other: &&u32| own > ALONE * f64::from(distances[**other as usize]);
            own > limit
                || own > ALONE * f64::from(least)
                    && search.nearest(slot, NEIGHBOURS, 0.0).0.iter().filter(closer).count() > NEIGHBOURS / 2
        };
        let alone = map_each(sorted.len(), &NoProgress, || Search::new(&sorted), is_alone);
        for slot in (0..sorted.len()).filter(|slot| alone[*slot]) {
            sorted.inputs(slot).iter().for_each(|i| found[near[*i as usize] as usize] = true);
        }
    }
    progress.advance(count as u64);
    Ok(found)
}

/// Applies the third rule of [`outliers`]: returns a flag per point, true if the point is far from the cloud's centre.
fn far(count: usize, position: &(impl Fn(usize) -> DVec3 + Sync)) -> Vec<bool> {
    let taken = count.min(SAMPLE);
    let sample: Vec<DVec3> =
        (0..taken).map(|k| position((k as u128 * count as u128 / taken as u128) as usize)).collect();
    let median = |mut values: Vec<f64>| {
        let middle = values.len().checked_sub(1).map_or(0, |last| last / 2);
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    let middle = DVec3::from([0, 1, 2].map(|axis| median(sample.iter().map(|p| p[axis]).collect())));
    let typical = median(sample.iter().map(|p| (*p - middle).length()).collect());
    let is_far = |i: usize| typical > 0.0 && (position(i) - middle).length() > FARTHEST * typical;
    map_each(count, &NoProgress, || (), |(), i| is_far(i))
}

/// Returns the mean distance of each slot's point to its nearest neighbours, in grid steps.
fn distances(points: &SortedPoints) -> Vec<f32> {
    let mean = |search: &mut Search<'_>, slot: usize| {
        let (near, _) = search.nearest(slot, NEIGHBOURS, 0.0);
        let distance = |other: &u32| f64::from(distance2(points.at(*other as usize), points.at(slot))).sqrt();
        (near.iter().map(distance).sum::<f64>() / near.len() as f64) as f32
    };
    map_each(points.len(), &NoProgress, || Search::new(points), mean)
}
