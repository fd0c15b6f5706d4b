//! Memory that one batch leaves to the next, and one frame to the next: fresh pages cost more than what is written there.

use crate::bins::{Entry, Grid, Segment};
use crate::planes::NeighbourPlanes;
use std::sync::{Mutex, PoisonError};
use surfel_render::FramePlan;

/// Emptied segments, lists of entries, and planes. It never holds more than the largest batch so far needed.
#[derive(Default)]
pub(crate) struct Recycled {
    segments: Mutex<Vec<Segment>>,
    entries: Mutex<Vec<Vec<Entry>>>,
    planes: Mutex<Vec<NeighbourPlanes>>,
}

impl Recycled {
    /// An empty segment.
    pub(crate) fn segment(&self) -> Segment {
        let mut segment = pop(&self.segments);
        segment.clear();
        segment
    }

    /// An empty list, for entries before they are sorted.
    pub(crate) fn entries(&self) -> Vec<Entry> {
        let mut entries = pop(&self.entries);
        entries.clear();
        entries
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

    pub(crate) fn give_back_entries(&self, entries: Vec<Entry>) {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner).push(entries);
    }

    /// Takes the segments back in order, so that each finds room for as many records as it had.
    pub(crate) fn give_back(&self, segments: Vec<Segment>) {
        self.segments.lock().unwrap_or_else(PoisonError::into_inner).extend(segments);
    }
}

fn pop<T: Default>(list: &Mutex<Vec<T>>) -> T {
    list.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
}
