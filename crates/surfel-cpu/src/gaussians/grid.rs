//! Division of an image of Gaussians into tiles of 16×16 pixels.

use surfel_render::Region;

/// Side, in pixels, of the tiles in which Gaussians are drawn.
pub(super) const TILE_PX: u32 = 16;

/// Grid of tiles over a region of the image. The first tile begins at the region's first pixel.
pub(super) struct TileGrid {
    pub region: Region,
    pub columns: usize,
    rows: usize,
}

impl TileGrid {
    pub(super) fn new(region: Region) -> Self {
        let [columns, rows] = [region.width, region.height].map(|px| px.div_ceil(TILE_PX) as usize);
        Self { region, columns, rows }
    }

    pub(super) fn tiles(&self) -> usize {
        self.columns * self.rows
    }

    /// Returns the pixels of a tile, clipped to the region.
    pub(super) fn pixels(&self, tile: usize) -> Region {
        let [x, y] = [tile % self.columns, tile / self.columns].map(|at| at as u32 * TILE_PX);
        let Region { width, height, .. } = self.region;
        Region {
            x: self.region.x + x,
            y: self.region.y + y,
            width: TILE_PX.min(width - x),
            height: TILE_PX.min(height - y),
        }
    }
}
