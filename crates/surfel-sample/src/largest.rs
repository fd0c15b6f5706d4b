//! Limit of a splat's size by the sizes of its neighbours.
//!
//! No splat is larger than [`TIMES`] the median radius of the [`AROUND`] nearest points. A splat can exceed the limit
//! only if the radius of some neighbour is less than 1/[`TIMES`] of its own. A quick test exempts most points from a
//! neighbour search, because no radius around them is that small.

use crate::nearest::Search;
use crate::parallel::map_each;
use crate::progress::NoProgress;
use crate::radii::Sizes;
use crate::sorted::{Bounds, FAN, LEAF, SortedPoints};

/// Number of nearest neighbours whose median radius limits a splat's radius.
const AROUND: usize = 100;
/// Largest radius of a splat, relative to the median radius of its [`AROUND`] nearest neighbours.
const TIMES: f64 = 6.0;
/// Maximum number of rounds in which splats are shortened. A shortened splat lowers the median radius around its
/// neighbours, so that these may exceed their limits. Three rounds have always sufficed.
const ROUNDS: usize = 16;
/// Fraction of the limit to which a splat that exceeds it is shortened. The margin allows for the rounding of an
/// ellipse's axis ratio.
const ROUNDING: f64 = 1.0 - 2e-4;

/// Shortens splats that are larger than [`TIMES`] the median radius of their [`AROUND`] nearest neighbours, in at most
/// [`ROUNDS`] rounds.
pub(crate) fn shorten(points: &SortedPoints, sizes: &mut Sizes) {
    for _ in 0..ROUNDS {
        let radii = map_each(points.len(), &NoProgress, || (), |(), slot| sizes.radius(slot) as f32);
        let least = SmallestRadii::new(points, &radii);
        let may_exceed = |level: usize, size: usize| {
            map_each(
                points.len().div_ceil(size),
                &NoProgress,
                || (),
                |(), i| least.may_exceed(points, &radii, level, i),
            )
        };
        // Groups of leaves are tested first: few need a test of each leaf.
        let groups = may_exceed(1, FAN * LEAF);
        let leaves = (0..points.len().div_ceil(LEAF)).filter(|leaf| groups[leaf / FAN]);
        let leaves = leaves.filter(|leaf| least.may_exceed(points, &radii, 0, *leaf));
        let slots: Vec<usize> = leaves.flat_map(|leaf| points.leaf(leaf)).collect();
        let limit = |search: &mut Search, i: usize| {
            let slot = slots[i];
            let (near, _) = search.nearest(slot, AROUND, 0.0);
            median(near.iter().map(|j| radii[*j as usize]))
                .map(|median| TIMES * f64::from(median))
                .filter(|limit| f64::from(radii[slot]) > *limit)
        };
        let limits = map_each(slots.len(), &NoProgress, || Search::new(points), limit);
        let mut is_done = true;
        for (slot, limit) in slots.into_iter().zip(limits) {
            if let Some(limit) = limit {
                is_done = false;
                sizes.shorten(slot, limit * ROUNDING);
            }
        }
        if is_done {
            return;
        }
    }
}

/// Returns the lower median of the first [`AROUND`] values; `None` if there are none.
fn median(values: impl Iterator<Item = f32>) -> Option<f32> {
    let mut all = [0.0; AROUND];
    let mut count = 0;
    for (to, value) in all.iter_mut().zip(values) {
        *to = value;
        count += 1;
    }
    let middle = usize::checked_sub(count, 1)? / 2;
    Some(*all[..count].select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Smallest splat radius in each box of the points' hierarchy, for each level: leaves, groups of leaves, and so on.
struct SmallestRadii {
    levels: Vec<Vec<f32>>,
}

impl SmallestRadii {
    fn new(points: &SortedPoints, radii: &[f32]) -> Self {
        let least = |values: &[f32]| values.iter().copied().fold(f32::INFINITY, f32::min);
        let mut levels = vec![radii.chunks(LEAF).map(least).collect::<Vec<f32>>()];
        while levels.len() < points.levels().len() {
            let above = levels[levels.len() - 1].chunks(FAN).map(least).collect();
            levels.push(above);
        }
        Self { levels }
    }

    /// True if a splat in box `index` of a level may exceed its limit, because a splat near the box has a radius small
    /// enough for a low median.
    fn may_exceed(&self, points: &SortedPoints, radii: &[f32], level: usize, index: usize) -> bool {
        let mut size = LEAF * FAN.pow(level as u32);
        let largest = radii[index * size..points.len().min((index + 1) * size)].iter().copied().fold(0.0, f32::max);
        let small = (f64::from(largest) / TIMES) as f32 * (1.0 + 1e-6);
        // Finds a box around the splat's box with more than [`AROUND`] points. None of the nearest neighbours is
        // farther away than the box's diagonal.
        let (mut level, mut index) = (level, index);
        let top = points.levels().len() - 1;
        while level > top || size <= AROUND || (index + 1) * size > points.len() {
            if level >= top {
                return self.levels[top].iter().any(|least| *least < small);
            }
            (level, index, size) = (level + 1, index / FAN, size * FAN);
        }
        let around = points.levels()[level][index / FAN].get(index % FAN);
        let widest = (0..3).map(|k| (f64::from(around.hi[k]) - f64::from(around.lo[k])).powi(2)).sum::<f64>().sqrt();
        let region = around.grown((widest * (1.0 + 1e-6) + 1.0).min(f64::from(i32::MAX)) as i32);
        self.has_small(points, &region, small)
    }

    /// True if a leaf of the hierarchy that meets `region` has a splat with a radius below `small`.
    fn has_small(&self, points: &SortedPoints, region: &Bounds, small: f32) -> bool {
        let top = points.levels().len() - 1;
        let mut stack: Vec<(usize, usize)> = (0..self.levels[top].len()).map(|index| (top, index)).collect();
        while let Some((level, index)) = stack.pop() {
            let bounds = points.levels()[level][index / FAN].get(index % FAN);
            let meets = (0..3).all(|k| bounds.lo[k] <= region.hi[k] && bounds.hi[k] >= region.lo[k]);
            if !meets || self.levels[level][index] >= small {
                continue;
            }
            if level == 0 {
                return true;
            }
            let below = &self.levels[level - 1];
            stack.extend((index * FAN..((index + 1) * FAN).min(below.len())).map(|index| (level - 1, index)));
        }
        false
    }
}
