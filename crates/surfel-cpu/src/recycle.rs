//! Memory that one batch leaves to the next, and one frame to the next: fresh pages cost more than what is written there.

use crate::bins::{Entries, Grid, Segment};
use crate::planes::NeighbourPlanes;
use crate::tile::TileScratch;
use std::sync::{Mutex, PoisonError};
use surfel_render::FramePlan;

/// Emptied segments, lists of entries, planes, and what threads draw tiles with. It never holds more than the largest batch so far needed.
#[derive(Default)]
pub(crate) struct Recycled {
    segments: Mutex<Vec<Segment>>,
    entries: Mutex<Vec<Entries>>,
    planes: Mutex<Vec<NeighbourPlanes>>,
    scratch: Mutex<Vec<TileScratch<'static>>>,
}

impl Recycled {
    /// An empty segment.
    pub(crate) fn segment(&self) -> Segment {
        let mut segment = pop(&self.segments);
        segment.clear();
        segment
    }

    /// An empty list, for entries before they are sorted.
    pub(crate) fn entries(&self) -> Entries {
        let mut entries = pop(&self.entries);
        entries.clear();
        entries
    }

    /// What a thread needs to draw tiles.
    pub(crate) fn scratch<'a>(&self) -> TileScratch<'a> {
        pop(&self.scratch).for_others()
    }

    pub(crate) fn give_back_scratch(&self, scratch: TileScratch<'_>) {
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).push(scratch.for_others());
    }

    /// Planes of a grid, with nothing in them, for a plan that looks twice.
    pub(crate) fn planes(&self, grid: &Grid, plan: &FramePlan) -> NeighbourPlanes {
        let mut planes = pop(&self.planes);
        planes.become_those_of(grid, plan);
        planes
    }

    pub(crate) fn give_back_planes(&self, planes: NeighbourPlanes) {
        self.planes.lock().unwrap_or_else(PoisonError::into_inner).push(planes);
    }

    pub(crate) fn give_back_entries(&self, entries: Entries) {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner).push(entries);
    }

    /// Takes the segments back in order, so that each finds room for as many records as it had.
    pub(crate) fn give_back(&self, segments: Vec<Segment>) {
        self.segments.lock().unwrap_or_else(PoisonError::into_inner).extend(segments);
    }
}

/// The memory of a list, for a list of something else: it is kept where both are as large and aligned alike.
pub(crate) fn emptied<T, U>(mut list: Vec<T>) -> Vec<U> {
    list.clear();
    list.into_iter().filter_map(|_| None).collect()
}

fn pop<T: Default>(list: &Mutex<Vec<T>>) -> T {
    list.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_leave_their_memory_to_lists_of_other_things() {
        let list: Vec<&u32> = Vec::with_capacity(100);
        let (at, capacity) = (list.as_ptr() as usize, list.capacity());
        let other: Vec<&f32> = emptied(list);
        assert_eq!((other.as_ptr() as usize, other.capacity()), (at, capacity));
    }
}
