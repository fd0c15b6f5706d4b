//! The shard of one of several runs of a conversion: a range of the octree's parts. A *part* is a subtree that is built
//! in memory.
//!
//! A part depends only on its own points and those in its margin. The octree follows from the bounds in the inputs'
//! headers. If several shards have points of a node above the parts, these points are merged in order of the shards.
//! The merged file therefore doesn't depend on where the ranges end.

use super::grid::{Cells, Frame, Grid};
use super::inputs::{Input, Stop};
use crate::error::Problem;
use crate::las::copc::build::LEAF_POINTS;
use crate::las::copc::octants::{VoxelKey, code};
use crate::las::header::Header;
use crate::las::{Sink, field};
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};
use std::ops::{Range, RangeInclusive};

/// Maximum number of octants for which numbers of points are estimated: those that the inputs' bounds overlap, summed
/// over the inputs. If there would be more, octants of a coarser level are used.
const MAX_OCTANTS: i64 = 1 << 22;

/// Minimum and maximum corner, in units of the grid.
type Bounds = [[i64; 3]; 2];

/// A range of the parts, and the octree that they belong to.
#[derive(Debug)]
pub(super) struct ShardRange {
    pub(super) frame: Frame,
    pub(super) cells: Cells,
    /// Minimum and maximum corner of all points by the headers, in steps of the first input.
    pub(super) ends: [[i32; 3]; 2],
    grid: Grid,
    parts: Range<u64>,
    /// Bounds of each input by its header; `None` for inputs without points.
    bounds: Vec<Option<Bounds>>,
    /// Rounding error of a bound along each axis, in units of the grid.
    bounds_error: [i64; 3],
}

impl ShardRange {
    /// Selects shard `index` of `count`; all shards have about the same number of points, as far as points are spread
    /// evenly over the inputs' bounds.
    pub(super) fn new([index, count]: [u32; 2], inputs: &[Input], grid: Grid, scale: DVec3) -> Self {
        let steps = |input: &Input| {
            let steps = |ends: [f64; 3]| (DVec3::from(ends) / scale).round().to_array().map(|v| v as i32);
            let ends = [steps(input.low), steps(input.high)];
            let end = |fold: fn(i32, i32) -> i32| [0, 1, 2].map(|k| fold(ends[0][k], ends[1][k]));
            (input.header.count > 0).then(|| [end(i32::min), end(i32::max)])
        };
        let steps: Vec<Option<[[i32; 3]; 2]>> = inputs.iter().map(steps).collect();
        let of_all = |end: usize, fold: fn(i32, i32) -> i32| {
            [0, 1, 2].map(|k| steps.iter().flatten().map(|b| b[end][k]).reduce(fold).unwrap_or(0))
        };
        let bounds = |steps: &[[i32; 3]; 2]| {
            let ends = steps.map(|end| grid.units(end));
            let end = |fold: fn(i64, i64) -> i64| [0, 1, 2].map(|k| fold(ends[0][k], ends[1][k]));
            [end(i64::min), end(i64::max)]
        };
        let bounds: Vec<Option<Bounds>> = steps.iter().map(|steps| steps.as_ref().map(bounds)).collect();
        let all = |end: usize, fold: fn(i64, i64) -> i64| {
            [0, 1, 2].map(|k| bounds.iter().flatten().map(|b| b[end][k]).reduce(fold).unwrap_or(0))
        };
        let ends = [all(0, i64::min), all(1, i64::max)];
        let cells = Cells::new(grid.cell(ends[0]), grid.cell(ends[1]));
        let frame = Frame::over(&grid, &cells, ends);
        let bounds_error = grid.steps.abs().ceil().to_array().map(|v| v as i64);
        let end_steps = [of_all(0, i32::min), of_all(1, i32::max)];
        let mut range = Self { frame, cells, ends: end_steps, grid, parts: 0..0, bounds, bounds_error };
        let mut level = cells.depth;
        let octants = |level| {
            let all = range.bounds.iter().flatten().map(|b| range.octants(b, level).map(long).iter().product());
            all.fold(0_i64, i64::saturating_add)
        };
        while level > 0 && octants(level) > MAX_OCTANTS {
            level -= 1;
        }
        range.parts = range.stretch(level, [index, count], inputs);
        range
    }

    /// Returns the range of octants of `level` that `bounds` overlap, as their indices along each axis.
    fn octants(&self, bounds: &Bounds, level: u32) -> [RangeInclusive<i64>; 3] {
        let cells = bounds.map(|end| self.grid.cell(end));
        let last = (1 << level) - 1;
        [0, 1, 2].map(|k| {
            let [first, end] = cells.map(|cell| self.cells.octant_along(k, cell[k], level).clamp(0, last));
            first..=end
        })
    }

    /// Returns the range of parts of shard `index` of `count`. Points are assumed to be spread evenly over each input's
    /// bounds. The range ends at borders between octants of `level`.
    fn stretch(&self, level: u32, [index, count]: [u32; 2], inputs: &[Input]) -> Range<u64> {
        let side = self.grid.side();
        let mut points: BTreeMap<u64, f64> = BTreeMap::new();
        for (input, bounds) in inputs.iter().zip(&self.bounds) {
            let Some(bounds) = bounds else { continue };
            let [xs, ys, zs] = self.octants(bounds, level);
            let fraction = |k: usize, octant: i64| {
                let (start, cells) = self.cells.stretch(k, octant, level);
                let (start, end) = (start * side, (start + cells) * side);
                let within = (bounds[1][k] + 1).min(end) - bounds[0][k].max(start);
                within.max(0) as f64 / (bounds[1][k] - bounds[0][k] + 1) as f64
            };
            for z in zs {
                for y in ys.clone() {
                    for x in xs.clone() {
                        let of_box = fraction(0, x) * fraction(1, y) * fraction(2, z);
                        let octant = code([x, y, z].map(|v| v as u32));
                        *points.entry(octant).or_default() += input.header.count as f64 * of_box;
                    }
                }
            }
        }
        let total: f64 = points.values().sum();
        let mut before = 0.0;
        let mut starts: Vec<(u64, f64)> = Vec::with_capacity(points.len());
        for (octant, points) in points {
            starts.push((octant, (before / total * f64::from(count)).floor()));
            before += points;
        }
        let shift = 3 * (self.cells.depth - level);
        let end = 1 << (3 * self.cells.depth);
        let edge = |shard: u32| match starts.iter().find(|(_, of)| *of >= f64::from(shard)) {
            _ if shard == 0 => 0,
            Some((octant, _)) if shard < count => octant << shift,
            _ => end,
        };
        edge(index)..edge(index + 1)
    }

    /// True if a grid cell belongs to this shard.
    pub(super) fn owns(&self, cell: [i64; 3]) -> bool {
        self.cells.part(cell).is_some_and(|part| self.parts.contains(&part))
    }

    /// True if an input may have points in this shard's parts or in their margins.
    pub(super) fn needs(&self, input: usize) -> bool {
        let Some(Some([low, high])) = self.bounds.get(input) else { return false };
        let reach = self.grid.reach() + 1;
        let grown = [
            [0, 1, 2].map(|k| low[k] - self.bounds_error[k] - reach),
            [0, 1, 2].map(|k| high[k] + self.bounds_error[k] + reach),
        ];
        let depth = self.cells.depth;
        let [xs, ys, zs] = self.octants(&grown, depth);
        // Visits octants from the root down, and stops at octants entirely inside or outside the range.
        let mut open = vec![(0, [0_i64; 3])];
        while let Some((level, at)) = open.pop() {
            let shift = depth - level;
            let is_in =
                |range: &RangeInclusive<i64>, v: i64| (range.start() >> shift..=range.end() >> shift).contains(&v);
            if !is_in(&xs, at[0]) || !is_in(&ys, at[1]) || !is_in(&zs, at[2]) {
                continue;
            }
            let start = code(at.map(|v| v as u32)) << (3 * shift);
            let end = start + (1 << (3 * shift));
            if end <= self.parts.start || start >= self.parts.end {
                continue;
            }
            if start >= self.parts.start && end <= self.parts.end {
                return true;
            }
            (0..8).for_each(|i| open.push((level + 1, [0, 1, 2].map(|k| 2 * at[k] + (i >> k & 1)))));
        }
        false
    }

    /// Returns an error for a point outside the bounds in its input's header: another shard may have missed it.
    pub(super) fn check(&self, input: usize, units: [i64; 3]) -> Result<(), Problem> {
        let within = |b: &Bounds| {
            (0..3).all(|k| (b[0][k] - self.bounds_error[k]..=b[1][k] + self.bounds_error[k]).contains(&units[k]))
        };
        if self.frame.holds(units) && self.bounds.get(input).is_some_and(|b| b.as_ref().is_some_and(within)) {
            return Ok(());
        }
        let problem = Problem::new("has a point outside of the bounds in its header, which say who converts what");
        Err(problem.help("convert without `shard`, which asks no header; or mend the header"))
    }

    /// Completes the point counts of octants above the parts for which other shards have points, too. A count above
    /// [`LEAF_POINTS`] may be too low, but stays above it, which suffices to decide that the octant is divided.
    pub(super) fn complete(&self, counts: &mut HashMap<VoxelKey, u64>, inputs: &[Input]) -> Result<(), Stop> {
        let depth = self.cells.depth;
        for level in (0..depth).rev() {
            let shift = 3 * (depth - level);
            let is_shared = |octant: u64| octant << shift < self.parts.start || (octant + 1) << shift > self.parts.end;
            let is_shared = |key: &&VoxelKey| key.level == level && is_shared(key.code);
            let shared: Vec<VoxelKey> = counts.keys().filter(is_shared).copied().collect();
            for key in shared {
                let child = |i| VoxelKey { level: level + 1, code: key.code * 8 + i };
                let below = (0..8).filter_map(|i| counts.get(&child(i)));
                let known = below.fold(counts[&key], |most, below| most.max(*below));
                let points = if known > LEAF_POINTS { known } else { self.count(key, inputs)? };
                counts.insert(key, points);
            }
        }
        Ok(())
    }

    /// Counts the points in an octant over all inputs; stops early above [`LEAF_POINTS`].
    fn count(&self, octant: VoxelKey, inputs: &[Input]) -> Result<u64, Stop> {
        let side = self.frame.finest << (self.frame.bits - octant.level);
        let at = crate::las::copc::octants::cell(octant.code);
        let low = [0, 1, 2].map(|k| self.frame.low[k] + i64::from(at[k]) * side);
        let mut found = 0;
        for (input, bounds) in inputs.iter().zip(&self.bounds) {
            let Some([from, to]) = bounds else { continue };
            if (0..3).any(|k| to[k] + self.bounds_error[k] < low[k] || from[k] - self.bounds_error[k] >= low[k] + side)
            {
                continue;
            }
            let mut again = input.again()?;
            let (input_bytes, shift) = (again.header.record_bytes, input.shift);
            let mut counter = Counter { grid: self.grid, low, side, input_bytes, shift, found };
            let read = again.read(&mut counter);
            found = counter.found;
            if found > LEAF_POINTS {
                break;
            }
            read?;
        }
        Ok(found)
    }
}

fn long(range: RangeInclusive<i64>) -> i64 {
    range.end() - range.start() + 1
}

/// A sink that counts the points in a cube. It stops the reading by an error once there are more than [`LEAF_POINTS`].
struct Counter {
    grid: Grid,
    low: [i64; 3],
    side: i64,
    input_bytes: usize,
    shift: [i64; 3],
    found: u64,
}

impl Sink for Counter {
    fn start(&mut self, _: &Header, _: usize) {}

    fn append(&mut self, records: &mut [u8]) -> Result<(), Problem> {
        for record in records.chunks_exact(self.input_bytes) {
            let at = |k: usize| i64::from(i32::from_le_bytes(field(record, 4 * k))) + self.shift[k];
            let units = self.grid.units([0, 1, 2].map(|k| at(k) as i32));
            self.found += u64::from((0..3).all(|k| (0..self.side).contains(&(units[k] - self.low[k]))));
        }
        if self.found > LEAF_POINTS { Err(Problem::new("has more points than need be counted")) } else { Ok(()) }
    }
}
