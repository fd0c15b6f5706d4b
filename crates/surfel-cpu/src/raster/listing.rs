//! Lists of a tile's opaque splats, and of its triangles.

use crate::setup::record::Record;
use crate::setup::segment::Segment;
use crate::setup::triangles::{ScreenTriangle, TriangleSegment};
use crate::tiles::grid::Grid;
use crate::tiles::lists::{BlockLists, ItemLists};

/// Opaque splats in tiles.
#[derive(Clone, Copy)]
pub(crate) struct Listing<'a> {
    pub segments: &'a [Segment],
    pub grid: Grid,
}

impl<'a> Listing<'a> {
    /// True if no opaque splat touches a tile.
    pub(crate) fn is_empty(&self, tile: usize) -> bool {
        self.segments.iter().all(|s| s.lists.of(tile).is_empty())
    }

    /// Fills the lists of a tile's blocks, those that are `wanted`.
    #[inline(always)]
    pub(crate) fn list(&self, tile: usize, wanted: u64, lists: &mut BlockLists<'a, Record>) {
        lists.clear();
        for segment in self.segments {
            lists.extend(&segment.records, segment.lists.of(tile), wanted);
        }
        lists.finish();
    }

    /// [`Self::list`] of few blocks.
    #[inline(always)]
    pub(crate) fn list_some(&self, tile: usize, wanted: u64, lists: &mut BlockLists<'a, Record>) {
        lists.clear();
        for segment in self.segments {
            lists.extend_some(&segment.records, segment.lists.of(tile), wanted);
        }
        lists.finish();
    }
}

/// Fills the lists of the `wanted` blocks of a tile with triangles, in scene order; which blocks have any.
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

/// What a thread reuses from tile to tile.
#[derive(Default)]
pub(crate) struct ListScratch<'a> {
    pub splats: BlockLists<'a, Record>,
    pub triangles: ItemLists<&'a ScreenTriangle>,
}

impl ListScratch<'_> {
    /// The same memory, for tiles of other things.
    pub(crate) fn for_others<'b>(self) -> ListScratch<'b> {
        ListScratch { splats: self.splats.for_others(), triangles: self.triangles.for_others() }
    }
}
