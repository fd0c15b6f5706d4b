//! Search for the columns of blocks that a footprint may touch, by rows of blocks, for a group of 16 splats at a time.

use crate::simd::lanes::Lanes;
use crate::tiles::grid::BLOCK;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::{Real, V2};

/// Half of a block's extent between pixel centres, in pixels.
pub(crate) const HALF: f32 = 1.5;

/// Slack of the test, in pixels and relative. The slack is far above the rounding of the forms, so that no block with a
/// covered pixel is lost. A superfluous block only costs time.
pub(crate) const SLACK: f32 = 2e-3;

/// Footprints over pixels, relative to their anchors.
pub(crate) struct MaskForms<S: Simd> {
    /// Offset from the anchor to the centre of its pixel.
    pub offset: V2<Lanes<S>>,
    /// Column and row of the pixel that contains the anchor.
    pub base: V2<Lanes<S>>,
    /// Gradient of the filtered u·w'.
    pub u: V2<Lanes<S>>,
    /// Gradient of the filtered v·w'.
    pub v: V2<Lanes<S>>,
    /// Upper bound of the footprint's w'.
    pub w: Lanes<S>,
}

/// Footprints with w' replaced by its maximum: slightly larger ellipses, which cover a range of columns in every row of
/// blocks.
pub(crate) struct Conic<S: Simd> {
    /// Mask of the splats that are tested; the others count with their whole box.
    tested: mask32x16<S>,
    /// First of six coefficients of the minimum and maximum column, in blocks, at an offset y from the anchor. The
    /// minimum is begin + slope·y − √(most − square·y²)·scale, the maximum end + slope·y + √(most − square·y²)·scale.
    begin: Lanes<S>,
    end: Lanes<S>,
    slope: Lanes<S>,
    scale: Lanes<S>,
    most: Lanes<S>,
    square: Lanes<S>,
    /// Offset y at which the maximum column is reached; the minimum is reached at −y.
    rightmost: Lanes<S>,
    /// Offset from the anchor to the first row of pixels.
    first_y: Lanes<S>,
}

impl<S: Simd> Conic<S> {
    /// Computes the coefficients. With A·x² + 2B·x·y + C·y² = w² for (u·w')² + (v·w')² = w², x = (−B·y ± √(A·w² − (A·C
    /// − B²)·y²))/A.
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

    /// Returns the range of columns that a row of blocks may touch, first to end.
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

    /// Returns half of the ellipse's extent in columns at an offset y.
    #[inline(always)]
    fn half(&self, y: Lanes<S>) -> Lanes<S> {
        let left = (-(self.square * y)).mul_add(y, self.most);
        left.max(left.zero()).sqrt() * self.scale
    }
}

/// Rows of blocks of sixteen boxes no larger than a tile.
pub(crate) struct Rows<S: Simd> {
    /// First column, relative to the first tile's side.
    pub left: Lanes<S>,
    /// End column, relative to the first tile's side.
    pub right: Lanes<S>,
    pub height: Lanes<S>,
    /// Number of columns of a tile.
    pub bits: u32,
}

impl<S: Simd> Rows<S> {
    /// Returns bits of the columns in the range `begin..end`, which may be empty.
    #[inline(always)]
    fn between(&self, begin: Lanes<S>, end: Lanes<S>) -> i32x16<S> {
        let (begin, end): (i32x16<S>, i32x16<S>) = (begin.0.to_int(), end.max(begin).0.to_int());
        let one = i32x16::splat(self.left.0.simd, 1);
        (one << end) - (one << begin)
    }

    /// Splits bits between the first tile's columns and the next tile's.
    #[inline(always)]
    fn split(&self, bits: i32x16<S>) -> [i32x16<S>; 2] {
        [bits & i32x16::splat(bits.simd, (1 << self.bits) - 1), bits >> self.bits]
    }

    /// Returns all blocks of boxes of up to two rows.
    #[inline(always)]
    pub(crate) fn up_to_two(&self) -> [[i32x16<S>; 2]; 2] {
        let zero = i32x16::splat(self.left.0.simd, 0);
        let is_two: mask32x16<S> = self.left.one().lt(self.height);
        let [left, right] = self.split(self.between(self.left, self.right));
        [[left | is_two.select(left << 8, zero), zero], [right | is_two.select(right << 8, zero), zero]]
    }

    /// Returns four rows, eight bits each, in the first tile's columns and in the next one's.
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
