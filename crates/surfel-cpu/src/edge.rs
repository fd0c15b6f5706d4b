//! Edge antialiasing by coverage (§5, ours after Z01 §7): the planes it needs besides the picture, and which pixels are
//! edges.

use crate::bins::Grid;
use crate::lanes::Lanes;
use crate::target::cut;
use crate::tile::EdgeRows;
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use surfel_math::Real;
use surfel_render::{Region, View};

/// Kept value, its writer's ε, and coverage of the pixels of a region, with a frame of pixels around it that are no one's
/// neighbours.
pub(crate) struct EdgePlanes {
    region: Region,
    stride: usize,
    kept: Vec<f32>,
    epsilon: Vec<f32>,
    coverage: Vec<f32>,
}

/// Pixels left and above of the region, and right and below.
const MARGIN: usize = 8;

impl EdgePlanes {
    /// Planes for a region, with nothing kept in it.
    pub(crate) fn new(region: Region) -> Self {
        let stride = region.width as usize + 2 * MARGIN;
        let size = stride * (region.height as usize + 2 * MARGIN);
        let mut planes = Self {
            region,
            stride,
            // −∞ is never behind anything.
            kept: vec![f32::NEG_INFINITY; size],
            epsilon: vec![0.0; size],
            coverage: vec![0.0; size],
        };
        for y in 0..region.height as usize {
            let at = planes.first() + y * stride;
            planes.kept[at..at + region.width as usize].fill(f32::INFINITY);
        }
        planes
    }

    /// The region whose neighbours all are known: a pixel more on every side, as far as the image goes.
    pub(crate) fn grown(region: Region, view: &View) -> Region {
        let [width, height] = view.size;
        let (x, y) = (region.x.saturating_sub(1), region.y.saturating_sub(1));
        let (end_x, end_y) = ((region.x + region.width + 1).min(width), (region.y + region.height + 1).min(height));
        Region { x, y, width: end_x - x, height: end_y - y }
    }

    fn first(&self) -> usize {
        MARGIN * self.stride + MARGIN
    }

    /// The planes cut into tiles.
    pub(crate) fn cut(&mut self, grid: &Grid) -> Vec<EdgeRows<'_>> {
        let (region, first, stride) = (self.region, self.first(), self.stride);
        let kept = cut(&mut self.kept, grid, region, first, stride);
        let epsilon = cut(&mut self.epsilon, grid, region, first, stride);
        let coverage = cut(&mut self.coverage, grid, region, first, stride);
        let planes = kept.into_iter().zip(epsilon).zip(coverage);
        planes.map(|((kept, epsilon), coverage)| EdgeRows { kept, epsilon, coverage }).collect()
    }

    /// Index of a pixel at most `MARGIN` outside.
    fn at(&self, x: i32, y: i32) -> usize {
        let row = y - self.region.y as i32 + MARGIN as i32;
        let column = x - self.region.x as i32 + MARGIN as i32;
        (row as usize) * self.stride + column as usize
    }

    /// Sixteen numbers of a block.
    #[inline(always)]
    fn block<S: Simd>(&self, simd: S, plane: &[f32], (x, y): (i32, i32)) -> Lanes<S> {
        let mut values = [0.0; 16];
        for (j, four) in values.chunks_exact_mut(4).enumerate() {
            let at = self.at(x, y + j as i32);
            four.copy_from_slice(&plane[at..at + 4]);
        }
        Lanes::load(simd, &values)
    }

    /// Kept values of a block.
    #[inline(always)]
    pub(crate) fn kept<S: Simd>(&self, simd: S, at: (i32, i32)) -> Lanes<S> {
        self.block(simd, &self.kept, at)
    }

    pub(crate) fn coverage_at(&self, x: i32, y: i32) -> f32 {
        self.coverage[self.at(x, y)]
    }

    /// Bits of a block's edge pixels: an 8-neighbour's kept value less its ε is greater than their own plus theirs, or they
    /// have filtered fragments but nothing kept.
    #[inline(always)]
    pub(crate) fn edges<S: Simd>(&self, simd: S, (x, y): (i32, i32)) -> u64 {
        let own = self.kept(simd, (x, y)) + self.block(simd, &self.epsilon, (x, y));
        let mut farthest = Lanes::splat(simd, f32::NEG_INFINITY);
        for dy in -1..=1 {
            for dx in -1..=1 {
                let at = (x + dx, y + dy);
                farthest = farthest.max(self.kept(simd, at) - self.block(simd, &self.epsilon, at));
            }
        }
        let nothing_kept = Lanes::splat(simd, f32::MAX).lt(own);
        let covered = Lanes::splat(simd, 0.0).lt(self.block(simd, &self.coverage, (x, y)));
        (own.lt(farthest) | (nothing_kept & covered)).to_bitmask()
    }
}
