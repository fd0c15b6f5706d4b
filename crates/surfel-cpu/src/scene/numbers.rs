//! Numbers of splats and polygons in the plane of what is nearest, until they become rows.

use crate::scene::cloud::StoredObject;
use std::sync::Arc;

/// Numbers of a scene's slots: object after object, as far as frames ask which splat is nearest.
#[derive(Clone, Default)]
pub(crate) struct SplatNumbers {
    /// Of each object its first number, and the rows of its slots.
    objects: Vec<(u32, Arc<[u32]>)>,
}

impl SplatNumbers {
    /// Where nothing is.
    pub(crate) const NOTHING: u32 = u32::MAX;
    /// Set where it is a polygon; the other bits are its mesh.
    pub(crate) const POLYGON: u32 = 1 << 31;
    /// Most slots: records have other bits beside them.
    pub(crate) const MOST: usize = 1 << 30;

    /// Numbers of the slots of these objects, all of which have rows.
    pub(crate) fn new(objects: &[StoredObject]) -> Self {
        let mut next = 0;
        let numbered = objects.iter().map(|object| {
            let rows = object.rows.clone().unwrap_or_default();
            let first = next;
            next += rows.len() as u32;
            (first, rows)
        });
        Self { objects: numbered.collect() }
    }

    /// The object of a number; the number itself where slots have none.
    #[inline(always)]
    pub(crate) fn object_of(&self, number: usize) -> usize {
        if self.objects.is_empty() { number } else { self.place(number as u32).0 }
    }

    /// The first number of an object, if slots have numbers.
    pub(crate) fn first(&self, object: u32) -> Option<u32> {
        self.objects.get(object as usize).map(|(first, _)| *first)
    }

    /// The object of a number, and its slot there.
    pub(crate) fn place(&self, number: u32) -> (usize, usize) {
        let after = self.objects.partition_point(|(first, _)| *first <= number);
        let object = after.saturating_sub(1);
        (object, (number - self.objects.get(object).map_or(0, |(first, _)| *first)) as usize)
    }

    /// By object, then by row: which of equally near splats is shown.
    pub(crate) fn order(&self, number: u32) -> (usize, u32) {
        let (object, slot) = self.place(number);
        let row = self.objects.get(object).and_then(|(_, rows)| rows.get(slot));
        (object, row.copied().unwrap_or(Self::NOTHING))
    }
}
