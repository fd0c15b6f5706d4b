//! Which blocks of a tile a footprint may touch.

use crate::bins::{BLOCK, Entry, Grid, Kind, TILE_BLOCKS};
use crate::lanes::{LANES, Lanes};
use crate::record::{BlockBox, Class, Record};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::{Real, V2};

/// Half of a block's extent between pixel centres.
const HALF: f32 = 1.5;

/// Slack of the test, in pixels and relative. Rounding of the forms is far below it, so that no block is lost whose pixels
/// find themselves inside; a block too many costs time and nothing else.
const SLACK: f32 = 2e-3;

/// How footprints are tested, from the plan.
#[derive(Clone, Copy)]
pub(crate) struct MaskForm {
    /// Depth is linear over pixels, and w of the unfiltered footprint 1.
    pub linear_depth: bool,
    /// Footprints are not their ellipse alone: the box counts.
    pub whole_box: bool,
}

/// Boxes of blocks that sixteen splats may touch, and which blocks of small boxes they do.
pub(crate) struct Masks {
    /// First column, first row, end column, end row, in blocks from the grid's origin.
    boxes: [[i32; LANES]; 4],
    /// Sixteen bits for the 4×4 blocks from a box's first on. All set where they weren't tested.
    bits: [i32; LANES],
    /// Splats, as bits, whose box is small and in one tile, and of them those that touch a block. Their `bits` are those in the
    /// box.
    alone: u64,
    touching: u64,
    /// Their tile, and where their first block is in it.
    tile: [i32; LANES],
    shift: [i32; LANES],
    /// Which of them are dots of four pixels, and of nine, as bits; none yet.
    pub dots: [u64; 2],
}

/// A filtered footprint and an unfiltered one over pixels, about their anchors.
pub(crate) struct MaskForms<S: Simd> {
    /// From the anchor to its pixel's centre, and that pixel.
    pub offset: V2<Lanes<S>>,
    pub base: V2<Lanes<S>>,
    /// Gradients of (u·w', v·w', w').
    pub filtered: [V2<Lanes<S>>; 3],
    pub visible: [V2<Lanes<S>>; 3],
    /// Splats of which both footprints count, as bits.
    pub general: u64,
}

/// Finds the blocks of the splats in `keep` from their ranges of pixels.
#[inline(always)]
pub(crate) fn masks<S: Simd>(
    forms: &MaskForms<S>,
    [first_column, end_column, first_row, end_row]: [Lanes<S>; 4],
    keep: u64,
    grid: &Grid,
    form: MaskForm,
) -> Masks {
    let k = |v: f32| first_column.constant(f64::from(v));
    let (x, y) = (k(grid.origin[0] as f32), k(grid.origin[1] as f32));
    let (x0, y0) = (block_of(first_column - x), block_of(first_row - y));
    // The end is one past the block of the last pixel: (end − 1 + BLOCK)/BLOCK, rounded down.
    let past = k(BLOCK as f32 - 1.0);
    let (x1, y1) = (block_of(end_column - x + past), block_of(end_row - y + past));
    let side = (x1 - x0).max(y1 - y0);
    let tested = k(2.0).lt(side) & side.le(k(4.0));
    let simd = first_column.0.simd;
    let all = i32x16::splat(simd, 0xffff);
    let wanted = tested.to_bitmask() & keep;
    let bits = if form.whole_box || wanted == 0 {
        all
    } else {
        // Centre of the first block, from the anchor. Whole pixels are exact.
        let center = V2::new(
            (x0.mul_add(k(BLOCK as f32), x) - forms.base.x) + (forms.offset.x + k(HALF)),
            (y0.mul_add(k(BLOCK as f32), y) - forms.base.y) + (forms.offset.y + k(HALF)),
        );
        let mut bits = four_by_four_each(&forms.filtered, center);
        if forms.general & wanted != 0 {
            bits |= four_by_four_each(&forms.visible, center);
        }
        tested.select(bits, all)
    };
    let one = k(1.0);
    let (size, per_block) = (k(grid.tile_blocks as f32), k(1.0 / grid.tile_blocks as f32));
    let tile_of = |block: Lanes<S>| Lanes((block * per_block).0.floor());
    let (column, row) = (tile_of(x0), tile_of(y0));
    let alone = side.le(k(4.0)) & tile_of(x1 - one).le(column) & tile_of(y1 - one).le(row);
    // Whole numbers below 2^24 are exact: the bits of the box's first row, times one bit for each row.
    let (width, height) = (x1 - x0, y1 - y0);
    let row_bits = one + if_more(width, 1.0, 2.0) + if_more(width, 2.0, 4.0) + if_more(width, 3.0, 8.0);
    let rows = one + if_more(height, 1.0, 16.0) + if_more(height, 2.0, 256.0) + if_more(height, 3.0, 4096.0);
    let in_box: i32x16<S> = (row_bits * rows).0.to_int();
    let bits = alone.select(bits & in_box, bits);
    let nothing: mask32x16<S> = bits.simd_eq(i32x16::splat(simd, 0));
    let shift = (y0 - row * size).mul_add(k(TILE_BLOCKS as f32), x0 - column * size);
    let (column, row): (i32x16<S>, i32x16<S>) = (column.0.to_int(), row.0.to_int());
    let tile = row * i32x16::splat(simd, grid.columns as i32) + column;
    Masks {
        boxes: [int(x0), int(y0), int(x1), int(y1)],
        bits: bits.to_array(),
        alone: alone.to_bitmask(),
        touching: !(alone & nothing).to_bitmask(),
        tile: tile.to_array(),
        shift: int(shift),
        dots: [0; 2],
    }
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

/// A number where the value is greater than a limit, else 0.
#[inline(always)]
fn if_more<S: Simd>(value: Lanes<S>, limit: f32, number: f32) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(value.0.simd, v);
    Lanes::select(k(limit).lt(value), k(number), k(0.0))
}

/// Sixteen bits for sixteen splats: whether a footprint may reach a pixel of the 4×4 blocks of which the first has this
/// centre.
#[inline(always)]
fn four_by_four_each<S: Simd>([u, v, w]: &[V2<Lanes<S>>; 3], center: V2<Lanes<S>>) -> i32x16<S> {
    let simd = center.x.0.simd;
    let k = |v: f32| Lanes::splat(simd, v);
    let (zero, slack) = (k(0.0), k(1.0 + SLACK));
    let (u_reach, v_reach) = (reach_each(u), reach_each(v));
    let w_reach = reach_each(w) + k(1.0);
    let step = k(BLOCK as f32);
    let mut bits = i32x16::splat(simd, 0);
    let mut y = center.y;
    for row in 0..4 {
        let (u_row, v_row, w_row) = (u.y * y, v.y * y, w.y.mul_add(y, w_reach));
        let mut x = center.x;
        for column in 0..4 {
            let u = (u.x.mul_add(x, u_row).abs() - u_reach).max(zero);
            let v = (v.x.mul_add(x, v_row).abs() - v_reach).max(zero);
            let w = w.x.mul_add(x, w_row).max(zero);
            let touches = u.mul_add(u, v * v).le(w * w * slack);
            bits = touches.select(bits | i32x16::splat(simd, 1 << (4 * row + column)), bits);
            x = x + step;
        }
        y = y + step;
    }
    bits
}

/// How far a form may move from a block's centre to its corners.
#[inline(always)]
fn reach_each<S: Simd>(gradient: &V2<Lanes<S>>) -> Lanes<S> {
    (gradient.x.abs() + gradient.y.abs()) * gradient.x.constant(f64::from(HALF + SLACK))
}

impl Masks {
    /// Which splats may touch a block, as bits; some that don't may be among them.
    pub(crate) fn touching(&self) -> u64 {
        self.touching
    }

    /// Calls `visit` with the entries of the splats in `keep`, whose records lie one after another from `first` on.
    #[inline(always)]
    pub(crate) fn entries<S: Simd>(
        &self,
        simd: S,
        mut keep: u64,
        (records, mut first): (&[Record], u32),
        grid: &Grid,
        form: MaskForm,
        mut visit: impl FnMut(Entry),
    ) {
        while keep != 0 {
            let i = keep.trailing_zeros() as usize % LANES;
            keep &= keep - 1;
            if self.alone >> i & 1 == 1 {
                let blocks = spread(self.bits[i] as u64) << (self.shift[i] & 63);
                visit(Entry::new(blocks, first, self.tile[i] as u32, self.kind(i)));
            } else if let Some(record) = records.get(first as usize) {
                for_tiles(simd, (record, first), (self.of(i), self.kind(i)), grid, form, &mut visit);
            }
            first += 1;
        }
    }

    #[inline(always)]
    fn kind(&self, i: usize) -> Kind {
        match self.dots.map(|bits| bits >> i & 1) {
            [1, _] => Kind::Four,
            [_, 1] => Kind::Nine,
            _ => Kind::Any,
        }
    }

    /// The box of one splat.
    #[inline(always)]
    fn of(&self, i: usize) -> (BlockBox, u64) {
        let [x0, y0, x1, y1] = [self.boxes[0][i], self.boxes[1][i], self.boxes[2][i], self.boxes[3][i]];
        (BlockBox([x0 as u32, y0 as u32, x1 as u32, y1 as u32]), self.bits[i] as u64)
    }

    /// Calls `visit` with the entry of every tile that splat `i` may touch.
    #[inline(always)]
    pub(crate) fn for_tiles<S: Simd>(
        &self,
        simd: S,
        i: usize,
        (record, index): (&Record, u32),
        grid: &Grid,
        form: MaskForm,
        visit: impl FnMut(Entry),
    ) {
        for_tiles(simd, (record, index), (self.of(i), self.kind(i)), grid, form, visit);
    }
}

/// Calls `visit` with the entry of every tile that a record may touch, given its box and the bits of the first 4×4 blocks.
#[inline(always)]
pub(crate) fn for_tiles<S: Simd>(
    simd: S,
    (record, index): (&Record, u32),
    ((blocks, bits), kind): ((BlockBox, u64), Kind),
    grid: &Grid,
    form: MaskForm,
    mut visit: impl FnMut(Entry),
) {
    let [x0, y0, x1, y1] = blocks.0;
    // A tile has 2, 4 or 8 blocks a side: division by a number that isn't known when this is compiled takes long.
    let (size, shift) = (grid.tile_blocks, grid.tile_blocks.trailing_zeros());
    let large = (x1 - x0).max(y1 - y0) > 4;
    let whole = large && (form.whole_box || record.class() == Class::Near);
    for row in y0 >> shift..=(y1 - 1) >> shift {
        for column in x0 >> shift..=(x1 - 1) >> shift {
            let tile = [column * size, row * size];
            let in_box = inside_box(blocks, tile, size);
            let blocks = if !large {
                in_box & placed(bits, x0 as i32 - tile[0] as i32, y0 as i32 - tile[1] as i32)
            } else if whole {
                in_box
            } else {
                in_box & touched(simd, record, blocks, tile, grid, form)
            };
            if blocks != 0 {
                visit(Entry::new(blocks, index, row * grid.columns + column, kind));
            }
        }
    }
}

/// The part of a tile's range along one axis that a box covers, in blocks.
#[inline(always)]
fn clipped(blocks: BlockBox, tile: [u32; 2], axis: usize, size: u32) -> (u32, u32) {
    let clip = |value: u32| (value.max(tile[axis]) - tile[axis]).min(size);
    (clip(blocks.0[axis]), clip(blocks.0[axis + 2]))
}

/// A bit for each block of a tile inside a box, row by row, eight bits a row; `tile` is the tile's first block.
#[inline(always)]
fn inside_box(blocks: BlockBox, tile: [u32; 2], size: u32) -> u64 {
    let ((x0, x1), (y0, y1)) = (clipped(blocks, tile, 0, size), clipped(blocks, tile, 1, size));
    let row = (1u64 << x1) - (1u64 << x0);
    // Bit 0 of every row from y0 up to y1.
    let rows = (0x0101_0101_0101_0101u64 >> (8 * (8 - (y1 - y0)))) << (8 * y0);
    row.wrapping_mul(rows)
}

/// Bits of 4×4 blocks, four a row, from block (x, y) of a tile on, which may lie up to three before it. What runs over the
/// tile's right side comes out in another row's unused columns: the caller knows which columns count.
#[inline(always)]
fn placed(bits: u64, x: i32, y: i32) -> u64 {
    // Columns before the tile are shifted out row by row, before the rows get their distance.
    let bits = if x < 0 { bits >> -x & (0x1111 * (0xf >> -x)) } else { bits };
    let spread = spread(bits);
    let at = TILE_BLOCKS as i32 * y + x.max(0);
    if at < 0 { spread >> -at } else { spread << at }
}

/// Four bits a row to eight bits a row.
#[inline(always)]
fn spread(bits: u64) -> u64 {
    (bits & 0xf) | (bits & 0xf0) << 4 | (bits & 0xf00) << 8 | (bits & 0xf000) << 12
}

/// A bit for each block of a tile that the record may touch, within its box.
#[inline(always)]
fn touched<S: Simd>(simd: S, record: &Record, blocks: BlockBox, tile: [u32; 2], grid: &Grid, form: MaskForm) -> u64 {
    let size = grid.tile_blocks;
    let ((x0, x1), (y0, y1)) = (clipped(blocks, tile, 0, size), clipped(blocks, tile, 1, size));
    let mut found = 0u64;
    for y in (y0..y1).step_by(4) {
        for x in (x0..x1).step_by(4) {
            let first = [tile[0] + x, tile[1] + y];
            found |= placed(four_by_four(simd, record, first, grid.origin, form.linear_depth), x as i32, y as i32);
        }
    }
    found
}

/// The test for 4×4 blocks from `first` on: sixteen bits.
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
    let all = match r.class() {
        Class::Shallow | Class::Plain => filtered,
        _ => {
            let visible_w = if linear { [0.0; 2] } else { [r.depth_x(), r.depth_y()] };
            filtered
                | touches(d_x, d_y, [r.visible_u_x(), r.visible_u_y()], [r.visible_v_x(), r.visible_v_y()], visible_w)
        }
    };
    all.to_bitmask()
}

/// Whether a footprint, given by its gradients, may reach a pixel of the blocks with these centres.
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

/// How far a form may move from a block's centre to its corners.
#[inline(always)]
fn reach(gradient: [f32; 2]) -> f32 {
    (HALF + SLACK) * (gradient[0].abs() + gradient[1].abs())
}
