//! Splats that may touch samples of a cell's pixels: setup notes them in the view of pixels, so that few are set up
//! once more in the view of samples.

use crate::simd::lanes::LANES;
use crate::tiles::drawn::PixelSet;

/// A splat that is to be set up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pick {
    pub object: u32,
    pub chunk: u32,
    /// Its slot in the object's columns.
    pub slot: u32,
    /// It is set up by itself, in f64.
    pub is_near: bool,
}

/// Some of a group's splats, and the pixels of the cell that they may touch.
#[derive(Clone, Copy)]
pub(crate) struct CandidateGroup {
    /// The chunk's rank among all that are visible.
    pub rank: u32,
    /// The group's first.
    pub first: Pick,
    /// Which they are, as bits.
    pub splats: u64,
    /// Of all of them: first column and row, last column and row.
    pub around: [i32; 4],
    /// Of each.
    pub pixels: [[i32; LANES]; 4],
}

/// Splats of a cell, in the order in which they were set up.
#[derive(Default)]
pub(crate) struct Candidates(Vec<CandidateGroup>);

impl Candidates {
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    #[inline(always)]
    pub(crate) fn push(&mut self, group: CandidateGroup) {
        self.0.push(group);
    }

    /// Those that may touch some pixels, in the order of chunks and slots, near ones of a group first.
    pub(crate) fn touching(&mut self, wanted: &PixelSet) -> Vec<Pick> {
        // What is occluded was noted after all else.
        if !self.0.is_sorted_by_key(|group| group.rank) {
            self.0.sort_by_key(|group| group.rank);
        }
        let mut picks = Vec::new();
        for CandidateGroup { first, splats, around, pixels, .. } in &self.0 {
            if !wanted.touches(*around, false) {
                continue;
            }
            let mut left = *splats;
            while left != 0 {
                let i = left.trailing_zeros() as usize % LANES;
                left &= left - 1;
                if wanted.touches(pixels.map(|side| side[i]), true) {
                    picks.push(Pick { slot: first.slot + i as u32, ..*first });
                }
            }
        }
        picks
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.0.as_slice())
    }
}
