//! Sets of a grid's blocks, for drawing only some of them.
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::tiles::grid::{BLOCK, Grid, TILE_BLOCKS};

/// A set of blocks of a grid, with a fast test whether a rectangle of pixels contains some of them.
pub(crate) struct BlockSet {
    pub grid: Grid,
    /// Blocks of the set in each tile, one bit per block, row by row, eight bits a row.
    tiles: Vec<u64>,
    /// Summed-area table: for each corner of the grid's tiles, the number of tiles that have blocks of the set among
    /// those both above the corner and to its left.
    sums: Vec<u32>,
    /// Number of blocks in the set.
    pub count: u64,
}

impl BlockSet {
    /// Returns an empty set of blocks of a grid.
    pub(crate) fn new(grid: Grid) -> Self {
        Self { grid, tiles: vec![0; grid.tiles()], sums: Vec::new(), count: 0 }
    }

    /// Adds the block that contains the pixel (x, y) of the grid's region. The block must not be in the set yet, since
    /// `count` grows with every call.
    pub(crate) fn add(&mut self, x: i32, y: i32) {
        let [column, row] = [x, y].map(|px| px as u32 / BLOCK % self.grid.tile_blocks);
        if let Some(blocks) = self.tiles.get_mut(self.grid.tile_of(x, y)) {
            *blocks |= 1 << (TILE_BLOCKS * row + column);
            self.count += 1;
        }
    }

    /// Computes the summed-area table that [`Self::touches`] needs. Call this after all blocks are added.
    pub(crate) fn finish(&mut self) {
        let (columns, rows) = (self.grid.columns as usize, self.grid.rows as usize);
        self.sums = vec![0; (columns + 1) * (rows + 1)];
        for row in 0..rows {
            let mut of_row = 0;
            for column in 0..columns {
                of_row += u32::from(self.tiles[row * columns + column] != 0);
                self.sums[(row + 1) * (columns + 1) + column + 1] =
                    self.sums[row * (columns + 1) + column + 1] + of_row;
            }
        }
    }

    /// Returns the indices of the tiles that have blocks of the set, each with the bits of these blocks.
    pub(crate) fn tiles(&self) -> impl Iterator<Item = (usize, u64)> + '_ {
        self.tiles.iter().copied().enumerate().filter(|(_, blocks)| *blocks != 0)
    }

    /// True if some block of the set may contain pixels of a box: minimum x and y, maximum x and y.
    pub(crate) fn touches(&self, [x0, y0, x1, y1]: [f64; 4]) -> bool {
        let (size, columns, rows) = (self.grid.tile_px(), i64::from(self.grid.columns), i64::from(self.grid.rows));
        // Blocks from the grid's origin. A box may be infinite; casts saturate.
        let block = |at: f64, axis: usize| {
            ((at - f64::from(self.grid.origin[axis])) / f64::from(BLOCK)).floor().clamp(-1.0, 1e9) as i64
        };
        let side = i64::from(size / BLOCK);
        let [x0, y0, x1, y1] = [block(x0, 0), block(y0, 1), block(x1, 0), block(y1, 1)];
        let (left, right) = (x0.max(0) / side, (x1.div_euclid(side) + 1).min(columns));
        let (top, bottom) = (y0.max(0) / side, (y1.div_euclid(side) + 1).min(rows));
        if left >= right || top >= bottom {
            return false;
        }
        let sum = |x: i64, y: i64| self.sums[y as usize * (columns as usize + 1) + x as usize];
        if sum(right, bottom) + sum(left, top) == sum(left, bottom) + sum(right, top) {
            return false;
        }
        if (right - left) * (bottom - top) > MAX_TILES {
            return true;
        }
        // If the tiles are few, they are tested block by block.
        let bits = |from: i64, to: i64, tile: i64| {
            let clip = |at: i64| (at - tile * side).clamp(0, side);
            (1u64 << clip(to + 1)) - (1u64 << clip(from))
        };
        (top..bottom).any(|row| {
            let rows = bits(y0, y1, row);
            (left..right).any(|column| {
                let blocks = self.tiles[(row * columns + column) as usize];
                let of_row = bits(x0, x1, column);
                let any = |y: u32| rows >> y & 1 == 1 && blocks >> (TILE_BLOCKS * y) & 0xff & of_row != 0;
                blocks != 0 && (0..TILE_BLOCKS).any(any)
            })
        })
    }
}

/// Largest number of tiles under a box for which [`BlockSet::touches`] tests the tiles' blocks one by one. With more, a
/// tile that has any block of the set suffices.
const MAX_TILES: i64 = 9;

/// The blocks of a grid that are drawn: all of them, or those of a set.
#[derive(Clone, Copy, Default)]
pub(crate) struct DrawnBlocks<'a>(Option<&'a BlockSet>);

impl<'a> DrawnBlocks<'a> {
    /// Returns the drawn blocks if only those of a set are drawn.
    pub(crate) fn some(blocks: &'a BlockSet) -> Self {
        Self(Some(blocks))
    }

    /// Returns the set of drawn blocks; `None` if all blocks are drawn.
    #[inline(always)]
    pub(crate) fn set(self) -> Option<&'a BlockSet> {
        self.0
    }

    /// Returns the bits of a tile's blocks that are drawn.
    #[inline(always)]
    pub(crate) fn of(self, tile: u32) -> u64 {
        self.0.map_or(u64::MAX, |set| set.tiles.get(tile as usize).copied().unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::xorshift::Xorshift;
    use surfel_render::Region;

    #[test]
    fn block_sets_touch_the_boxes_that_have_a_pixel_of_theirs() {
        let mut numbers = Xorshift::new();
        let mut random = move || numbers.share();
        let mut found = [0; 2];
        for tile_blocks in [2, 4, 8] {
            let region = Region { x: 21, y: 35, width: 200, height: 150 };
            let mut set = BlockSet::new(Grid::new(region, tile_blocks));
            let pixels: Vec<[i32; 2]> =
                (0..6).map(|_| [21.0 + 199.0 * random(), 35.0 + 149.0 * random()].map(|at| at as i32)).collect();
            pixels.iter().for_each(|&[x, y]| set.add(x, y));
            set.finish();
            assert_eq!(set.tiles().map(|(_, blocks)| blocks.count_ones()).sum::<u32>(), 6);
            for _ in 0..1000 {
                let (x, y) = (10.0 + 230.0 * random(), 20.0 + 180.0 * random());
                let (width, height) = (30.0 * random(), 30.0 * random());
                // A block's pixels, from its first to its last.
                let within = |&[px, py]: &[i32; 2]| {
                    let [bx, by] = [px, py].map(|at| f64::from(at / 4 * 4));
                    bx <= x + width && bx + 4.0 > x && by <= y + height && by + 4.0 > y
                };
                let expected = pixels.iter().any(within);
                let touches = set.touches([x, y, x + width, y + height]);
                // Over many tiles the test only finds whether one of them has any block.
                let is_exact = width.max(height) <= f64::from(2 * BLOCK * tile_blocks);
                assert!(touches == expected || (touches && !is_exact), "{x} {y} {width} {height}");
                found[usize::from(expected)] += 1;
            }
            assert!(set.touches([f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY]));
        }
        assert!(found.iter().all(|count| *count > 50), "{found:?}");
    }
}
