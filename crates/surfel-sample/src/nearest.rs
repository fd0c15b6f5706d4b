//! Exact nearest neighbours of points in Morton order. The points near a leaf are gathered once into contiguous
//! columns, and each query from that leaf scans them by SIMD.
//!
//! A *slot* is a point's place in the order of [`SortedPoints`], and a *grid step* is the unit of its coordinates.

use crate::lanes::{LANES, compress, numbers, rank};
use crate::sorted::{Bounds, FAN, LEAF, SortedPoints};
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, i32x16, mask32x16, u32x16};

/// Largest number of candidates that are scanned for neighbours; with more, a tree search is faster.
const MOST: usize = 2048;
/// Capacity of the candidates' columns: [`MOST`], plus one leaf that exceeds this limit, plus one SIMD write beyond the
/// end.
const ROOM: usize = MOST + 2 * LEAF;
/// Maximum number of times that candidates are gathered for one query. After that, the query falls back to a tree
/// search.
const MAX_GATHERS: usize = 8;
/// Ratio of the first search radius of a query to the distance of the previous query's farthest neighbour, both
/// squared. Most queries need no larger radius.
const LIKELY: f32 = 1.5;
/// Largest number of survivors (candidates within the search radius) that are ranked by SIMD; more are sorted.
const RANKED: usize = 96;
/// Largest number of survivors in excess of the requested neighbours that is sorted as it is. If there are more, and
/// more than [`RANKED`], the search radius is narrowed first.
const SPARE: usize = LANES;
/// Maximum number of bisection steps that narrow the search radius; equal distances can't be separated.
const MAX_NARROWING_STEPS: usize = 16;
/// Maximum number of levels in the hierarchy of bounding boxes, with [`FAN`] boxes per group.
const MAX_LEVELS: usize = 10;
/// Largest number of neighbours that a query can return.
pub(crate) const MAX_NEIGHBOURS: usize = 128;

/// Returns the squared distance between two points in squared grid steps. All searches use this formula in the same
/// order, so that results agree to the last bit.
#[inline(always)]
pub(crate) fn distance2(p: [i32; 3], q: [i32; 3]) -> f32 {
    let [x, y, z] = [(p[0] - q[0]) as f32, (p[1] - q[1]) as f32, (p[2] - q[2]) as f32];
    x * x + y * y + z * z
}

/// Points near a leaf of [`SortedPoints`], in slot order: their coordinates in grid steps and their slots, as columns
/// with capacity for whole SIMD steps.
#[derive(Clone, Debug, Default)]
struct Candidates {
    x: Vec<i32>,
    y: Vec<i32>,
    z: Vec<i32>,
    slots: Vec<u32>,
    count: usize,
}

/// Candidates within the search radius of a query, in slot order, with buffers for sorting them by distance.
#[derive(Clone, Debug, Default)]
struct Survivors {
    distances2: Vec<f32>,
    /// Index of each survivor among the candidates.
    places: Vec<u32>,
    ranks: Vec<u32>,
    keys: Vec<u64>,
}

/// Search for the nearest neighbours of points, with buffers that are reused. Queries in the order of slots are the
/// fastest.
///
/// Results depend only on the points. Neighbours are ordered by squared distance in f32, and equal distances by slot.
pub(crate) struct Search<'a> {
    points: &'a SortedPoints,
    level: Level,
    candidates: Candidates,
    /// Index of the leaf for whose points the candidates were gathered.
    leaf: usize,
    /// Squared distance from each of the leaf's points up to which the candidates include all points; negative if none
    /// were gathered.
    complete2: f32,
    /// Last query from this leaf: the position of its point, the squared distance of its farthest neighbour, and the
    /// number of neighbours.
    last: Option<([i32; 3], f32, usize)>,
    /// Largest ratio, over the queries from the previous leaf, of the farthest neighbour's squared distance to the
    /// number of neighbours. It gives the distance within which candidates are gathered for the next leaf.
    typical2: f32,
    /// Largest ratio, over the queries from the current leaf, of the farthest neighbour's squared distance to the
    /// number of neighbours.
    largest2: f32,
    survivors: Survivors,
    /// Slots of the neighbours that the last query found, nearest first.
    slots: [u32; MAX_NEIGHBOURS],
    /// Squared distances of the neighbours that the last query found.
    distances2: [f32; MAX_NEIGHBOURS],
}

impl<'a> Search<'a> {
    pub(crate) fn new(points: &'a SortedPoints) -> Self {
        Self {
            points,
            level: Level::new(),
            candidates: Candidates::default(),
            leaf: usize::MAX,
            complete2: -1.0,
            last: None,
            typical2: 0.0,
            largest2: 0.0,
            survivors: Survivors::default(),
            slots: [0; MAX_NEIGHBOURS],
            distances2: [0.0; MAX_NEIGHBOURS],
        }
    }

    /// Returns the `count` (at most [`MAX_NEIGHBOURS`]) nearest neighbours of a point, nearest first, without the
    /// point itself. The second value is the squared distance of the farthest one. A small cloud may have fewer
    /// neighbours. `guess2` is an estimate of that squared distance, or 0 if there is none; it affects only the speed.
    pub(crate) fn nearest(&mut self, slot: usize, count: usize, guess2: f32) -> (&[u32], f32) {
        let count = count.min(self.points.len() - 1).min(MAX_NEIGHBOURS);
        if count == 0 {
            return (&[], 0.0);
        }
        let q = self.points.at(slot);
        let found = self.near_leaf(slot, q, count, guess2) || self.alone(q, count);
        assert!(found);
        let farthest2 = self.distances2[count - 1];
        self.last = Some((q, farthest2, count));
        self.largest2 = self.largest2.max(farthest2 / count as f32);
        (&self.slots[..count], farthest2)
    }

    /// Prepares for queries from a leaf by gathering all points within the squared distance `reach2` of the leaf's box.
    pub(crate) fn expect(&mut self, leaf: usize, reach2: f32) {
        self.enter(leaf);
        if reach2 > 0.0 && self.points.len() > MOST {
            // Includes points at exactly this distance, however it is rounded, and at least one step more.
            self.gather((reach2 * 1.000_01).max(4.0));
        }
    }

    /// Resets the state for queries from a new leaf.
    fn enter(&mut self, leaf: usize) {
        if leaf != self.leaf {
            if self.largest2 > 0.0 {
                self.typical2 = self.largest2;
            }
            (self.leaf, self.complete2, self.last, self.largest2) = (leaf, -1.0, None, 0.0);
        }
    }

    /// Searches the neighbours among the leaf's candidates. Returns false if the search would need too many candidates
    /// or attempts ([`MOST`], [`MAX_GATHERS`]).
    fn near_leaf(&mut self, slot: usize, q: [i32; 3], count: usize, guess2: f32) -> bool {
        let leaf = slot / LEAF;
        self.enter(leaf);
        let (mut sure2, mut near2) = (f32::INFINITY, guess2);
        if let Some((p, farthest2, n)) = self.last
            && n >= count
        {
            // The last query and its neighbours are at least `count` points other than this one within the sum of both
            // distances.
            let reach = farthest2.sqrt() + distance2(p, q).sqrt();
            sure2 = reach * reach * 1.000_01;
            if near2 == 0.0 {
                near2 = LIKELY * farthest2;
            }
        }
        let mut want2 = if guess2 > 0.0 { guess2 } else { self.typical2 * count as f32 };
        if want2 <= 0.0 {
            let b = self.points.bounds(leaf);
            want2 = distance2(b.lo, b.hi) * 0.25;
        }
        // Squared radius of the first scan. If the scan finds too few points, a second scan is wider, and a third
        // covers all candidates.
        let (mut first2, mut is_guess) = if near2 > 0.0 { (near2, true) } else { (f32::INFINITY, false) };
        want2 = want2.min(sure2);
        want2 = if self.points.len() <= MOST { f32::MAX } else { want2.max(4.0) };
        for _ in 0..MAX_GATHERS {
            // Gathers more than this query needs, so that the following queries find enough.
            if self.complete2 < want2 && !self.gather(1.3 * want2) {
                if want2 >= sure2 {
                    return false;
                }
                // The points are denser here than at the last query.
                want2 *= 0.25;
                continue;
            }
            let bound2 = sure2.min(self.complete2).min(first2);
            let found = self.scan(q, bound2, count);
            if found >= count {
                return true;
            }
            if first2 >= self.complete2 {
                want2 = (2.0 * self.complete2).min(sure2 * 1.001);
            }
            // On a line, distances grow with the number of neighbours; elsewhere they grow less.
            let times = count as f32 / found.max(1) as f32;
            first2 = if is_guess { LIKELY * first2 * times * times } else { f32::INFINITY };
            is_guess = false;
        }
        false
    }

    /// Gathers the points within a squared distance of the leaf's box; returns false if there are too many.
    fn gather(&mut self, reach2: f32) -> bool {
        self.complete2 = -1.0;
        // The relative error of squares in f32 is below 2⁻²².
        let reach = (f64::from(reach2).sqrt() * 1.000_001 + 1.0).min(f64::from(i32::MAX)) as i32;
        let (points, candidates) = (self.points, &mut self.candidates);
        let region = points.bounds(self.leaf).grown(reach);
        for column in [&mut candidates.x, &mut candidates.y, &mut candidates.z] {
            column.resize(ROOM, 0);
        }
        candidates.slots.resize(ROOM, 0);
        if !dispatch!(self.level, simd => collect_by(simd, points, &region, candidates)) {
            return false;
        }
        self.complete2 = reach2;
        true
    }

    /// Finds the `count` nearest candidates within a squared distance, nearest first. Returns the number of candidates
    /// within the distance; if this is less than `count`, no neighbours are stored.
    fn scan(&mut self, q: [i32; 3], bound2: f32, count: usize) -> usize {
        let (candidates, survivors) = (&self.candidates, &mut self.survivors);
        survivors.distances2.resize(ROOM, 0.0);
        survivors.places.resize(ROOM, 0);
        survivors.ranks.resize(RANKED, 0);
        let (all, n) = dispatch!(self.level, simd => scan_by(simd, candidates, (q, bound2), count, survivors));
        if all < count {
            return all;
        }
        let Survivors { distances2, places, ranks, keys } = survivors;
        if n <= RANKED {
            for ((d2, place), rank) in distances2.iter().zip(&*places).zip(&*ranks).take(n) {
                // Writes survivors beyond `count` too, because a branch would cost more.
                let rank = *rank as usize % MAX_NEIGHBOURS;
                (self.slots[rank], self.distances2[rank]) = (candidates.slots[*place as usize], *d2);
            }
            return all;
        }
        keys.clear();
        keys.extend(distances2.iter().zip(&*places).take(n).map(|(d2, place)| key(*d2, *place)));
        if n > count + SPARE {
            keys.select_nth_unstable(count - 1);
            keys.truncate(count);
        }
        keys.sort_unstable();
        for (key, (slot, d2)) in keys.iter().zip(self.slots.iter_mut().zip(&mut self.distances2)).take(count) {
            (*slot, *d2) = (candidates.slots[*key as u32 as usize], f32::from_bits((key >> 32) as u32));
        }
        all
    }

    /// Searches the hierarchy of boxes from its root, without candidates. Returns true if `count` neighbours were
    /// found.
    fn alone(&mut self, q: [i32; 3], count: usize) -> bool {
        let levels = self.points.levels();
        let mut found: Vec<u64> = Vec::with_capacity(count + 1);
        let mut farthest2 = f32::INFINITY;
        // Rounding by up to two units in the last place may make a box seem farther than a point in it.
        const SLACK: f32 = 0.999_999;
        let mut stack: Vec<(f32, usize, usize)> = Vec::new();
        let push = |stack: &mut Vec<(f32, usize, usize)>, level: usize, group: usize| {
            let from = stack.len();
            let boxes = (0..FAN).map(|i| (levels[level][group].get(i), group * FAN + i));
            let boxes = boxes.filter(|(b, _)| b.lo[0] <= b.hi[0]);
            stack.extend(boxes.map(|(b, index)| (b.distance2(q), level, index)));
            // The nearest box is on top of the stack.
            stack[from..].sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.2.cmp(&a.2)));
        };
        push(&mut stack, levels.len() - 1, 0);
        while let Some((distance, level, index)) = stack.pop() {
            if distance * SLACK > farthest2 {
                continue;
            }
            if level > 0 {
                push(&mut stack, level - 1, index);
                continue;
            }
            for slot in self.points.leaf(index) {
                let d = distance2(self.points.at(slot), q);
                let key = key(d, slot as u32);
                if d == 0.0 || (found.len() == count && found.last().is_some_and(|last| key >= *last)) {
                    continue;
                }
                found.insert(found.partition_point(|other| *other < key), key);
                found.truncate(count);
                if let Some(last) = found.get(count - 1) {
                    farthest2 = f32::from_bits((last >> 32) as u32);
                }
            }
        }
        for (key, (slot, d2)) in found.iter().zip(self.slots.iter_mut().zip(&mut self.distances2)) {
            (*slot, *d2) = (*key as u32, f32::from_bits((key >> 32) as u32));
        }
        found.len() == count
    }
}

/// Collects the points in `region` as candidates, in the order of their slots; returns false if there are more than
/// [`MOST`].
#[inline(always)]
fn collect_by<S: Simd>(simd: S, points: &SortedPoints, region: &Bounds, candidates: &mut Candidates) -> bool {
    let levels = points.levels();
    candidates.count = 0;
    // Per level: the current group, and one bit for each of its boxes that remain to be visited.
    let (mut groups, mut left) = ([0; MAX_LEVELS], [0; MAX_LEVELS]);
    let top = levels.len() - 1;
    let mut level = top;
    left[top] = levels[top][0].meeting(simd, region);
    loop {
        if left[level] == 0 {
            if level == top {
                return candidates.count <= MOST;
            }
            level += 1;
            continue;
        }
        let index = groups[level] * FAN + left[level].trailing_zeros() as usize;
        left[level] &= left[level] - 1;
        if level > 0 {
            level -= 1;
            (groups[level], left[level]) = (index, levels[level][index].meeting(simd, region));
        } else if candidates.count > MOST {
            return false;
        } else {
            collect_leaf(simd, points, index, region, candidates);
        }
    }
}

/// Appends the points of a leaf that are in `region` to the candidates.
#[inline(always)]
fn collect_leaf<S: Simd>(simd: S, points: &SortedPoints, leaf: usize, region: &Bounds, candidates: &mut Candidates) {
    let c = candidates;
    let range = points.leaf(leaf);
    let (xs, ys, zs) = (&points.x[range.clone()], &points.y[range.clone()], &points.z[range.clone()]);
    let first = range.start as u32;
    let (x_steps, y_steps, z_steps) = (xs.as_chunks::<LANES>().0, ys.as_chunks::<LANES>().0, zs.as_chunks::<LANES>().0);
    for step in 0..x_steps.len().min(y_steps.len()).min(z_steps.len()) {
        let (x, x_in) = within(simd, &x_steps[step], region.lo[0], region.hi[0]);
        let (y, y_in) = within(simd, &y_steps[step], region.lo[1], region.hi[1]);
        let (z, z_in) = within(simd, &z_steps[step], region.lo[2], region.hi[2]);
        let is_in = x_in & y_in & z_in;
        compress(x, is_in, &mut c.x, c.count);
        compress(y, is_in, &mut c.y, c.count);
        compress(z, is_in, &mut c.z, c.count);
        compress(numbers(simd, first + (step * LANES) as u32), is_in, &mut c.slots, c.count);
        c.count += is_in.to_bitmask().count_ones() as usize;
    }
    for i in xs.len() / LANES * LANES..xs.len() {
        let p = [xs[i], ys[i], zs[i]];
        if region.contains(p) {
            let n = c.count;
            (c.x[n], c.y[n], c.z[n], c.slots[n]) = (p[0], p[1], p[2], first + i as u32);
            c.count += 1;
        }
    }
}

#[inline(always)]
fn within<S: Simd>(simd: S, coordinates: &[i32; LANES], lo: i32, hi: i32) -> (i32x16<S>, mask32x16<S>) {
    let c = i32x16::load_array_ref(simd, coordinates);
    (c, c.simd_ge(i32x16::splat(simd, lo)) & c.simd_le(i32x16::splat(simd, hi)))
}

#[inline(always)]
fn difference<S: Simd>(simd: S, coordinates: &[i32; LANES], from: i32x16<S>) -> f32x16<S> {
    (i32x16::load_array_ref(simd, coordinates) - from).to_float()
}

/// Selects the candidates within a squared distance `bound2` of `q`. If far more than `count` are selected, the
/// farthest are dropped. The remaining ones are ranked by distance if they are at most [`RANKED`]. Returns the number
/// of selected and of remaining candidates.
#[inline(always)]
fn scan_by<S: Simd>(
    simd: S,
    candidates: &Candidates,
    (q, bound2): ([i32; 3], f32),
    count: usize,
    survivors: &mut Survivors,
) -> (usize, usize) {
    // No closures: the compiler doesn't inline them into SIMD code.
    let (qx, qy, qz) = (i32x16::splat(simd, q[0]), i32x16::splat(simd, q[1]), i32x16::splat(simd, q[2]));
    let (bound, zero) = (f32x16::splat(simd, bound2), f32x16::splat(simd, 0.0));
    let c = candidates;
    let (xs, ys, zs) = (c.x.as_chunks::<LANES>().0, c.y.as_chunks::<LANES>().0, c.z.as_chunks::<LANES>().0);
    let steps = c.count.div_ceil(LANES).min(xs.len()).min(ys.len()).min(zs.len());
    let mut n = 0;
    for step in 0..steps {
        let first = step * LANES;
        let x = difference(simd, &xs[step], qx);
        let y = difference(simd, &ys[step], qy);
        let z = difference(simd, &zs[step], qz);
        let d2 = x * x + y * y + z * z;
        let place = numbers(simd, first as u32);
        let is_one = place.simd_lt(u32x16::splat(simd, c.count as u32));
        let near = d2.simd_le(bound) & d2.simd_gt(zero) & is_one;
        compress(d2, near, &mut survivors.distances2, n);
        compress(place, near, &mut survivors.places, n);
        n += near.to_bitmask().count_ones() as usize;
    }
    let most = RANKED.max(count + SPARE);
    let left = if n > most { narrow(simd, survivors, n, (count, most)) } else { n };
    if left <= RANKED {
        rank(simd, &mut survivors.distances2, left, &mut survivors.ranks);
    }
    (n, left)
}

/// Drops the farthest of `n` survivors (candidates within the search radius). At least `count` remain and, unless many
/// distances are equal, at most `most`. Returns the number of remaining survivors.
#[inline(always)]
fn narrow<S: Simd>(simd: S, survivors: &mut Survivors, n: usize, (count, most): (usize, usize)) -> usize {
    let room = n.next_multiple_of(LANES);
    survivors.distances2[n..room].fill(f32::INFINITY);
    let groups = survivors.distances2[..room].as_chunks::<LANES>().0;
    let farthest = survivors.distances2[..n].iter().copied().fold(0.0, f32::max);
    let (mut low, mut high) = (0.0, farthest);
    for _ in 0..MAX_NARROWING_STEPS {
        let middle = 0.5 * (low + high);
        let bound = f32x16::splat(simd, middle);
        let mut within = 0;
        for group in groups {
            within += f32x16::load_array_ref(simd, group).simd_le(bound).to_bitmask().count_ones() as usize;
        }
        if within < count {
            low = middle;
            continue;
        }
        high = middle;
        if within <= most {
            break;
        }
    }
    let bound = f32x16::splat(simd, high);
    let mut left = 0;
    for first in (0..room).step_by(LANES) {
        let (Some(distances2), Some(places)) =
            (survivors.distances2[first..].first_chunk(), survivors.places[first..].first_chunk())
        else {
            break;
        };
        let (d2, place) = (f32x16::load_array_ref(simd, distances2), u32x16::load_array_ref(simd, places));
        let near = d2.simd_le(bound);
        // The write position never passes the read position.
        compress(d2, near, &mut survivors.distances2, left);
        compress(place, near, &mut survivors.places, left);
        left += near.to_bitmask().count_ones() as usize;
    }
    left
}

#[inline(always)]
fn key(distance2: f32, place: u32) -> u64 {
    u64::from(distance2.to_bits()) << 32 | u64::from(place)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::levels;
    use crate::mesh::random::Random;
    use glam::DVec3;

    /// Returns the slots of all other points sorted by squared distance and slot, cut off at `count`.
    fn brute_force(points: &SortedPoints, slot: usize, count: usize) -> Vec<u32> {
        let q = points.at(slot);
        let mut all: Vec<(f32, u32)> =
            (0..points.len()).filter(|s| *s != slot).map(|s| (distance2(points.at(s), q), s as u32)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.into_iter().take(count).map(|a| a.1).collect()
    }

    fn check(name: &str, positions: &[DVec3], step: usize) {
        let points = SortedPoints::new(positions.len(), |i| positions[i]).unwrap();
        for (level, count) in levels().into_iter().flat_map(|l| [1, 16, 48, MAX_NEIGHBOURS].map(|count| (l, count))) {
            let mut search = Search { level, ..Search::new(&points) };
            for slot in (0..points.len()).step_by(step) {
                let expected = brute_force(&points, slot, count);
                let (found, farthest2) = search.nearest(slot, count, 0.0);
                assert_eq!(found, expected, "{name}: {count} of {slot}");
                let last = expected.last().map_or(0.0, |j| distance2(points.at(*j as usize), points.at(slot)));
                assert_eq!(farthest2, last);
                // A guess, exact or wrong, doesn't change the result.
                for guess2 in [last, 0.1 * last, 9.0 * last] {
                    assert_eq!(search.nearest(slot, count, guess2).0, expected, "{name}: {count} of {slot}, {guess2}");
                }
            }
        }
        let mut alone = Search::new(&points);
        for slot in (0..points.len()).step_by(3 * step) {
            let count = 16.min(points.len() - 1);
            assert!(count == 0 || alone.alone(points.at(slot), count));
            assert_eq!(alone.slots[..count], brute_force(&points, slot, count), "{name}: {slot} by itself");
        }
    }

    #[test]
    fn nearest_agrees_with_brute_force() {
        let mut random = Random::new(7);
        let mut scattered = |count: usize, levels: f64| -> Vec<DVec3> {
            let mut coordinate = || (random.unit() * levels).floor() / levels;
            (0..count).map(|_| DVec3::new(coordinate(), coordinate(), coordinate())).collect()
        };
        for count in [1, 2, 3, 31, 32, 33, 200] {
            check("few", &scattered(count, 1e9), 1);
        }
        check("scattered", &scattered(5000, 1e9), 37);
        // Few coordinate values, so most distances tie.
        check("ties", &scattered(9000, 17.0), 61);
        // A dense cluster that exceeds the candidates' capacity for queries from strays.
        let mut clusters: Vec<DVec3> = scattered(6000, 1e9).iter().map(|p| *p * 1e-3).collect();
        clusters.extend(scattered(40, 1e9));
        check("strays", &clusters, 43);
        let line: Vec<DVec3> = (0..4000).map(|i| DVec3::new(f64::from(i), 0.0, f64::from(i % 2) * 1e-3)).collect();
        check("line", &line, 59);
        let sheet: Vec<DVec3> = scattered(6000, 1e9).iter().map(|p| DVec3::new(p.x, p.y * p.y * p.y, 0.0)).collect();
        check("sheet", &sheet, 41);
    }
}
