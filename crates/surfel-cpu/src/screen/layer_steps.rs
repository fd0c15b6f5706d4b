//! Planes of transparent layers for edges by samples: depth range of the nearest layer, and number of layers (rendering
//! model §5).
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::screen::gbuffer::TileRows;
use crate::shade::transparent::CompositedLayers;
use crate::tiles::grid::Grid;
use fearless_simd::Simd;
use surfel_render::{FramePlan, Pass};

/// Planes of one tile's transparent layers. In pixels without layers, the depths are +∞ and the number is 0.
#[derive(Clone)]
pub(crate) struct LayerPlanes {
    /// Depth at which the nearest layer begins.
    pub begin: TileRows,
    /// Depth at which the nearest layer ends.
    pub end: TileRows,
    /// Number of layers that aren't empty.
    pub count: TileRows,
}

impl LayerPlanes {
    const EMPTY: Self = Self { begin: TileRows::EMPTY, end: TileRows::EMPTY, count: TileRows::ZERO };
}

/// Planes of transparent layers of a cell's tiles, in which edges by samples find steps. Empty if the plan has no
/// transparent layers or no samples.
#[derive(Default)]
pub(crate) struct LayerSteps {
    tiles: Vec<Option<Box<LayerPlanes>>>,
}

impl LayerSteps {
    /// Returns empty planes for a grid's tiles, or none if the plan doesn't need them.
    pub(crate) fn new(grid: &Grid, plan: &FramePlan) -> Self {
        let wanted = plan.has(Pass::EdgeSamples) && plan.separates_transparent;
        Self { tiles: vec![None; if wanted { grid.tiles() } else { 0 }] }
    }

    /// Writes the planes of a block from its composited layers.
    #[inline(always)]
    pub(crate) fn put<S: Simd>(&mut self, tile: usize, block: u32, layers: &CompositedLayers<S>) {
        let Some(tile) = self.tiles.get_mut(tile) else { return };
        let planes = tile.get_or_insert_with(|| Box::new(LayerPlanes::EMPTY));
        planes.begin.put(block, layers.begin);
        planes.end.put(block, layers.end);
        planes.count.put(block, layers.count);
    }

    /// Returns the planes of a tile; `None` if the tile has no layers.
    pub(crate) fn of(&self, tile: usize) -> Option<&LayerPlanes> {
        self.tiles.get(tile)?.as_deref()
    }

    /// Returns the heap memory that the planes use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.tiles.as_slice()) + self.tiles.iter().flatten().count() * size_of::<LayerPlanes>()
    }
}
