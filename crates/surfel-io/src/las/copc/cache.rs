//! Nodes of COPC files that stay decoded.

use super::hierarchy::LevelValues;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

/// A file as it was when it was opened: one of the same name may be another later.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct FileState {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
    pub(super) modified: Option<SystemTime>,
}

impl FileState {
    /// That of a file that is there.
    pub fn of(path: &Path) -> Option<Self> {
        let metadata = std::fs::metadata(path).ok()?;
        Some(Self { path: path.to_path_buf(), bytes: metadata.len(), modified: metadata.modified().ok() })
    }
}

/// What is decoded of a node's points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Decoded {
    /// All.
    All,
    /// What splats are made of.
    Splats(LevelValues),
}

/// A node: its file, where in it, and what is decoded.
type Key = (Arc<FileState>, u64, Decoded);

/// Decoded nodes of COPC files ([`super::Copc::with_cache`]): those used last, of at most so many bytes.
#[derive(Debug, Default)]
pub struct NodeCache(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    nodes: HashMap<Key, (Arc<[u8]>, u64)>,
    /// When each was used last.
    order: BTreeMap<u64, Key>,
    now: u64,
    bytes: u64,
    most_bytes: u64,
    read_bytes: u64,
}

impl NodeCache {
    /// Keeps at most so many bytes from now on; before the first such call none.
    pub fn limit(&self, most_bytes: u64) {
        let mut kept = self.lock();
        kept.most_bytes = most_bytes;
        kept.shrink();
    }

    /// Bytes that are kept.
    pub fn bytes(&self) -> u64 {
        self.lock().bytes
    }

    /// Compressed bytes of points that were read of files so far, because no node of theirs was kept.
    pub fn read_bytes(&self) -> u64 {
        self.lock().read_bytes
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
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

    /// Keeps a node that was read, if there is room for it.
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

impl Kept {
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
        // 2 was used longest ago.
        add(4, 10);
        assert!(has(1) && !has(2) && has(3) && has(4));
        add(5, 31);
        assert!(!has(5) && cache.bytes() == 30);
        add(4, 12);
        assert!(has(4) && cache.bytes() <= 30 && cache.read_bytes() == 7);
        cache.limit(12);
        assert!(has(4) && !has(3) && cache.bytes() == 12);
        // Another file of that name, and other columns, are others.
        assert!(cache.get(&state(10), 4, POINTS).is_none());
        assert!(cache.get(&file, 4, Decoded::All).is_none());
        cache.limit(0);
        assert!(cache.bytes() == 0 && cache.lock().order.is_empty() && cache.lock().nodes.is_empty());
    }
}
