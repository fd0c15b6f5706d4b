//! Distinct points in Morton order, with fixed-point coordinates and a hierarchy of bounding boxes. A point's place in
//! the order is its *slot*.

use crate::SampleError;
use crate::parallel::{for_chunks, map_tasks};
use fearless_simd::prelude::*;
use fearless_simd::{i32x8, mask32x8};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Number of points per leaf: one SIMD step. On 1 M points, leaves of 32 are slower by 1/20, and leaves of 64 by 1/7.
pub(crate) const LEAF: usize = 16;
/// Number of points per run, the unit that is sorted in k-d order: a power-of-two number of leaves.
pub(crate) const RUN: usize = 256 * LEAF;
/// Number of child boxes per box in the hierarchy of bounding boxes.
pub(crate) const FAN: usize = 8;
/// Largest absolute coordinate of a point, in grid steps from the centre of all points. The limit makes the difference
/// of two coordinates fit an i32.
const REACH: f64 = 1_073_741_823.0;
/// Number of points per parallel task.
const CHUNK: usize = 1 << 15;

/// Axis-aligned box including its boundary, in grid steps from the centre of all points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) lo: [i32; 3],
    pub(crate) hi: [i32; 3],
}

impl Default for Bounds {
    fn default() -> Self {
        Self { lo: [i32::MAX; 3], hi: [i32::MIN; 3] }
    }
}

impl Bounds {
    fn with(self, other: &Self) -> Self {
        let pick = |k: usize| (self.lo[k].min(other.lo[k]), self.hi[k].max(other.hi[k]));
        let [x, y, z] = [pick(0), pick(1), pick(2)];
        Self { lo: [x.0, y.0, z.0], hi: [x.1, y.1, z.1] }
    }

    /// Returns this box grown by `distance` along each axis, clamped to the range of coordinates.
    pub(crate) fn grown(&self, distance: i32) -> Self {
        const MOST: i32 = REACH as i32;
        let lo = self.lo.map(|c| c.saturating_sub(distance).max(-MOST));
        Self { lo, hi: self.hi.map(|c| c.saturating_add(distance).min(MOST)) }
    }

    #[inline]
    pub(crate) fn contains(&self, p: [i32; 3]) -> bool {
        (0..3).all(|k| self.lo[k] <= p[k] && p[k] <= self.hi[k])
    }

    /// Returns the squared distance of `p` to the box, 0 inside.
    #[inline]
    pub(crate) fn distance2(&self, p: [i32; 3]) -> f32 {
        let along = |k: usize| {
            let d = (i64::from(self.lo[k]) - i64::from(p[k])).max(i64::from(p[k]) - i64::from(self.hi[k])).max(0);
            d as f32
        };
        let [x, y, z] = [along(0), along(1), along(2)];
        x * x + y * y + z * z
    }
}

/// The [`FAN`] child boxes of one box, as columns. Unused places hold empty boxes, which meet no region.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Boxes {
    lo: [[i32; FAN]; 3],
    hi: [[i32; FAN]; 3],
}

impl Boxes {
    fn new(boxes: &[Bounds]) -> Self {
        let mut all = Self { lo: [[i32::MAX; FAN]; 3], hi: [[i32::MIN; FAN]; 3] };
        for (i, b) in boxes.iter().enumerate() {
            for k in 0..3 {
                (all.lo[k][i], all.hi[k][i]) = (b.lo[k], b.hi[k]);
            }
        }
        all
    }

    #[inline]
    pub(crate) fn get(&self, i: usize) -> Bounds {
        Bounds { lo: self.lo.map(|c| c[i]), hi: self.hi.map(|c| c[i]) }
    }

    /// Returns one bit per box, set if the box meets `region`; the first box has the lowest bit.
    #[inline(always)]
    pub(crate) fn meeting<S: Simd>(&self, simd: S, region: &Bounds) -> u32 {
        let mut meets = mask32x8::splat(simd, true);
        for k in 0..3 {
            meets &= i32x8::load_array_ref(simd, &self.lo[k]).simd_le(i32x8::splat(simd, region.hi[k]));
            meets &= i32x8::load_array_ref(simd, &self.hi[k]).simd_ge(i32x8::splat(simd, region.lo[k]));
        }
        meets.to_bitmask() as u32
    }
}

/// Distinct points, sorted so that neighbours in space are mostly close together in memory. A point is addressed by its
/// *slot*, its place in that order: runs of 4096 points along a Morton curve, each run in k-d order.
///
/// Coordinates are rounded to whole grid steps from the centre of the points' bounding box. A step is about 2⁻³⁰ of
/// half the longest side. Points that round to the same coordinates become one.
#[derive(Debug)]
pub(crate) struct SortedPoints {
    pub(crate) x: Vec<i32>,
    pub(crate) y: Vec<i32>,
    pub(crate) z: Vec<i32>,
    /// Input indices ordered by slot; the indices of coincident points are consecutive and ascending.
    order: Vec<u32>,
    /// Index in `order` of each slot's first input, and the end of the last slot's inputs; empty if no points coincide.
    starts: Vec<u32>,
    /// Bounding boxes of leaves, of groups of [`FAN`] leaves, and so on, up to a level with a single group.
    levels: Vec<Vec<Boxes>>,
    /// Centre of all points' bounding box, in object coordinates.
    pub(crate) center: DVec3,
    /// Size of a grid step, in object units.
    pub(crate) step: f64,
}

/// Spreads the low 21 bits of `x` to every third bit.
fn spread(x: u32) -> u64 {
    let x = u64::from(x) & 0x1f_ffff;
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Returns the upper 63 of the 93 bits of the Morton code of a point, given in grid steps.
fn upper(p: [i32; 3]) -> u64 {
    let [x, y, z] = p.map(|c| spread((c + (1 << 30)) as u32 >> 10));
    x | y << 1 | z << 2
}

/// Returns the lower 30 bits of the Morton code of a point, given in grid steps.
fn lower(p: [i32; 3]) -> u64 {
    let [x, y, z] = p.map(|c| spread((c + (1 << 30)) as u32 & 0x3ff));
    x | y << 1 | z << 2
}

impl SortedPoints {
    /// Sorts `total` points. `position` returns the position of point i, in object coordinates.
    ///
    /// # Errors
    /// [`SampleError::NotFinite`] if a position isn't finite, [`SampleError::TooMany`] for more points than indices
    /// address.
    pub(crate) fn new(total: usize, position: impl Fn(usize) -> DVec3 + Sync) -> Result<Self, SampleError> {
        SampleError::check_count("points", total)?;
        let (lo, hi) = extent(total, &position)?;
        // Halving first avoids overflow: hi − lo may overflow although neither does.
        let (center, half) = (0.5 * lo + 0.5 * hi, (0.5 * hi - 0.5 * lo).max_element());
        let half = if half > 0.0 { half } else { 1.0 };
        let fixed = |i: usize| ((position(i) - center) / half * REACH).round().to_array().map(|c| c as i32);
        let mut keyed = vec![(0_u64, 0_u32); total];
        for_chunks(&mut keyed, CHUNK, &|first, chunk| {
            for (i, key) in (first..).zip(chunk) {
                *key = (upper(fixed(i)), i as u32);
            }
        });
        keyed.par_sort_unstable();
        // Points with equal upper bits are sorted by the lower bits; with one far stray, all other points have equal
        // upper bits.
        let same = |keyed: &[(u64, u32)], i: usize| i > 0 && i < keyed.len() && keyed[i].0 == keyed[i - 1].0;
        let mut at = 0;
        while at < total {
            let mut end = at + 1;
            while same(&keyed, end) {
                end += 1;
            }
            if end > at + 1 {
                let mut run: Vec<(u64, u32)> =
                    keyed[at..end].iter().map(|k| (lower(fixed(k.1 as usize)), k.1)).collect();
                run.par_sort_unstable();
                keyed[at..end].iter_mut().zip(run).for_each(|(k, r)| k.1 = r.1);
            }
            at = end;
        }
        let mut order = vec![0_u32; total];
        for_chunks(&mut order, CHUNK, &|first, chunk| {
            chunk.iter_mut().zip(&keyed[first..]).for_each(|(o, k)| *o = k.1);
        });
        drop(keyed);
        let (mut x, mut y, mut z) = (vec![0_i32; total], vec![0_i32; total], vec![0_i32; total]);
        let columns = x.chunks_mut(CHUNK).zip(y.chunks_mut(CHUNK)).zip(z.chunks_mut(CHUNK)).zip(order.chunks(CHUNK));
        for_chunks(&mut columns.collect::<Vec<_>>(), 1, &|_, columns| {
            let (((x, y), z), order) = &mut columns[0];
            for (i, input) in order.iter().enumerate() {
                [x[i], y[i], z[i]] = fixed(*input as usize);
            }
        });
        let starts = distinct(&mut x, &mut y, &mut z);
        let (order, starts) = reordered(order, starts, &compact(&mut x, &mut y, &mut z));
        let levels = levels(&x, &y, &z);
        Ok(Self { x, y, z, order, starts, levels, center, step: half / REACH })
    }

    /// Returns the number of distinct points.
    pub(crate) fn len(&self) -> usize {
        self.x.len()
    }

    /// Returns the number of input points.
    #[cfg(test)]
    pub(crate) fn total(&self) -> usize {
        self.order.len()
    }

    /// Returns the coordinates of the point at `slot`, in grid steps from the centre of all points.
    #[inline]
    pub(crate) fn at(&self, slot: usize) -> [i32; 3] {
        [self.x[slot], self.y[slot], self.z[slot]]
    }

    /// Returns the position of the point at `slot` as a vector, in grid steps from the centre of all points.
    #[inline]
    pub(crate) fn point(&self, slot: usize) -> DVec3 {
        DVec3::new(f64::from(self.x[slot]), f64::from(self.y[slot]), f64::from(self.z[slot]))
    }

    /// Returns the input indices of the coincident points at `slot`, ascending; at least one.
    #[inline]
    pub(crate) fn inputs(&self, slot: usize) -> &[u32] {
        inputs(&self.order, &self.starts, slot)
    }

    /// Returns the slot of each input point, the place of its position in the sorted order.
    #[cfg(any(test, feature = "sharp"))]
    pub(crate) fn slots(&self) -> Vec<u32> {
        slots(&self.order, &self.starts)
    }

    /// Returns the slot of each input point, and frees all other data.
    pub(crate) fn into_slots(self) -> Vec<u32> {
        let Self { x, y, z, order, starts, levels, .. } = self;
        drop((x, y, z, levels));
        slots(&order, &starts)
    }

    /// Returns the bounding boxes of leaves, of groups of [`FAN`] leaves, and so on. The children of box `i` of a level
    /// are group `i` of the level below.
    pub(crate) fn levels(&self) -> &[Vec<Boxes>] {
        &self.levels
    }

    /// Returns the bounding box of a leaf.
    #[inline]
    pub(crate) fn bounds(&self, leaf: usize) -> Bounds {
        self.levels[0][leaf / FAN].get(leaf % FAN)
    }

    /// Returns the slots of a leaf: up to [`LEAF`] consecutive ones.
    pub(crate) fn leaf(&self, index: usize) -> std::ops::Range<usize> {
        index * LEAF..((index + 1) * LEAF).min(self.len())
    }
}

#[inline]
fn inputs<'a>(order: &'a [u32], starts: &[u32], slot: usize) -> &'a [u32] {
    match starts.is_empty() {
        true => &order[slot..=slot],
        false => &order[starts[slot] as usize..starts[slot + 1] as usize],
    }
}

fn slots(order: &[u32], starts: &[u32]) -> Vec<u32> {
    let count = if starts.is_empty() { order.len() } else { starts.len() - 1 };
    let slots: Vec<AtomicU32> = (0..order.len()).map(|_| AtomicU32::new(0)).collect();
    map_tasks(count.div_ceil(CHUNK), |task| {
        for slot in task * CHUNK..count.min((task + 1) * CHUNK) {
            inputs(order, starts, slot).iter().for_each(|i| slots[*i as usize].store(slot as u32, Ordering::Relaxed));
        }
    });
    slots.into_iter().map(AtomicU32::into_inner).collect()
}

/// Returns the two corners of the points' bounding box; zero without points. Fails if a position isn't finite.
fn extent(total: usize, position: &(impl Fn(usize) -> DVec3 + Sync)) -> Result<(DVec3, DVec3), SampleError> {
    let parts = map_tasks(total.div_ceil(CHUNK), |task| {
        let (mut lo, mut hi, mut finite) = (DVec3::INFINITY, DVec3::NEG_INFINITY, true);
        for i in task * CHUNK..total.min((task + 1) * CHUNK) {
            let p = position(i);
            finite &= p.is_finite();
            (lo, hi) = (lo.min(p), hi.max(p));
        }
        (lo, hi, finite)
    });
    if !parts.iter().all(|p| p.2) {
        let bad = || (0..total).filter(|i| !position(*i).is_finite());
        return Err(SampleError::NotFinite { index: bad().next().unwrap_or(0), count: bad().count(), total });
    }
    let fold = |f: fn(DVec3, DVec3) -> DVec3, of: fn(&(DVec3, DVec3, bool)) -> DVec3| parts.iter().map(of).reduce(f);
    Ok((fold(DVec3::min, |p| p.0).unwrap_or(DVec3::ZERO), fold(DVec3::max, |p| p.1).unwrap_or(DVec3::ZERO)))
}

/// Removes all but the first of equal points. Returns the start of each remaining point's inputs; empty if all points
/// are distinct.
fn distinct(x: &mut Vec<i32>, y: &mut Vec<i32>, z: &mut Vec<i32>) -> Vec<u32> {
    let total = x.len();
    let is_first = |i: usize| i == 0 || x[i] != x[i - 1] || y[i] != y[i - 1] || z[i] != z[i - 1];
    if (0..total).all(is_first) {
        return Vec::new();
    }
    let mut starts: Vec<u32> = (0..total).filter(|i| is_first(*i)).map(|i| i as u32).collect();
    for column in [x, y, z] {
        for (to, from) in starts.iter().enumerate() {
            column[to] = column[*from as usize];
        }
        column.truncate(starts.len());
        column.shrink_to_fit();
    }
    starts.push(total as u32);
    starts
}

/// Sorts each run of [`RUN`] points so that the points of a leaf are close together in all directions. Along a Morton
/// curve alone they aren't, because the curve jumps. Returns the previous index of each point.
fn compact(x: &mut [i32], y: &mut [i32], z: &mut [i32]) -> Vec<u32> {
    let mut from = vec![0_u32; x.len()];
    let columns = x.chunks_mut(RUN).zip(y.chunks_mut(RUN)).zip(z.chunks_mut(RUN)).zip(from.chunks_mut(RUN));
    let mut runs: Vec<_> = columns.collect();
    for_chunks(&mut runs, 1, &|run, columns| {
        let (((x, y), z), from) = &mut columns[0];
        let mut items: Vec<([i32; 3], u32)> =
            (0..x.len()).map(|i| ([x[i], y[i], z[i]], (run * RUN + i) as u32)).collect();
        split(&mut items);
        for (i, (p, index)) in items.into_iter().enumerate() {
            (x[i], y[i], z[i], from[i]) = (p[0], p[1], p[2], index);
        }
    });
    from
}

/// Splits the items recursively along the longest side of their bounding box, at a whole number of leaves, down to
/// single leaves.
fn split(items: &mut [([i32; 3], u32)]) {
    let leaves = items.len().div_ceil(LEAF);
    if leaves < 2 {
        return;
    }
    let bounds = items.iter().fold(Bounds::default(), |all, i| all.with(&Bounds { lo: i.0, hi: i.0 }));
    let side = |k: usize| i64::from(bounds.hi[k]) - i64::from(bounds.lo[k]);
    let axis = (1..3).fold(0, |best, k| if side(k) > side(best) { k } else { best });
    // The left part is a power of two of leaves, so that groups of leaves are compact too.
    let middle = leaves.next_power_of_two() / 2 * LEAF;
    items.select_nth_unstable_by_key(middle, |i| (i.0[axis], i.1));
    let (left, right) = items.split_at_mut(middle);
    split(left);
    split(right);
}

/// Reorders the columns `order` and `starts` of [`SortedPoints`]: slot `i` gets the input points that slot `from[i]`
/// had.
fn reordered(order: Vec<u32>, starts: Vec<u32>, from: &[u32]) -> (Vec<u32>, Vec<u32>) {
    if starts.is_empty() {
        let mut new = vec![0_u32; order.len()];
        for_chunks(&mut new, CHUNK, &|first, chunk| {
            chunk.iter_mut().zip(&from[first..]).for_each(|(to, from)| *to = order[*from as usize]);
        });
        return (new, starts);
    }
    let (mut new, mut new_starts) = (Vec::with_capacity(order.len()), Vec::with_capacity(starts.len()));
    for i in from {
        new_starts.push(new.len() as u32);
        let i = *i as usize;
        new.extend_from_slice(&order[starts[i] as usize..starts[i + 1] as usize]);
    }
    new_starts.push(new.len() as u32);
    (new, new_starts)
}

fn levels(x: &[i32], y: &[i32], z: &[i32]) -> Vec<Vec<Boxes>> {
    let mut boxes = vec![Bounds::default(); x.len().div_ceil(LEAF)];
    for_chunks(&mut boxes, CHUNK / LEAF, &|first, chunk| {
        for (i, bounds) in (first..).zip(chunk) {
            for s in i * LEAF..x.len().min((i + 1) * LEAF) {
                let p = [x[s], y[s], z[s]];
                *bounds = bounds.with(&Bounds { lo: p, hi: p });
            }
        }
    });
    let mut levels = Vec::new();
    loop {
        levels.push(boxes.chunks(FAN).map(Boxes::new).collect());
        if boxes.len() <= FAN {
            return levels;
        }
        boxes = boxes.chunks(FAN).map(|group| group.iter().fold(Bounds::default(), Bounds::with)).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::random::Random;

    fn of(positions: &[DVec3]) -> SortedPoints {
        SortedPoints::new(positions.len(), |i| positions[i]).unwrap()
    }

    #[test]
    fn slots_lead_to_all_coincident_points_in_order_far_from_the_origin() {
        let mut random = Random::new(2);
        // About five hundred places for a thousand points.
        let mut level = || (random.unit() * 8.0).floor() - 1e7;
        let positions: Vec<DVec3> = (0..1000).map(|_| DVec3::new(level(), level(), level())).collect();
        let points = of(&positions);
        let slots = points.slots();
        let mut seen = 0;
        for slot in 0..points.len() {
            let inputs = points.inputs(slot);
            assert!(inputs.is_sorted() && inputs.iter().all(|i| slots[*i as usize] as usize == slot));
            let first = positions[inputs[0] as usize];
            assert_eq!(positions.iter().filter(|p| **p == first).count(), inputs.len());
            assert!((points.point(slot) * points.step + points.center - first).length() < 1e-8);
            seen += inputs.len();
        }
        assert_eq!((seen, points.total()), (1000, 1000));
    }

    #[test]
    fn differences_keep_f32s_digits_and_more_at_ten_million_metres() {
        // A scan of 100 m with points 0.1 mm apart, in f64 map coordinates.
        let origin = DVec3::new(4.5e6, 9.9e6, 300.0);
        let mut positions: Vec<DVec3> = (0..500).map(|i| origin + DVec3::new(1e-4 * f64::from(i), 0.0, 0.0)).collect();
        positions.push(origin + DVec3::splat(100.0));
        let points = of(&positions);
        let slots = points.slots();
        assert_eq!(points.len(), 501);
        for i in 1..500 {
            let between = points.x[slots[i] as usize] - points.x[slots[i - 1] as usize];
            // Tolerance: half a step (5e-8 m) per coordinate, and the rounding of f64 at 9.9e6 m (1e-9 m).
            assert!((f64::from(between) * points.step - 1e-4).abs() < 1.1e-7, "{i}: {between}");
        }
    }

    #[test]
    fn points_closer_than_any_spacing_count_as_one_and_strays_leave_the_others_sorted() {
        let mut positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        positions.extend((0..100).map(|i| DVec3::splat(1e-13 * f64::from(i))));
        assert_eq!(of(&positions).len(), 3);
        // All points but one are within 2⁻²¹ of the extent, where the upper bits of all codes are equal.
        let mut random = Random::new(3);
        let mut positions: Vec<DVec3> =
            (0..3000).map(|_| DVec3::new(random.unit(), random.unit(), random.unit()) * 1e-7).collect();
        positions.push(DVec3::ONE);
        let points = of(&positions);
        // 3000 points on a tenth of the steps rarely coincide, and leaves are as small as without the distant point.
        let alone = of(&positions[..3000]);
        let side = |points: &SortedPoints| {
            let leaves = (0..90).map(|leaf| points.bounds(leaf));
            leaves.map(|b| f64::from(b.hi[0] - b.lo[0]) * points.step).sum::<f64>()
        };
        assert!(points.len() > 2900 && side(&points) < 1.2 * side(&alone), "{} {}", side(&points), side(&alone));
    }

    #[test]
    fn boxes_hold_what_is_below_them() {
        let mut random = Random::new(4);
        let positions: Vec<DVec3> =
            (0..5000).map(|_| DVec3::new(random.unit(), random.unit(), random.unit())).collect();
        let points = of(&positions);
        assert_eq!(points.levels().last().unwrap().len(), 1);
        for [below, level] in points.levels().array_windows() {
            for (i, group) in below.iter().enumerate() {
                let b = level[i / FAN].get(i % FAN);
                // Missing boxes are empty: lo is above hi.
                let children = (0..FAN).map(|c| group.get(c)).filter(|c| c.lo[0] <= c.hi[0]);
                assert!(children.clone().count() > 0);
                assert!(children.into_iter().all(|c| (0..3).all(|k| b.lo[k] <= c.lo[k] && c.hi[k] <= b.hi[k])));
            }
        }
        for leaf in 0..points.len().div_ceil(LEAF) {
            assert!(points.leaf(leaf).all(|s| points.bounds(leaf).distance2(points.at(s)) == 0.0));
        }
    }

    #[test]
    fn boxes_side_by_side_meet_what_each_one_meets() {
        let mut random = Random::new(5);
        let mut corner = || [(); 3].map(|()| (random.unit() * 20.0) as i32 - 10);
        let mut bounds = || {
            let (a, b) = (corner(), corner());
            Bounds::default().with(&Bounds { lo: a, hi: a }).with(&Bounds { lo: b, hi: b })
        };
        for count in (1..=FAN).chain([FAN; 20]) {
            let (boxes, region): (Vec<Bounds>, Bounds) = ((0..count).map(|_| bounds()).collect(), bounds());
            let meets = |b: &Bounds| (0..3).all(|k| b.lo[k] <= region.hi[k] && region.lo[k] <= b.hi[k]);
            let expected: u32 = boxes.iter().enumerate().map(|(i, b)| u32::from(meets(b)) << i).sum();
            let group = Boxes::new(&boxes);
            let met = fearless_simd::dispatch!(fearless_simd::Level::new(), simd => group.meeting(simd, &region));
            assert_eq!(met, expected, "{boxes:?} {region:?}");
        }
    }
}
