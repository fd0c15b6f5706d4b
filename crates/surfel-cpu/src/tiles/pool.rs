//! Pools of scratch memory that is reused within a frame and from frame to frame. Fresh pages cost more than writing to
//! them.

use std::sync::{Mutex, PoisonError};

/// A pool of values, such as buffers, that are reused instead of allocated anew. It never contains more values than
/// were in use at once.
#[derive(Default)]
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T: Default> Pool<T> {
    /// Takes a used value, with its old content, out of the pool; creates a new one if the pool is empty.
    pub(crate) fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    pub(crate) fn give_back(&self, used: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(used);
    }
}

/// A list that overwrites its old content, so that no memory has to be cleared.
#[derive(Default)]
pub(crate) struct Reused<T> {
    /// Items of the list; those past `used` are left over from earlier content.
    slots: Vec<T>,
    /// Number of items in the list.
    used: usize,
}

impl<T: Copy + Default> Reused<T> {
    pub(crate) fn clear(&mut self) {
        self.used = 0;
    }

    /// Sets the number of items; new items have unspecified values.
    pub(crate) fn resize(&mut self, count: usize) {
        if self.slots.len() < count {
            self.slots.resize(count, T::default());
        }
        self.used = count;
    }

    /// Reserves memory for `more` further items.
    pub(crate) fn make_room(&mut self, more: usize) {
        let used = self.used;
        self.resize(used + more);
        self.used = used;
    }

    /// Returns places for the next `N` items, to be written by the caller; never `None`. [`Self::advance`] then adds
    /// those that were written.
    #[inline(always)]
    pub(crate) fn room<const N: usize>(&mut self) -> Option<&mut [T; N]> {
        if self.slots.len() < self.used + N {
            self.grow(N);
        }
        self.slots[self.used..].first_chunk_mut()
    }

    #[cold]
    fn grow(&mut self, more: usize) {
        self.slots.resize(2 * self.slots.len() + more, T::default());
    }

    #[inline(always)]
    pub(crate) fn advance(&mut self, count: usize) {
        self.used += count;
    }

    #[inline(always)]
    pub(crate) fn push(&mut self, item: T) {
        if let Some([slot]) = self.room() {
            *slot = item;
            self.advance(1);
        }
    }
}

impl<T> std::ops::Deref for Reused<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.slots[..self.used]
    }
}

impl<T> std::ops::DerefMut for Reused<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.slots[..self.used]
    }
}

/// Empties a list and converts it to a list of another type. The memory is reused if items of both types have the same
/// size and alignment.
pub(crate) fn recycle_vec<T, U>(mut list: Vec<T>) -> Vec<U> {
    list.clear();
    list.into_iter().filter_map(|_| None).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_leave_their_memory_to_lists_of_other_things() {
        let list: Vec<&u32> = Vec::with_capacity(100);
        let (at, capacity) = (list.as_ptr() as usize, list.capacity());
        let other: Vec<&f32> = recycle_vec(list);
        assert_eq!((other.as_ptr() as usize, other.capacity()), (at, capacity));
    }
}
