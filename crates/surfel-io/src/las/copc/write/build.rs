//! Second step of a conversion: builds the octree from sorted points, part by part.
//!
//! A part is a subtree that is built in memory. Several parts are built at once as far as their points fit into memory.

use super::conversion::Conversion;
use super::grid::{Cells, Frame, Grid, each_near_cell};
use super::inputs::{Input, Stop};
use super::layout::Layout;
use super::nodes::Nodes;
use super::parts::{Loaded, Made, Maker, is_withheld, position};
use super::sort::{Lists, SortedPoints, Spills};
use crate::error::Problem;
use crate::las::copc::build::{CELL_BITS, LEAF_POINTS, Part};
use crate::las::copc::octants::{VoxelKey, code};
use crate::las::copc::output::{Cube, Summary};
use crate::las::copc::spill::Spill;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::hash::Hash;
use std::io;

/// An octree whose nodes are in temporary files, with statistics of its points and notes for the user.
pub(super) struct Octree {
    pub(super) cube: Cube,
    pub(super) nodes: Nodes,
    pub(super) summary: Summary,
    pub(super) notes: Vec<String>,
}

/// Builds the nodes of sorted points. Nodes above the parts remain incomplete if the points are those of a shard.
pub(super) fn build(
    conversion: &Conversion<'_>,
    inputs: &[Input],
    mut sorted: SortedPoints,
    nodes: Nodes,
) -> Result<Octree, Stop> {
    let (frame, parts) = frame(conversion, &sorted);
    let cube = cube(&conversion.layout, &sorted.grid, &frame);
    let counts = counts(conversion, inputs, &sorted, (&frame, &parts))?;
    // Moves the records of grid cells from memory to disk, because the parts need the memory.
    sorted.cells.flush()?;
    let viewpoint = if let [input] = inputs { input.viewpoint() } else { None };
    let Conversion { task, layout, first, .. } = conversion;
    let maker = Maker { prepare: task.prepare, layout, viewpoint, grid: sorted.grid, input: first };
    let all = sorted.summary.count;
    let mut builder = Builder { conversion, maker, frame, nodes, waiting: Vec::new(), taken: HashSet::new(), all };
    builder.build_parts(&mut sorted.cells, parts, &counts)?;
    let SortedPoints { cells, summary, notes, .. } = sorted;
    drop(cells);
    let mut nodes = builder.nodes;
    // Other shards have points of the nodes above the parts, too.
    if conversion.shard_range.is_none() {
        nodes.compress_upper(&layout.laz)?;
    }
    Ok(Octree { cube, nodes, summary, notes })
}

/// Grid cells of each part of the octree, by the part's Morton code.
type PartCells = BTreeMap<u64, Vec<[i64; 3]>>;

/// Returns the octree over all grid cells, and the grid cells of each part.
fn frame(conversion: &Conversion<'_>, sorted: &SortedPoints) -> (Frame, PartCells) {
    let SortedPoints { grid, summary, .. } = sorted;
    let mut found: Vec<[i64; 3]> = sorted.cells.points.sizes().map(|(cell, _)| cell).collect();
    found.sort_unstable();
    let (frame, cells) = match &conversion.shard_range {
        Some(range) => (range.frame, range.cells),
        None => {
            let end =
                |fold: fn(i64, i64) -> i64| [0, 1, 2].map(|k| found.iter().map(|c| c[k]).reduce(fold).unwrap_or(0));
            let cells = Cells::new(end(i64::min), end(i64::max));
            let ends = [summary.low, summary.high].map(|end| grid.units(end));
            let end = |fold: fn(i64, i64) -> i64| [0, 1, 2].map(|k| fold(ends[0][k], ends[1][k]));
            (Frame::over(grid, &cells, [end(i64::min), end(i64::max)]), cells)
        }
    };
    let mut parts = PartCells::new();
    for cell in found {
        if let Some(part) = cells.part(cell) {
            parts.entry(part).or_default().push(cell);
        }
    }
    (frame, parts)
}

/// Returns the octree's cube, in coordinates of the file.
fn cube(layout: &Layout, grid: &Grid, frame: &Frame) -> Cube {
    let side = (frame.finest << frame.bits) as f64 * grid.unit;
    let low = [0, 1, 2].map(|k| (grid.low[k] + frame.low[k]) as f64 * grid.unit);
    let center = (DVec3::from(layout.template.offset) + DVec3::from(low) + 0.5 * side).to_array();
    let spacing = side / f64::from(1_u32 << CELL_BITS);
    Cube { center, half: 0.5 * side, spacing }
}

/// Counts the points of each octant from the root to the level of the parts. The counts of a shard include the points
/// of other shards, but may be too low above [`LEAF_POINTS`].
fn counts(
    conversion: &Conversion<'_>,
    inputs: &[Input],
    sorted: &SortedPoints,
    (frame, parts): (&Frame, &PartCells),
) -> Result<HashMap<VoxelKey, u64>, Stop> {
    let bytes: HashMap<[i64; 3], u64> = sorted.cells.points.sizes().collect();
    let mut counts: HashMap<VoxelKey, u64> = HashMap::new();
    for (code, cells) in parts {
        let points = cells.iter().map(|cell| bytes[cell]).sum::<u64>() / conversion.layout.sorted_bytes as u64;
        let part = VoxelKey { level: frame.depth, code: *code };
        (0..=frame.depth).for_each(|level| *counts.entry(part.at_level(level)).or_default() += points);
    }
    if let Some(range) = &conversion.shard_range {
        range.complete(&mut counts, inputs)?;
    }
    Ok(counts)
}

/// Octant to be read into memory, with the lists of its records. An octant with too many points is divided into its
/// children.
struct Octant {
    key: VoxelKey,
    /// Level of an enclosing octant that has so few points that it isn't divided; `None` if there is none.
    leaf_at: Option<u32>,
    lists: Lists,
}

/// Reads parts into memory and builds their nodes.
struct Builder<'a> {
    conversion: &'a Conversion<'a>,
    maker: Maker<'a>,
    frame: Frame,
    nodes: Nodes,
    /// Parts in memory that are built together with the next ones.
    waiting: Vec<Loaded>,
    /// Cells for which a point is already selected, and which are larger than the octants into which a part was
    /// divided.
    taken: HashSet<VoxelKey>,
    /// Number of points of all parts.
    all: u64,
}

impl Builder<'_> {
    /// Builds the parts that no earlier run built, and saves progress between parts. `taken` needn't be saved. It is
    /// used only if a part was divided into smaller octants, and each of its cells, at level 7 or finer, lies inside
    /// one part of `parts` (level 7 or coarser).
    fn build_parts(
        &mut self,
        cells: &mut Spills<[i64; 3]>,
        parts: PartCells,
        counts: &HashMap<VoxelKey, u64>,
    ) -> Result<(), Stop> {
        let count = parts.len();
        for (i, (code, part)) in parts.into_iter().enumerate().skip(self.nodes.parts_built) {
            let key = VoxelKey { level: self.frame.depth, code };
            if !self.waiting.is_empty() && !self.has_room(counts[&key]) {
                self.make_waiting()?;
                self.nodes.keep(self.conversion, i)?;
            }
            let leaf_at = (0..key.level).find(|level| counts[&key.at_level(*level)] <= LEAF_POINTS);
            let lists = cells.take(&part);
            self.read_part(cells, Octant { key, leaf_at, lists })?;
        }
        self.make_waiting()?;
        self.nodes.keep(self.conversion, count)
    }

    /// True if `points` more points fit into memory.
    fn has_room(&self, points: u64) -> bool {
        let size = self.conversion.layout.sorted_bytes;
        let waiting = self.waiting.iter().map(|part| part.records.len() / size).sum::<usize>() as u64;
        waiting + points <= self.conversion.task.limits.held_points
    }

    /// Reads the points of an octant into memory. An octant with more than `most_points` points is divided into its
    /// children instead, as long as the octree has finer levels for them. Returns an error for more than
    /// `most_in_place` points that can't be divided.
    fn read_part<K: Copy + Eq + Hash>(&mut self, spills: &mut Spills<K>, octant: Octant) -> Result<(), Stop> {
        let limits = &self.conversion.task.limits;
        let bytes = octant.lists.points.iter().map(|list| list.bytes).sum::<u64>();
        let points = bytes / self.conversion.layout.sorted_bytes as u64;
        let VoxelKey { level: depth, .. } = octant.key;
        if points > limits.most_points && depth + CELL_BITS < self.frame.bits {
            return self.divide(spills, octant);
        }
        if points > limits.most_in_place {
            let what =
                format!("has {points} points in about one place, with the other inputs, which don't fit into memory");
            let problem = Problem::new(what).expected(format!("at most {}", limits.most_in_place));
            let problem = problem.help("allow more (`memory`), or leave out equal points before");
            return Err(self.conversion.invalid(problem));
        }
        if !self.has_room(points) {
            self.make_waiting()?;
        }
        let records = spills.points.bytes_of(&octant.lists.points)?;
        let mut margin = Vec::new();
        for list in &octant.lists.margin {
            spills.margins.read(list, &mut |block| {
                // Grid cells that were merged have each other's points in their margins.
                let outside = self.records(block).filter(|record| !self.is_inside(octant.key, record));
                outside.for_each(|record| margin.extend_from_slice(record));
                Ok(())
            })?;
        }
        let part = Part { bits: self.frame.bits, depth, leaf_at: octant.leaf_at };
        self.waiting.push(Loaded { part, records, margin });
        Ok(())
    }

    /// Sorts the points of an octant by child, and reads each child.
    fn divide<K: Copy + Eq + Hash>(&mut self, spills: &mut Spills<K>, octant: Octant) -> Result<(), Stop> {
        let Octant { key, lists, .. } = octant;
        let level = key.level + 1;
        let mut children = Spills::new(self.conversion.task.folder)?;
        let Spills { points, margins } = &mut children;
        for list in &lists.points {
            spills.points.read(list, &mut |block| {
                self.records(block).try_for_each(|record| {
                    let child = self.frame.octant(self.maker.grid.units(position(record)), level);
                    points.append(child, record)?;
                    let has_splat = self.maker.prepare.is_some() && !is_withheld(record);
                    if has_splat { self.add_beside(margins, key, record) } else { Ok(()) }
                })
            })?;
        }
        for list in &lists.margin {
            spills.margins.read(list, &mut |block| {
                let mut outside = self.records(block).filter(|record| !self.is_inside(key, record));
                outside.try_for_each(|record| self.add_beside(margins, key, record))
            })?;
        }
        drop(lists);
        let mut codes: Vec<u64> = children.points.sizes().map(|(code, _)| code).collect();
        codes.sort_unstable();
        for code in codes {
            let lists = children.take(&[code]);
            self.read_part(&mut children, Octant { key: VoxelKey { level, code }, leaf_at: None, lists })?;
        }
        Ok(())
    }

    fn records<'r>(&self, block: &'r [u8]) -> std::slice::ChunksExact<'r, u8> {
        block.chunks_exact(self.conversion.layout.sorted_bytes)
    }

    fn is_inside(&self, octant: VoxelKey, record: &[u8]) -> bool {
        self.frame.octant(self.maker.grid.units(position(record)), octant.level) == octant.code
    }

    /// Appends a record to the margin of each child of `octant` that is near the record's point, but doesn't contain
    /// it.
    fn add_beside(&self, margins: &mut Spill<u64>, octant: VoxelKey, record: &[u8]) -> io::Result<()> {
        let Frame { low, finest, bits, .. } = self.frame;
        let side = finest << (bits - octant.level - 1);
        let units = self.maker.grid.units(position(record));
        let from_root = [0, 1, 2].map(|k| units[k] - low[k]);
        each_near_cell(from_root, side, &mut |cell| match octant.code == code(cell.map(|c| (c >> 1) as u32)) {
            true => margins.append(code(cell.map(|c| c as u32)), record),
            false => Ok(()),
        })
    }

    /// Builds the octree nodes of the parts of the cloud that wait in memory (`waiting`), and writes them. Points of
    /// nodes above the parts go to `upper`. Afterwards no part is waiting.
    fn make_waiting(&mut self) -> Result<(), Stop> {
        let waiting = std::mem::take(&mut self.waiting);
        let Self { maker, frame, nodes, taken, .. } = self;
        // If a part was divided, its octants share the cells that are larger than an octant: the first octant selects a
        // point for such a cell, and later ones don't. These octants are therefore built one after another.
        let made: Vec<Made> = if waiting.iter().all(|part| part.part.depth <= CELL_BITS) {
            let made = waiting.into_par_iter().map(|part| maker.make(frame, &part, &mut HashSet::new()));
            made.collect::<io::Result<_>>()?
        } else {
            waiting.into_iter().map(|part| maker.make(frame, &part, taken)).collect::<io::Result<_>>()?
        };
        for made in made {
            for (key, bytes) in made.upper {
                nodes.upper.append(key, &bytes)?;
            }
            nodes.chunks.append(made.packed)?;
            nodes.points += made.points;
        }
        (self.conversion.task.progress)("building the octree", nodes.points, self.all);
        Ok(())
    }
}
