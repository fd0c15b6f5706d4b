//! Which blocks of a tile a footprint may touch.

use crate::bins::{BLOCK, Entry, Grid, TILE_BLOCKS};
use crate::lanes::Lanes;
use crate::record::{BlockBox, Class, Record};
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

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

/// Calls `visit` with the entry of every tile that a record may touch.
#[inline(always)]
pub(crate) fn for_tiles<S: Simd>(
    simd: S,
    record: &Record,
    index: u32,
    blocks: BlockBox,
    grid: &Grid,
    form: MaskForm,
    mut visit: impl FnMut(Entry),
) {
    let [x0, y0, x1, y1] = [blocks.0[0] as u32, blocks.0[1] as u32, blocks.0[2] as u32, blocks.0[3] as u32];
    let size = grid.tile_blocks;
    // Few splats reach over more than 4×4 blocks, so that one test serves all tiles.
    let whole = (x1 - x0 <= 2 && y1 - y0 <= 2) || form.whole_box || record.class() == Class::Near;
    let few = (!whole && x1 - x0 <= 4 && y1 - y0 <= 4)
        .then(|| four_by_four(simd, record, [x0, y0], grid.origin, form.linear_depth));
    for row in y0 / size..=(y1 - 1) / size {
        for column in x0 / size..=(x1 - 1) / size {
            let tile = [column * size, row * size];
            let in_box = inside_box(blocks, tile, size);
            let blocks = match few {
                _ if whole => in_box,
                Some(bits) => in_box & placed(bits, x0 as i32 - tile[0] as i32, y0 as i32 - tile[1] as i32),
                None => in_box & touched(simd, record, blocks, tile, grid, form),
            };
            if blocks != 0 {
                visit(Entry { blocks, record: index, tile: row * grid.columns + column });
            }
        }
    }
}

/// The part of a tile's range along one axis that a box covers, in blocks.
#[inline(always)]
fn clipped(blocks: BlockBox, tile: [u32; 2], axis: usize, size: u32) -> (u32, u32) {
    let clip = |value: u16| (u32::from(value).max(tile[axis]) - tile[axis]).min(size);
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
    let spread = (bits & 0xf) | (bits & 0xf0) << 4 | (bits & 0xf00) << 8 | (bits & 0xf000) << 12;
    let at = TILE_BLOCKS as i32 * y + x.max(0);
    if at < 0 { spread >> -at } else { spread << at }
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
