//! What edges by samples need of transparent layers: where the nearest one lies, and how many there are (§5).

use crate::screen::gbuffer::TileRows;
use crate::shade::transparent::CompositedLayers;
use crate::tiles::grid::Grid;
use fearless_simd::Simd;
use surfel_render::{FramePlan, Pass};

/// A tile's planes: +∞, +∞ and 0 where there are no layers.
#[derive(Clone)]
pub(crate) struct LayerPlanes {
    pub begin: TileRows,
    pub end: TileRows,
    pub count: TileRows,
}

impl LayerPlanes {
    const EMPTY: Self = Self { begin: TileRows::EMPTY, end: TileRows::EMPTY, count: TileRows::ZERO };
}

/// Those of a cell's tiles. Empty where the plan has no transparent layers or doesn't sample.
#[derive(Default)]
pub(crate) struct LayerSteps {
    tiles: Vec<Option<Box<LayerPlanes>>>,
}

impl LayerSteps {
    /// For a grid's tiles, if the plan needs it.
    pub(crate) fn new(grid: &Grid, plan: &FramePlan) -> Self {
        let wanted = plan.has(Pass::EdgeSamples) && plan.separates_transparent;
        Self { tiles: vec![None; if wanted { grid.tiles() } else { 0 }] }
    }

    /// Writes a block's.
    #[inline(always)]
    pub(crate) fn put<S: Simd>(&mut self, tile: usize, block: u32, layers: &CompositedLayers<S>) {
        let Some(tile) = self.tiles.get_mut(tile) else { return };
        let planes = tile.get_or_insert_with(|| Box::new(LayerPlanes::EMPTY));
        planes.begin.put(block, layers.begin);
        planes.end.put(block, layers.end);
        planes.count.put(block, layers.count);
    }

    /// A tile's, if it has layers.
    pub(crate) fn of(&self, tile: usize) -> Option<&LayerPlanes> {
        self.tiles.get(tile)?.as_deref()
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.tiles.as_slice()) + self.tiles.iter().flatten().count() * size_of::<LayerPlanes>()
    }
}
