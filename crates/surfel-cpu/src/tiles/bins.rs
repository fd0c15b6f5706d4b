//! Items sorted stably into tiles.

use crate::tiles::grid::Grid;
use crate::tiles::pool::Reused;

/// Bytes of a record of a splat.
pub(crate) const RECORD_BYTES: usize = 128;

/// A record in a tile.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entry {
    /// Blocks of the tile that it may touch, a bit each, row by row, eight bits a row.
    pub blocks: u64,
    /// Index of the record in its segment.
    pub record: u32,
    /// Index of the tile, and [`Kind`] in the two highest bits.
    place: u32,
}

/// Whether a splat is a tiny one, whose fragments setup has found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Any = 0,
    /// One of 2×2 pixels.
    Tiny2 = 1,
    /// One of 3×3 pixels.
    Tiny3 = 2,
}

impl Entry {
    /// Tiles are 8 pixels wide or more: even the largest image has fewer than 2^30.
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

    #[inline(always)]
    pub(crate) fn kind(&self) -> Kind {
        match self.place >> 30 {
            0 => Kind::Any,
            1 => Kind::Tiny2,
            _ => Kind::Tiny3,
        }
    }
}

/// Entries of a group of 16 splats no larger than a tile, at most.
pub(crate) const OF_GROUP: usize = 64;

/// Entries, before they are sorted or after.
pub(crate) type Entries = Reused<Entry>;

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
        self.entries.resize(unsorted.len());
        for &entry in unsorted.iter() {
            let at = &mut self.next[entry.tile()];
            self.entries[*at as usize] = entry;
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

    /// Entries of all tiles.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.starts.as_slice()) + size_of_val(&*self.entries)
    }
}
