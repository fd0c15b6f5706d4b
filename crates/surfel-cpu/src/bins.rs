//! Records sorted stably into tiles, in segments that threads fill on their own.

use crate::near::NearSplat;
use crate::record::Record;
use surfel_render::Region;

/// Pixels along a tile's side.
pub(crate) const TILE: u32 = 32;

/// The region cut into tiles.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    pub region: Region,
    pub columns: u32,
    pub rows: u32,
}

impl Grid {
    pub(crate) fn new(region: Region) -> Self {
        Self { region, columns: region.width.div_ceil(TILE), rows: region.height.div_ceil(TILE) }
    }

    /// Tiles that a box of pixels touches: columns and rows.
    fn tiles(&self, pixels: &[i32; 4]) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
        let column = |x: i32| (x as u32 - self.region.x) / TILE;
        let row = |y: i32| (y as u32 - self.region.y) / TILE;
        (column(pixels[0])..column(pixels[2] - 1) + 1, row(pixels[1])..row(pixels[3] - 1) + 1)
    }
}

/// Some chunks' records, with each tile's list of them in splat order.
pub(crate) struct Segment {
    pub records: Vec<Record>,
    pub near: Vec<NearSplat>,
    record_lists: Lists,
    near_lists: Lists,
}

impl Segment {
    pub(crate) fn new(records: Vec<Record>, near: Vec<NearSplat>, grid: &Grid) -> Self {
        let record_lists = Lists::new(records.iter().map(|r| &r.pixels), grid);
        let near_lists = Lists::new(near.iter().map(|r| &r.pixels), grid);
        Self { records, near, record_lists, near_lists }
    }

    /// Records that touch a tile.
    pub(crate) fn records_of(&self, tile: usize) -> impl Iterator<Item = &Record> {
        self.record_lists.of(tile).iter().map(|&i| &self.records[i as usize])
    }

    /// Near splats that touch a tile.
    pub(crate) fn near_of(&self, tile: usize) -> impl Iterator<Item = &NearSplat> {
        self.near_lists.of(tile).iter().map(|&i| &self.near[i as usize])
    }

    /// Pairs of record and tile.
    pub(crate) fn pairs(&self) -> usize {
        self.record_lists.entries.len() + self.near_lists.entries.len()
    }
}

/// A counting sort by tile.
struct Lists {
    /// Where each tile's entries start; empty if there are none at all.
    starts: Vec<u32>,
    entries: Vec<u32>,
}

impl Lists {
    fn new<'a>(boxes: impl Iterator<Item = &'a [i32; 4]> + Clone, grid: &Grid) -> Self {
        let mut starts = vec![0u32; (grid.columns * grid.rows + 1) as usize];
        let each = |pixels: &[i32; 4], visit: &mut dyn FnMut(usize)| {
            let (columns, rows) = grid.tiles(pixels);
            for row in rows {
                for column in columns.clone() {
                    visit((row * grid.columns + column) as usize);
                }
            }
        };
        for pixels in boxes.clone() {
            each(pixels, &mut |tile| starts[tile + 1] += 1);
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let total = starts[starts.len() - 1] as usize;
        if total == 0 {
            return Self { starts: Vec::new(), entries: Vec::new() };
        }
        let mut entries = vec![0u32; total];
        let mut next = starts.clone();
        for (i, pixels) in boxes.enumerate() {
            each(pixels, &mut |tile| {
                entries[next[tile] as usize] = i as u32;
                next[tile] += 1;
            });
        }
        Self { starts, entries }
    }

    fn of(&self, tile: usize) -> &[u32] {
        match self.starts.get(tile..tile + 2) {
            Some(range) => &self.entries[range[0] as usize..range[1] as usize],
            None => &[],
        }
    }
}
