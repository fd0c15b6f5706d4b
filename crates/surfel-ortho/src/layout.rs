//! Division of the plane into blocks of pixels, which are drawn one after another.
//!
//! Blocks depend only on the files and the grid, not on the bounds of the image. Images of the same files therefore
//! agree where they overlap.

use super::grid::Grid;
use std::ops::RangeInclusive;

/// Largest and smallest side of a block, without its margin, in pixels.
const BLOCK_PX: (i64, i64) = (2048, 16);
/// Largest expected number of points in a block and its surroundings, by which the block's side is selected. A block
/// with the smallest side may have more.
const BLOCK_POINTS: f64 = 3e6;
/// Smallest width, in point spacings, of the halo around a drawn area whose points are used too. A splat's radius is at
/// most 4 spacings. The rest of the halo has the neighbours from which the normals and radii of these splats are
/// estimated. The halo is also at least as wide as the largest splat of splat files, and as 8 pixels.
const HALO_SPACINGS: f64 = 12.0;
/// Smallest width, in point spacings, of the margin that is drawn around a block; up to 5 pixels are added. Its pixels
/// and points help to locate edges near the block's border.
const MARGIN_SPACINGS: f64 = 6.0;
/// Maximum width of the margin around a block, in pixels.
const MAX_MARGIN_PX: i64 = 1024;
/// Number of bins along a block's side. Each file's points are sorted into these square bins, so that the points of a
/// block are found quickly.
const BINS: i64 = 4;

/// Density and sizes of the points and splats of all files, by which blocks are laid out. Lengths are in the units of x
/// and y.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sampling {
    /// Largest number of points per unit of area, where files overlap as the sum of their densities.
    pub(crate) density: f64,
    /// Largest mean distance between neighbouring points of one file; 0 without points.
    pub(crate) spacing: f64,
    /// Largest radius of a splat in splat files; 0 without any.
    pub(crate) reach: f64,
}

/// Division of an image's grid into blocks: their size and surroundings, and the bins by which points are sorted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Layout {
    grid: Grid,
    /// Side of a block in pixels.
    pub(crate) block_px: i64,
    /// Width of the margin that is drawn around a block, in pixels.
    pub(crate) margin_px: i64,
    /// Width, in the units of x and y, of the halo around the drawn area whose points are used too.
    pub(crate) halo: f64,
    /// Distance between points ([`Sampling::spacing`]), in the units of x and y, rounded up to a power of √2; 0 without
    /// points.
    pub(crate) spacing: f64,
}

impl Layout {
    pub(crate) fn new(grid: Grid, sampling: Sampling) -> Self {
        let (gsd, Sampling { density, mut spacing, reach }) = (grid.gsd, sampling);
        // The spacing is rounded up to a power of √2, so that the layout doesn't depend on how points are divided into
        // files.
        if spacing > 0.0 {
            spacing = ((2.0 * spacing.log2()).ceil() / 2.0).exp2();
        }
        let halo = (HALO_SPACINGS * spacing).max(reach).max(8.0 * gsd);
        let margin = ((MARGIN_SPACINGS * spacing).max(reach) / gsd).ceil() + 4.0;
        let margin_px = margin.min(MAX_MARGIN_PX as f64) as i64;
        let mut block_px = BLOCK_PX.0;
        let points = |side: i64| density * ((side + 2 * margin_px) as f64 * gsd + 2.0 * halo).powi(2);
        while block_px > BLOCK_PX.1 && points(block_px) > BLOCK_POINTS {
            block_px /= 2;
        }
        Self { grid, block_px, margin_px, halo, spacing }
    }

    /// Returns the index of the bin that contains a coordinate along an axis (0: x, 1: y).
    pub(crate) fn bin(&self, axis: usize, value: f64) -> i64 {
        let side = self.block_px as f64 * self.grid.gsd / BINS as f64;
        ((value - self.grid.origin[axis]) / side).floor() as i64
    }

    /// Returns the range of indices, along an axis (0: x, 1: y), of the blocks that contain pixels of `grid`.
    pub(crate) fn blocks(&self, grid: &Grid, axis: usize) -> RangeInclusive<i64> {
        let (first, count) = (grid.first[axis], i64::from(grid.size[axis]));
        first.div_euclid(self.block_px)..=(first + count - 1).div_euclid(self.block_px)
    }

    /// Returns the area of a block without its margin: minimum x, minimum y, maximum x, maximum y.
    pub(crate) fn own(&self, block: [i64; 2]) -> [f64; 4] {
        let edge = |axis: usize, index: i64| self.grid.edge(axis, index * self.block_px);
        [edge(0, block[0]), edge(1, block[1]), edge(0, block[0] + 1), edge(1, block[1] + 1)]
    }

    /// Returns the area of a block with its margin, enlarged by `by` on each side: minimum x, minimum y, maximum x,
    /// maximum y.
    pub(crate) fn drawn(&self, block: [i64; 2], by: f64) -> [f64; 4] {
        let edge = |axis: usize, index: i64| self.grid.edge(axis, index);
        let start = |axis: usize| edge(axis, block[axis] * self.block_px - self.margin_px) - by;
        let end = |axis: usize| edge(axis, (block[axis] + 1) * self.block_px + self.margin_px) + by;
        [start(0), start(1), end(0), end(1)]
    }
}
