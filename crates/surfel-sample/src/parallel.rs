//! Parallel loops with ordered results.
//!
//! All loops run through one instance of rayon's loop, which calls the work through a pointer. Rayon's machinery is
//! thus compiled once, not once per closure.

use crate::progress::Progress;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Number of indices in a task of [`map_each`]: small enough to balance the load, large enough to amortise a task's
/// state.
const CHUNK: usize = 512;

/// Returns `work(state, i)` for each index i in 0..count, computed in parallel. Each chunk of indices creates its own
/// `state` and reports its steps when it ends.
pub(crate) fn map_each<T: Clone + Default + Send, S>(
    count: usize,
    progress: &dyn Progress,
    state: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize) -> T + Sync,
) -> Vec<T> {
    let mut results = vec![T::default(); count];
    for_chunks(&mut results, CHUNK, &|first, chunk| {
        let mut state = state();
        for (i, result) in (first..).zip(chunk.iter_mut()) {
            *result = work(&mut state, i);
        }
        progress.advance(chunk.len() as u64);
    });
    results
}

/// Returns `work(i)` for each index i in 0..count, computed in parallel with one task per index.
pub(crate) fn map_tasks<T: Clone + Default + Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut results = vec![T::default(); count];
    for_chunks(&mut results, 1, &|i, result| result[0] = work(i));
    results
}

/// Returns the result of `work` for each chunk of `length` items, in order; `work` receives the index of the first
/// item.
pub(crate) fn map_chunks<T: Send, R: Clone + Default + Send>(
    items: &mut [T],
    length: usize,
    work: &(dyn Fn(usize, &mut [T]) -> R + Sync),
) -> Vec<R> {
    let chunks: Vec<Mutex<&mut [T]>> = items.chunks_mut(length).map(Mutex::new).collect();
    let chunk = |i: usize| work(i * length, &mut chunks[i].lock().unwrap_or_else(PoisonError::into_inner));
    map_tasks(chunks.len(), chunk)
}

/// Calls `work` with each chunk of `length` items and the index of the chunk's first item, in parallel.
pub(crate) fn for_chunks<T: Send>(items: &mut [T], length: usize, work: &(dyn Fn(usize, &mut [T]) + Sync)) {
    let chunks: Vec<Mutex<&mut [T]>> = items.chunks_mut(length).map(Mutex::new).collect();
    for_tasks(chunks.len(), &|i| work(i * length, &mut chunks[i].lock().unwrap_or_else(PoisonError::into_inner)));
}

fn for_tasks(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    struct Steps(AtomicU64);

    impl Progress for Steps {
        fn stage(&self, _name: &str, _total: u64) {}

        fn advance(&self, steps: u64) {
            self.0.fetch_add(steps, Ordering::Relaxed);
        }
    }

    #[test]
    fn parallel_maps_keep_order_and_report_every_step() {
        for count in [0, 1, CHUNK, 3 * CHUNK + 7] {
            let steps = Steps(AtomicU64::new(0));
            // The state counts the items of its chunk.
            let each = map_each(count, &steps, || 0, |seen, i| (i, std::mem::replace(seen, *seen + 1)));
            assert!(each.iter().enumerate().all(|(i, found)| *found == (i, i % CHUNK)), "{count}");
            assert_eq!(steps.0.into_inner(), count as u64);
            assert_eq!(map_tasks(count, |i| 2 * i), (0..count).map(|i| 2 * i).collect::<Vec<_>>());
        }
    }
}
