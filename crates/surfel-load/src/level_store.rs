//! Cache of point files with levels of detail, which images share.

use crate::levels;
use crate::memory::default_budget;
use crate::{Error, LoadOptions};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use surfel_io::atomic::Temporary;
use surfel_io::byte_size;
use surfel_io::copc::{FileState, MIN_MEMORY, NodeCache};
use surfel_sample::Progress;

/// Cache for point files that are drawn with levels of detail. Images with the same cache share its data.
///
/// The cache contains COPC copies of files that don't fit into memory, as temporary files. If many images follow, it
/// also contains decoded nodes. The temporary files are deleted when the store is dropped. They are also deleted when a
/// signal ends a program that calls [`surfel_io::atomic::remove_temporary_files`].
pub struct LevelStore {
    nodes: Option<Arc<NodeCache>>,
    /// Temporary COPC copies of point files. Each has its own lock, which is held while the copy is written. Different
    /// copies can be written at the same time, and no copy is written twice.
    converted: Mutex<BTreeMap<Key, Arc<Mutex<Option<Converted>>>>>,
    /// Smallest memory budget, in bytes, with which a COPC copy is written.
    least_memory: u64,
}

/// Key of a COPC copy: path of the source file, and the column names if the options state them.
type Key = (PathBuf, Option<String>);

/// Temporary COPC copy of a point file.
struct Converted {
    /// Identity (path, size and modification time) of the source file when it was copied; `None` if it can't be read. A
    /// source with another identity is copied again.
    of: Option<FileState>,
    file: Arc<Temporary>,
}

impl Default for LevelStore {
    /// Creates a store that doesn't cache decoded nodes, for a single image or for images that share one selection of
    /// nodes.
    fn default() -> Self {
        Self { nodes: None, converted: Mutex::default(), least_memory: MIN_MEMORY }
    }
}

impl LevelStore {
    /// Creates a store that also caches decoded nodes, for images that each select their own nodes. The cache may use
    /// the memory within the budget ([`LoadOptions::memory`]) that an image's points don't need.
    pub fn caching_nodes() -> Self {
        Self { nodes: Some(Arc::default()), ..Self::default() }
    }

    /// Sets the smallest memory budget, in bytes, with which a file is copied to COPC.
    #[must_use]
    pub fn with_least_memory(self, least_memory: u64) -> Self {
        Self { least_memory, ..self }
    }

    /// Returns the path of the temporary COPC copy of a file that was loaded without column names; `None` if there is
    /// no copy.
    pub fn converted(&self, path: &Path) -> Option<PathBuf> {
        let slot = lock(&self.converted).get(&(path.to_path_buf(), None))?.clone();
        let converted = lock(&slot);
        converted.as_ref().map(|converted| converted.file.path().to_path_buf())
    }

    /// Returns the size of the cached decoded nodes in bytes; 0 if the store doesn't cache nodes.
    pub fn cached_bytes(&self) -> u64 {
        self.nodes.as_ref().map_or(0, |nodes| nodes.bytes())
    }

    /// Returns the number of compressed bytes of points that were read so far; 0 if the store doesn't cache nodes.
    pub fn read_bytes(&self) -> u64 {
        self.nodes.as_ref().map_or(0, |nodes| nodes.read_bytes())
    }

    /// Returns the estimated memory, in bytes, that the allocator retains after a COPC copy was written: a third of the
    /// smallest memory budget for writing. With a budget of 200 MiB, 40 to 60 MiB were measured.
    pub(crate) fn allocator_bytes(&self) -> u64 {
        self.least_memory / 3
    }

    /// True if the store caches decoded nodes.
    pub(crate) fn caches_nodes(&self) -> bool {
        self.nodes.is_some()
    }

    /// Returns the cache of decoded nodes, after limiting its size to `room_bytes`, or to 0 bytes if that is `None`.
    /// Returns `None` if the store doesn't cache nodes.
    pub(crate) fn nodes(&self, room_bytes: Option<u64>) -> Option<Arc<NodeCache>> {
        let nodes = self.nodes.as_ref()?;
        nodes.limit(room_bytes.unwrap_or(0));
        Some(nodes.clone())
    }

    /// Returns a temporary COPC copy of a point file, and a note about it for the user. Writes the copy unless it
    /// exists. Returns `None` if the memory budget is too small for writing, or if the file itself is COPC.
    pub(crate) fn by_levels(
        &self,
        path: &Path,
        options: &LoadOptions,
        progress: &dyn Progress,
    ) -> Result<Option<(Arc<Temporary>, String)>, Error> {
        let key = (path.to_path_buf(), options.convert.columns.as_ref().map(ToString::to_string));
        let slot = lock(&self.converted).entry(key).or_default().clone();
        let mut converted = lock(&slot);
        let budget = options.memory.or_else(default_budget).unwrap_or(0);
        let of = FileState::of(path);
        if converted.as_ref().is_none_or(|kept| kept.of != of) {
            *converted = None;
            if budget < self.least_memory || levels::has_levels(path) {
                return Ok(None);
            }
            let file = levels::save_temporary(
                (path, options.convert.columns.as_ref()),
                &large_files_folder(),
                budget,
                progress,
            )?;
            *converted = Some(Converted { of, file: Arc::new(file) });
        }
        Ok(converted.as_ref().map(|Converted { file, .. }| {
            let written_bytes = std::fs::metadata(file.path()).map_or(0, |metadata| metadata.len());
            let note = format!(
                "all its points don't fit into the {} that may be used, so they were written by levels first, to a \
                 temporary file of {}: surfel convert FILE -o FILE.copc.laz keeps it",
                byte_size(budget),
                byte_size(written_bytes),
            );
            (file.clone(), note)
        }))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the folder for large temporary files: TMPDIR if it is set, else `/var/tmp` on Unix, which isn't in memory,
/// else the system's folder for temporary files.
fn large_files_folder() -> PathBuf {
    let on_disk = Path::new("/var/tmp");
    let is_said = std::env::var_os("TMPDIR").is_some();
    if !is_said && cfg!(unix) && on_disk.is_dir() { on_disk.to_path_buf() } else { std::env::temp_dir() }
}

impl fmt::Debug for LevelStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("LevelStore")
    }
}

impl PartialEq for LevelStore {
    /// True only if both are the same store in memory.
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use surfel_sample::NoProgress;

    /// Returns a binary PLY file of hills: `side`² points, 0.1 apart.
    fn ply(side: u32) -> Vec<u8> {
        let properties = "property float x\nproperty float y\nproperty float z";
        let count = side * side;
        let head = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}\nend_header\n");
        let mut bytes = head.into_bytes();
        for i in 0..count {
            let [x, y] = [i % side, i / side].map(|v| v as f32 * 0.1);
            [x, y, 3.0 * (x * 0.2).sin() * (y * 0.17).cos()].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        }
        bytes
    }

    const SIDE: u32 = 400;

    /// A progress observer that waits in its first stage, for a limited time, until a second observer arrives.
    struct Meeting<'a>(&'a (Mutex<usize>, std::sync::Condvar), std::sync::atomic::AtomicBool);

    impl Progress for Meeting<'_> {
        fn stage(&self, _: &str, _: u64) {
            if self.1.swap(true, std::sync::atomic::Ordering::SeqCst) {
                return;
            }
            let (here, all) = self.0;
            let mut here = lock(here);
            *here += 1;
            all.notify_all();
            drop(all.wait_timeout_while(here, std::time::Duration::from_secs(20), |here| *here < 2).unwrap());
        }
        fn advance(&self, _: u64) {}
    }

    #[test]
    fn different_files_are_written_side_by_side_and_one_file_once() {
        let folder = std::env::temp_dir().join(format!("surfel-store-side-by-side-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("in.ply"), ply(SIDE)).unwrap();
        fs::write(folder.join("other.ply"), ply(SIDE / 2)).unwrap();
        let store = LevelStore { least_memory: 0, ..LevelStore::default() };
        let options = LoadOptions::default().with_memory(Some(1 << 30));
        let meeting = (Mutex::new(0), std::sync::Condvar::new());
        let write = |name: &str, progress: &dyn Progress| {
            store.by_levels(&folder.join(name), &options, progress).unwrap().unwrap().0
        };
        std::thread::scope(|scope| {
            for name in ["in.ply", "other.ply"] {
                let progress = Meeting(&meeting, Default::default());
                scope.spawn(move || write(name, &progress));
            }
        });
        let met = *lock(&meeting.0);
        assert_eq!(met, 2);
        // Both threads share the file that the first one wrote.
        fs::write(folder.join("in.ply"), ply(SIDE - 1)).unwrap();
        let both = std::thread::scope(|scope| {
            [0, 1].map(|_| scope.spawn(|| write("in.ply", &NoProgress))).map(|thread| thread.join().unwrap())
        });
        assert!(Arc::ptr_eq(&both[0], &both[1]));
        drop(both);
        drop(store);
        fs::remove_dir_all(&folder).unwrap();
    }
}
