//! A cache of decoded COPC nodes.

use super::hierarchy::LevelValues;
use crate::RegularFile;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

/// Identity of a file by path, size and modification time when it was opened. Caches compare it: a file that changes
/// later has another identity, so that its old nodes aren't used.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct FileState {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
    pub(super) modified: Option<SystemTime>,
}

impl FileState {
    /// Returns the identity of a file as it is now; `None` if it isn't a regular file or can't be opened.
    pub fn of(path: &Path) -> Option<Self> {
        RegularFile::open(path).ok()?.map(|file| Self::of_opened(path, &file))
    }

    /// Returns the identity of an open file: the given path, and the file's size and modification time.
    pub(super) fn of_opened(path: &Path, file: &RegularFile) -> Self {
        Self { path: path.to_path_buf(), bytes: file.file_bytes(), modified: file.modified() }
    }
}

/// Fields of a node's points that were decoded. A cached node is used only for the same fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Decoded {
    /// All fields of the points.
    All,
    /// Only the fields that splats are made of, with these colours and normals.
    Splats(LevelValues),
}

/// Key of a cached node: file, byte offset of the node's chunk, and decoded fields.
type Key = (Arc<FileState>, u64, Decoded);

/// Least-recently-used cache of decoded nodes of COPC files ([`super::Copc::with_cache`]), with a limit in bytes.
#[derive(Debug, Default)]
pub struct NodeCache(Mutex<CacheState>);

#[derive(Debug, Default)]
struct CacheState {
    nodes: HashMap<Key, (Arc<[u8]>, u64)>,
    /// Keys of the cached nodes, by the value of the counter `now` at their last use. If the nodes exceed the limit,
    /// they are removed in this order.
    order: BTreeMap<u64, Key>,
    now: u64,
    bytes: u64,
    most_bytes: u64,
    read_bytes: u64,
}

impl NodeCache {
    /// Sets the maximum number of bytes that the cached nodes take. The limit is 0 initially.
    pub fn limit(&self, most_bytes: u64) {
        let mut kept = self.lock();
        kept.most_bytes = most_bytes;
        kept.shrink();
    }

    /// Returns the number of bytes that the cached nodes take.
    pub fn bytes(&self) -> u64 {
        self.lock().bytes
    }

    /// Returns the number of compressed bytes that were read from files so far, for nodes that weren't cached.
    pub fn read_bytes(&self) -> u64 {
        self.lock().read_bytes
    }

    fn lock(&self) -> MutexGuard<'_, CacheState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn get(&self, file: &Arc<FileState>, at: u64, decoded: Decoded) -> Option<Arc<[u8]>> {
        let kept = &mut *self.lock();
        let key = (file.clone(), at, decoded);
        let (records, used) = kept.nodes.get_mut(&key)?;
        kept.order.remove(used);
        kept.now += 1;
        *used = kept.now;
        kept.order.insert(kept.now, key);
        Some(records.clone())
    }

    /// Adds a node that was read from the file. `at` is the byte offset of the node's chunk, and `read_bytes` the
    /// compressed size, which is added to [`Self::read_bytes`]. The decoded points (`records`) are cached if they fit
    /// the limit.
    pub(super) fn add(&self, file: &Arc<FileState>, at: u64, decoded: Decoded, (records, read_bytes): (&[u8], u64)) {
        let kept = &mut *self.lock();
        kept.read_bytes += read_bytes;
        if records.len() as u64 > kept.most_bytes {
            return;
        }
        kept.now += 1;
        kept.bytes += records.len() as u64;
        let key = (file.clone(), at, decoded);
        if let Some((old, used)) = kept.nodes.insert(key.clone(), (records.into(), kept.now)) {
            kept.bytes -= old.len() as u64;
            kept.order.remove(&used);
        }
        kept.order.insert(kept.now, key);
        kept.shrink();
    }
}

impl CacheState {
    fn shrink(&mut self) {
        while self.bytes > self.most_bytes
            && let Some((_, oldest)) = self.order.pop_first()
        {
            self.bytes -= self.nodes.remove(&oldest).map_or(0, |(records, _)| records.len() as u64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: Decoded = Decoded::Splats(LevelValues::Without);

    #[test]
    fn nodes_used_last_stay_and_no_more_than_the_limit() {
        let cache = NodeCache::default();
        let state = |bytes| Arc::new(FileState { path: "a".into(), bytes, modified: None });
        let file = state(9);
        let add = |at: u64, len: usize| cache.add(&file, at, POINTS, (&vec![at as u8; len], 1));
        let has = |at: u64| cache.get(&file, at, POINTS).is_some_and(|r| r.iter().all(|v| *v == at as u8));
        add(1, 10);
        assert!(!has(1), "nothing is kept without a limit");
        cache.limit(30);
        (1..=3).for_each(|at| add(at, 10));
        assert!(has(1) && cache.bytes() == 30);
        // Node 2 is the least recently used.
        add(4, 10);
        assert!(has(1) && !has(2) && has(3) && has(4));
        add(5, 31);
        assert!(!has(5) && cache.bytes() == 30);
        add(4, 12);
        assert!(has(4) && cache.bytes() <= 30 && cache.read_bytes() == 7);
        cache.limit(12);
        assert!(has(4) && !has(3) && cache.bytes() == 12);
        // The same path with another size, and other fields, are other keys.
        assert!(cache.get(&state(10), 4, POINTS).is_none());
        assert!(cache.get(&file, 4, Decoded::All).is_none());
        cache.limit(0);
        assert!(cache.bytes() == 0 && cache.lock().order.is_empty() && cache.lock().nodes.is_empty());
    }
}
