//! The grid that points are sorted into, and the octree over its cells. A *part* is a subtree of the octree that is
//! built in memory.

use crate::las::copc::build::CELL_BITS;
use crate::las::copc::octants::{BITS, code};
use glam::DVec3;
use std::io;

/// Cell side divided by the margin's width. A part also sees points of its neighbours within this margin of its border.
/// The margin is about 16 points wide for a surface with `cell_points` points per cell.
const MARGIN: i64 = 64;

/// The grid that points are sorted into, aligned to the inputs' own coordinate steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Number of grid units ([`Self::unit`]) in one step of the inputs' integer coordinates, per axis; a step is the
    /// files' coordinate scale.
    pub(super) steps: DVec3,
    /// Length of a grid unit, in the files' coordinates; all axes have the same.
    pub(super) unit: f64,
    /// Minimum corner of the grid, in units.
    pub(super) low: [i64; 3],
    /// Side of the finest octree cell, in units.
    pub(super) finest: i64,
    /// Number of finest octree cells along a grid cell, as a power of two.
    pub(super) cell_bits: u32,
}

impl Grid {
    /// Builds a grid over `count` points in a box. A cell gets about `cell_points` points if they are on a surface. It
    /// gets more if the box would have more than `most_cells` cells or than 2⁷ along an axis.
    pub(super) fn new(
        scale: DVec3,
        [low, high]: [[f64; 3]; 2],
        count: u64,
        (cell_points, most_cells): (u64, usize),
    ) -> Self {
        let magnitude = scale.abs();
        // A step has at most 2²¹ units, so that a 32-bit position fits into 53 bits. A step has 256 units where all
        // axes have the same scale. The finest cells, 2⁷ to 2⁸ units, then divide any octant whose points differ.
        let unit = (magnitude.min_element() / 256.0).max(magnitude.max_element() * 2f64.powi(-21));
        let lengths = [0, 1, 2].map(|k| ((high[k] - low[k]) / unit).clamp(0.0, 2f64.powi(53)) as i64 + 1);
        let longest = lengths.into_iter().fold(0, i64::max);
        let mut depth = 0;
        while depth < CELL_BITS && count >> (2 * depth) > cell_points {
            depth += 1;
        }
        let side = |depth: u32| (longest >> depth) + 1;
        // The ends of the box may cut off two of the cells along an axis.
        let cells = |depth: u32| lengths.map(|length| (length / side(depth) + 2) as u64).into_iter().product::<u64>();
        while depth > 0 && cells(depth) > most_cells as u64 {
            depth -= 1;
        }
        let side = side(depth);
        // The side is finest · 2^cell_bits, where `finest` has 8 bits, so that no side grows by more than 1/128.
        let side_bits = i64::BITS - side.leading_zeros();
        let cell_bits = side_bits.saturating_sub(8).clamp(CELL_BITS, BITS - depth);
        let finest = ((side - 1) >> cell_bits) + 1;
        let low = [0, 1, 2].map(|k| (low[k] / unit).clamp(-2f64.powi(60), 2f64.powi(60)).floor() as i64);
        Self { steps: scale / unit, unit, low, finest, cell_bits }
    }

    pub(super) fn side(&self) -> i64 {
        self.finest << self.cell_bits
    }

    pub(super) fn units(&self, position: [i32; 3]) -> [i64; 3] {
        let on = |k: usize| (f64::from(position[k]) * self.steps[k]).round() as i64;
        [0, 1, 2].map(|k| on(k) - self.low[k])
    }

    pub(super) fn cell(&self, units: [i64; 3]) -> [i64; 3] {
        let side = self.side();
        units.map(|u| u.div_euclid(side))
    }

    /// Returns the width of a cell's margin, in units.
    pub(super) fn reach(&self) -> i64 {
        self.side() / MARGIN
    }
}

/// Calls `each` for every cell that doesn't contain a point but is nearer to it than `side` / [`MARGIN`]. Cells are
/// cubes of side `side`. The point's position `units` and `side` are in grid units.
pub(super) fn each_near_cell(
    units: [i64; 3],
    side: i64,
    each: &mut dyn FnMut([i64; 3]) -> io::Result<()>,
) -> io::Result<()> {
    let reach = side / MARGIN;
    let ways = units.map(|u| match u.rem_euclid(side) {
        within if within < reach => -1,
        within if within >= side - reach => 1,
        _ => 0,
    });
    if ways == [0; 3] {
        return Ok(());
    }
    let cell = units.map(|u| u.div_euclid(side));
    // The bits of `axes` name the axes along which the neighbour differs from the point's cell.
    for axes in 1..8 {
        let is_along = |k: usize| axes >> k & 1 == 1;
        if (0..3).all(|k| !is_along(k) || ways[k] != 0) {
            each([0, 1, 2].map(|k| cell[k] + if is_along(k) { ways[k] } else { 0 }))?;
        }
    }
    Ok(())
}

/// The range of grid cells that an octree covers, and their assignment to parts. If a side of the octree has more than
/// 128 cells, a part covers several of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cells {
    low: [i64; 3],
    levels: u32,
    /// Octree level of the parts.
    pub(super) depth: u32,
}

impl Cells {
    pub(super) fn new(low: [i64; 3], high: [i64; 3]) -> Self {
        let most = (0..3).map(|k| high[k].abs_diff(low[k]) + 1).max().unwrap_or(1);
        let levels = most.next_power_of_two().trailing_zeros();
        Self { low, levels, depth: levels.min(CELL_BITS) }
    }

    /// Returns the index, along axis `k`, of the octant of `level` (at most [`Self::depth`]) that contains a cell. The
    /// index is out of range for cells outside the octree.
    pub(super) fn octant_along(&self, k: usize, cell: i64, level: u32) -> i64 {
        (cell - self.low[k]) >> (self.levels - level)
    }

    /// Returns the Morton code of the part that contains a cell, or `None` outside the octree.
    pub(super) fn part(&self, cell: [i64; 3]) -> Option<u64> {
        let at = [0, 1, 2].map(|k| self.octant_along(k, cell[k], self.depth));
        at.iter().all(|v| (0..1 << self.depth).contains(v)).then(|| code(at.map(|v| v as u32)))
    }

    /// Returns the first grid cell and the number of grid cells along axis `k` of the octant with index `octant` at
    /// `level`.
    pub(super) fn stretch(&self, k: usize, octant: i64, level: u32) -> (i64, i64) {
        let side = 1 << (self.levels - level);
        (self.low[k] + octant * side, side)
    }
}

/// The octree over the grid's cells, in grid units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    /// Minimum corner of the root, in units from the grid's corner.
    pub(super) low: [i64; 3],
    /// Bits of a Morton code per axis: the level of the finest cells.
    pub(super) bits: u32,
    /// Side of the finest cell, in units.
    pub(super) finest: i64,
    /// Octree level of the parts.
    pub(super) depth: u32,
}

impl Frame {
    /// Builds the octree over `cells`, whose points have the bounds `ends`, in units. The octree of a single cell
    /// shrinks to the bounds of its points.
    pub(super) fn over(grid: &Grid, cells: &Cells, ends: [[i64; 3]; 2]) -> Self {
        if cells.levels == 0 {
            let longest = (0..3).map(|k| ends[0][k].abs_diff(ends[1][k])).max().unwrap_or(0) as i64;
            let mut bits = BITS;
            while bits > CELL_BITS && longest >> (bits - 1) == 0 {
                bits -= 1;
            }
            return Self { low: ends[0], bits, finest: (longest >> bits) + 1, depth: 0 };
        }
        let (side, mut bits, mut finest) = (grid.side(), cells.levels + grid.cell_bits, grid.finest);
        while bits > BITS {
            (bits, finest) = (bits - 1, finest * 2);
        }
        Self { low: cells.low.map(|l| l * side), bits, finest, depth: cells.depth }
    }

    /// True if a position, in grid units, is inside the octree.
    pub(super) fn holds(&self, units: [i64; 3]) -> bool {
        (0..3).all(|k| (0..self.finest << self.bits).contains(&(units[k] - self.low[k])))
    }

    pub(super) fn code(&self, units: [i64; 3]) -> u64 {
        code([0, 1, 2].map(|k| ((units[k] - self.low[k]) / self.finest) as u32))
    }

    /// Returns the Morton code of the octant of `level` that contains a position in grid units.
    pub(super) fn octant(&self, units: [i64; 3], level: u32) -> u64 {
        self.code(units) >> (3 * (self.bits - level))
    }
}
