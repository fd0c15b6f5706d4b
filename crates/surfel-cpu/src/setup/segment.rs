//! Records of some chunks, sorted into tiles.

use crate::setup::clips::{CellClips, ScreenClips};
use crate::setup::near::NearSplat;
use crate::setup::record::Records;
use crate::tiles::bins::TileLists;

/// Some chunks' records, with each tile's list of them in splat order.
#[derive(Default)]
pub(crate) struct Segment {
    pub records: Records,
    pub near: Vec<NearSplat>,
    pub clips: ScreenClips,
    /// Splats that were looked at one by one.
    pub set_up: u64,
    /// Splats with a record, each counted in one part of a view.
    pub drawn: u64,
    /// Seconds of a thread that setting up and sorting took.
    pub set_up_s: f64,
    pub sort_s: f64,
    /// The records that touch each tile.
    pub lists: TileLists,
    /// The largest ε of splats whose sides are kept apart; 0 without any.
    pub largest_epsilon: f32,
}

impl Segment {
    /// Empties it but for what sorting overwrites, and keeps its memory.
    pub(crate) fn clear(&mut self) {
        self.records.clear();
        self.near.clear();
        self.set_up = 0;
        self.drawn = 0;
        self.largest_epsilon = 0.0;
        (self.set_up_s, self.sort_s) = (0.0, 0.0);
    }

    /// Moves its near splats and clips to the end of everyone's.
    pub(crate) fn move_rare(&mut self, near: &mut Vec<NearSplat>, clips: &mut CellClips) {
        clips.push(std::mem::take(&mut self.clips));
        if !self.near.is_empty() {
            self.records.iter_mut().for_each(|record| record.renumber(near.len()));
            near.append(&mut self.near);
        }
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.records) + self.lists.bytes()
    }
}

/// What a transparent splat has besides its record.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TransparentSplat {
    pub alpha: f32,
    /// View position of its centre.
    pub center: [f32; 3],
    /// Its colour lit at its centre, where the plan has a remaining layer.
    pub lit: [f32; 3],
}

/// Some chunks' transparent splats: their records, sorted into tiles, and what they have besides.
#[derive(Default)]
pub(crate) struct TransparentSegment {
    pub segment: Segment,
    /// One for each record.
    pub splats: Vec<TransparentSplat>,
}
