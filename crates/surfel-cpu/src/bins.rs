//! Records sorted stably into tiles, in segments that threads fill on their own.

use crate::clip::{FrameClips, ScreenClips};
use crate::near::NearSplat;
use crate::record::{Records, Slots};
use crate::small_dots::SmallDot;
use surfel_render::Region;

/// Pixels along the side of a block, the unit of rasterisation: sixteen pixels, one for each lane.
pub(crate) const BLOCK: u32 = 4;

/// Blocks along a tile's side, at most: one bit each in a `u64`.
pub(crate) const TILE_BLOCKS: u32 = 8;

/// A region cut into tiles, whose corners are whole multiples of their size: what a block computes doesn't depend on
/// the region.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    pub region: Region,
    /// Blocks along a tile's side: 2, 4 or 8.
    pub tile_blocks: u32,
    /// First column and row of the first tile, in pixels.
    pub origin: [u32; 2],
    pub columns: u32,
    pub rows: u32,
}

impl Grid {
    pub(crate) fn new(region: Region, tile_blocks: u32) -> Self {
        let tile = tile_blocks * BLOCK;
        let first = [region.x / tile, region.y / tile];
        Self {
            region,
            tile_blocks,
            origin: first.map(|i| i * tile),
            columns: (region.x + region.width).div_ceil(tile) - first[0],
            rows: (region.y + region.height).div_ceil(tile) - first[1],
        }
    }

    pub(crate) fn tiles(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// The tile that holds a pixel of the region.
    pub(crate) fn tile_of(&self, x: i32, y: i32) -> usize {
        let [column, row] =
            [(x, self.origin[0]), (y, self.origin[1])].map(|(at, first)| (at as u32 - first) / self.tile_px());
        (row * self.columns + column) as usize
    }

    /// Pixels along a tile's side.
    pub(crate) fn tile_px(&self) -> u32 {
        self.tile_blocks * BLOCK
    }
}

/// A record in a tile.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entry {
    /// Blocks of the tile that it may touch, a bit each, row by row, eight bits a row.
    pub blocks: u64,
    /// Index of the record, or small dot, in its segment.
    pub record: u32,
    /// Index of the tile, and [`Kind`] in the two highest bits.
    place: u32,
}

/// Whether a splat is a [dot](crate::dots).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Any = 0,
    /// One of 2×2 pixels.
    Four = 1,
    /// One of 3×3 pixels.
    Nine = 2,
    /// One of 2×2 pixels among the [small ones](crate::small_dots).
    Small = 3,
}

impl Entry {
    /// Tiles are 8 pixels wide or more: even the largest picture has fewer than 2^30.
    #[inline(always)]
    pub(crate) fn new(blocks: u64, record: u32, tile: u32, kind: Kind) -> Self {
        Self::at(blocks, record, Self::place(tile, kind as u32))
    }

    /// Of a [`Self::place`].
    #[inline(always)]
    pub(crate) fn at(blocks: u64, record: u32, place: u32) -> Self {
        Self { blocks, record, place }
    }

    /// A tile, and the number of a splat's [`Kind`] there.
    #[inline(always)]
    pub(crate) fn place(tile: u32, kind: u32) -> u32 {
        tile | kind << 30
    }

    #[inline(always)]
    pub(crate) fn tile(&self) -> usize {
        (self.place & (u32::MAX >> 2)) as usize
    }

    /// Another record of the same splat.
    pub(crate) fn refer_to(&mut self, record: u32, kind: Kind) {
        *self = Self::new(self.blocks, record, self.tile() as u32, kind);
    }

    #[inline(always)]
    pub(crate) fn kind(&self) -> Kind {
        match self.place >> 30 {
            0 => Kind::Any,
            1 => Kind::Four,
            2 => Kind::Nine,
            _ => Kind::Small,
        }
    }
}

/// Entries of sixteen splats no larger than a tile, at most.
pub(crate) const OF_SIXTEEN: usize = 64;

/// Entries before they are sorted. Their memory is kept when they are cleared: what is written is written once.
#[derive(Default)]
pub(crate) struct Entries {
    /// Those past `used` are left from before.
    slots: Vec<Entry>,
    used: usize,
}

impl Entries {
    pub(crate) fn clear(&mut self) {
        self.used = 0;
    }

    #[inline(always)]
    pub(crate) fn push(&mut self, entry: Entry) {
        if let Some(room) = self.room() {
            room[0] = entry;
            self.advance(1);
        }
    }

    /// Where the next ones go, always there; [`Self::advance`] says how many were added.
    #[inline(always)]
    pub(crate) fn room(&mut self) -> Option<&mut [Entry; OF_SIXTEEN]> {
        if self.slots.len() < self.used + OF_SIXTEEN {
            self.grow();
        }
        self.slots[self.used..].first_chunk_mut()
    }

    /// So many, whatever they hold.
    fn resize(&mut self, count: usize) -> &mut [Entry] {
        if self.slots.len() < count {
            self.slots.resize(count, Entry::default());
        }
        self.used = count;
        &mut self.slots[..count]
    }

    #[cold]
    fn grow(&mut self) {
        self.slots.resize(2 * self.slots.len() + OF_SIXTEEN, Entry::default());
    }

    #[inline(always)]
    pub(crate) fn advance(&mut self, count: usize) {
        self.used += count;
    }
}

impl std::ops::Deref for Entries {
    type Target = [Entry];

    fn deref(&self) -> &[Entry] {
        &self.slots[..self.used]
    }
}

/// Each tile's entries, in the order in which they were found.
#[derive(Default)]
pub(crate) struct TileLists {
    /// Where each tile's entries start; empty if there are none at all.
    starts: Vec<u32>,
    /// Where each tile's next entry goes, while they are sorted.
    next: Vec<u32>,
    /// Sorted.
    entries: Entries,
}

impl TileLists {
    /// Sorts entries into tiles, by counting, in the memory of what was sorted before, and leaves that of what wasn't.
    pub(crate) fn sort(&mut self, unsorted: &mut Entries, grid: &Grid) {
        self.starts.clear();
        self.entries.clear();
        if unsorted.is_empty() {
            return;
        }
        self.starts.resize(grid.tiles() + 1, 0);
        if grid.tiles() == 1 {
            self.starts[1] = unsorted.len() as u32;
            std::mem::swap(&mut self.entries, unsorted);
            return;
        }
        for entry in unsorted.iter() {
            self.starts[entry.tile() + 1] += 1;
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.next.clone_from(&self.starts);
        // What is there is overwritten, all of it.
        let sorted = self.entries.resize(unsorted.len());
        for &entry in unsorted.iter() {
            let at = &mut self.next[entry.tile()];
            sorted[*at as usize] = entry;
            *at += 1;
        }
    }

    /// The entries of a tile.
    pub(crate) fn of(&self, tile: usize) -> &[Entry] {
        match self.starts.get(tile..tile + 2) {
            Some(range) => &self.entries[range[0] as usize..range[1] as usize],
            None => &[],
        }
    }

    pub(crate) fn of_mut(&mut self, tile: usize) -> &mut [Entry] {
        match self.starts.get(tile..tile + 2) {
            Some(range) => &mut self.entries.slots[range[0] as usize..range[1] as usize],
            None => &mut [],
        }
    }

    /// How many entries each tile has; nothing if there are none at all.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = usize> {
        self.starts.windows(2).map(|range| (range[1] - range[0]) as usize)
    }

    /// Entries of all tiles.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.starts.as_slice()) + size_of_val(&*self.entries)
    }
}

/// Some chunks' records, with each tile's list of them in splat order.
#[derive(Default)]
pub(crate) struct Segment {
    pub records: Records,
    /// Dots that need no record.
    pub small_dots: Slots<SmallDot>,
    /// Records that small dots were given.
    pub unfolded: u64,
    pub near: Vec<NearSplat>,
    pub clips: ScreenClips,
    /// Splats that were looked at one by one.
    pub set_up: u64,
    /// Splats with a record, each counted in one part of a view.
    pub drawn: u64,
    /// Seconds of a thread that setting up and sorting took.
    pub set_up_s: f64,
    pub sort_s: f64,
    pub lists: TileLists,
}

impl Segment {
    /// Empties it but for what sorting overwrites, and keeps its memory.
    pub(crate) fn clear(&mut self) {
        self.records.clear();
        self.small_dots.clear();
        self.unfolded = 0;
        self.near.clear();
        self.set_up = 0;
        self.drawn = 0;
        (self.set_up_s, self.sort_s) = (0.0, 0.0);
    }

    /// Sorts the records' entries into tiles.
    pub(crate) fn sort(&mut self, unsorted: &mut Entries, grid: &Grid) {
        self.lists.sort(unsorted, grid);
    }

    /// Moves its near splats and clips to the end of everyone's.
    pub(crate) fn move_rare(&mut self, near: &mut Vec<NearSplat>, clips: &mut FrameClips) {
        clips.push(std::mem::take(&mut self.clips));
        if !self.near.is_empty() {
            self.records.iter_mut().for_each(|record| record.renumber(near.len()));
            near.append(&mut self.near);
        }
    }

    /// The records that touch a tile, in splat order.
    pub(crate) fn of(&self, tile: usize) -> &[Entry] {
        self.lists.of(tile)
    }

    /// How many records touch each tile; nothing if there are none at all.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = usize> {
        self.lists.lengths()
    }

    /// Pairs of record and tile.
    pub(crate) fn pairs(&self) -> usize {
        self.lists.len()
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.records) + size_of_val(&*self.small_dots) + self.lists.bytes()
    }
}
