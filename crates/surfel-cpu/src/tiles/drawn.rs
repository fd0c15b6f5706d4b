//! Which blocks of a grid are drawn, where it isn't all of them.

use crate::tiles::grid::{BLOCK, Grid, TILE_BLOCKS};

/// Some blocks of a grid, and where there are any.
pub(crate) struct BlockSet {
    pub grid: Grid,
    /// A bit for each of a tile's blocks.
    tiles: Vec<u64>,
    /// How many they are.
    pub count: u64,
}

impl BlockSet {
    /// None yet.
    pub(crate) fn new(grid: Grid) -> Self {
        Self { grid, tiles: vec![0; grid.tiles()], count: 0 }
    }

    /// Adds the block that holds a pixel of the grid's region.
    pub(crate) fn add(&mut self, x: i32, y: i32) {
        let [column, row] = [x, y].map(|px| px as u32 / BLOCK % self.grid.tile_blocks);
        if let Some(blocks) = self.tiles.get_mut(self.grid.tile_of(x, y)) {
            let block = 1 << (TILE_BLOCKS * row + column);
            self.count += u64::from(*blocks & block == 0);
            *blocks |= block;
        }
    }

    /// Tiles that have any, each with its blocks as bits.
    pub(crate) fn tiles(&self) -> impl Iterator<Item = (usize, u64)> + '_ {
        self.tiles.iter().copied().enumerate().filter(|(_, blocks)| *blocks != 0)
    }
}

/// Some pixels of a grid.
pub(crate) struct PixelSet {
    grid: Grid,
    /// Tile by tile, row by row, a bit each.
    rows: Vec<[u32; TILE_PX]>,
    /// Blocks that have any.
    blocks: BlockSet,
}

/// Pixels along a tile's side, at most.
const TILE_PX: usize = (TILE_BLOCKS * BLOCK) as usize;

impl PixelSet {
    /// Those of the tiles' rows, as bits.
    pub(crate) fn new(grid: Grid, rows: Vec<[u32; TILE_PX]>) -> Self {
        let mut blocks = BlockSet::new(grid);
        for (tile, rows) in rows.iter().enumerate() {
            let set = &mut blocks.tiles[tile];
            for (y, row) in rows.iter().enumerate().filter(|(_, row)| **row != 0) {
                // Whether any of each four.
                let any = row | row >> 1;
                let any = (any | any >> 2) & 0x1111_1111;
                // Bits 0, 4, 8, … one after another.
                let any = (any | any >> 3) & 0x0303_0303;
                let any = (any | any >> 6) & 0x000f_000f;
                *set |= u64::from((any | any >> 12) & 0xff) << (TILE_BLOCKS * (y as u32 / BLOCK));
            }
            blocks.count += u64::from(set.count_ones());
        }
        Self { grid, rows, blocks }
    }

    /// Each of them.
    pub(crate) fn for_each(&self, mut visit: impl FnMut(i32, i32)) {
        for (tile, blocks) in self.blocks.tiles.iter().enumerate().filter(|(_, blocks)| **blocks != 0) {
            let ((x, y), mut rows) = (self.grid.block_px(tile, 0), *blocks);
            while rows != 0 {
                let row = rows.trailing_zeros() / TILE_BLOCKS * BLOCK;
                rows &= u64::MAX.checked_shl(2 * (row + BLOCK)).unwrap_or_default();
                for (y, bits) in (y + row as i32..).zip(&self.rows[tile][row as usize..(row + BLOCK) as usize]) {
                    let mut left = *bits;
                    while left != 0 {
                        visit(x + left.trailing_zeros() as i32, y);
                        left &= left - 1;
                    }
                }
            }
        }
    }

    /// True if one of them lies in a box inside the grid's region: first column and row, last column and row. If not
    /// exactly, then if one may, of the same blocks.
    #[inline(always)]
    pub(crate) fn touches(&self, pixels: [i32; 4], exactly: bool) -> bool {
        let (size, shift) = (self.grid.tile_blocks, self.grid.tile_blocks.trailing_zeros());
        let [ox, oy] = self.grid.origin;
        let [x0, y0, x1, y1] = [(0, ox), (1, oy), (2, ox), (3, oy)].map(|(i, o)| (pixels[i] as u32).saturating_sub(o));
        let blocks = [x0 / BLOCK, y0 / BLOCK, x1 / BLOCK + 1, y1 / BLOCK + 1];
        for row in y0 / BLOCK >> shift..=y1 / BLOCK >> shift {
            for column in x0 / BLOCK >> shift..=x1 / BLOCK >> shift {
                let tile = (row * self.grid.columns + column) as usize;
                let set = self.blocks.tiles.get(tile).copied().unwrap_or_default();
                if set == 0 || set & box_in_tile(blocks, [column * size, row * size], size) == 0 {
                    continue;
                }
                if !exactly {
                    return true;
                }
                let (x, y, px) = (column * size * BLOCK, row * size * BLOCK, size * BLOCK);
                let [first_x, first_y] = [x0.max(x) - x, y0.max(y) - y];
                let [end_x, end_y] = [(x1 + 1 - x).min(px), (y1 + 1 - y).min(px)];
                let columns = ((1u64 << end_x) - (1u64 << first_x)) as u32;
                let rows = self.rows[tile].get(first_y as usize..end_y as usize).unwrap_or_default();
                if rows.iter().any(|row| row & columns != 0) {
                    return true;
                }
            }
        }
        false
    }
}

/// A bit for each block of a tile inside a box, row by row, eight bits a row: the box's first column and row, end
/// column and row, and the tile's first block.
#[inline(always)]
pub(crate) fn box_in_tile(blocks: [u32; 4], tile: [u32; 2], size: u32) -> u64 {
    let clip = |value: u32, axis: usize| (value.max(tile[axis]) - tile[axis]).min(size);
    let ((x0, x1), (y0, y1)) = ((clip(blocks[0], 0), clip(blocks[2], 0)), (clip(blocks[1], 1), clip(blocks[3], 1)));
    let row = (1u64 << x1) - (1u64 << x0);
    // Bit 0 of every row from y0 up to y1.
    let rows = (0x0101_0101_0101_0101u64 >> (8 * (8 - (y1 - y0)))) << (8 * y0);
    row.wrapping_mul(rows)
}

/// Which blocks of a grid's tiles are drawn.
#[derive(Clone, Copy, Default)]
pub(crate) struct DrawnBlocks<'a>(Option<&'a BlockSet>);

impl<'a> DrawnBlocks<'a> {
    /// Some of them.
    pub(crate) fn some(blocks: &'a BlockSet) -> Self {
        Self(Some(blocks))
    }

    /// Which, if it isn't all of them.
    #[inline(always)]
    pub(crate) fn set(self) -> Option<&'a BlockSet> {
        self.0
    }

    /// A tile's, as bits.
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
    fn pixel_sets_touch_the_boxes_that_have_a_pixel_of_theirs() {
        let mut numbers = Xorshift::new();
        let mut random = move || numbers.share();
        let mut found = [[0; 2]; 2];
        for tile_blocks in [2, 4, 8] {
            let region = Region { x: 21, y: 35, width: 200, height: 150 };
            let grid = Grid::new(region, tile_blocks);
            let mut rows = vec![[0; TILE_PX]; grid.tiles()];
            let mut pixels: Vec<[i32; 2]> =
                (0..6).map(|_| [21.0 + 199.0 * random(), 35.0 + 149.0 * random()].map(|at| at as i32)).collect();
            for &[x, y] in &pixels {
                let tile = grid.tile_of(x, y);
                let (first_x, first_y) = grid.block_px(tile, 0);
                rows[tile][(y - first_y) as usize] |= 1 << (x - first_x);
            }
            let set = PixelSet::new(grid, rows);
            let mut visited = Vec::new();
            set.for_each(|x, y| visited.push([x, y]));
            pixels.sort_unstable();
            visited.sort_unstable();
            assert_eq!(visited, pixels);
            for _ in 0..1000 {
                let [x, y] = [21.0 + 180.0 * random(), 35.0 + 130.0 * random()].map(|at| at as i32);
                let [width, height] = [20.0 * random(), 20.0 * random()].map(|at| at as i32);
                for (exactly, side) in [(false, 4), (true, 1)] {
                    // A block's pixels from its first to its last.
                    let within = |&[px, py]: &[i32; 2]| {
                        let [bx, by] = [px, py].map(|at| at / side * side);
                        bx <= x + width && bx + side > x && by <= y + height && by + side > y
                    };
                    let expected = pixels.iter().any(within);
                    let touches = set.touches([x, y, x + width, y + height], exactly);
                    assert_eq!(touches, expected, "{x} {y} {width} {height} {exactly}");
                    found[usize::from(exactly)][usize::from(expected)] += 1;
                }
            }
            assert!(set.touches([21, 35, 220, 184], true));
        }
        assert!(found.as_flattened().iter().all(|count| *count > 50), "{found:?}");
    }
}
