//! Tiny splats: splats of at most 2×2 or 3×3 pixels, whose fragments are computed by setup.
//!
//! A splat two pixels wide covers about three of a block's sixteen pixels and touches about two blocks, so that
//! evaluating it block by block wastes most lanes. Setup has sixteen splats in its lanes. It evaluates all of them at
//! one pixel each, four or nine times, by the formulas of `evaluate.rs`. Their records store depths and weights in
//! place of forms.
//!
//! Tiles of tiny splats are drawn splat by splat (`tiny_tile.rs`). In other tiles the stored fragments are read where
//! other splats are evaluated. Values and their order are the same in both cases, so the image is bit-identical.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat projected to the screen
//! ([`Record`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)). A *lane* is one of the 16 numbers
//! that SIMD instructions compute at once.

use crate::setup::evaluate::{self, Fragment, FrameConstants};
use crate::setup::record::{CLASS, FORMS, GENERAL, Record, RecordLanes, TINY};
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::{Real, V2};
use surfel_render::{FramePlan, View};

/// Fragments of a group's tiny splats, which their records store in place of linear forms: depths row by row, then
/// weights. A weight is NaN in a pixel outside the filtered footprint, and negative in a pixel inside the unfiltered
/// one.
pub(crate) struct TinyLanes<S: Simd> {
    /// Mask of the tiny splats of 2×2 pixels.
    four: mask32x16<S>,
    /// Mask of the tiny splats of 3×3 pixels.
    nine: mask32x16<S>,
    /// Column and row of each splat's first pixel, as the bits of integers.
    first_px: V2<Lanes<S>>,
    /// Depths of each splat's fragments in 3×3 pixels, row by row.
    depths: [Lanes<S>; 9],
    /// Signed weights of each splat's fragments in 3×3 pixels, row by row; the sign marks the unfiltered footprint.
    weights: [Lanes<S>; 9],
}

/// Indices, in a row-by-row list of 3×3 pixels, of the upper left 2×2.
const CORNER: [usize; 4] = [0, 1, 3, 4];

impl<S: Simd> TinyLanes<S> {
    /// Returns bits of the tiny splats of 2×2 pixels, and of the tiny splats of 3×3.
    #[inline(always)]
    pub(crate) fn bits(&self) -> [u64; 2] {
        [self.four.to_bitmask(), self.nine.to_bitmask()]
    }

    #[inline(always)]
    pub(crate) fn write(&self, fields: &mut [[Lanes<S>; LANES]; 2]) {
        let bits = |bits: u32| Lanes::splat(self.first_px.x.0.simd, f32::from_bits(bits));
        let fields = fields.as_flattened_mut();
        for (at, four, nine) in [
            (0, self.first_px.x, self.first_px.x),
            (1, self.first_px.y, self.first_px.y),
            (CLASS, bits(TINY[0]), bits(TINY[1])),
        ] {
            fields[at] = Lanes::select(self.four, four, Lanes::select(self.nine, nine, fields[at]));
        }
        if self.nine.to_bitmask() != 0 {
            for (field, value) in fields[FORMS..].iter_mut().zip(self.depths.iter().chain(&self.weights)) {
                *field = Lanes::select(self.nine, *value, *field);
            }
        }
        for (i, pixel) in CORNER.into_iter().enumerate() {
            for (at, numbers) in [(FORMS + i, &self.depths), (FORMS + 4 + i, &self.weights)] {
                fields[at] = Lanes::select(self.four, numbers[pixel], fields[at]);
            }
        }
    }
}

/// Finder of tiny splats, which evaluates their fragments.
pub(crate) struct TinyFinder {
    frame: FrameConstants,
}

impl TinyFinder {
    pub(crate) fn new(plan: &FramePlan, view: &View) -> Self {
        Self { frame: FrameConstants::new(plan, view) }
    }

    /// Finds the tiny splats of a group by their ranges of pixels, and evaluates their fragments. `None` if no splat in
    /// `keep` is tiny, or fewer than three quarters are, which would gain nothing.
    #[inline(always)]
    pub(crate) fn find<S: Simd>(
        &self,
        r: &RecordLanes<S>,
        keep: u64,
        [first_column, end_column, first_row, end_row]: [Lanes<S>; 4],
    ) -> Option<TinyLanes<S>> {
        let (zero, one) = (r.z.zero(), r.z.one());
        let two = one + one;
        // The 2×2 pixels whose centres are nearest, and the 3×3 around the one with the splat's centre.
        let x = r.base_x - Lanes::select(zero.lt(r.offset_x), one, zero);
        let y = r.base_y - Lanes::select(zero.lt(r.offset_y), one, zero);
        let four = x.le(first_column) & end_column.le(x + two) & y.le(first_row) & end_row.le(y + two);
        let (left, top) = (r.base_x - one, r.base_y - one);
        let columns = left.le(first_column) & end_column.le(r.base_x + two);
        let nine = columns & top.le(first_row) & end_row.le(r.base_y + two) & !four;
        // A few tiny splats among others would make their tiles slower.
        let tiny = ((four | nine).to_bitmask() & keep).count_ones();
        if tiny == 0 || 4 * tiny < 3 * keep.count_ones() {
            return None;
        }
        let (x, y) = (Lanes::select(four, x, left), Lanes::select(four, y, top));
        let classes: i32x16<S> = r.class_bits.0.bitcast();
        let cheap: mask32x16<S> = classes.simd_lt(i32x16::splat(r.z.0.simd, GENERAL as i32));
        let all_cheap = !cheap.to_bitmask() & keep == 0;
        let side = if nine.to_bitmask() & keep == 0 { 2 } else { 3 };
        let (mut depths, mut weights) = ([zero; 9], [zero; 9]);
        for row in 0..side {
            for column in 0..side {
                let px = V2::new(x + x.constant(f64::from(column)), y + y.constant(f64::from(row)));
                let d = ((px.x - r.base_x) + r.offset_x, (px.y - r.base_y) + r.offset_y);
                let mut found = Numbers::of(&evaluate::cheap(r, d, &self.frame));
                if !all_cheap {
                    found = found.where_else(cheap, Numbers::of(&evaluate::general(r, d, &self.frame)));
                }
                let i = (3 * row + column) as usize;
                (depths[i], weights[i]) = (found.depth, found.weight);
            }
        }
        Some(TinyLanes { four, nine, first_px: V2::new(whole_bits(x), whole_bits(y)), depths, weights })
    }
}

/// Depths and weights of sixteen fragments, in the form stored in tiny splats' records.
struct Numbers<S: Simd> {
    depth: Lanes<S>,
    weight: Lanes<S>,
}

impl<S: Simd> Numbers<S> {
    #[inline(always)]
    fn of(fragment: &Fragment<S>) -> Self {
        let (one, nan) = (fragment.z.one(), fragment.z.constant(f64::NAN));
        let sign = Lanes::select(fragment.visible, -one, one);
        Self { depth: fragment.z, weight: Lanes::select(fragment.inside, fragment.weight, nan).copysign(sign) }
    }

    /// Returns `self` in the lanes of a mask, and `others` elsewhere.
    #[inline(always)]
    fn where_else(&self, mask: mask32x16<S>, others: Self) -> Self {
        Self {
            depth: Lanes::select(mask, self.depth, others.depth),
            weight: Lanes::select(mask, self.weight, others.weight),
        }
    }
}

/// Converts whole f32 numbers to integers, and returns the integers' bits in f32 lanes.
#[inline(always)]
fn whole_bits<S: Simd>(v: Lanes<S>) -> Lanes<S> {
    let whole: i32x16<S> = v.0.to_int();
    Lanes(whole.bitcast())
}

/// Returns the column and row of a tiny splat's first pixel.
#[inline(always)]
pub(crate) fn first_px(record: &Record) -> (i32, i32) {
    (record.0[0].to_bits() as i32, record.0[1].to_bits() as i32)
}
