//! Memory that one batch leaves to the next, and one frame to the next: fresh pages cost more than what is written there.

use crate::bins::{Entry, Segment};
use std::sync::{Mutex, PoisonError};

/// Emptied segments and lists of entries. It never holds more than the largest batch so far needed.
#[derive(Default)]
pub(crate) struct Recycled {
    segments: Mutex<Vec<Segment>>,
    entries: Mutex<Vec<Vec<Entry>>>,
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
