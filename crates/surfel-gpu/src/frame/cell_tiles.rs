//! Tile that the compute path draws, and the tiles of the samples of its edge pixels. A *cell* is a square of 16×16
//! pixels (or samples) of a tile, which one workgroup draws.

use crate::frame::tile::TileData;
use crate::frame::uniforms::FrameScene;
use crate::passes::cell_stages::{CellStage, cell_stages, sample_stages};
use crate::passes::cells::{BIN_SIDE, CellBuffer, CellCapacity, CellCounts, MAX_BINS};
use crate::scene::limits::Limits;
use crate::scene::segment::UploadedScene;
use surfel_render::{FramePlan, Pass, Region, SAMPLES_SIDE, View};
use surfel_shaders::layout;

/// Number of image pixels along the side of a cell whose pixels are samples. Each image pixel has [`SAMPLES_SIDE`]
/// samples along its side.
const PIXELS_OF_CELL: u32 = layout::CELL_SIDE / SAMPLES_SIDE;

/// A tile of pixels, followed by the tiles of its samples if edges are antialiased by samples.
pub struct CellTiles {
    tiles: Vec<TileData>,
    counts: Vec<CellCounts>,
}

impl CellTiles {
    /// Creates the list: the tile `pixels` and, if the plan antialiases edges by samples, the tiles of its samples.
    pub fn new(pixels: TileData, scene: &UploadedScene, frame: &FrameScene, view: &View, plan: &FramePlan) -> Self {
        let mut tiles = Vec::new();
        if plan.has(Pass::EdgeSamples) {
            let (fine_view, fine_plan) = (view.of_samples(), plan.of_samples());
            for (i, part) in (1..).zip(sampled_parts(pixels.tile)) {
                let samples = part.of_samples();
                let mut data = TileData::of_cells(scene, frame, &fine_view, &fine_plan, samples);
                data.attach_to_pixel_tile(&pixels, samples);
                data.put_part(i, plan);
                tiles.push(data);
            }
        }
        tiles.insert(0, pixels);
        let counts = tiles.iter().filter_map(|tile| tile.cells.clone()).collect();
        Self { tiles, counts }
    }

    /// Returns the tiles in the order in which they are drawn.
    pub fn tiles(&self) -> &[TileData] {
        &self.tiles
    }

    /// Prepares the tiles for compositing over an application's image: sets the mapping of its depths, and makes the
    /// background transparent. The depth buffer contains `offset + scale/z` or, in orthographic views, `offset +
    /// scale·z` for the depth z.
    pub fn prepare_for_host(&mut self, offset: f32, scale: f32) {
        for tile in &mut self.tiles {
            tile.set_host_depth(offset, scale);
            tile.clear_background();
        }
    }

    /// Returns the data of the tile of pixels.
    pub fn into_pixels(self) -> Option<TileData> {
        self.tiles.into_iter().next()
    }

    /// Returns the tile of pixels, which is the first of the tiles.
    pub fn pixels(&self) -> Option<&TileData> {
        self.tiles.first()
    }

    /// Returns the capacity with which the tiles are first drawn: the capacity `before` of an earlier tile, or an
    /// estimate. `None` if neither is within the limits.
    pub fn room(&self, before: Option<CellCapacity>, limits: Limits) -> Option<CellCapacity> {
        CellCapacity::start(before, &self.counts, limits)
    }

    /// Returns the capacity of buffers that the tiles need, after they were drawn with the capacity `room`. `counters`
    /// are the words of [`CellBuffer::Counters`] after drawing. `None` if the capacity exceeds the limits.
    pub fn grown(&self, room: CellCapacity, counters: &[u32], limits: Limits) -> Option<CellCapacity> {
        room.grown(counters, &self.counts, limits)
    }

    /// Writes the capacity of the buffers to the tiles' uniforms.
    pub fn put_room(&mut self, room: CellCapacity) {
        self.tiles.iter_mut().for_each(|tile| tile.put_room(room));
    }

    /// Returns the number of floats of the shaders' `planes` with the capacity `room`: the planes of the tile of pixels
    /// and what other passes read, and then the samples if they have transparent layers.
    pub fn floats(&self, room: CellCapacity) -> u32 {
        room.all_floats(&self.counts).try_into().unwrap_or(u32::MAX)
    }

    /// Returns the size of a buffer, in bytes, that suffices for all of these tiles with the capacity `room`.
    pub fn bytes(&self, buffer: CellBuffer, room: CellCapacity) -> u64 {
        buffer.bytes(&self.counts, room)
    }

    /// Returns, for each tile of [`CellTiles::tiles`], the stages that draw it, in the order in which they run.
    pub fn stages(&self, plan: &FramePlan, room: CellCapacity) -> Vec<Vec<CellStage>> {
        let of_tile = |(tile, cells): (&TileData, &CellCounts)| {
            let size = [tile.tile.width, tile.tile.height];
            if cells.is_of_samples {
                sample_stages(plan, cells, room, size.map(|side| side / SAMPLES_SIDE))
            } else {
                cell_stages(plan, cells, room, size)
            }
        };
        self.tiles.iter().zip(&self.counts).map(of_tile).collect()
    }
}

/// Splits a tile of pixels into bands of rows. The samples of a band have at most [`MAX_BINS`] bins.
fn sampled_parts(tile: Region) -> Vec<Region> {
    let columns = tile.width.div_ceil(PIXELS_OF_CELL * BIN_SIDE).max(1);
    let height = (MAX_BINS / columns).max(1) * PIXELS_OF_CELL * BIN_SIDE;
    let rows = (0..tile.height).step_by(height as usize);
    rows.map(|y| Region { y: tile.y + y, height: height.min(tile.height - y), ..tile }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::cells::bins_of;

    #[test]
    fn parts_of_samples_hold_every_pixel_once_and_have_few_enough_bins() {
        for size in [[1, 1], [70, 50], [1024, 1024], [1920, 1080], [4096, 4096]] {
            let tile = Region { x: 3, y: 5, width: size[0], height: size[1] };
            let parts = sampled_parts(tile);
            let mut next = tile.y;
            for part in &parts {
                assert_eq!((part.x, part.y, part.width), (tile.x, next, tile.width));
                let samples = part.of_samples();
                let bins = bins_of(CellCounts::size_of([samples.width, samples.height]));
                assert!(bins <= MAX_BINS, "{size:?}: {bins}");
                next += part.height;
            }
            assert_eq!(next, tile.y + tile.height);
        }
        assert_eq!(sampled_parts(Region { x: 0, y: 0, width: 1024, height: 1024 }).len(), 1);
    }
}
