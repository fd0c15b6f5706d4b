//! How the plane is divided for drawing: into blocks of pixels that depend on the files and the grid alone, never on
//! the bounds of the image, so that any two images of the same files agree where they overlap.

use super::grid::Grid;
use super::source::{Holds, Source};
use std::ops::RangeInclusive;

/// Sides of the largest and the smallest blocks, in pixels.
const BLOCK_PX: (i64, i64) = (2048, 16);
/// Points that a block has at most on average, with those around it.
const BLOCK_POINTS: f64 = 3e6;
/// Spacings of points that a block looks beyond its edges: a splat's radius is at most 4, and what it is judged by lies
/// within as many again.
const HALO_SPACINGS: f64 = 12.0;
/// Spacings of points around a block that are drawn, too: what lies behind a surface is looked for there.
const MARGIN_SPACINGS: f64 = 6.0;
/// Most pixels of that margin.
const MOST_MARGIN_PX: i64 = 1024;
/// Bins along a block's side.
const BINS: i64 = 4;

/// Blocks and bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Layout {
    grid: Grid,
    /// Pixels of a block's side.
    pub(crate) block_px: i64,
    /// Pixels around a block that are drawn with it.
    pub(crate) margin_px: i64,
    /// How far beyond what is drawn points count, in the units of x and y.
    pub(crate) halo: f64,
    /// Mean distance between points; 0 without points.
    pub(crate) spacing: f64,
}

impl Layout {
    pub(crate) fn new(grid: Grid, sources: &[Source]) -> Self {
        let gsd = grid.gsd;
        let (mut density, mut spacing, mut reach) = (0.0_f64, 0.0_f64, 0.0_f64);
        let own_density = |source: &Source| match &source.holds {
            Holds::Points(points) if points.density.is_finite() => points.density,
            _ => 0.0,
        };
        for source in sources {
            if let Holds::Splats(cloud) = &source.holds {
                reach = (0..cloud.len()).map(|i| cloud.radius_max(i)).fold(reach, f64::max);
            }
            let own = own_density(source);
            if own > 0.0 {
                let middle = 0.5 * (source.bounds.0 + source.bounds.1);
                let at = [middle.x, middle.y, middle.x, middle.y];
                // Files that lie above each other have the density of all, those beside each other of one.
                let mut all: Vec<f64> = sources.iter().filter(|other| other.meets(at)).map(own_density).collect();
                // In an order of their own, so that the sum is the same in any order of files.
                all.sort_unstable_by(f64::total_cmp);
                density = density.max(all.iter().sum());
                spacing = spacing.max(own.sqrt().recip());
            }
        }
        // In steps, so that the same points in other files are looked at alike.
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

    /// The bin of a coordinate along an axis (0: x, 1: y).
    pub(crate) fn bin(&self, axis: usize, value: f64) -> i64 {
        let side = self.block_px as f64 * self.grid.gsd / BINS as f64;
        ((value - self.grid.origin[axis]) / side).floor() as i64
    }

    /// The blocks along an axis that a grid like this one has pixels of.
    pub(crate) fn blocks(&self, grid: &Grid, axis: usize) -> RangeInclusive<i64> {
        let (first, count) = (grid.first[axis], i64::from(grid.size[axis]));
        first.div_euclid(self.block_px)..=(first + count - 1).div_euclid(self.block_px)
    }

    /// The block itself, in the plane: least x and y, then largest.
    pub(crate) fn own(&self, block: [i64; 2]) -> [f64; 4] {
        let edge = |axis: usize, index: i64| self.grid.edge(axis, index * self.block_px);
        [edge(0, block[0]), edge(1, block[1]), edge(0, block[0] + 1), edge(1, block[1] + 1)]
    }

    /// What is drawn of a block, in the plane: least x and y, then largest, `by` farther on every side.
    pub(crate) fn drawn(&self, block: [i64; 2], by: f64) -> [f64; 4] {
        let edge = |axis: usize, index: i64| self.grid.edge(axis, index);
        let start = |axis: usize| edge(axis, block[axis] * self.block_px - self.margin_px) - by;
        let end = |axis: usize| edge(axis, (block[axis] + 1) * self.block_px + self.margin_px) + by;
        [start(0), start(1), end(0), end(1)]
    }
}
