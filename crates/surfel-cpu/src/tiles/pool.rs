//! A scratch pool: memory that one part of a frame leaves to the next, and one frame to the next. Fresh pages cost more
//! than what is written there.

use std::sync::{Mutex, PoisonError};

/// Things of one type that are reused. A pool never holds more than were in use at once.
#[derive(Default)]
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T: Default> Pool<T> {
    /// One that was used before, whatever it holds, or a new one.
    pub(crate) fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    pub(crate) fn give_back(&self, used: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(used);
    }
}

/// A list that writes over what it held before: memory that nothing has to clear first.
#[derive(Default)]
pub(crate) struct Reused<T> {
    /// Those past `used` are left from before.
    slots: Vec<T>,
    used: usize,
}

impl<T: Copy + Default> Reused<T> {
    pub(crate) fn clear(&mut self) {
        self.used = 0;
    }

    /// Makes the list so long, whatever it holds.
    pub(crate) fn resize(&mut self, count: usize) {
        if self.slots.len() < count {
            self.slots.resize(count, T::default());
        }
        self.used = count;
    }

    /// Makes room for more items than there are.
    pub(crate) fn make_room(&mut self, more: usize) {
        let used = self.used;
        self.resize(used + more);
        self.used = used;
    }

    /// Where the next `N` items go, always there; [`Self::advance`] says how many were added.
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

/// The memory of a list, for a list of something else: the same where items are as large and aligned alike.
pub(crate) fn emptied<T, U>(mut list: Vec<T>) -> Vec<U> {
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
        let other: Vec<&f32> = emptied(list);
        assert_eq!((other.as_ptr() as usize, other.capacity()), (at, capacity));
    }
}
