//! Blue noise by weighted sample elimination (Yuksel 2015, "Sample elimination for generating Poisson disk sample
//! sets").

use crate::parallel::map_tasks;
use crate::progress::Progress;
use crate::tree::{KdTree, Nearest};
use glam::DVec3;
use std::ops::Range;

/// Yuksel's exponent α, and β and γ of the weight limit that keeps close pairs from hiding everything else (§3).
const ALPHA: i32 = 8;
const BETA: f64 = 0.65;
const GAMMA: f64 = 1.5;
/// Neighbours that count for a sample: two times the 11 that an even threefold oversampling has within reach, so
/// that a mesh with many faces in one place costs no more.
const MOST: usize = 24;

/// Samples that one thread thins by itself: a cell of the tree. Pairs across cells don't see each other, which
/// costs a few percent of the samples some evenness, no density, and buys all threads and their caches.
const BLOCK: usize = 1 << 14;

/// The `keep` samples (tree slots, in ascending order) that are left of `tree` when those with the closest
/// neighbours are taken out one by one. `normals` by input index: samples on opposite sides of a thin part don't
/// see each other. `reach`, by input index, is how far apart those are that don't mind each other, [`reach`] of the
/// density about them; of two that differ, the smaller counts.
///
/// Weights are Yuksel's eq. 2.
pub(crate) fn eliminate(
    tree: &KdTree,
    normals: &[DVec3],
    keep: usize,
    reach: &(dyn Fn(usize) -> f64 + Sync),
    progress: &dyn Progress,
) -> Vec<u32> {
    let count = tree.len();
    if keep >= count {
        return (0..count as u32).collect();
    }
    let closest = 1.0 - (keep as f64 / count as f64).powf(GAMMA);
    let thinning = Thinning { tree, normals, reach, closest };
    progress.stage("even samples", count as u64);
    let blocks = blocks(count);
    let left = map_tasks(blocks.len(), |i| {
        let block = &blocks[i];
        // Rounded sums: every block keeps its share, and all of them together exactly `keep`.
        let share = |end: usize| (end as u128 * keep as u128 / count as u128) as usize;
        let left = thinning.thin(block, share(block.end) - share(block.start));
        progress.advance(block.len() as u64);
        left
    });
    left.concat()
}

/// Twice the maximal Poisson disk radius in a plane of `area` with `keep` samples, r = √(A / (2√3·N)).
pub(crate) fn reach(area: f64, keep: f64) -> f64 {
    2.0 * (area / (2.0 * 3.0_f64.sqrt() * keep)).sqrt()
}

/// Halves 0..count as the tree does, until no part is larger than [`BLOCK`].
fn blocks(count: usize) -> Vec<Range<usize>> {
    let (mut done, mut open) = (Vec::new(), vec![(0, count)]);
    while let Some((start, end)) = open.pop() {
        if end - start <= BLOCK {
            done.push(start..end);
        } else {
            let middle = start + (end - start) / 2;
            open.extend([(middle, end), (start, middle)]);
        }
    }
    done
}

struct Thinning<'a> {
    tree: &'a KdTree,
    normals: &'a [DVec3],
    /// Distance from which samples don't mind each other, by input index.
    reach: &'a (dyn Fn(usize) -> f64 + Sync),
    /// Share of it below which it doesn't matter how close they are, over [`BETA`].
    closest: f64,
}

impl Thinning<'_> {
    fn weight(&self, distance: f64, reach: f64) -> f32 {
        let least = reach * self.closest * BETA;
        (1.0 - distance.max(least) / reach).max(0.0).powi(ALPHA) as f32
    }

    /// The `keep` slots that are left of `block`.
    fn thin(&self, block: &Range<usize>, keep: usize) -> Vec<u32> {
        let reach_of = |slot: usize| (self.reach)(self.tree.index(slot));
        let reaches: Vec<f64> = block.clone().map(reach_of).collect();
        let mut found = Nearest::within(MOST + 1, reaches.iter().copied().fold(0.0, f64::max));
        // Each sample's neighbours in the block, with the weight it lays on them.
        let mut pairs: Vec<(u32, f32)> = Vec::with_capacity(12 * block.len());
        let mut ends = Vec::with_capacity(block.len());
        for slot in block.clone() {
            self.tree.nearest(self.tree.point(slot), &mut found);
            let normal = self.normals[self.tree.index(slot)];
            for &(square, other) in found.items() {
                let other = other as usize;
                let is_seen = other != slot && block.contains(&other);
                if is_seen && normal.dot(self.normals[self.tree.index(other)]) >= 0.0 {
                    let reach = reaches[slot - block.start].min(reaches[other - block.start]);
                    pairs.push(((other - block.start) as u32, self.weight(square.sqrt(), reach)));
                }
            }
            ends.push(pairs.len());
        }
        let mut weights = vec![0.0_f32; block.len()];
        pairs.iter().for_each(|(other, w)| weights[*other as usize] += w);
        let mut heap = Heap::new(weights);
        for _ in keep..block.len() {
            let Some(taken) = heap.pop().map(|t| t as usize) else { break };
            let start = if taken == 0 { 0 } else { ends[taken - 1] };
            for (other, w) in &pairs[start..ends[taken]] {
                heap.lighten(*other, *w);
            }
        }
        let mut left = heap.order;
        left.sort_unstable();
        left.iter_mut().for_each(|slot| *slot += block.start as u32);
        left
    }
}

/// A binary heap with the heaviest element on top, whose elements can become lighter.
struct Heap {
    weights: Vec<f32>,
    /// Elements in heap order.
    order: Vec<u32>,
    /// Each element's place in `order`; `GONE` once popped.
    place: Vec<u32>,
}

const GONE: u32 = u32::MAX;

impl Heap {
    fn new(weights: Vec<f32>) -> Self {
        let order: Vec<u32> = (0..weights.len() as u32).collect();
        let mut heap = Self { place: order.clone(), order, weights };
        for i in (0..heap.order.len() / 2).rev() {
            heap.sink(i);
        }
        heap
    }

    /// Heavier first, equal ones by index: the order of removal is fixed.
    fn above(&self, a: u32, b: u32) -> bool {
        let (x, y) = (self.weights[a as usize], self.weights[b as usize]);
        x > y || (x == y && a < b)
    }

    fn sink(&mut self, mut at: usize) {
        let Some(&element) = self.order.get(at) else { return };
        loop {
            let (left, right) = (2 * at + 1, 2 * at + 2);
            let Some(&l) = self.order.get(left) else { break };
            let child = match self.order.get(right) {
                Some(&r) if self.above(r, l) => right,
                _ => left,
            };
            let lifted = self.order[child];
            if !self.above(lifted, element) {
                break;
            }
            self.order[at] = lifted;
            self.place[lifted as usize] = at as u32;
            at = child;
        }
        self.order[at] = element;
        self.place[element as usize] = at as u32;
    }

    fn pop(&mut self) -> Option<u32> {
        let top = *self.order.first()?;
        let last = self.order.pop()?;
        self.place[top as usize] = GONE;
        if let Some(first) = self.order.first_mut() {
            *first = last;
            self.sink(0);
        }
        Some(top)
    }

    fn lighten(&mut self, element: u32, by: f32) {
        let place = self.place[element as usize];
        if place != GONE {
            self.weights[element as usize] -= by;
            self.sink(place as usize);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;
    use crate::mesh::random::Random;

    #[test]
    fn elimination_leaves_few_close_pairs() {
        // One block, and sixteen of them.
        for (keep, share) in [(2000, 0.0), (60_000, 0.05)] {
            let mut random = Random::new(5);
            let points: Vec<DVec3> = (0..3 * keep).map(|_| DVec3::new(random.unit(), random.unit(), 0.0)).collect();
            let tree = KdTree::new(&points);
            let left = eliminate(&tree, &vec![DVec3::Z; points.len()], keep, &|_| reach(1.0, keep as f64), &NoProgress);
            assert_eq!(left.len(), keep);
            let hexagonal = 2.0 * (1.0 / (2.0 * 3.0_f64.sqrt() * keep as f64)).sqrt();
            let mut found = Nearest::within(2, f64::INFINITY);
            let kept = KdTree::new(&left.iter().map(|s| tree.point(*s as usize)).collect::<Vec<_>>());
            let mut closest: Vec<f64> = (0..keep)
                .map(|s| {
                    kept.nearest(kept.point(s), &mut found);
                    found.items()[1].0.sqrt() / hexagonal
                })
                .collect();
            closest.sort_by(f64::total_cmp);
            // Of the hexagonal distance, Yuksel's sets reach 0.7 at fivefold oversampling, and random points 0.01;
            // pairs across blocks may be as close as those.
            let least = closest[(share * keep as f64) as usize];
            assert!(least > 0.45, "{keep}: {least}");
        }
    }

    #[test]
    fn elimination_of_coincident_samples_stays_cheap_and_exact() {
        let tree = KdTree::new(&vec![DVec3::ONE; 5000]);
        assert_eq!(eliminate(&tree, &vec![DVec3::Z; 5000], 100, &|_| reach(1.0, 100.0), &NoProgress).len(), 100);
    }
}
