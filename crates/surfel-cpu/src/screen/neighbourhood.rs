//! Values of a tile's pixels and of the pixels around it, in one array. Screen-space passes compare sixteen pixels of a
//! row at a time.
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::screen::gbuffer::{BLOCKS, Marks, SIDE, TileRows};
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::grid::{BLOCK, Grid, Rect, TILE_BLOCKS};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use surfel_math::Real;

/// Number of rows stored above and below a tile: the largest distance at which a pass reads neighbours.
const ROWS_AROUND: usize = 2;

/// Number of columns stored on either side of a tile. On the left, passes read two of them. On the right, a load of
/// sixteen pixels may start two pixels past the start of the tile's last sixteen.
const COLUMNS_AROUND: usize = 8;

/// Number of blocks that sixteen pixels of a row span.
const BLOCKS_PER_LOAD: u32 = LANES as u32 / BLOCK;

/// Values of a plane in a tile's pixels and in the pixels around it.
#[repr(align(64))]
pub(crate) struct Neighbourhood([[f32; SIDE + 2 * COLUMNS_AROUND]; SIDE + 2 * ROWS_AROUND]);

impl Default for Neighbourhood {
    fn default() -> Self {
        Self([[0.0; SIDE + 2 * COLUMNS_AROUND]; SIDE + 2 * ROWS_AROUND])
    }
}

impl Neighbourhood {
    /// Loads the values of a tile and of `reach` pixels around it. Empty pixels get +∞. Pixels outside the grid's
    /// region, such as those outside the image, get `outside`.
    pub(crate) fn load(
        &mut self,
        plane: &[TileRows],
        grid: &Grid,
        tile: usize,
        marks: impl Fn(usize) -> Marks,
        reach: i32,
        outside: f32,
    ) {
        let (size, columns) = (grid.tile_px() as i32, grid.columns as i32);
        let (column, row) = (tile as i32 % columns, tile as i32 / columns);
        let first_x = grid.origin[0] as i32 + column * size;
        let first_y = grid.origin[1] as i32 + row * size;
        self.0.as_flattened_mut().fill(outside);
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
            if !(0..columns).contains(&(column + dx)) || !(0..grid.rows as i32).contains(&(row + dy)) {
                continue;
            }
            let other = ((row + dy) * columns + column + dx) as usize;
            // From here on, coordinates are relative to this tile's first pixel.
            let rect = Rect::of_tile(grid, other, grid.region);
            let (x0, x1) = ((rect.x - first_x).max(-reach), (rect.end_x - first_x).min(size + reach));
            let (y0, y1) = ((rect.y - first_y).max(-reach), (rect.end_y - first_y).min(size + reach));
            if x0 >= x1 {
                continue;
            }
            let from = plane.get(other).filter(|_| marks(other).touched != 0);
            let (left, end) = ((x0 - dx * size) as usize, (x1 - dx * size) as usize);
            for y in y0..y1 {
                let to = &mut self.0[(y + ROWS_AROUND as i32) as usize];
                let to = &mut to[(x0 + COLUMNS_AROUND as i32) as usize..(x1 + COLUMNS_AROUND as i32) as usize];
                match from {
                    Some(from) => to.copy_from_slice(&from.0[(y - dy * size) as usize][left..end]),
                    None => to.fill(f32::INFINITY),
                }
            }
        }
    }

    /// Loads sixteen values of row `y` from column `x` on, relative to the tile, which may be up to two pixels outside
    /// it. Lanes more than two columns beyond the tile are meaningless.
    #[inline(always)]
    pub(crate) fn row<S: Simd>(&self, simd: S, x: i32, y: i32) -> Lanes<S> {
        let row = self.0.get((y + ROWS_AROUND as i32) as usize);
        let at = (x + COLUMNS_AROUND as i32) as usize;
        Lanes::load(simd, row.and_then(|row| row.get(at..)).unwrap_or_default())
    }

    /// Returns the value of the pixel (x, y), relative to the tile, which may be up to two pixels outside it.
    pub(crate) fn at(&self, x: i32, y: i32) -> f32 {
        let row = self.0.get((y + ROWS_AROUND as i32) as usize);
        row.and_then(|row| row.get((x + COLUMNS_AROUND as i32) as usize)).copied().unwrap_or(f32::INFINITY)
    }

    /// Loads the values of 4×4 pixels from pixel (x, y) on, relative to the tile, which may be up to two pixels outside
    /// it.
    #[inline(always)]
    pub(crate) fn block<S: Simd>(&self, simd: S, x: i32, y: i32) -> Lanes<S> {
        let mut values = [0.0; LANES];
        let at = (x + COLUMNS_AROUND as i32) as usize;
        let rows = self.0.iter().skip((y + ROWS_AROUND as i32) as usize);
        for (four, row) in values.chunks_exact_mut(4).zip(rows) {
            if let Some(numbers) = row.get(at..at + 4) {
                four.copy_from_slice(numbers);
            }
        }
        Lanes::load(simd, &values)
    }

    /// Finds the pixels of the `wanted` blocks that have a neighbour beyond their own surface. A pixel's bit is set in
    /// `steps` if its value in `own` is below the maximum of its 3×3 neighbourhood.
    #[inline(always)]
    pub(crate) fn steps<S: Simd>(&self, simd: S, own: &TileRows, wanted: u64, steps: &mut [u16; BLOCKS]) {
        for first in (0..BLOCKS as u32).step_by(BLOCKS_PER_LOAD as usize) {
            let abreast = wanted >> first & ((1 << BLOCKS_PER_LOAD) - 1);
            if abreast == 0 {
                continue;
            }
            let x = (first % TILE_BLOCKS * BLOCK) as i32;
            let y = (first / TILE_BLOCKS * BLOCK) as i32;
            // Maxima of three pixels in a row: for the row above, the block's four rows, and the row below.
            let mut rows = [Lanes::splat(simd, 0.0); BLOCK as usize + 2];
            for (row, y) in rows.iter_mut().zip(y - 1..) {
                *row = self.row(simd, x - 1, y).max(self.row(simd, x, y)).max(self.row(simd, x + 1, y));
            }
            for j in 0..BLOCK as usize {
                let greatest = rows[j].max(rows[j + 1]).max(rows[j + 2]);
                let own = Lanes::load(simd, &own.0[y as usize + j][x as usize..]);
                let bits = own.lt(greatest).to_bitmask();
                if bits == 0 {
                    continue;
                }
                for block in 0..BLOCKS_PER_LOAD {
                    let four = bits >> (BLOCK * block) & 0xf & (abreast >> block & 1).wrapping_neg();
                    steps[(first + block) as usize % BLOCKS] |= (four << (BLOCK as usize * j)) as u16;
                }
            }
        }
    }
}
