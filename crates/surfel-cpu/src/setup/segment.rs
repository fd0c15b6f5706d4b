//! Segments: the records of some chunks, sorted into tiles.

use crate::setup::clips::{CellClips, ScreenClips};
use crate::setup::near::NearSplat;
use crate::setup::record::Records;
use crate::tiles::bins::TileLists;

/// The records of some chunks, with each tile's list of them in splat order.
#[derive(Default)]
pub(crate) struct Segment {
    pub records: Records,
    pub near: Vec<NearSplat>,
    pub clips: ScreenClips,
    /// Number of splats in chunks that were processed.
    pub set_up: u64,
    /// Number of splats with a record, each counted in one cell of a view.
    pub drawn: u64,
    /// Thread time of setup, in seconds.
    pub set_up_s: f64,
    /// Thread time of sorting, in seconds.
    pub sort_s: f64,
    /// Lists of the records that touch each tile.
    pub lists: TileLists,
    /// The largest ε of the splats whose facings are separated; 0 without any.
    pub largest_epsilon: f32,
}

impl Segment {
    /// Clears everything that sorting doesn't overwrite, and retains the memory.
    pub(crate) fn clear(&mut self) {
        self.records.clear();
        self.near.clear();
        self.set_up = 0;
        self.drawn = 0;
        self.largest_epsilon = 0.0;
        (self.set_up_s, self.sort_s) = (0.0, 0.0);
    }

    /// Moves the near splats and the clips to the ends of the cell's lists.
    pub(crate) fn move_rare(&mut self, near: &mut Vec<NearSplat>, clips: &mut CellClips) {
        clips.push(std::mem::take(&mut self.clips));
        if !self.near.is_empty() {
            self.records.iter_mut().for_each(|record| record.renumber(near.len()));
            near.append(&mut self.near);
        }
    }

    /// Returns the heap memory in use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.records) + self.lists.bytes()
    }
}

/// Data that a transparent splat has besides its record.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TransparentSplat {
    pub alpha: f32,
    /// View position of the splat's centre.
    pub center: [f32; 3],
    /// Colour, lit at the splat's centre, if the plan has a layer of remaining fragments.
    pub lit: [f32; 3],
}

/// Transparent splats of some chunks: their records, sorted into tiles, and their additional data.
#[derive(Default)]
pub(crate) struct TransparentSegment {
    pub segment: Segment,
    /// Additional data of the splats, one for each record.
    pub splats: Vec<TransparentSplat>,
}
