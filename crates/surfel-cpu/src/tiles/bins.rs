//! Stable sorting of records into the lists of the tiles that they touch.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat, ball or triangle projected to
//! the screen, as setup stores it. A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::tiles::grid::Grid;
use crate::tiles::pool::Reused;

/// Size of a splat's record, in bytes. The cull module estimates memory by it.
pub(crate) const RECORD_BYTES: usize = 128;

/// An entry of a tile's list: a record that may touch the tile, and the blocks that it may touch there.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entry {
    /// Blocks of the tile that the record may touch: one bit per block, row by row, eight bits a row.
    pub blocks: u64,
    /// Index of the record in the segment's list of records.
    pub record: u32,
    /// Index of the tile, with the splat's [`Kind`] in the two highest bits.
    place: u32,
}

/// Kind of a record in a tile's list: a tiny splat, whose fragments setup has computed, or any other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Any splat, ball or triangle that isn't a tiny splat.
    Any = 0,
    /// A tiny splat of at most 2×2 pixels, whose fragments setup has computed.
    Tiny2 = 1,
    /// A tiny splat of at most 3×3 pixels, whose fragments setup has computed.
    Tiny3 = 2,
}

impl Entry {
    /// Creates an entry. Tiles are 8 pixels wide or more, so even the largest image has fewer than 2^30.
    #[inline(always)]
    pub(crate) fn new(blocks: u64, record: u32, tile: u32, kind: Kind) -> Self {
        Self::at(blocks, record, Self::place(tile, kind as u32))
    }

    /// Creates an entry from a tile and a kind that [`Self::place`] has packed.
    #[inline(always)]
    pub(crate) fn at(blocks: u64, record: u32, place: u32) -> Self {
        Self { blocks, record, place }
    }

    /// Packs the index of a tile and the number of a splat's [`Kind`] into an integer.
    #[inline(always)]
    pub(crate) fn place(tile: u32, kind: u32) -> u32 {
        tile | kind << 30
    }

    #[inline(always)]
    pub(crate) fn tile(&self) -> usize {
        (self.place & (u32::MAX >> 2)) as usize
    }

    #[inline(always)]
    pub(crate) fn kind(&self) -> Kind {
        match self.place >> 30 {
            0 => Kind::Any,
            1 => Kind::Tiny2,
            _ => Kind::Tiny3,
        }
    }
}

/// Largest number of entries of a group of 16 splats whose boxes are no larger than a tile: four tiles each.
pub(crate) const OF_GROUP: usize = 64;

/// A list of entries, sorted by tile or not.
pub(crate) type Entries = Reused<Entry>;

/// The entries of a grid's tiles, tile by tile. A tile's entries are in the order in which they were found, which is
/// splat order.
#[derive(Default)]
pub(crate) struct TileLists {
    /// Index in `entries` of each tile's first entry; empty if there are no entries.
    starts: Vec<u32>,
    /// Index in `entries` at which each tile's next entry is put; used only while sorting.
    next: Vec<u32>,
    /// Entries sorted by tile, stably.
    entries: Entries,
}

impl TileLists {
    /// Sorts entries into tiles by counting. The sorted entries reuse this list's memory. The content of `unsorted` is
    /// unspecified afterwards.
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
        // Every element is overwritten.
        self.entries.resize(unsorted.len());
        for &entry in unsorted.iter() {
            let at = &mut self.next[entry.tile()];
            self.entries[*at as usize] = entry;
            *at += 1;
        }
    }

    /// Returns the entries of a tile.
    pub(crate) fn of(&self, tile: usize) -> &[Entry] {
        match self.starts.get(tile..tile + 2) {
            Some(range) => &self.entries[range[0] as usize..range[1] as usize],
            None => &[],
        }
    }

    /// Returns the number of entries of all tiles.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// Returns the heap memory that the lists use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.starts.as_slice()) + size_of_val(&*self.entries)
    }
}
