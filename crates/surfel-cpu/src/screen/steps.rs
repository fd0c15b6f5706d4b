//! Which pixels are sampled (§5, edges by samples): those beside a step of depth, on either side of it.

use crate::screen::gbuffer::{BLOCKS, GBuffer, TileRows};
use crate::screen::layer_steps::{LayerPlanes, LayerSteps};
use crate::screen::neighbourhood::Neighbourhood;
use crate::simd::lanes::LANES;
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::drawn::BlockSet;
use crate::tiles::grid::{BLOCK, Grid, Rect};
use fearless_simd::Simd;
use surfel_render::{Region, SAMPLES_SIDE};

// A block of samples is a pixel.
const _: () = assert!(SAMPLES_SIDE == BLOCK, "samples of a pixel fill a block");

/// Rows of a tile that nothing touches.
static NOTHING: TileRows = TileRows::EMPTY;

/// What steps are found in.
pub(crate) struct StepPlanes<'a> {
    pub gbuffer: &'a GBuffer,
    pub layers: &'a LayerSteps,
    /// The grid of both.
    pub grid: &'a Grid,
}

impl StepPlanes<'_> {
    /// The sampled pixels of a region of the grid, as blocks of samples.
    #[inline(never)]
    pub(crate) fn sampled(
        &self,
        instructions: Instructions,
        region: Region,
        neighbourhood: &mut Neighbourhood,
    ) -> BlockSet {
        let mut sampled = BlockSet::new(Grid::new(region.of_samples(), self.grid.tile_blocks));
        let own = Rect::of(region);
        let mut rises = vec![[0u16; BLOCKS]; self.grid.tiles()];
        for (tile, rises) in rises.iter_mut().enumerate() {
            with_instructions!(instructions, simd =>
                simd.vectorize(#[inline(always)] || self.rises_of(simd, tile, neighbourhood, rises)));
        }
        // Where something falls, something rises beside it.
        let rise: Vec<bool> = rises.iter().map(|of_tile| of_tile.iter().any(|bits| *bits != 0)).collect();
        for (tile, mut steps) in rises.into_iter().enumerate() {
            if self.any_around(tile, &|tile: usize| rise[tile]) {
                with_instructions!(instructions, simd =>
                    simd.vectorize(#[inline(always)] || self.falls_of(simd, tile, neighbourhood, &mut steps)));
            }
            for (block, &bits) in (0..).zip(&steps).filter(|(_, bits)| **bits != 0) {
                let (x, y) = self.grid.block_px(tile, block);
                let bits = bits & own.lanes_of_block((x, y)) as u16;
                let side = SAMPLES_SIDE as i32;
                for lane in (0..LANES as i32).filter(|lane| bits >> lane & 1 == 1) {
                    sampled.add((x + lane % 4) * side, (y + lane / 4) * side);
                }
            }
        }
        sampled.finish();
        sampled
    }

    /// Finds the pixels of a tile that end before a neighbour begins, or have fewer layers.
    #[inline(always)]
    fn rises_of<S: Simd>(&self, simd: S, tile: usize, neighbourhood: &mut Neighbourhood, steps: &mut [u16; BLOCKS]) {
        let Some([begins, ends]) = self.gbuffer.reaches() else { return };
        let (grid, wanted) = (self.grid, self.grid.blocks(tile));
        let marks = |tile: usize| self.gbuffer.marks(tile);
        let is_touched = marks(tile).touched != 0;
        // Nothing ends before nothing begins.
        if is_touched {
            neighbourhood.load(begins, grid, tile, marks, 1, f32::NEG_INFINITY);
            neighbourhood.rises(simd, own_rows(ends, tile, is_touched), wanted, steps);
        }
        if let Some(steps_of) = self.layers_around(tile) {
            let [_, end, count] = steps_of;
            let (far, near) = (f32::INFINITY, f32::NEG_INFINITY);
            neighbourhood.load_from(self.of_layers(|p| &p.begin), grid, tile, 1, [far, near]);
            neighbourhood.rises(simd, end, wanted, steps);
            neighbourhood.load_from(self.of_layers(|p| &p.count), grid, tile, 1, [0.0, near]);
            neighbourhood.rises(simd, count, wanted, steps);
        }
    }

    /// Adds those that begin after a neighbour ends, or have more layers.
    #[inline(always)]
    fn falls_of<S: Simd>(&self, simd: S, tile: usize, neighbourhood: &mut Neighbourhood, steps: &mut [u16; BLOCKS]) {
        let Some([begins, ends]) = self.gbuffer.reaches() else { return };
        let (grid, wanted) = (self.grid, self.grid.blocks(tile));
        let marks = |tile: usize| self.gbuffer.marks(tile);
        neighbourhood.load(ends, grid, tile, marks, 1, f32::INFINITY);
        neighbourhood.falls(simd, own_rows(begins, tile, marks(tile).touched != 0), wanted, steps);
        if let Some(steps_of) = self.layers_around(tile) {
            let [begin, _, count] = steps_of;
            let far = f32::INFINITY;
            neighbourhood.load_from(self.of_layers(|p| &p.end), grid, tile, 1, [far, far]);
            neighbourhood.falls(simd, begin, wanted, steps);
            neighbourhood.load_from(self.of_layers(|p| &p.count), grid, tile, 1, [0.0, far]);
            neighbourhood.falls(simd, count, wanted, steps);
        }
    }

    /// A plane of the transparent layers, tile by tile.
    fn of_layers<'s>(
        &'s self,
        plane: impl Fn(&LayerPlanes) -> &TileRows + Copy,
    ) -> impl Fn(usize) -> Option<&'s TileRows> {
        move |tile| self.layers.of(tile).map(plane)
    }

    /// Where a tile's nearest layers begin and end, and how many layers it has, if there are any in it or around it.
    fn layers_around(&self, tile: usize) -> Option<[&TileRows; 3]> {
        static ZERO: TileRows = TileRows::ZERO;
        let has_layers = |tile: usize| self.layers.of(tile).is_some();
        if self.layers.are_none() || !self.any_around(tile, &has_layers) {
            return None;
        }
        let Some(own) = self.layers.of(tile) else { return Some([&NOTHING, &NOTHING, &ZERO]) };
        Some([&own.begin, &own.end, &own.count])
    }

    /// True if a tile or one of those around it is such.
    fn any_around(&self, tile: usize, is: &impl Fn(usize) -> bool) -> bool {
        let (columns, rows) = (self.grid.columns as i32, self.grid.rows as i32);
        let (x, y) = (tile as i32 % columns, tile as i32 / columns);
        let inside = |x: i32, y: i32| (0..columns).contains(&x) && (0..rows).contains(&y);
        (y - 1..=y + 1).any(|y| (x - 1..=x + 1).any(|x| inside(x, y) && is((y * columns + x) as usize)))
    }
}

/// A tile's own rows of a plane.
fn own_rows(plane: &[TileRows], tile: usize, is_touched: bool) -> &TileRows {
    plane.get(tile).filter(|_| is_touched).unwrap_or(&NOTHING)
}
