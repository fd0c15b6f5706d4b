//! Lists of the opaque splats, and of the triangles, that touch each block of a tile.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::setup::record::Record;
use crate::setup::segment::Segment;
use crate::setup::triangles::{ScreenTriangle, TriangleSegment};
use crate::tiles::grid::Grid;
use crate::tiles::lists::{BlockLists, ItemLists};

/// The opaque splats of a cell, sorted into tiles, from which the lists of each block are filled.
#[derive(Clone, Copy)]
pub(crate) struct Listing<'a> {
    pub segments: &'a [Segment],
    pub grid: Grid,
}

impl<'a> Listing<'a> {
    /// True if no opaque splat touches the tile.
    pub(crate) fn is_empty(&self, tile: usize) -> bool {
        self.segments.iter().all(|s| s.lists.of(tile).is_empty())
    }

    /// Fills the block lists of a tile with the splats that touch each block in `wanted` (one bit per block).
    #[inline(always)]
    pub(crate) fn list(&self, tile: usize, wanted: u64, lists: &mut BlockLists<'a, Record>) {
        lists.clear();
        for segment in self.segments {
            lists.extend(&segment.records, segment.lists.of(tile), wanted);
        }
        lists.finish();
    }

    /// Fills the block lists of a tile as [`Self::list`] does; faster if few bits of `wanted` are set.
    #[inline(always)]
    pub(crate) fn list_some(&self, tile: usize, wanted: u64, lists: &mut BlockLists<'a, Record>) {
        lists.clear();
        for segment in self.segments {
            lists.extend_some(&segment.records, segment.lists.of(tile), wanted);
        }
        lists.finish();
    }
}

/// Fills the block lists of a tile with the triangles that touch each block in `wanted` (one bit per block), in scene
/// order. Returns bits of the blocks whose lists aren't empty.
pub(crate) fn list_triangles<'a>(
    segments: &'a [TriangleSegment],
    tile: usize,
    wanted: u64,
    lists: &mut ItemLists<&'a ScreenTriangle>,
) -> u64 {
    lists.clear();
    for segment in segments {
        for entry in segment.lists.of(tile) {
            lists.push(&segment.triangles[entry.record as usize], entry.blocks & wanted);
        }
    }
    lists.finish()
}

/// Per-thread block lists of splats and of triangles, reused between tiles.
#[derive(Default)]
pub(crate) struct ListScratch<'a> {
    pub splats: BlockLists<'a, Record>,
    pub triangles: ItemLists<&'a ScreenTriangle>,
}

impl ListScratch<'_> {
    /// Empties the lists and returns their memory for items of another lifetime.
    pub(crate) fn for_others<'b>(self) -> ListScratch<'b> {
        ListScratch { splats: self.splats.for_others(), triangles: self.triangles.for_others() }
    }
}
