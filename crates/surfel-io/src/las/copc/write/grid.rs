//! The grid that points are sorted into, and the octree over its cells.

use crate::las::copc::build::CELL_BITS;
use crate::las::copc::octants::{BITS, code};
use glam::DVec3;
use std::io;

/// Parts see the points beyond their border that are nearer than their side over this: some 16 of a surface's points,
/// where it has as many of them as a cell is made for.
const MARGIN: i64 = 64;

/// The grid that points are sorted into, on the inputs' own steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Units in a step of each axis, a step being what the inputs' positions are whole numbers of.
    pub(super) steps: DVec3,
    pub(super) unit: f64,
    /// Least corner, in units.
    pub(super) low: [i64; 3],
    /// Units in the side of the finest cell of the octree.
    pub(super) finest: i64,
    /// Finest cells along a cell of the grid, as a power of two.
    pub(super) cell_bits: u32,
}

impl Grid {
    /// A grid over `count` points in a box: cells of about so many points, if they are on a surface, and at most so
    /// many cells in the box.
    pub(super) fn new(
        scale: DVec3,
        [low, high]: [[f64; 3]; 2],
        count: u64,
        (cell_points, most_cells): (u64, usize),
    ) -> Self {
        let magnitude = scale.abs();
        // A step has 2²¹ units at most, so that a position of 32 bits has 53, and 256 where axes have the same scale:
        // the finest cells, 2⁷ to 2⁸ units, then divide whatever octant has points that differ.
        let unit = (magnitude.min_element() / 256.0).max(magnitude.max_element() * 2f64.powi(-21));
        let lengths = [0, 1, 2].map(|k| ((high[k] - low[k]) / unit).clamp(0.0, 2f64.powi(53)) as i64 + 1);
        let longest = lengths.into_iter().fold(0, i64::max);
        let mut depth = 0;
        while depth < CELL_BITS && count >> (2 * depth) > cell_points {
            depth += 1;
        }
        let side = |depth: u32| (longest >> depth) + 1;
        // Two of the cells along an axis may be cut by the box's ends.
        let cells = |depth: u32| lengths.map(|length| (length / side(depth) + 2) as u64).into_iter().product::<u64>();
        while depth > 0 && cells(depth) > most_cells as u64 {
            depth -= 1;
        }
        let side = side(depth);
        // A side of finest · 2^cell_bits, where finest has 8 bits, so that no side is more than 1/128 longer.
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

    /// How far a cell's points see beyond its border, in units.
    pub(super) fn reach(&self) -> i64 {
        self.side() / MARGIN
    }
}

/// Calls `each` for every other cell of a grid that a point is nearer to than `side` / [`MARGIN`].
pub(super) fn in_reach(units: [i64; 3], side: i64, each: &mut dyn FnMut([i64; 3]) -> io::Result<()>) -> io::Result<()> {
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
    // Bits say along which axes it is another cell.
    for axes in 1..8 {
        let is_along = |k: usize| axes >> k & 1 == 1;
        if (0..3).all(|k| !is_along(k) || ways[k] != 0) {
            each([0, 1, 2].map(|k| cell[k] + if is_along(k) { ways[k] } else { 0 }))?;
        }
    }
    Ok(())
}

/// The grid's cells that an octree is over, and which of its parts each is in. Cells of which more than 128 are along
/// its side are put together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cells {
    low: [i64; 3],
    levels: u32,
    /// Level of the parts.
    pub(super) depth: u32,
}

impl Cells {
    pub(super) fn new(low: [i64; 3], high: [i64; 3]) -> Self {
        let most = (0..3).map(|k| high[k].abs_diff(low[k]) + 1).max().unwrap_or(1);
        let levels = most.next_power_of_two().trailing_zeros();
        Self { low, levels, depth: levels.min(CELL_BITS) }
    }

    /// The octant of a level, at most [`Self::depth`], that a cell is in, along one axis; outside of the octree it is
    /// none of them.
    pub(super) fn octant_along(&self, k: usize, cell: i64, level: u32) -> i64 {
        (cell - self.low[k]) >> (self.levels - level)
    }

    /// The part that a cell is in, if it is in the octree.
    pub(super) fn part(&self, cell: [i64; 3]) -> Option<u64> {
        let at = [0, 1, 2].map(|k| self.octant_along(k, cell[k], self.depth));
        at.iter().all(|v| (0..1 << self.depth).contains(v)).then(|| code(at.map(|v| v as u32)))
    }

    /// Where an octant of a level begins along one axis, and how long it is, in cells.
    pub(super) fn stretch(&self, k: usize, octant: i64, level: u32) -> (i64, i64) {
        let side = 1 << (self.levels - level);
        (self.low[k] + octant * side, side)
    }
}

/// The octree over the grid's cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    /// Least corner of the root, in units from the grid's.
    pub(super) low: [i64; 3],
    /// Bits of codes.
    pub(super) bits: u32,
    /// Units in the side of the finest cell.
    pub(super) finest: i64,
    /// Level of the parts that points are sorted into.
    pub(super) depth: u32,
}

impl Frame {
    /// The octree over these cells, whose points reach from and to `ends`, in units: those of one cell may need much
    /// less than it.
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

    /// True for what is in the octree.
    pub(super) fn holds(&self, units: [i64; 3]) -> bool {
        (0..3).all(|k| (0..self.finest << self.bits).contains(&(units[k] - self.low[k])))
    }

    pub(super) fn code(&self, units: [i64; 3]) -> u64 {
        code([0, 1, 2].map(|k| ((units[k] - self.low[k]) / self.finest) as u32))
    }

    /// The octant of a level that a point is in.
    pub(super) fn octant(&self, units: [i64; 3], level: u32) -> u64 {
        self.code(units) >> (3 * (self.bits - level))
    }
}
