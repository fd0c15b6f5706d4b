//! Numbers by which records and pixels identify their splat or polygon, until the frame's plane `index` is converted to
//! rows.
//!
//! A *slot* is the index of a stored splat in the columns of its object
//! ([`StoredObject`](crate::scene::cloud::StoredObject)). A *record* is a splat projected to the screen.

use std::sync::Arc;

/// Numbering of all stored splats (slots) of a scene, consecutive over its objects. Empty unless a frame needs the
/// nearest splat.
#[derive(Clone, Default)]
pub(crate) struct SplatNumbers {
    /// Number of each object's first slot, and the rows of the object's slots in the input file.
    objects: Vec<(u32, Arc<[u32]>)>,
}

impl SplatNumbers {
    /// Number of a pixel that shows neither a splat nor a polygon.
    pub(crate) const NOTHING: u32 = u32::MAX;
    /// Bit that marks the number of a polygon; the other bits are the index of its mesh.
    pub(crate) const POLYGON: u32 = 1 << 31;
    /// Largest number of slots that can be numbered, because a record stores other bits next to the number.
    pub(crate) const MAX_SLOTS: usize = 1 << 30;

    /// Numbers the slots of objects, each given by the rows of its slots in the input file. Slots of an object without
    /// rows get no numbers.
    pub(crate) fn new(objects: impl Iterator<Item = Option<Arc<[u32]>>>) -> Self {
        let mut next = 0;
        let numbered = objects.map(|rows| {
            let rows = rows.unwrap_or_default();
            let first = next;
            next += rows.len() as u32;
            (first, rows)
        });
        Self { objects: numbered.collect() }
    }

    /// Returns the object of a slot's number. If slots aren't numbered, records store object indices, and the result is
    /// `number` itself.
    #[inline(always)]
    pub(crate) fn object_of(&self, number: usize) -> usize {
        if self.objects.is_empty() { number } else { self.place(number as u32).0 }
    }

    /// Returns the number of an object's first slot, if slots are numbered.
    pub(crate) fn first(&self, object: u32) -> Option<u32> {
        self.objects.get(object as usize).map(|(first, _)| *first)
    }

    /// Returns the object of a slot's number, and the slot within the object.
    pub(crate) fn place(&self, number: u32) -> (usize, usize) {
        let after = self.objects.partition_point(|(first, _)| *first <= number);
        let object = after.saturating_sub(1);
        (object, (number - self.objects.get(object).map_or(0, |(first, _)| *first)) as usize)
    }

    /// Returns a key that orders splats by object, then by row. Of equally near splats, the one with the lowest key is
    /// shown.
    pub(crate) fn order(&self, number: u32) -> (usize, u32) {
        let (object, slot) = self.place(number);
        let row = self.objects.get(object).and_then(|(_, rows)| rows.get(slot));
        (object, row.copied().unwrap_or(Self::NOTHING))
    }
}
