//! Stable sorting of items into tiles.

use crate::tiles::grid::Grid;
use crate::tiles::pool::Reused;

/// Size of a splat's record, in bytes.
pub(crate) const RECORD_BYTES: usize = 128;

/// An entry of a tile's list: a record that may touch the tile.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entry {
    /// Blocks of the tile that the record may touch, one bit per block, row by row, eight bits a row.
    pub blocks: u64,
    /// Index of the record in its segment.
    pub record: u32,
    /// Index of the tile, with [`Kind`] in the two highest bits.
    place: u32,
}

/// Kind of a splat: a tiny one, whose fragments setup has computed, or any other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Any = 0,
    /// A tiny splat of 2×2 pixels.
    Tiny2 = 1,
    /// A tiny splat of 3×3 pixels.
    Tiny3 = 2,
}

impl Entry {
    /// Creates an entry. Tiles are 8 pixels wide or more, so even the largest image has fewer than 2^30.
    #[inline(always)]
    pub(crate) fn new(blocks: u64, record: u32, tile: u32, kind: Kind) -> Self {
        Self::at(blocks, record, Self::place(tile, kind as u32))
    }

    /// Creates an entry from a packed [`Self::place`].
    #[inline(always)]
    pub(crate) fn at(blocks: u64, record: u32, place: u32) -> Self {
        Self { blocks, record, place }
    }

    /// Packs a tile and the number of a splat's [`Kind`].
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

/// Maximum number of entries of a group of 16 splats no larger than a tile.
pub(crate) const OF_GROUP: usize = 64;

/// A list of entries, sorted or unsorted.
pub(crate) type Entries = Reused<Entry>;

/// The entries of each tile, in the order in which they were found.
#[derive(Default)]
pub(crate) struct TileLists {
    /// Index of each tile's first entry; empty if there are no entries.
    starts: Vec<u32>,
    /// Index of each tile's next entry, during sorting.
    next: Vec<u32>,
    /// Entries sorted by tile.
    entries: Entries,
}

impl TileLists {
    /// Sorts entries into tiles by counting. The sorted entries reuse this list's memory; `unsorted` retains its own,
    /// or gets this list's.
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

    /// Returns the heap memory in use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.starts.as_slice()) + size_of_val(&*self.entries)
    }
}
