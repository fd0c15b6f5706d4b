//! Division of the plane into blocks of pixels for drawing.
//!
//! Blocks depend only on the files and the grid, not on the bounds of the image. Any two images of the same files
//! therefore agree where they overlap.

use super::grid::Grid;
use std::ops::RangeInclusive;

/// Largest and smallest side of a block, in pixels.
const BLOCK_PX: (i64, i64) = (2048, 16);
/// Largest average number of points in a block, including the points around it.
const BLOCK_POINTS: f64 = 3e6;
/// Width of the halo of points used around a drawn area, in point spacings. A splat's radius is at most 4 spacings, and
/// it is estimated from points within as many again.
const HALO_SPACINGS: f64 = 12.0;
/// Width, in point spacings, of the margin around a block that is drawn too. Surfaces behind an edge are searched for
/// there.
const MARGIN_SPACINGS: f64 = 6.0;
/// Largest margin in pixels.
const MOST_MARGIN_PX: i64 = 1024;
/// Number of bins along a block's side.
const BINS: i64 = 4;

/// Sampling of the plane by the points and splats of all files, in the units of x and y.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sampling {
    /// Largest number of points per square unit.
    pub(crate) density: f64,
    /// Largest mean distance between the points of a file; 0 without points.
    pub(crate) spacing: f64,
    /// Largest radius of a splat.
    pub(crate) reach: f64,
}

/// Blocks of an image, and bins of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Layout {
    grid: Grid,
    /// Side of a block in pixels.
    pub(crate) block_px: i64,
    /// Width in pixels of the margin that is drawn around a block.
    pub(crate) margin_px: i64,
    /// Width of the halo of points around the drawn area, in the units of x and y.
    pub(crate) halo: f64,
    /// Mean distance between points; 0 without points.
    pub(crate) spacing: f64,
}

impl Layout {
    pub(crate) fn new(grid: Grid, sampling: Sampling) -> Self {
        let (gsd, Sampling { density, mut spacing, reach }) = (grid.gsd, sampling);
        // Rounded to steps, so that the same points divided into other files get the same layout.
        if spacing > 0.0 {
            spacing = ((2.0 * spacing.log2()).ceil() / 2.0).exp2();
        }
        let halo = (HALO_SPACINGS * spacing).max(reach).max(8.0 * gsd);
        let margin = ((MARGIN_SPACINGS * spacing).max(reach) / gsd).ceil() + 4.0;
        let margin_px = margin.min(MOST_MARGIN_PX as f64) as i64;
        let mut block_px = BLOCK_PX.0;
        let points = |side: i64| density * ((side + 2 * margin_px) as f64 * gsd + 2.0 * halo).powi(2);
        while block_px > BLOCK_PX.1 && points(block_px) > BLOCK_POINTS {
            block_px /= 2;
        }
        Self { grid, block_px, margin_px, halo, spacing }
    }

    /// Returns the bin of a coordinate along an axis (0: x, 1: y).
    pub(crate) fn bin(&self, axis: usize, value: f64) -> i64 {
        let side = self.block_px as f64 * self.grid.gsd / BINS as f64;
        ((value - self.grid.origin[axis]) / side).floor() as i64
    }

    /// Returns the blocks along an axis that contain pixels of `grid`.
    pub(crate) fn blocks(&self, grid: &Grid, axis: usize) -> RangeInclusive<i64> {
        let (first, count) = (grid.first[axis], i64::from(grid.size[axis]));
        first.div_euclid(self.block_px)..=(first + count - 1).div_euclid(self.block_px)
    }

    /// Returns the block's own area in the plane: least x and y, then largest.
    pub(crate) fn own(&self, block: [i64; 2]) -> [f64; 4] {
        let edge = |axis: usize, index: i64| self.grid.edge(axis, index * self.block_px);
        [edge(0, block[0]), edge(1, block[1]), edge(0, block[0] + 1), edge(1, block[1] + 1)]
    }

    /// Returns the area of a block with its margin in the plane, enlarged by `by` on every side: least x and y, then
    /// largest.
    pub(crate) fn drawn(&self, block: [i64; 2], by: f64) -> [f64; 4] {
        let edge = |axis: usize, index: i64| self.grid.edge(axis, index);
        let start = |axis: usize| edge(axis, block[axis] * self.block_px - self.margin_px) - by;
        let end = |axis: usize| edge(axis, (block[axis] + 1) * self.block_px + self.margin_px) + by;
        [start(0), start(1), end(0), end(1)]
    }
}
