//! Data of files with levels of detail that is shared between images.

use crate::levels;
use crate::memory::{self, default_budget};
use crate::{Error, LoadOptions};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use surfel_io::atomic::Temporary;
use surfel_io::copc::{FileState, LEAST_MEMORY, NodeCache};
use surfel_sample::Progress;

/// Cache of files with levels of detail, shared between images.
///
/// It holds LOD copies of files that don't fit into memory, as temporary COPC files, and, if many images follow,
/// decoded nodes. The temporary files are deleted when the store is dropped, and when a signal ends a program that
/// calls [`surfel_io::atomic::remove_temporary_files`].
pub struct LevelStore {
    nodes: Option<Arc<NodeCache>>,
    /// Temporary files by path and column names. Each has its own lock, held while the file is written: other files can
    /// be written at the same time, and no file is written twice.
    converted: Mutex<BTreeMap<Key, Arc<Mutex<Option<Converted>>>>>,
    /// Least memory in bytes for writing a COPC file.
    least_memory: u64,
}

/// A file's path, and its column names if they are given.
type Key = (PathBuf, Option<String>);

/// A file that was converted to COPC.
struct Converted {
    /// State of the source file when it was converted; a file that has been replaced since is converted again.
    of: Option<FileState>,
    file: Arc<Temporary>,
}

impl Default for LevelStore {
    /// Creates a store without decoded nodes, for a single image or several that share one selection of nodes.
    fn default() -> Self {
        Self { nodes: None, converted: Mutex::default(), least_memory: LEAST_MEMORY }
    }
}

impl LevelStore {
    /// Creates a store with decoded nodes, for images that each select their own nodes. The nodes use the part of
    /// [`LoadOptions::memory`] that an image's points don't need.
    pub fn keeping_nodes() -> Self {
        Self { nodes: Some(Arc::default()), ..Self::default() }
    }

    /// Returns the compressed bytes of points read so far; 0 if the store caches no nodes.
    pub fn read_bytes(&self) -> u64 {
        self.nodes.as_ref().map_or(0, |nodes| nodes.read_bytes())
    }

    /// Returns the memory in bytes that the allocator retains after a file has been written. It is estimated as a third
    /// of the least memory for writing (40 to 60 of 200 MiB were measured).
    pub(crate) fn left_bytes(&self) -> u64 {
        self.least_memory / 3
    }

    /// True if the store caches decoded nodes.
    pub(crate) fn keeps_nodes(&self) -> bool {
        self.nodes.is_some()
    }

    /// Returns the node cache, limited to `room_bytes`.
    pub(crate) fn nodes(&self, room_bytes: Option<u64>) -> Option<Arc<NodeCache>> {
        let nodes = self.nodes.as_ref()?;
        nodes.limit(room_bytes.unwrap_or(0));
        Some(nodes.clone())
    }

    /// Returns a COPC copy of a file of points, and a note about it. `None` if writing it needs more memory than the
    /// budget, or the file has levels of detail itself.
    pub(crate) fn by_levels(
        &self,
        path: &Path,
        options: &LoadOptions,
        progress: &dyn Progress,
    ) -> Result<Option<(Arc<Temporary>, String)>, Error> {
        let key = (path.to_path_buf(), options.columns.as_ref().map(ToString::to_string));
        let slot = lock(&self.converted).entry(key).or_default().clone();
        let mut converted = lock(&slot);
        let budget = options.memory.or_else(default_budget).unwrap_or(0);
        let of = FileState::of(path);
        if converted.as_ref().is_none_or(|kept| kept.of != of) {
            *converted = None;
            if budget < self.least_memory || levels::has_levels(path) {
                return Ok(None);
            }
            let file =
                levels::save_temporary((path, options.columns.as_ref()), &large_files_folder(), budget, progress)?;
            *converted = Some(Converted { of, file: Arc::new(file) });
        }
        Ok(converted.as_ref().map(|Converted { file, .. }| {
            let written_bytes = std::fs::metadata(file.path()).map_or(0, |metadata| metadata.len());
            let note = format!(
                "all its points don't fit into the {:.1} GB that may be used, so they were written by levels first, to \
                 a temporary file of {:.1} GB: surfel convert FILE -o FILE.copc.laz keeps it",
                memory::gigabytes(budget),
                memory::gigabytes(written_bytes),
            );
            (file.clone(), note)
        }))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the folder for large temporary files: TMPDIR, or else one that the system doesn't hold in memory.
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
    /// True only for the same store.
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::CopcRequest;
    use crate::request::{Pictures, RenderOptions, Request, Resolved, Source};
    use std::fs;
    use surfel_model::{Camera, Geometry, SplatCloud};
    use surfel_sample::NoProgress;

    /// Returns a LAS file of format 6: hills of `side`² points, 0.1 apart, in millimetres.
    fn las(side: u32) -> Vec<u8> {
        let mut bytes = vec![0; 375];
        bytes[..4].copy_from_slice(b"LASF");
        bytes[24..26].copy_from_slice(&[1, 4]);
        bytes[94..96].copy_from_slice(&375_u16.to_le_bytes());
        bytes[96..100].copy_from_slice(&375_u32.to_le_bytes());
        bytes[104] = 6;
        bytes[105..107].copy_from_slice(&30_u16.to_le_bytes());
        for k in 0..3 {
            let mut put = |at: usize, v: f64| bytes[at..at + 8].copy_from_slice(&v.to_le_bytes());
            put(131 + 8 * k, 0.001);
            put(179 + 16 * k, if k == 2 { 3.0 } else { f64::from(side) * 0.1 });
            put(187 + 16 * k, if k == 2 { -3.0 } else { 0.0 });
        }
        bytes[247..255].copy_from_slice(&u64::from(side * side).to_le_bytes());
        for i in 0..side * side {
            let [x, y] = [i % side, i / side].map(|v| f64::from(v) * 0.1);
            let z = 3.0 * (x * 0.2).sin() * (y * 0.17).cos();
            [x, y, z].iter().for_each(|v| bytes.extend_from_slice(&((v * 1000.0).round() as i32).to_le_bytes()));
            bytes.extend_from_slice(&[0; 18]);
        }
        bytes
    }

    const SIDE: u32 = 400;

    /// Creates a folder with `in.las`.
    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("surfel-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("in.las"), las(SIDE)).unwrap();
        folder
    }

    fn camera(eye: [f64; 3]) -> Camera {
        Camera::perspective(eye, [eye[0], 20.0, 0.0], 30.0, [160, 120]).with_up([0.0, 0.0, 1.0])
    }

    fn request(path: &Path, memory: &str, store: &Arc<LevelStore>) -> Request {
        let mut options = RenderOptions::default();
        options.set("memory", memory).unwrap();
        let source = Source::of(&[path.to_path_buf()], None).unwrap();
        Request::new(source, &Pictures::One, &options).unwrap().with_level_store(store.clone())
    }

    fn resolved(request: &Request, eye: [f64; 3]) -> Result<(Resolved, Vec<String>), Error> {
        let loaded = request.load(None, &NoProgress)?;
        let mut notes = Vec::new();
        let asked = request.clone().with_pictures(Pictures::Cameras(vec![camera(eye)]));
        Ok((asked.resolve(loaded, &NoProgress, &mut |note| notes.push(note))?, notes))
    }

    fn cloud(resolved: &Resolved) -> &SplatCloud {
        match &resolved.scene.objects[0].geometry {
            Geometry::Splats(cloud) => cloud,
            _ => panic!("no splats"),
        }
    }

    #[test]
    fn file_that_does_not_fit_is_drawn_as_if_it_had_been_converted_first() {
        let folder = folder("store-converts");
        let (input, converted) = (folder.join("in.las"), folder.join("out.copc.laz"));
        levels::save_copc(std::slice::from_ref(&input), &converted, &CopcRequest::default(), &NoProgress).unwrap();
        // Less than the some 75 bytes per point that all points need.
        let (memory, eye) = ("10M", [20.0, -150.0, 80.0]);
        let store = Arc::new(LevelStore { least_memory: 0, ..LevelStore::default() });
        let (found, notes) = resolved(&request(&input, memory, &store), eye).unwrap();
        assert!(notes.iter().any(|note| note.contains("written by levels first")), "{notes:?}");
        let (expected, notes) = resolved(&request(&converted, memory, &Arc::default()), eye).unwrap();
        assert!(!notes.iter().any(|note| note.contains("written by levels first")), "{notes:?}");
        assert_eq!(found.file.camera, expected.file.camera);
        assert!(cloud(&found).len() < (SIDE * SIDE) as usize && cloud(&found) == cloud(&expected));
        // The file is written once, and deleted with its last user.
        let kept = || lock(&lock(&store.converted)[&(input.clone(), None)]).as_ref().unwrap().file.path().to_path_buf();
        let temporary = kept();
        let (again, _) = resolved(&request(&input, memory, &store), [30.0, -150.0, 80.0]).unwrap();
        assert!(!cloud(&again).is_empty());
        assert!(temporary.exists() && kept() == temporary);
        // A replaced file is converted again.
        fs::write(&input, las(SIDE - 1)).unwrap();
        let (other, _) = resolved(&request(&input, memory, &store), eye).unwrap();
        assert!(!temporary.exists() && cloud(&other) != cloud(&found));
        let temporary = kept();
        drop(store);
        assert!(!temporary.exists());
        // A file is refused if even its conversion needs too much memory.
        let error = resolved(&request(&input, memory, &Arc::default()), eye).unwrap_err().to_string();
        assert!(error.contains("surfel convert"), "{error}");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn columns_that_do_not_fit_are_drawn_as_their_conversion_and_seen_as_what_they_are() {
        let folder = folder("store-columns");
        let (input, converted) = (folder.join("in.ply"), folder.join("out.copc.laz"));
        let count = SIDE * SIDE;
        let properties = "property float x\nproperty float y\nproperty float z";
        let head =
            format!("ply\nformat binary_little_endian 1.0\ncomment up -y\nelement vertex {count}\n{properties}\n");
        let mut bytes = (head + "end_header\n").into_bytes();
        for i in 0..count {
            let [x, y] = [i % SIDE, i / SIDE].map(|v| v as f32 * 0.1);
            [x, y, 3.0 * (x * 0.2).sin() * (y * 0.17).cos()].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        }
        fs::write(&input, bytes).unwrap();
        levels::save_copc(std::slice::from_ref(&input), &converted, &CopcRequest::default(), &NoProgress).unwrap();
        let (memory, eye) = ("9M", [20.0, -150.0, 80.0]);
        let store = Arc::new(LevelStore { least_memory: 0, ..LevelStore::default() });
        let (found, notes) = resolved(&request(&input, memory, &store), eye).unwrap();
        assert!(notes.iter().any(|note| note.contains("written by levels first")), "{notes:?}");
        let (expected, _) = resolved(&request(&converted, memory, &Arc::default()), eye).unwrap();
        assert!(cloud(&found).len() < count as usize);
        // Equal except for the up axis that the file states, which COPC can't store.
        let [found, expected] = [&found, &expected].map(|resolved| cloud(resolved).data());
        assert!((&found.centers, &found.shape) == (&expected.centers, &expected.shape));
        let options = LoadOptions::default().with_memory(Some(9 << 20)).with_levels(Some(levels::Levels::Overview));
        let loaded = crate::load(&input, &options.with_level_store(Some(store)), &NoProgress).unwrap();
        assert_eq!((loaded.format, loaded.up), (surfel_io::Format::Ply, surfel_model::Up::MinusY));
        assert_eq!(loaded.up_reason, Some(crate::framing::UpReason::Stated));
        fs::remove_dir_all(&folder).unwrap();
    }

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
        let folder = folder("store-side-by-side");
        fs::write(folder.join("other.las"), las(SIDE / 2)).unwrap();
        let store = LevelStore { least_memory: 0, ..LevelStore::default() };
        let options = LoadOptions::default().with_memory(Some(1 << 30));
        let meeting = (Mutex::new(0), std::sync::Condvar::new());
        let write = |name: &str, progress: &dyn Progress| {
            store.by_levels(&folder.join(name), &options, progress).unwrap().unwrap().0
        };
        std::thread::scope(|scope| {
            for name in ["in.las", "other.las"] {
                let progress = Meeting(&meeting, Default::default());
                scope.spawn(move || write(name, &progress));
            }
        });
        let met = *lock(&meeting.0);
        assert_eq!(met, 2);
        // Both threads share the file that the first one wrote.
        fs::write(folder.join("in.las"), las(SIDE - 1)).unwrap();
        let both = std::thread::scope(|scope| {
            [0, 1].map(|_| scope.spawn(|| write("in.las", &NoProgress))).map(|thread| thread.join().unwrap())
        });
        assert!(Arc::ptr_eq(&both[0], &both[1]));
        drop(both);
        drop(store);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn views_that_come_back_read_nothing() {
        let folder = folder("store-keeps");
        let converted = folder.join("out.copc.laz");
        levels::save_copc(&[folder.join("in.las")], &converted, &CopcRequest::default(), &NoProgress).unwrap();
        let eyes = [[8.0, 2.0, 4.0], [32.0, 2.0, 4.0], [20.0, -20.0, 10.0]];
        let plain: Vec<_> =
            eyes.iter().map(|eye| resolved(&request(&converted, "100M", &Arc::default()), *eye).unwrap()).collect();
        let drawn = |store: &Arc<LevelStore>, memory: &str, eye: usize| {
            let (found, _) = resolved(&request(&converted, memory, store), eyes[eye]).unwrap();
            assert!(cloud(&found) == cloud(&plain[eye].0), "{eye}");
            store.read_bytes()
        };
        let store = Arc::new(LevelStore::keeping_nodes());
        let read = [0, 1, 2].map(|eye| drawn(&store, "100M", eye));
        assert!(0 < read[0] && read[0] < read[1] && read[1] <= read[2], "{read:?}");
        assert_eq!([0, 1, 2, 0].map(|eye| drawn(&store, "100M", eye)), [read[2]; 4]);
        // The cache is limited to the memory that an image's points don't need. Without any, all nodes are read again.
        let needs = plain.iter().map(|(resolved, _)| cloud(resolved).len() as u64 * memory::KNOWN_BYTES).max().unwrap();
        let store = Arc::new(LevelStore::keeping_nodes());
        let first = drawn(&store, &needs.to_string(), 0);
        assert!(store.nodes.as_ref().unwrap().bytes() <= needs);
        let second = drawn(&store, &needs.to_string(), 1);
        assert!(second > first && drawn(&store, &needs.to_string(), 0) > second);
        fs::remove_dir_all(&folder).unwrap();
    }
}
