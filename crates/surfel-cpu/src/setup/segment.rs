//! Segments: the records of the chunks that one setup has processed, sorted into tiles.
//!
//! A *cell* is a part of the view that one thread draws alone ([`Cell`](crate::cull::cells::Cell)). A *record* is a
//! splat projected to the screen ([`Record`](crate::setup::record::Record)). A *tile* is a square of 8 to 32 pixels a
//! side ([`Grid`](crate::tiles::grid::Grid)).

use crate::setup::clips::{CellClips, ScreenClips};
use crate::setup::near::NearSplat;
use crate::setup::record::Records;
use crate::tiles::bins::TileLists;

/// The records of the chunks that one setup has processed, with each tile's list of them in splat order.
#[derive(Default)]
pub(crate) struct Segment {
    pub records: Records,
    pub near: Vec<NearSplat>,
    pub clips: ScreenClips,
    /// Number of splats in the chunks that were processed.
    pub set_up: u64,
    /// Number of splats that have a record, each counted in only one cell of a view.
    pub drawn: u64,
    /// Thread time of projecting the splats, in seconds.
    pub set_up_s: f64,
    /// Thread time of sorting the records into tiles, in seconds.
    pub sort_s: f64,
    /// Lists of the records that may touch each tile.
    pub lists: TileLists,
    /// Largest depth tolerance ε, in world units, of the splats of oriented clouds, if front and back sides are blended
    /// separately; else 0.
    pub largest_epsilon: f32,
}

impl Segment {
    /// Clears everything that sorting doesn't overwrite, without freeing memory.
    pub(crate) fn clear(&mut self) {
        self.records.clear();
        self.near.clear();
        self.set_up = 0;
        self.drawn = 0;
        self.largest_epsilon = 0.0;
        (self.set_up_s, self.sort_s) = (0.0, 0.0);
    }

    /// Moves the near splats and the clips, of which few frames have any, to the ends of the cell's lists.
    pub(crate) fn move_near_and_clips(&mut self, near: &mut Vec<NearSplat>, clips: &mut CellClips) {
        clips.push(std::mem::take(&mut self.clips));
        if !self.near.is_empty() {
            self.records.iter_mut().for_each(|record| record.renumber(near.len()));
            near.append(&mut self.near);
        }
    }

    /// Returns the heap memory that records and lists use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.records) + self.lists.bytes()
    }
}

/// Opacity, position and light of a transparent splat, which its record doesn't contain.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TransparentSplat {
    pub alpha: f32,
    /// View position of the splat's centre.
    pub center: [f32; 3],
    /// Colour lit at the splat's centre, for the layer that blends the fragments behind the peeled layers; unused
    /// without that layer.
    pub lit: [f32; 3],
}

/// Transparent splats of the chunks that one setup has processed: their records, sorted into tiles, and further data.
#[derive(Default)]
pub(crate) struct TransparentSegment {
    pub segment: Segment,
    /// Opacity, position and light of each splat, in the order of the records.
    pub splats: Vec<TransparentSplat>,
}
