//! Writing of drawn pixels to image files.

use super::OrthoStats;
use super::block::BlockPixels;
use super::block::StoredPlanes;
use super::fill::{BlockStore, Planes};
use super::grid::Grid;
use super::layout::Layout;
use std::path::Path;
use surfel_io::{GeoSamples, GeoTiles, IoError};

/// Kind of values that an image file stores.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Shown {
    Color,
    Height,
    Normal,
}

/// Image files to which drawn pixels are written, one per kind of values.
pub(super) struct Sink<'a, 'b> {
    pub(super) grid: Grid,
    pub(super) shown: Vec<Shown>,
    pub(super) tiles: &'a mut [GeoTiles<'b>],
}

impl Sink<'_, '_> {
    pub(super) fn has(&self) -> StoredPlanes {
        StoredPlanes { color: self.shown.contains(&Shown::Color), normal: self.shown.contains(&Shown::Normal) }
    }

    /// Writes a rectangle of pixels to all files, and counts it in `stats`. `at` is the column and row of its upper
    /// left pixel in the image.
    pub(super) fn write(&mut self, at: [u32; 2], planes: &Planes, stats: &mut OrthoStats) -> Result<(), IoError> {
        let width = planes.width as u32;
        let or_no_data = |v: f32| if v.is_nan() { GeoSamples::NODATA } else { v };
        for (shown, tiles) in self.shown.iter().zip(self.tiles.iter_mut()) {
            match shown {
                Shown::Color => tiles.write_color(at, width, &planes.color, &planes.filled)?,
                Shown::Height => {
                    let heights: Vec<f32> = planes.height.iter().copied().map(or_no_data).collect();
                    tiles.write_f32(at, width, &heights, &planes.filled)?;
                }
                Shown::Normal => {
                    let normals: Vec<f32> = planes.normal.as_flattened().iter().copied().map(or_no_data).collect();
                    tiles.write_f32(at, width, &normals, &planes.filled)?;
                }
            }
        }
        stats.covered += planes.height.iter().filter(|z| !z.is_nan()).count() as u64;
        stats.filled += planes.filled.iter().filter(|filled| **filled).count() as u64;
        Ok(())
    }

    pub(super) fn done_above(&mut self, row: u32) -> Result<(), IoError> {
        self.tiles.iter_mut().try_for_each(|tiles| tiles.done_above(row))
    }
}

/// Destination to which drawn blocks are written.
pub(super) enum Out<'a, 'b, 'c> {
    /// Image files, to which only the pixels of a block within the image are written.
    Image(&'a mut Sink<'b, 'c>),
    /// Store for whole blocks, in which gaps are filled later. The path is that of an image file in the same folder,
    /// for messages.
    Store(&'a mut BlockStore, &'a Path),
}

impl Out<'_, '_, '_> {
    pub(super) fn has(&self) -> StoredPlanes {
        match self {
            Self::Image(sink) => sink.has(),
            Self::Store(store, _) => store.has(),
        }
    }

    pub(super) fn put(
        &mut self,
        pixels: &BlockPixels,
        layout: &Layout,
        block: [i64; 2],
        stats: &mut OrthoStats,
    ) -> Result<(), IoError> {
        let Layout { block_px, margin_px, .. } = *layout;
        match self {
            Self::Image(sink) => {
                let grid = sink.grid;
                let overlap = |axis: usize| {
                    let (first, count) = (grid.first[axis], i64::from(grid.size[axis]));
                    let start = block[axis] * block_px;
                    (start.max(first), (start + block_px).min(first + count))
                };
                let ((x0, x1), (y0, y1)) = (overlap(0), overlap(1));
                // Rows of a block are counted from the top, rows of the grid from the south.
                let top = (block[1] + 1) * block_px + margin_px;
                let rows = (y0..y1).rev().map(|y| (top - 1 - y) as usize);
                let left = (x0 - block[0] * block_px + margin_px) as usize;
                let planes = Planes::cut(pixels, left, (x1 - x0) as usize, rows);
                let at = [x0 - grid.first[0], grid.first[1] + i64::from(grid.size[1]) - y1].map(|v| v as u32);
                sink.write(at, &planes, stats)
            }
            Self::Store(store, path) => {
                let (from, side) = (margin_px as usize, block_px as usize);
                let planes = Planes::cut(pixels, from, side, from..from + side);
                store.put(block, &planes).map_err(|source| unwritable(path, source))
            }
        }
    }

    /// Reports that the row of blocks with this index is complete, so that the image files can write their finished
    /// tiles.
    pub(super) fn done(&mut self, layout: &Layout, row: i64) -> Result<(), IoError> {
        let Self::Image(sink) = self else { return Ok(()) };
        let end = sink.grid.first[1] + i64::from(sink.grid.size[1]) - row * layout.block_px;
        sink.done_above(end.clamp(0, i64::from(sink.grid.size[1])) as u32)
    }
}

pub(super) fn unwritable(path: &Path, source: std::io::Error) -> IoError {
    IoError::System { path: path.to_path_buf(), action: "write it", source }
}
