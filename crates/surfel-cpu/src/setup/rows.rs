//! Search for the columns of blocks that a footprint may touch in each row of blocks, for a group of 16 splats at a
//! time.
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::simd::lanes::Lanes;
use crate::tiles::grid::BLOCK;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::{Real, V2};

/// Distance in pixels from a block's centre to the centres of its outermost pixels, along x or y.
pub(crate) const HALF: f32 = 1.5;

/// Amount by which footprints are enlarged in the search for touched blocks, in pixels and relative to their size. It
/// is far above the rounding of the forms, so that no block with a covered pixel is lost. A superfluous block only
/// costs time.
pub(crate) const SLACK: f32 = 2e-3;

/// Footprints of a group's splats as linear forms over pixels, relative to the splats' projected centres.
pub(crate) struct MaskForms<S: Simd> {
    /// Offset, in pixels, from each projected centre to the centre of the pixel that contains it.
    pub offset: V2<Lanes<S>>,
    /// Column and row of the pixel that contains each projected centre.
    pub base: V2<Lanes<S>>,
    /// Change of the filtered footprint's form u·w' ([`Record`](crate::setup::record::Record)) per pixel to the right
    /// and down.
    pub u: V2<Lanes<S>>,
    /// Change of the filtered footprint's form v·w' ([`Record`](crate::setup::record::Record)) per pixel to the right
    /// and down.
    pub v: V2<Lanes<S>>,
    /// Upper bound of the homogeneous coordinate w' over the footprint.
    pub w: Lanes<S>,
}

/// Ellipses around a group's footprints, for finding the range of columns that a footprint may touch in each row of
/// blocks. They are slightly larger than the footprints, because the homogeneous coordinate w' is replaced by its
/// maximum.
///
/// At offset y from the projected centre, in pixels, an ellipse extends over a range of columns of blocks. The first
/// column is begin + slope·y − √(most − square·y²)·scale. The column after the last is end + slope·y + √(most −
/// square·y²)·scale.
pub(crate) struct Conic<S: Simd> {
    /// Mask of the splats whose ellipse is tested; the others touch all columns of their box.
    tested: mask32x16<S>,
    /// Constant of the ellipse's first column, in blocks.
    begin: Lanes<S>,
    /// Constant of the column after the ellipse's last, in blocks.
    end: Lanes<S>,
    /// Change of the ellipse's middle column, in blocks, per pixel down.
    slope: Lanes<S>,
    /// Factor from the root of `most` − `square`·y² to half of the ellipse's extent in columns.
    scale: Lanes<S>,
    /// Minuend under the root of the ellipse's half extent.
    most: Lanes<S>,
    /// Factor of y² under the root of the ellipse's half extent.
    square: Lanes<S>,
    /// Offset y, in pixels, at which the ellipse reaches its largest column; the smallest is reached at −y.
    rightmost: Lanes<S>,
    /// Offset in y, in pixels, from the projected centre to the first row of pixels of the box.
    first_y: Lanes<S>,
}

impl<S: Simd> Conic<S> {
    /// Computes the ellipses' coefficients. The ellipse (u·w')² + (v·w')² = w², with w the maximum of w', is A·x² +
    /// 2B·x·y + C·y² = w² in pixels. Solved for x: x = (−B·y ± √(A·w² − (A·C − B²)·y²))/A.
    #[inline(always)]
    pub(crate) fn of(forms: &MaskForms<S>, anchor_x: Lanes<S>, first_y: Lanes<S>, tested: mask32x16<S>) -> Self {
        let (u, v) = (&forms.u, &forms.v);
        let k = |c: f32| Lanes::splat(first_y.0.simd, c);
        let (a, b, c) = (u.x.mul_add(u.x, v.x * v.x), u.x.mul_add(u.y, v.x * v.y), u.y.mul_add(u.y, v.y * v.y));
        let determinant = u.cross(*v);
        let per_block = k(1.0 / BLOCK as f32);
        let scale = per_block / a;
        Self {
            tested,
            // The range begins with the first block whose last pixel isn't before the ellipse. It ends after the last
            // block whose first pixel isn't beyond the ellipse.
            begin: (anchor_x - k(SLACK + 2.0 * HALF)) * per_block,
            end: (anchor_x + k(SLACK + BLOCK as f32)) * per_block,
            slope: -(b * scale),
            scale,
            most: a * (forms.w * forms.w * k(1.0 + SLACK)),
            square: determinant * determinant,
            rightmost: -(b * forms.w) / (c.sqrt() * determinant.abs()),
            first_y: first_y - k(SLACK),
        }
    }

    /// Returns the range of columns, first to end, that the ellipses may touch in a row of blocks.
    #[inline(always)]
    fn columns(&self, row: usize) -> [Lanes<S>; 2] {
        let k = |c: f32| Lanes::splat(self.first_y.0.simd, c);
        let first = self.first_y + k((row as u32 * BLOCK) as f32);
        let last = first + k(2.0 * (HALF + SLACK));
        let at = (-self.rightmost).max(first).min(last);
        let least = self.slope.mul_add(at, self.begin) - self.half(at);
        let at = self.rightmost.max(first).min(last);
        let greatest = self.slope.mul_add(at, self.end) + self.half(at);
        [Lanes(least.0.ceil()), Lanes(greatest.0.floor())]
    }

    /// Returns half of the ellipses' extent, in columns of blocks, at an offset `y` in pixels.
    #[inline(always)]
    fn half(&self, y: Lanes<S>) -> Lanes<S> {
        let left = (-(self.square * y)).mul_add(y, self.most);
        left.max(left.zero()).sqrt() * self.scale
    }
}

/// Boxes of blocks of sixteen splats, each no larger than a tile, from which rows of touched blocks are computed.
pub(crate) struct Rows<S: Simd> {
    /// First column of each box, in blocks from the left side of the tile that contains its first block.
    pub left: Lanes<S>,
    /// End column of each box, in blocks from the left side of the same tile.
    pub right: Lanes<S>,
    /// Number of rows of blocks in each box.
    pub height: Lanes<S>,
    /// Number of columns of blocks in a tile.
    pub bits: u32,
}

impl<S: Simd> Rows<S> {
    /// Returns a mask with one bit for each column in the range `begin..end`, which may be empty.
    #[inline(always)]
    fn between(&self, begin: Lanes<S>, end: Lanes<S>) -> i32x16<S> {
        let (begin, end): (i32x16<S>, i32x16<S>) = (begin.0.to_int(), end.max(begin).0.to_int());
        let one = i32x16::splat(self.left.0.simd, 1);
        (one << end) - (one << begin)
    }

    /// Splits a mask of columns into those of the box's first tile and those of the next tile.
    #[inline(always)]
    fn split(&self, bits: i32x16<S>) -> [i32x16<S>; 2] {
        [bits & i32x16::splat(bits.simd, (1 << self.bits) - 1), bits >> self.bits]
    }

    /// Returns the masks of all blocks of boxes that have at most two rows, in the form of [`Self::four_rows`].
    #[inline(always)]
    pub(crate) fn up_to_two(&self) -> [[i32x16<S>; 2]; 2] {
        let zero = i32x16::splat(self.left.0.simd, 0);
        let is_two: mask32x16<S> = self.left.one().lt(self.height);
        let [left, right] = self.split(self.between(self.left, self.right));
        [[left | is_two.select(left << 8, zero), zero], [right | is_two.select(right << 8, zero), zero]]
    }

    /// Returns masks of the touched blocks in four rows from row `first` on, eight bits a row: in the box's first tile,
    /// and in the next tile. Without `conic`, all blocks of the boxes count as touched.
    #[inline(always)]
    pub(crate) fn four_rows(&self, first: usize, conic: Option<&Conic<S>>) -> [i32x16<S>; 2] {
        let zero = i32x16::splat(self.left.0.simd, 0);
        let (mut left, mut right) = (zero, zero);
        for i in 0..4 {
            let row = first + i;
            let (mut begin, mut end) = (self.left, self.right);
            if let Some(conic) = conic {
                let [least, greatest] = conic.columns(row);
                begin = Lanes::select(conic.tested, least.max(begin).min(end), begin);
                end = Lanes::select(conic.tested, greatest.min(end), end);
            }
            let has: mask32x16<S> = self.left.constant(row as f64).lt(self.height);
            let [a, b] = self.split(has.select(self.between(begin, end), zero));
            left |= a << (8 * i as u32);
            right |= b << (8 * i as u32);
        }
        [left, right]
    }
}
