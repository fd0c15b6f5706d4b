//! Blue noise by weighted sample elimination (Yuksel 2015, "Sample elimination for generating Poisson disk sample
//! sets").
//!
//! Candidates are sorted into blocks that fit a core's cache, by repeated halving along the longest side. Each block
//! finds its close pairs by a sorted grid, and removes its heaviest candidates by a queue of buckets. A block depends
//! only on its own candidates, so the result doesn't depend on the number of threads. A *cell* is a cube of the grid.

use crate::parallel::map_tasks;
use crate::progress::Progress;
use glam::{DVec3, Vec3};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Exponent α of the weights in Yuksel 2015, §3.
const ALPHA: i32 = 8;
/// Factor β of the weight limit in Yuksel 2015, §3, which prevents close pairs from dominating all others.
const BETA: f64 = 0.65;
/// Exponent γ of the weight limit in Yuksel 2015, §3.
const GAMMA: f64 = 1.5;

/// Maximum number of candidates in a block. Pairs across blocks are ignored: a few per cent of the samples are less
/// even, at the same density. In return, all threads and their caches are used.
const BLOCK: usize = 1 << 14;
/// Number of candidates above which both halves are divided into blocks in parallel.
const PARALLEL: usize = 1 << 16;

/// Maximum number of candidates per row of grid cells with which one candidate is compared. The limit bounds the cost
/// for meshes with many faces in one place. With even threefold oversampling, a cell has four candidates.
const MAX_IN_ROW: usize = 48;
/// Smallest overlap of a pair of candidates that counts, relative to the pair's reach. Larger overlaps have weights
/// above 4·10⁻¹¹.
const LEAST: f32 = 0.05;
/// Number of the finest possible grid level, for candidates of different reach; level 0 is the coarsest. Each level has
/// half the cell size of the previous one.
const LEVELS: u16 = 12;
/// Maximum number of grid cells along an axis. Cells farther out are merged, which costs only time.
const MAX_CELLS: f64 = 65_000.0;

/// Number of low bits of a weight (f32) that [`bucket_of`] ignores. The remaining 7 bits of the fraction give 128
/// buckets per power of two.
const BUCKET_SHIFT: u32 = 23 - 7;
/// Number of buckets that all finite weights need.
const BUCKETS: usize = 0x7f80_0000 >> BUCKET_SHIFT;
/// Candidate index that stands for no candidate.
const NONE: u16 = u16::MAX;

/// Candidate for a sample, which elimination removes or retains.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Candidate {
    pub(crate) position: DVec3,
    /// Index of the part of the surface that contains the candidate.
    pub(crate) part: u32,
    /// Unique index of the candidate, less than the number of candidates.
    pub(crate) number: u32,
}

/// Properties that all candidates in one part of the surface share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PartFacts {
    /// Unit normal of the part. Candidates ignore each other if their normals differ by more than 90°, as on opposite
    /// sides of a thin part.
    pub(crate) normal: DVec3,
    /// Distance beyond which candidates ignore each other: the [`reach`] for their density. For two candidates, the
    /// smaller distance counts.
    pub(crate) reach: f64,
}

/// Removes the candidates with the closest neighbours one by one until `keep` are left. Returns the numbers of the
/// remaining candidates, in ascending order.
///
/// Weights are Yuksel's eq. 2.
pub(crate) fn eliminate(
    mut candidates: Vec<Candidate>,
    of_part: &(dyn Fn(u32) -> PartFacts + Sync),
    keep: usize,
    progress: &dyn Progress,
) -> Vec<u32> {
    let count = candidates.len();
    if keep >= count {
        return (0..count as u32).collect();
    }
    progress.stage("even samples", count as u64);
    halve(&mut candidates);
    let blocks = blocks(count);
    let thinning = Thinning { of_part, closest: 1.0 - (keep as f64 / count as f64).powf(GAMMA) };
    // Buffers that no thread uses at present.
    let idle: Mutex<Vec<Block>> = Mutex::default();
    let take = || idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let left = map_tasks(blocks.len(), |i| {
        let range = &blocks[i];
        let mut block = take().unwrap_or_default();
        // Rounded cumulative sums give every block its share, and all blocks together exactly `keep`.
        let share = |end: usize| (end as u128 * keep as u128 / count as u128) as usize;
        let left = thinning.thin(&candidates[range.clone()], share(range.end) - share(range.start), &mut block);
        idle.lock().unwrap_or_else(PoisonError::into_inner).push(block);
        progress.advance(range.len() as u64);
        left
    });
    let mut is_left = vec![false; count];
    left.iter().flatten().for_each(|number| is_left[*number as usize] = true);
    (0..count as u32).filter(|number| is_left[*number as usize]).collect()
}

/// Returns twice the largest Poisson disk radius r of N = `keep` samples in a plane of area A = `area`: 2r with r = √(A
/// / (2√3·N)).
pub(crate) fn reach(area: f64, keep: f64) -> f64 {
    2.0 * (area / (2.0 * 3.0_f64.sqrt() * keep)).sqrt()
}

/// Sorts candidates so that those in each range of [`blocks`] are in a box of their own. Every larger range is divided
/// at the median along the longest side of its box.
fn halve(candidates: &mut [Candidate]) {
    if candidates.len() <= BLOCK {
        return;
    }
    let (lo, hi) = bounds(candidates);
    let axis = (hi - lo).max_position();
    let middle = candidates.len() / 2;
    let order = |a: &Candidate, b: &Candidate| {
        a.position[axis].total_cmp(&b.position[axis]).then_with(|| a.number.cmp(&b.number))
    };
    candidates.select_nth_unstable_by(middle, order);
    let (left, right) = candidates.split_at_mut(middle);
    if left.len() < PARALLEL {
        halve(left);
        halve(right);
    } else {
        rayon::join(|| halve(left), || halve(right));
    }
}

fn bounds(candidates: &[Candidate]) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    candidates.iter().fold(none, |(lo, hi), c| (lo.min(c.position), hi.max(c.position)))
}

/// Returns the ranges into which [`halve`] divides `count` candidates: the blocks, in order.
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
    of_part: &'a (dyn Fn(u32) -> PartFacts + Sync),
    /// Distance between the candidates of a pair, relative to the pair's reach, below which the weight doesn't grow.
    /// The factor [`BETA`] isn't included yet.
    closest: f64,
}

/// Candidate in a block. Its position is relative to the lowest corner of the block's bounding box. All lengths are in
/// units of the largest reach in the block.
#[derive(Clone, Copy, Default)]
struct Local {
    position: Vec3,
    reach: f32,
    normal: Vec3,
    /// Grid level whose cells fit the candidate's own reach. Level n has cells of side 2⁻ⁿ.
    level: u16,
    /// Index of the candidate among the block's candidates.
    index: u16,
}

/// Two candidates that are too close, and the weight of each for the other as the upper 16 bits of an f32.
#[derive(Clone, Copy)]
struct Pair {
    first: u16,
    second: u16,
    weight: u16,
}

/// Buffers for one block, reused from block to block.
#[derive(Default)]
struct Block {
    locals: Vec<Local>,
    /// Pairs of a cell's number and the index in `locals` of a candidate in it, sorted by cell.
    cells: Vec<(u64, u16)>,
    /// Buffer for the radix sort of `cells`.
    sorting: Vec<(u64, u16)>,
    pairs: Vec<Pair>,
    /// Candidates close to the current one, and their squared distances. The last element may be written, but isn't
    /// used.
    near: Vec<(u16, f32)>,
    /// End index of each candidate's neighbours in [`Self::neighbours`].
    ends: Vec<u32>,
    /// Neighbours of all candidates, concatenated. The upper half of an entry is the candidate, the lower half the
    /// weight.
    neighbours: Vec<u32>,
    queue: Queue,
}

impl Thinning<'_> {
    /// Removes candidates of a block until `keep` remain, and returns the numbers of the remaining ones.
    fn thin(&self, candidates: &[Candidate], keep: usize, block: &mut Block) -> Vec<u32> {
        self.gather(candidates, block);
        block.find_pairs((self.closest * BETA) as f32);
        block.link();
        block.queue.remove_heaviest(candidates.len() - keep, &block.ends, &block.neighbours);
        let weights = block.locals.iter().zip(&block.queue.weights);
        let left = weights.filter(|(_, weight)| !weight.is_nan());
        left.map(|(local, _)| candidates[usize::from(local.index)].number).collect()
    }

    /// Fills in the block's candidates as [`Local`] values.
    fn gather(&self, candidates: &[Candidate], block: &mut Block) {
        let lo = bounds(candidates).0;
        let reaches = candidates.iter().map(|c| (self.of_part)(c.part).reach);
        let unit = reaches.fold(f64::MIN_POSITIVE, f64::max);
        block.locals.clear();
        block.locals.extend(candidates.iter().zip(0..).map(|(candidate, index)| {
            let PartFacts { normal, reach } = (self.of_part)(candidate.part);
            let reach = (reach / unit) as f32;
            Local {
                position: ((candidate.position - lo) / unit).as_vec3(),
                reach,
                normal: normal.as_vec3(),
                // Exponent, rounded up: 0 for reaches above ½, 1 for those above ¼.
                level: (126_u32.saturating_sub(reach.to_bits().saturating_sub(1) >> 23) as u16).min(LEVELS),
                index,
            }
        }));
    }
}

impl Block {
    /// Finds the pairs of candidates that are closer than their reach by more than [`LEAST`] and don't face away from
    /// each other, each pair once. In crowded places, some pairs are missing ([`MAX_IN_ROW`]). `closest` is the
    /// distance, relative to the reach, below which the weight doesn't grow.
    fn find_pairs(&mut self, closest: f32) {
        let finest = self.locals.iter().map(|c| c.level).max().unwrap_or(0);
        // This sort brings neighbours close together in memory.
        self.sort_into_cells(finest);
        let sorted = self.cells.iter().map(|(_, i)| self.locals[usize::from(*i)]).collect();
        self.locals = sorted;
        self.pairs.clear();
        for level in 0..=finest {
            if self.locals.iter().any(|c| c.level == level) {
                let strides = self.sort_into_cells(level);
                self.compare_cells(strides, level, closest);
            }
        }
    }

    /// Sorts the candidates of a level and of all coarser levels by cell. Returns the differences between a cell's
    /// number and that of the same cell in the next row and in the next layer.
    fn sort_into_cells(&mut self, level: u16) -> [u64; 2] {
        let per_unit = f64::from(level).exp2();
        let cell = |x: f32| (f64::from(x) * per_unit).min(MAX_CELLS) as u64 + 1;
        let high = self.locals.iter().fold(Vec3::ZERO, |high, c| high.max(c.position));
        // A cell at either end of a row and of a layer stays empty, so that neighbours are never in another row.
        let row = cell(high.x) + 2;
        let layer = row * (cell(high.y) + 2);
        let most = layer * (cell(high.z) + 1);
        self.cells.clear();
        let number = |p: Vec3| cell(p.z) * layer + cell(p.y) * row + cell(p.x);
        let locals = self.locals.iter().zip(0..);
        self.cells.extend(locals.filter(|(c, _)| c.level <= level).map(|(c, i)| (number(c.position), i)));
        sort_by_cell(&mut self.cells, &mut self.sorting, most);
        [row, layer]
    }

    /// Compares each candidate with those in half of the surrounding cells, so that each pair is compared once.
    fn compare_cells(&mut self, [row, layer]: [u64; 2], level: u16, closest: f32) {
        let Self { locals, cells, pairs, near, .. } = self;
        // Middles of the rows of three cells, relative to the cell; the cell itself starts the first row. Then the
        // range of each row.
        let middles = [0, row, layer - row, layer, layer + row];
        let mut ranges = [(0, 0); 5];
        let mut last = 0;
        near.resize(middles.len() * MAX_IN_ROW + 1, (0, 0.0));
        for (place, &(cell, first)) in cells.iter().enumerate() {
            if cell != last {
                for (middle, (begin, end)) in middles.iter().map(|m| cell + m).zip(&mut ranges) {
                    *begin += cells[*begin..].iter().take_while(|(other, _)| other + 1 < middle).count();
                    *end += cells[*end..].iter().take_while(|(other, _)| *other <= middle + 1).count();
                }
                last = cell;
            }
            ranges[0].0 = place + 1;
            let a = &locals[usize::from(first)];
            // No branch depends on distances, because no processor could predict it.
            let mut count = 0;
            for (begin, end) in ranges {
                for &(_, second) in &cells[begin..end.min(begin + MAX_IN_ROW)] {
                    let square = a.position.distance_squared(locals[usize::from(second)].position);
                    near[count] = (second, square);
                    count += usize::from(square < a.reach * a.reach);
                }
            }
            for &(second, square) in &near[..count] {
                let b = &locals[usize::from(second)];
                let reach = a.reach.min(b.reach);
                let is_of_level = a.level == level || b.level == level;
                if square < reach * reach && is_of_level && a.normal.dot(b.normal) >= 0.0 {
                    let share = 1.0 - (square.sqrt() / reach).max(closest);
                    if share > LEAST {
                        let weight = (share.powi(ALPHA).to_bits() >> 16) as u16;
                        pairs.push(Pair { first, second, weight });
                    }
                }
            }
        }
    }

    /// Lists each candidate's neighbours, and sums the weights of its pairs.
    fn link(&mut self) {
        let count = self.locals.len();
        self.ends.clear();
        self.ends.resize(count + 1, 0);
        self.queue.weights.clear();
        self.queue.weights.resize(count, 0.0);
        for pair in &self.pairs {
            for i in [pair.first, pair.second] {
                self.ends[usize::from(i) + 1] += 1;
                // Exact sums: weights have 8 bits, and their exponents differ by at most 40.
                self.queue.weights[usize::from(i)] += f64::from(weight(u32::from(pair.weight)));
            }
        }
        let mut sum = 0;
        for end in &mut self.ends {
            sum += *end;
            *end = sum;
        }
        // Until the neighbours are filled in, each entry is the start of a candidate's neighbours; afterwards it is
        // their end.
        self.neighbours.clear();
        self.neighbours.resize(sum as usize, 0);
        for pair in &self.pairs {
            for (of, other) in [(pair.first, pair.second), (pair.second, pair.first)] {
                let place = &mut self.ends[usize::from(of)];
                self.neighbours[*place as usize] = u32::from(other) << 16 | u32::from(pair.weight);
                *place += 1;
            }
        }
    }
}

/// Decodes a weight, a bfloat16 in the lower 16 bits.
fn weight(bits: u32) -> f32 {
    f32::from_bits(bits << 16)
}

/// Sorts by cell number with a stable radix sort; the largest number is `most`.
fn sort_by_cell(cells: &mut Vec<(u64, u16)>, sorting: &mut Vec<(u64, u16)>, most: u64) {
    const BITS: u32 = 11;
    let mut shift = 0;
    while shift < 64 && most >> shift > 0 {
        let digit = |cell: u64| (cell >> shift) as usize & ((1 << BITS) - 1);
        let mut starts = [0_u32; 1 << BITS];
        cells.iter().for_each(|(cell, _)| starts[digit(*cell)] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        sorting.resize(cells.len(), (0, 0));
        for item in &*cells {
            let start = &mut starts[digit(item.0)];
            sorting[*start as usize] = *item;
            *start += 1;
        }
        std::mem::swap(cells, sorting);
        shift += BITS;
    }
}

/// Priority queue of candidates in buckets of nearly equal weight, the heaviest first.
#[derive(Default)]
struct Queue {
    /// Weight of each candidate; NaN once the candidate is removed.
    weights: Vec<f64>,
    /// First candidate in each bucket, or [`NONE`] if the bucket is empty.
    heads: Vec<u16>,
    /// Next candidate in the same bucket as each candidate, or [`NONE`] if it is the last.
    next: Vec<u16>,
}

impl Queue {
    /// Removes the `excess` heaviest candidates one by one, and reduces the weights of their neighbours. A candidate
    /// stays in its old bucket until that bucket is the heaviest, and then moves to the right one.
    fn remove_heaviest(&mut self, excess: usize, ends: &[u32], neighbours: &[u32]) {
        self.heads.clear();
        self.heads.resize(BUCKETS, NONE);
        self.next.clear();
        self.next.resize(self.weights.len(), NONE);
        for i in 0..self.weights.len() {
            self.push(i as u16);
        }
        let mut bucket = BUCKETS - 1;
        let mut left = excess;
        while left > 0 {
            let top = self.heads[bucket];
            if top == NONE {
                bucket -= 1;
                continue;
            }
            let i = usize::from(top);
            self.heads[bucket] = self.next[i];
            if bucket_of(self.weights[i]) < bucket {
                self.push(top);
                continue;
            }
            self.weights[i] = f64::NAN;
            left -= 1;
            let start = if i == 0 { 0 } else { ends[i - 1] };
            for neighbour in &neighbours[start as usize..ends[i] as usize] {
                self.weights[(neighbour >> 16) as usize] -= f64::from(weight(*neighbour));
            }
        }
    }

    fn push(&mut self, i: u16) {
        let head = &mut self.heads[bucket_of(self.weights[usize::from(i)])];
        self.next[usize::from(i)] = std::mem::replace(head, i);
    }
}

/// Returns the bucket index of a non-negative weight.
fn bucket_of(weight: f64) -> usize {
    ((weight as f32).to_bits() >> BUCKET_SHIFT) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;
    use crate::mesh::random::Random;
    use crate::tree::{KdTree, Nearest};
    use std::collections::BTreeSet;

    fn candidates(positions: &[DVec3]) -> Vec<Candidate> {
        positions.iter().zip(0..).map(|(position, i)| Candidate { position: *position, part: i, number: i }).collect()
    }

    #[test]
    fn elimination_leaves_few_close_pairs_and_no_holes() {
        // One block, and sixteen blocks.
        for (keep, share) in [(2000, 0.0), (60_000, 0.05)] {
            let mut random = Random::new(5);
            let points: Vec<DVec3> = (0..3 * keep).map(|_| DVec3::new(random.unit(), random.unit(), 0.0)).collect();
            let facts = PartFacts { normal: DVec3::Z, reach: reach(1.0, keep as f64) };
            let left = eliminate(candidates(&points), &|_| facts, keep, &NoProgress);
            assert!(left.len() == keep && left.is_sorted());
            let hexagonal = 2.0 * (1.0 / (2.0 * 3.0_f64.sqrt() * keep as f64)).sqrt();
            let mut found = Nearest::within(2, f64::INFINITY);
            let kept = KdTree::new(&left.iter().map(|i| points[*i as usize]).collect::<Vec<_>>());
            let mut closest: Vec<f64> = (0..keep)
                .map(|s| {
                    kept.nearest(kept.point(s), &mut found);
                    found.items()[1].0.sqrt() / hexagonal
                })
                .collect();
            closest.sort_by(f64::total_cmp);
            // Relative to the hexagonal distance, Yuksel's sets reach 0.7 at fivefold oversampling, and random points
            // 0.01. Pairs across blocks may be as close as random points.
            let least = closest[(share * keep as f64) as usize];
            assert!(least > 0.6, "{keep}: {least}");
            let mean = closest.iter().sum::<f64>() / keep as f64;
            let variance = closest.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / keep as f64;
            assert!(mean > 0.74 && variance.sqrt() < 0.13 * mean, "{keep}: {mean} {variance}");
        }
    }

    #[test]
    fn elimination_of_coincident_samples_stays_cheap_and_exact() {
        let facts = PartFacts { normal: DVec3::Z, reach: reach(1.0, 100.0) };
        assert_eq!(eliminate(candidates(&[DVec3::ONE; 5000]), &|_| facts, 100, &NoProgress).len(), 100);
        assert_eq!(eliminate(candidates(&[DVec3::ONE; 5]), &|_| facts, 9, &NoProgress), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn pairs_are_those_that_are_closer_than_the_smaller_reach() {
        let mut random = Random::new(9);
        // A flat part, a thick one, and one far away; reaches span four powers of two, and include exact powers.
        let mut points: Vec<DVec3> = (0..1500).map(|_| DVec3::new(random.unit(), random.unit(), 0.0)).collect();
        points.extend((0..500).map(|_| DVec3::new(random.unit(), random.unit(), 0.3 * random.unit())));
        points.extend((0..100).map(|_| DVec3::new(40.0 + 0.1 * random.unit(), -7.0, random.unit())));
        let facts: Vec<PartFacts> = (0..points.len())
            .map(|i| {
                let exponent = if i % 3 == 0 { (5.0 * random.unit()).floor() } else { 4.0 * random.unit() };
                let normal = if i % 5 == 0 { DVec3::NEG_Z } else { DVec3::new(0.1, 0.0, 1.0) };
                PartFacts { normal, reach: 0.08 * (-exponent).exp2() }
            })
            .collect();
        let candidates = candidates(&points);
        let thinning = Thinning { of_part: &|part| facts[part as usize], closest: 0.8 };
        let mut block = Block::default();
        thinning.gather(&candidates, &mut block);
        block.find_pairs(0.5);
        let number = |local: u16| usize::from(block.locals[usize::from(local)].index);
        let ordered = |i: usize, j: usize| (i.min(j), i.max(j));
        let found: Vec<_> = block.pairs.iter().map(|p| ordered(number(p.first), number(p.second))).collect();
        let share = |i: usize, j: usize| points[i].distance(points[j]) / facts[i].reach.min(facts[j].reach);
        let all = (0..points.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
        let alike = all.filter(|&(i, j)| facts[i].normal.dot(facts[j].normal) >= 0.0);
        let wanted: BTreeSet<_> = alike.filter(|&(i, j)| share(i, j) < f64::from(1.0 - LEAST)).collect();
        assert!(wanted.len() > 1000 && found.len() == wanted.len(), "{} {}", found.len(), wanted.len());
        assert_eq!(found.into_iter().collect::<BTreeSet<_>>(), wanted);
        for pair in &block.pairs {
            let (i, j) = (number(pair.first), number(pair.second));
            let exact = (1.0 - share(i, j).max(0.5)).powi(ALPHA);
            let got = f64::from(weight(u32::from(pair.weight)));
            // Tolerance for weights of seven bits and positions in f32.
            assert!((got / exact - 1.0).abs() < 0.02, "{got} {exact}");
        }
    }

    #[test]
    fn heaviest_candidates_are_removed_first_and_lighten_their_neighbours() {
        // A chain with links of increasing weight: candidates are removed for their heavier link, but not two in a row.
        let bits = |weight: f32| weight.to_bits() >> 16;
        let links: Vec<u32> = (0..5).map(|i| bits((i as f32 - 8.0).exp2())).collect();
        let neighbours = [1 << 16 | links[0], links[0], 2 << 16 | links[1], 1 << 16 | links[1], 3 << 16 | links[2]];
        let neighbours = [&neighbours[..], &[2 << 16 | links[2], 4 << 16 | links[3], 3 << 16 | links[3]]].concat();
        let ends = [1, 3, 5, 7, 8];
        let mut queue = Queue { weights: vec![0.0; 5], ..Queue::default() };
        for (i, weight) in queue.weights.iter_mut().enumerate() {
            let start = if i == 0 { 0 } else { ends[i - 1] };
            *weight = neighbours[start..ends[i]].iter().map(|n| f64::from(f32::from_bits(n << 16))).sum();
        }
        let ends = ends.map(|end| end as u32);
        queue.remove_heaviest(2, &ends, &neighbours);
        let left: Vec<bool> = queue.weights.iter().map(|weight| !weight.is_nan()).collect();
        assert_eq!(left, [true, false, true, false, true]);
        assert_eq!([queue.weights[0], queue.weights[2], queue.weights[4]], [0.0; 3]);
    }
}
