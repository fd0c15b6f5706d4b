//! Search for the blocks (4×4 pixels) of a tile that a footprint may touch. Tiles' lists store them as bit masks.
//!
//! A *record* is a splat projected to the screen ([`Record`]). A *tile* is a square of 8 to 32 pixels a side
//! ([`Grid`](crate::tiles::grid::Grid)).

use crate::setup::record::{BlockBox, Class, Record};
use crate::setup::rows::{Conic, HALF, MaskForms, Rows, SLACK};
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::bins::{Entries, Entry, Kind, OF_GROUP};
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::grid::{BLOCK, Grid, TILE_BLOCKS};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16, mask64x8, u64x8};
use surfel_math::{Real, V2};

/// Parameters of the search for touched blocks that all splats of a frame share.
#[derive(Clone, Copy)]
pub(crate) struct MaskForm<'a> {
    /// Blocks that are drawn. A tile without any of them gets no entries in its list.
    pub drawn: DrawnBlocks<'a>,
    /// True if depth is a linear function of pixels, so that the homogeneous coordinate w of the unfiltered footprint
    /// is 1.
    pub linear_depth: bool,
    /// True if footprints exceed their ellipses, as with the filter `clamp`, so that all blocks of their boxes count as
    /// touched.
    pub whole_box: bool,
}

/// Blocks that the splats of a group may touch. Each splat has a box of blocks and, if the box is no larger than a
/// tile, masks of the touched blocks in it.
pub(crate) struct Masks {
    /// First column, first row, end column and end row of each splat's box, in blocks from the grid's origin.
    boxes: [[i32; LANES]; 4],
    /// Bits of the splats whose box is larger than a tile. Their touched blocks are searched tile by tile when they are
    /// listed.
    large: u64,
    /// Bits of the splats that touch blocks in each of four tiles. The tiles are the first tile of a splat's box, the
    /// tile on its right, and the two tiles below these. Only for boxes no larger than a tile.
    filled: [u64; 4],
    /// Bits of the splats that may touch at least one block. Splats of [`Self::large`] are all included.
    touching: u64,
    /// Masks of the blocks that each splat may touch, in each of the same four tiles as in `filled`.
    blocks: [[u64; LANES]; 4],
    /// First tile of each splat's box, and the splat's kind, packed by [`Entry::place`].
    place: [i32; LANES],
}

/// Finds the blocks that the splats in `keep` may touch, from their ranges of pixels: first and end column, first and
/// end row.
#[inline(always)]
pub(crate) fn masks<S: Simd>(
    forms: &MaskForms<S>,
    [first_column, end_column, first_row, end_row]: [Lanes<S>; 4],
    keep: u64,
    grid: &Grid,
    form: MaskForm<'_>,
) -> Masks {
    let simd = first_column.0.simd;
    let k = |v: f32| Lanes::splat(simd, v);
    let origin = V2::new(k(grid.origin[0] as f32), k(grid.origin[1] as f32));
    let (x0, y0) = (block_of(first_column - origin.x), block_of(first_row - origin.y));
    // The end is one past the block of the last pixel: (end − 1 + BLOCK)/BLOCK, rounded down.
    let past = k(BLOCK as f32 - 1.0);
    let (x1, y1) = (block_of(end_column - origin.x + past), block_of(end_row - origin.y + past));
    let (width, height) = (x1 - x0, y1 - y0);
    let side = width.max(height);
    let (size, per_block) = (k(grid.tile_blocks as f32), k(1.0 / grid.tile_blocks as f32));
    let (column, row) = (Lanes((x0 * per_block).0.floor()), Lanes((y0 * per_block).0.floor()));
    let tile = V2::new(column * size, row * size);
    // Columns in the first tile and the next, relative to the first tile's side.
    let (left, right) = (x0 - tile.x, x1 - tile.x);
    let fits = side.le(size);
    let several = size.lt(right) | size.lt(y1 - tile.y);
    let of_box = Rows { left, right, height, bits: grid.tile_blocks };
    let wanted = k(2.0).lt(side) & fits;
    let blocks = if wanted.to_bitmask() & keep == 0 {
        of_box.up_to_two()
    } else {
        // Offset of the first block's first pixel from the tile's first pixel and from the anchor. Whole pixels are
        // exact.
        let first_y = (y0.mul_add(k(BLOCK as f32), origin.y) - forms.base.y) + forms.offset.y;
        let anchor_x = (forms.base.x - tile.x.mul_add(k(BLOCK as f32), origin.x)) - forms.offset.x;
        let conic = Conic::of(forms, anchor_x, first_y, k(2.0).le(width.min(height)) & fits);
        let conic = if form.whole_box { None } else { Some(&conic) };
        let [low_left, low_right] = of_box.four_rows(0, conic);
        let [high_left, high_right] = if (k(4.0).lt(height) & fits).to_bitmask() & keep == 0 {
            [i32x16::splat(simd, 0); 2]
        } else {
            of_box.four_rows(4, conic)
        };
        [[low_left, high_left], [low_right, high_right]]
    };
    let any = (blocks[0][0] | blocks[0][1]) | (blocks[1][0] | blocks[1][1]);
    let nothing: mask32x16<S> = any.simd_eq(i32x16::splat(simd, 0));
    let (tile_column, tile_row): (i32x16<S>, i32x16<S>) = (column.0.to_int(), row.0.to_int());
    let above: i32x16<S> = ((y0 - tile.y) * k(TILE_BLOCKS as f32)).0.to_int();
    let (blocks, filled) = in_tiles(blocks, above, several.to_bitmask() & keep != 0, grid);
    Masks {
        boxes: [int(x0), int(y0), int(x1), int(y1)],
        large: !fits.to_bitmask(),
        touching: !(fits & nothing).to_bitmask(),
        filled,
        blocks,
        place: (tile_row * i32x16::splat(simd, grid.columns as i32) + tile_column).to_array(),
    }
}

/// Distributes the touched blocks of each splat's box to the masks of up to four tiles. Returns the masks, and per tile
/// the bits of the splats whose mask isn't 0. `rows` has the blocks' columns, four rows at a time, in the first tile
/// and in the tile on its right. `above` is the number of bits before the box's first row.
#[inline(always)]
fn in_tiles<S: Simd>(
    rows: [[i32x16<S>; 2]; 2],
    above: i32x16<S>,
    several: bool,
    grid: &Grid,
) -> ([[u64; LANES]; 4], [u64; 4]) {
    let simd = above.simd;
    let bits = TILE_BLOCKS * grid.tile_blocks;
    let all = u64x8::splat(simd, u64::MAX >> (64 - bits));
    let most = u64x8::splat(simd, u64::from(bits - 1));
    let (left, right) = (pairs(rows[0]), pairs(rows[1]));
    let above = pairs([above, i32x16::splat(simd, 0)]);
    let (mut blocks, mut filled) = ([[0; LANES]; 4], [0; 4]);
    for half in 0..2 {
        let (left, right, here) = (left[half], right[half], above[half]);
        put((left << here) & all, half, (&mut blocks[0], &mut filled[0]));
        if several {
            // Shifted in two steps, since all rows may be above.
            let below = most - here;
            put((right << here) & all, half, (&mut blocks[1], &mut filled[1]));
            put((left >> 1) >> below, half, (&mut blocks[2], &mut filled[2]));
            put((right >> 1) >> below, half, (&mut blocks[3], &mut filled[3]));
        }
    }
    (blocks, filled)
}

/// Stores eight masks as the first or the second `half` of the sixteen masks `all`, and sets the bits of the nonzero
/// ones in `filled`.
#[inline(always)]
fn put<S: Simd>(numbers: u64x8<S>, half: usize, (all, filled): (&mut [u64; LANES], &mut u64)) {
    numbers.store_slice(&mut all[half * 8..half * 8 + 8]);
    let none: mask64x8<S> = numbers.simd_eq(u64x8::splat(numbers.simd, 0));
    *filled |= (!none.to_bitmask() & 0xff) << (8 * half);
}

/// Moves the low sixteen bits apart, so that bit i becomes bit 4·i.
#[inline(always)]
fn spread(bits: u64) -> u64 {
    let bits = (bits | bits << 24) & 0x0000_00ff_0000_00ff;
    let bits = (bits | bits << 12) & 0x000f_000f_000f_000f;
    let bits = (bits | bits << 6) & 0x0303_0303_0303_0303;
    (bits | bits << 3) & 0x1111_1111_1111_1111
}

/// Combines two vectors of 32-bit numbers to 64-bit numbers, with the first vector's in the low halves.
#[inline(always)]
fn pairs<S: Simd>([low, high]: [i32x16<S>; 2]) -> [u64x8<S>; 2] {
    [low.zip_low(high).bitcast(), low.zip_high(high).bitcast()]
}

#[inline(always)]
fn block_of<S: Simd>(pixels: Lanes<S>) -> Lanes<S> {
    Lanes((pixels * pixels.constant(1.0 / f64::from(BLOCK))).0.floor())
}

#[inline(always)]
fn int<S: Simd>(v: Lanes<S>) -> [i32; LANES] {
    let v: i32x16<S> = v.0.to_int();
    v.to_array()
}

impl Masks {
    /// Returns bits of the splats that may touch at least one block. The test is conservative.
    pub(crate) fn touching(&self) -> u64 {
        self.touching
    }

    /// Returns bits of the splats that may touch a block in `drawn`. Splats with a box larger than a tile are all
    /// included.
    #[inline(always)]
    pub(crate) fn drawn(&self, drawn: DrawnBlocks<'_>, grid: &Grid) -> u64 {
        if drawn.set().is_none() {
            return u64::MAX;
        }
        let mut found = self.large;
        for ((blocks, filled), next) in self.blocks.iter().zip(self.filled).zip(next_tiles(grid)) {
            let mut left = filled;
            while left != 0 {
                let i = left.trailing_zeros() as usize % LANES;
                left &= left - 1;
                found |= u64::from(blocks[i] & drawn.of((self.place[i] as u32).wrapping_add(next)) != 0) << i;
            }
        }
        found
    }

    /// Appends the tile entries of the splats in `keep`, whose records are consecutive from index `first` on.
    #[inline(always)]
    pub(crate) fn entries<S: Simd>(
        &self,
        simd: S,
        mut keep: u64,
        (records, first): (&[Record], u32),
        grid: &Grid,
        form: MaskForm<'_>,
        entries: &mut Entries,
    ) {
        if keep & self.large != 0 {
            let mut first = first;
            while keep != 0 {
                let i = keep.trailing_zeros() as usize % LANES;
                keep &= keep - 1;
                if let Some(record) = records.get(first as usize) {
                    self.list_tiles(simd, i, (record, first), grid, form, entries);
                }
                first += 1;
            }
            return;
        }
        let Some(room) = entries.room::<OF_GROUP>() else { return };
        let [here, beside, below, across] = self.filled;
        let mut left = spread(here & keep) | spread(below & keep) << 2;
        left |= spread(beside & keep) << 1 | spread(across & keep) << 3;
        let next = next_tiles(grid);
        let mut count = 0;
        // Splat by splat, since lists are in splat order.
        while left != 0 {
            let (i, tile) = (left.trailing_zeros() as usize / 4, left.trailing_zeros() as usize % 4);
            left &= left - 1;
            let before = (keep & ((1 << i) - 1)).count_ones();
            let place = self.place[i % LANES] as u32 + next[tile];
            room[count % OF_GROUP] = Entry::at(self.blocks[tile][i % LANES], first + before, place);
            count += 1;
        }
        entries.advance(count);
    }

    /// Marks splats as tiny in their entries: `two` has the bits of splats of 2×2 pixels, `three` those of 3×3. No
    /// splat may be marked yet.
    #[inline(always)]
    pub(crate) fn set_tiny(&mut self, [two, three]: [u64; 2]) {
        let (two, three) = (two as u32, (three & !two) as u32);
        for (i, place) in self.place.iter_mut().enumerate() {
            let kind = (two >> i & 1) * Kind::Tiny2 as u32 + (three >> i & 1) * Kind::Tiny3 as u32;
            *place |= Entry::place(0, kind) as i32;
        }
    }

    /// Appends the entry of every tile that splat `i` of the group may touch.
    #[inline(always)]
    pub(crate) fn list_tiles<S: Simd>(
        &self,
        simd: S,
        i: usize,
        (record, index): (&Record, u32),
        grid: &Grid,
        form: MaskForm<'_>,
        entries: &mut Entries,
    ) {
        if self.large >> i & 1 == 1 {
            self.list_large(simd, i, (record, index), grid, form, entries);
            return;
        }
        for (blocks, next) in self.blocks.iter().zip(next_tiles(grid)) {
            if blocks[i] != 0 {
                entries.push(Entry::at(blocks[i], index, self.place[i] as u32 + next));
            }
        }
    }

    /// Appends the entries of splat `i` of the group, whose box is larger than a tile.
    // If this code is inlined into the loops over splats, LLVM's output for Arm varies from build to build.
    #[inline(never)]
    fn list_large<S: Simd>(
        &self,
        simd: S,
        i: usize,
        record: (&Record, u32),
        grid: &Grid,
        form: MaskForm<'_>,
        entries: &mut Entries,
    ) {
        let blocks = BlockBox(self.boxes.map(|lanes| lanes[i] as u32));
        list_tiles(simd, record, blocks, grid, form, entries);
    }
}

/// Returns the differences of tile indices from a tile to itself, to the tile on its right, and to the two tiles below
/// these.
#[inline(always)]
fn next_tiles(grid: &Grid) -> [u32; 4] {
    [0, 1, grid.columns, grid.columns + 1]
}

/// Appends the entry of every tile that a record may touch, given the record's box of blocks.
#[inline(never)]
pub(crate) fn list_tiles<S: Simd>(
    simd: S,
    (record, index): (&Record, u32),
    blocks: BlockBox,
    grid: &Grid,
    form: MaskForm<'_>,
    entries: &mut Entries,
) {
    let [x0, y0, x1, y1] = blocks.0;
    // A tile has 2, 4 or 8 blocks a side: shifts replace a slow division by a number unknown at compile time.
    let (size, shift) = (grid.tile_blocks, grid.tile_blocks.trailing_zeros());
    let whole = form.whole_box || record.class() == Class::Near;
    simd.vectorize(
        #[inline(always)]
        || {
            for row in y0 >> shift..=(y1 - 1) >> shift {
                for column in x0 >> shift..=(x1 - 1) >> shift {
                    let (tile, number) = ([column * size, row * size], row * grid.columns + column);
                    let drawn = form.drawn.of(number);
                    if drawn == 0 {
                        continue;
                    }
                    let in_box = inside_box(blocks, tile, size);
                    if in_box & drawn == 0 {
                        continue;
                    }
                    let blocks = if whole { in_box } else { in_box & touched(simd, record, blocks, tile, grid, form) };
                    if blocks != 0 {
                        entries.push(Entry::new(blocks, index, number, Kind::Any));
                    }
                }
            }
        },
    );
}

/// Returns the range of a tile's blocks along one axis that a box covers, counted from the tile's first block. `size`
/// is the tile's side in blocks.
#[inline(always)]
fn clipped(blocks: BlockBox, tile: [u32; 2], axis: usize, size: u32) -> (u32, u32) {
    let clip = |value: u32| (value.max(tile[axis]) - tile[axis]).min(size);
    (clip(blocks.0[axis]), clip(blocks.0[axis + 2]))
}

/// Returns the mask of a tile's blocks that are inside a box, row by row, eight bits a row. `tile` is the tile's first
/// block.
#[inline(always)]
fn inside_box(blocks: BlockBox, tile: [u32; 2], size: u32) -> u64 {
    let ((x0, x1), (y0, y1)) = (clipped(blocks, tile, 0, size), clipped(blocks, tile, 1, size));
    let row = (1u64 << x1) - (1u64 << x0);
    // Bit 0 of every row from y0 up to y1.
    let rows = (0x0101_0101_0101_0101u64 >> (8 * (8 - (y1 - y0)))) << (8 * y0);
    row.wrapping_mul(rows)
}

/// Converts a mask of 4×4 blocks, four bits a row, to a tile's mask of eight bits a row. (x, y) is the first block in
/// the tile. Blocks beyond the tile's right side set unused columns of another row, which the caller masks off.
#[inline(always)]
fn in_rows_of_eight(bits: u64, x: u32, y: u32) -> u64 {
    let spread = (bits & 0xf) | (bits & 0xf0) << 4 | (bits & 0xf00) << 8 | (bits & 0xf000) << 12;
    spread << (TILE_BLOCKS * y + x)
}

/// Returns the mask of a tile's blocks that a record may touch, within the record's box `blocks`. `tile` is the tile's
/// first block.
#[inline(always)]
fn touched<S: Simd>(
    simd: S,
    record: &Record,
    blocks: BlockBox,
    tile: [u32; 2],
    grid: &Grid,
    form: MaskForm<'_>,
) -> u64 {
    let size = grid.tile_blocks;
    let ((x0, x1), (y0, y1)) = (clipped(blocks, tile, 0, size), clipped(blocks, tile, 1, size));
    let mut found = 0u64;
    for y in (y0..y1).step_by(4) {
        for x in (x0..x1).step_by(4) {
            let first = [tile[0] + x, tile[1] + y];
            found |= in_rows_of_eight(four_by_four(simd, record, first, grid.origin, form.linear_depth), x, y);
        }
    }
    found
}

/// Tests whether a record may touch each of 4×4 blocks, from block `first` on, and returns one bit per block.
#[inline(always)]
fn four_by_four<S: Simd>(simd: S, record: &Record, first: [u32; 2], origin_px: [u32; 2], linear: bool) -> u64 {
    let k = |v: f32| Lanes::splat(simd, v);
    let center = |axis: usize, base: f32, offset: f32| {
        let px = (origin_px[axis] + first[axis] * BLOCK) as f32;
        k((px - base) + (offset + HALF))
    };
    let step = k(BLOCK as f32);
    let d_x = Lanes::block_columns(simd).mul_add(step, center(0, record.base_x(), record.offset_x()));
    let d_y = Lanes::block_rows(simd).mul_add(step, center(1, record.base_y(), record.offset_y()));
    let r = record;
    let filtered = touches(d_x, d_y, [r.u_x(), r.u_y()], [r.v_x(), r.v_y()], [r.w_x(), r.w_y()]);
    let all = if r.is_filtered() {
        let visible_w = if linear { [0.0; 2] } else { [r.depth_x(), r.depth_y()] };
        filtered | touches(d_x, d_y, [r.visible_u_x(), r.visible_u_y()], [r.visible_v_x(), r.visible_v_y()], visible_w)
    } else {
        filtered
    };
    all.to_bitmask()
}

/// Returns a mask of the blocks in which a footprint may touch a pixel. `d_x` and `d_y` are the offsets of the blocks'
/// centres from the footprint's, in pixels. The other arguments are the gradients of its forms u·w', v·w' and w'.
#[inline(always)]
fn touches<S: Simd>(d_x: Lanes<S>, d_y: Lanes<S>, u: [f32; 2], v: [f32; 2], w: [f32; 2]) -> mask32x16<S> {
    let k = |v: f32| Lanes::splat(d_x.0.simd, v);
    let zero = k(0.0);
    let (u_reach, v_reach, w_reach) = (reach(u), reach(v), reach(w));
    let u = (d_x.mul_add(k(u[0]), d_y * k(u[1])).abs() - k(u_reach)).max(zero);
    let v = (d_x.mul_add(k(v[0]), d_y * k(v[1])).abs() - k(v_reach)).max(zero);
    let w = d_x.mul_add(k(w[0]), d_y.mul_add(k(w[1]), k(1.0 + w_reach))).max(zero);
    u.mul_add(u, v * v).le(w * w * k(1.0 + SLACK))
}

/// Returns the largest change of a linear form from a block's centre to the pixel centres at its corners.
#[inline(always)]
fn reach(gradient: [f32; 2]) -> f32 {
    (HALF + SLACK) * (gradient[0].abs() + gradient[1].abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};
    use crate::simd::xorshift::Xorshift;
    use surfel_math::bounds;
    use surfel_math::mapping::Footprint;
    use surfel_render::Region;

    /// Returns the number of blocks that sixteen random ellipses touch, and the number found for them.
    #[inline(always)]
    fn check<S: Simd>(simd: S, grid: &Grid, random: &mut impl FnMut() -> f64) -> [usize; 2] {
        let form = MaskForm { drawn: DrawnBlocks::default(), linear_depth: false, whole_box: false };
        let mut numbers = [[0.0f32; LANES]; 13];
        let mut footprints = Vec::new();
        for i in 0..LANES {
            let center = V2::new(96.0 * random(), 80.0 * random());
            let (angle, long) = (6.3 * random(), 0.5 + 15.0 * random());
            let (sine, cosine, short) = (angle.sin(), angle.cos(), 0.1 + random() * long);
            let slope = V2::new(0.2 * random(), 0.2 * random());
            let (s, t) = (V2::new(long * cosine, long * sine), V2::new(-short * sine, short * cosine));
            let f = Footprint::about_center(s, t, s.cross(t), slope);
            let e = bounds::footprint(&f);
            let pixels = |from: f64, to: f64, start: u32, length: u32| {
                let (least, most) = (f64::from(start), f64::from(start + length));
                [(from - 0.5).ceil().clamp(least, most) as f32, ((to - 0.5).floor() + 1.0).clamp(least, most) as f32]
            };
            let r = grid.region;
            let columns = pixels(center.x + e.min.x, center.x + e.max.x, r.x, r.width);
            let rows = pixels(center.y + e.min.y, center.y + e.max.y, r.y, r.height);
            let base = [center.x.floor() as f32, center.y.floor() as f32];
            let offset = [base[0] + 0.5 - center.x as f32, base[1] + 0.5 - center.y as f32];
            let (u, v) = ([f.u.x as f32, f.u.y as f32], [f.v.x as f32, f.v.y as f32]);
            let w = (1.0 / (1.0 - slope.length())) as f32;
            let all = [&columns[..], &rows[..], &base[..], &offset[..], &u[..], &v[..], &[w]].concat();
            numbers.iter_mut().zip(all).for_each(|(lanes, number)| lanes[i] = number);
            footprints.push((center, f, columns, rows));
        }
        let n = numbers.map(|lanes| Lanes::load(simd, &lanes));
        let forms = MaskForms {
            base: V2::new(n[4], n[5]),
            offset: V2::new(n[6], n[7]),
            u: V2::new(n[8], n[9]),
            v: V2::new(n[10], n[11]),
            w: n[12],
        };
        let drawn = (n[0].lt(n[1]) & n[2].lt(n[3])).to_bitmask();
        let masks = masks(&forms, [n[0], n[1], n[2], n[3]], drawn, grid, form);
        let keep = drawn & masks.touching() & !masks.large;
        let mut entries = Entries::default();
        masks.entries(simd, keep, (&[], 0), grid, form, &mut entries);
        let (mut touched, lanes) = (0, (0..LANES).filter(|i| keep >> i & 1 == 1));
        for (record, i) in lanes.enumerate() {
            let (center, f, columns, rows) = &footprints[i];
            let mut blocks = std::collections::BTreeSet::new();
            for (x, y) in (rows[0] as u32..rows[1] as u32)
                .flat_map(|y| (columns[0] as u32..columns[1] as u32).map(move |x| (x, y)))
            {
                if f.contains(V2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - *center) {
                    let tile = grid.tile_of(x as i32, y as i32);
                    let at = [x, y].map(|px| px % grid.tile_px() / BLOCK);
                    blocks.insert((tile, TILE_BLOCKS * at[1] + at[0]));
                }
            }
            touched += blocks.len();
            for (tile, block) in blocks {
                let has = |e: &&Entry| e.record as usize == record && e.tile() == tile && e.blocks >> block & 1 == 1;
                assert_eq!(entries.iter().filter(has).count(), 1, "block {block} of tile {tile}: {center:?} {f:?}");
            }
        }
        [touched, entries.iter().map(|e| e.blocks.count_ones() as usize).sum()]
    }

    #[test]
    fn every_block_with_a_pixel_of_a_footprint_is_found_and_few_others() {
        let mut numbers = Xorshift::new();
        let mut random = move || numbers.share();
        for &level in SimdLevel::ALL {
            for tile_blocks in [2, 4, 8] {
                let grid = Grid::new(Region { x: 3, y: 5, width: 90, height: 71 }, tile_blocks);
                let [mut touched, mut found] = [0; 2];
                for _ in 0..200 {
                    let instructions = Instructions::new(level).unwrap();
                    let counts = with_instructions!(instructions, simd => check(simd, &grid, &mut random));
                    touched += counts[0];
                    found += counts[1];
                }
                // Slopes of up to 0.28 widen an ellipse by up to 1.4, and small boxes, of two blocks, count as a whole.
                assert!(touched > 1000 && (found as f64) < 1.35 * touched as f64, "{touched} {found}");
            }
        }
    }
}
