//! Atomic writing: files appear complete or not at all.

mod names;

use crate::error::{IoError, WRITE, WRITE_THERE};
use names::Name;
use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::NamedTempFile;

/// Paths of the temporary files that this process has created and not yet published or removed.
static TEMPORARY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Folders that this process has already searched for left-over temporary files.
static SEARCHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn temporary_files() -> MutexGuard<'static, Vec<PathBuf>> {
    TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes all temporary files of this process and prevents new ones. Call it before exiting on a signal.
pub fn remove_temporary_files() {
    let mut files = temporary_files();
    files.drain(..).for_each(|path| drop(fs::remove_file(path)));
    // Writers need this lock to create or publish a file, and never get it again.
    std::mem::forget(files);
}

/// Returns the canonical path of the file that writing `path` creates or replaces: absolute, with links followed,
/// without `.` and `..`. Two paths of the same file have the same target.
pub fn target(path: &Path) -> PathBuf {
    fs::canonicalize(path).unwrap_or_else(|_| match (fs::canonicalize(folder_of(path)), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()),
    })
}

/// Writes `path` atomically: content goes to a temporary file in the same folder, which is synced and renamed. A reader
/// sees the old file or the complete new one. On failure the temporary file is removed and `path` is unchanged.
///
/// A symbolic link is followed; devices and pipes (`/dev/stdout`) are written directly. A replaced file keeps its
/// permissions; a new file gets the process's default permissions.
///
/// # Errors
/// [`IoError::Exists`] if the file exists, or appears meanwhile, and `overwrite` is false; [`IoError::System`] if the
/// folder can't be written or `content` fails.
pub fn write(
    path: &Path,
    overwrite: bool,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), IoError> {
    if fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        let system = |source| unwritten(path, WRITE, source);
        let mut sink = BufWriter::new(OpenOptions::new().write(true).open(path).map_err(system)?);
        return content(&mut sink).and_then(|()| sink.flush()).map_err(system);
    }
    write_seekable(path, overwrite, |sink| content(sink))
}

/// Writes `path` like [`write()`], for content that seeks; devices and pipes aren't supported.
///
/// # Errors
/// Errors of [`write()`]; also if `path` isn't a regular file.
pub fn write_seekable(
    path: &Path,
    overwrite: bool,
    content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), IoError> {
    let mut pending = Pending::new(path, overwrite)?;
    content(&mut pending.sink).map_err(|source| unwritten(path, WRITE, source))?;
    pending.publish()
}

/// Converts an error of writing the content of `path`. An [`IoError`] inside `source`, which names an input file of the
/// content, is returned unchanged.
fn unwritten(path: &Path, action: &'static str, source: io::Error) -> IoError {
    let system = |source| IoError::System { path: path.to_path_buf(), action, source };
    source.downcast::<IoError>().unwrap_or_else(system)
}

/// A file that is written under a temporary name and renamed by [`Pending::publish`]. Dropping it earlier removes the
/// temporary file.
#[derive(Debug)]
pub struct Pending {
    /// Buffered writer for the content.
    pub sink: BufWriter<File>,
    temporary: NamedTempFile,
    _registered: Registered,
    path: PathBuf,
    target: PathBuf,
    existing: Option<fs::Metadata>,
    overwrite: bool,
}

impl Pending {
    /// Creates a temporary file that will become `path`, which must be a name for a regular file.
    ///
    /// # Errors
    /// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`] if `path` is a folder, a
    /// device or a pipe, or if its folder can't be written.
    pub fn new(path: &Path, overwrite: bool) -> Result<Self, IoError> {
        let system = |source| IoError::System { path: path.to_path_buf(), action: WRITE, source };
        let existing = fs::metadata(path).ok();
        match &existing {
            Some(found) if found.is_dir() => return Err(system(io::Error::other("it is a folder"))),
            Some(found) if !found.is_file() => return Err(system(io::Error::other("it is a device or a pipe"))),
            Some(_) if !overwrite => return Err(IoError::Exists { path: path.to_path_buf() }),
            _ => {}
        }
        let target = if existing.is_some() { fs::canonicalize(path).map_err(system)? } else { path.to_path_buf() };
        remove_left_over_once(folder_of(&target));
        let (temporary, registered) = registered_in(folder_of(&target)).map_err(system)?;
        let file = temporary.as_file().try_clone().map_err(system)?;
        let sink = BufWriter::with_capacity(1 << 18, file);
        Ok(Self { sink, temporary, _registered: registered, path: path.to_path_buf(), target, existing, overwrite })
    }

    /// Returns the path of the temporary file, for another program that writes the content.
    pub fn temporary_path(&self) -> &Path {
        self.temporary.path()
    }

    /// Completes the file: syncs the content and renames the temporary file to the target path.
    ///
    /// # Errors
    /// [`IoError::Exists`] if the file appeared meanwhile and may not be overwritten; [`IoError::System`] if the
    /// content can't be written.
    pub fn publish(self) -> Result<(), IoError> {
        let Self { mut sink, temporary, _registered, path, target, existing, overwrite } = self;
        let system = |source| IoError::System { path: path.clone(), action: WRITE, source };
        sink.flush().map_err(system)?;
        drop(sink);
        if let Some(found) = existing {
            // If the system refuses the old permissions, the new file's own are fine.
            let _ = temporary.as_file().set_permissions(found.permissions());
        }
        temporary.as_file().sync_all().map_err(system)?;
        publish(temporary, &target, overwrite).map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => IoError::Exists { path: path.clone() },
            _ => system(source),
        })
    }
}

/// A temporary file for this process alone. It is removed when it is dropped, and by [`remove_temporary_files`], which
/// a program calls when a signal ends it. If the process was killed, the next process that creates a temporary file in
/// the folder removes it.
#[derive(Debug)]
pub struct Temporary {
    file: NamedTempFile,
    _registered: Registered,
}

impl Temporary {
    /// Writes a temporary file in a folder.
    ///
    /// # Errors
    /// [`IoError::System`] if the folder can't be written or `content` fails.
    pub fn write(folder: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<Self, IoError> {
        remove_left_over_once(folder);
        let written = registered_in(folder).and_then(|(file, registered)| {
            let mut sink = BufWriter::with_capacity(1 << 18, file.as_file());
            content(&mut sink)?;
            sink.flush()?;
            drop(sink);
            Ok(Self { file, _registered: registered })
        });
        written.map_err(|source| unwritten(folder, WRITE_THERE, source))
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }
}

/// Creates a file without a name in a folder, for this process alone; it disappears when it is closed.
///
/// # Errors
/// [`io::Error`] if the folder can't be written.
pub fn unnamed_in(folder: &Path) -> io::Result<File> {
    tempfile::tempfile_in(folder)
}

/// Creates a temporary file in a folder, which is removed when dropped. Its name isn't derived from the target's, which
/// may already have the maximum length.
fn temporary_in(folder: &Path) -> io::Result<NamedTempFile> {
    let (prefix, mut builder) = (Name::prefix_of_this_process(), tempfile::Builder::new());
    builder.prefix(&prefix).suffix(names::SUFFIX).rand_bytes(names::RANDOM_CHARACTERS);
    // The default mode would make the file unreadable for others; the system applies the process's umask.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

/// A path that is registered in [`TEMPORARY`] until it is dropped.
#[derive(Debug)]
struct Registered(PathBuf);

impl Drop for Registered {
    fn drop(&mut self) {
        temporary_files().retain(|path| *path != self.0);
    }
}

/// Creates a temporary file that [`remove_temporary_files`] removes. It is locked, so that no other process removes it
/// as left over.
fn registered_in(folder: &Path) -> io::Result<(NamedTempFile, Registered)> {
    let mut files = temporary_files();
    loop {
        let file = temporary_in(folder)?;
        // Another process may just have locked the new file in order to remove it as a left-over one. Then another file
        // is created. Where locks don't work, no process removes files, because removal needs a lock.
        let taken = matches!(file.as_file().try_lock(), Err(TryLockError::WouldBlock));
        if !taken && file.path().exists() {
            files.push(file.path().to_path_buf());
            let registered = Registered(file.path().to_path_buf());
            return Ok((file, registered));
        }
    }
}

/// Removes left-over temporary files of a folder, once per folder and process. Listing the folder for every written
/// file would take time that grows with the square of the number of files.
fn remove_left_over_once(folder: &Path) {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    if SEARCHED.lock().unwrap_or_else(PoisonError::into_inner).insert(absolute) {
        remove_left_over(folder);
    }
}

/// Removes temporary files in `folder` whose writers were killed. The file's name must state a process of this host
/// that has ended, or the file must be unchanged for [`names::OLD`]. A file that is locked is never removed. A free
/// lock alone isn't sufficient: on some shared file systems locks are local to a host.
fn remove_left_over(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let Some(name) = entry.file_name().to_str().and_then(Name::parse) else { continue };
        let Ok(found) = entry.metadata() else { continue };
        if !found.is_file() || !name.is_left_over(found.modified().ok()) {
            continue;
        }
        // Some systems lock only files that are open for writing.
        let Ok(file) = OpenOptions::new().read(true).write(true).open(entry.path()) else { continue };
        if file.try_lock().is_ok() {
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn publish(temporary: NamedTempFile, target: &Path, overwrite: bool) -> io::Result<()> {
    // A signal handler runs before or after publishing, not during it.
    let _files = temporary_files();
    if overwrite {
        temporary.persist(target)?;
    } else if let Err(failed) = temporary.persist_noclobber(target) {
        // If another writer has created the target meanwhile, `persist_noclobber` fails, so that one of the two writers
        // succeeds. File systems without support for this need the replacing rename below.
        if failed.error.kind() == io::ErrorKind::AlreadyExists {
            return Err(failed.error);
        }
        failed.file.persist(target)?;
    }
    // Makes the rename durable; not every system can sync a folder.
    let _ = File::open(folder_of(target)).and_then(|folder| folder.sync_all());
    Ok(())
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the name of a temporary file of a process of this host that has ended.
    fn name_of_ended() -> String {
        // No process can have this id.
        names::tests::name_of(i32::MAX as u32)
    }

    #[test]
    fn files_that_killed_writers_left_are_removed_and_those_being_written_are_not() {
        let folder = std::env::temp_dir().join(format!("surfel-left-over-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let names = || {
            let mut names: Vec<_> = fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
            names.sort();
            names
        };
        let ended = name_of_ended();
        // A user's own names, and those of Surfel 0.2, stay.
        let mut kept = [".surfel-mine", ".surfel-mine.tmp", ".surfel-aB3xYz.tmp", "other.tmp", ".surfel-d.tmp.txt"];
        kept.sort_unstable();
        for name in kept.iter().chain([&ended.as_str()]) {
            fs::write(folder.join(name), "x").unwrap();
        }
        let before = names().len();
        let mut during = Vec::new();
        let write = |name: &str, inner: &mut dyn FnMut()| {
            write(&folder.join(name), false, |out| {
                inner();
                out.write_all(b"whole")
            })
        };
        write("a", &mut || {
            // A concurrent writer doesn't remove this one's file.
            write("b", &mut || during = names()).unwrap();
        })
        .unwrap();
        // The left-over file is removed; `a` is being written, `b` exists.
        assert_eq!(during.len(), before - 1 + 2, "{during:?}");
        assert!(!during.iter().any(|name| *name == *ended), "{during:?}");
        assert_eq!(names().into_iter().filter(|name| name != "a" && name != "b").collect::<Vec<_>>(), kept);
        assert_eq!(fs::read(folder.join("a")).unwrap(), b"whole");
        assert!(!temporary_files().iter().any(|path| path.starts_with(&folder)));
        fs::remove_dir_all(&folder).unwrap();
    }

    /// Checks the rules for files that nobody locks, as on shared file systems whose locks are local to a host.
    #[cfg(unix)]
    #[test]
    fn files_of_living_writers_stay_without_locks() {
        let folder = std::env::temp_dir().join(format!("surfel-no-locks-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        // One file of a running process of this host, one of another host.
        let [here, elsewhere] = [names::tests::name_of(child.id()), names::tests::name_elsewhere()];
        for name in [&here, &elsewhere] {
            fs::write(folder.join(name), "x").unwrap();
        }
        remove_left_over(&folder);
        assert!(folder.join(&here).exists() && folder.join(&elsewhere).exists());
        child.kill().unwrap();
        child.wait().unwrap();
        remove_left_over(&folder);
        assert!(!folder.join(&here).exists() && folder.join(&elsewhere).exists());
        // After a month the file counts as left over.
        let old = std::time::SystemTime::now() - names::OLD - std::time::Duration::from_secs(60);
        File::options().write(true).open(folder.join(&elsewhere)).unwrap().set_modified(old).unwrap();
        remove_left_over(&folder);
        assert!(!folder.join(&elsewhere).exists());
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_folder_is_searched_once() {
        let folder = std::env::temp_dir().join(format!("surfel-once-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let left = folder.join(name_of_ended());
        let exists_after = |name: &str| {
            fs::write(&left, "x").unwrap();
            write(&folder.join(name), false, |out| out.write_all(b"whole")).unwrap();
            left.exists()
        };
        assert_eq!(["a", "b"].map(exists_after), [false, true]);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn paths_of_one_file_have_one_target() {
        let folder = std::env::temp_dir().join(format!("surfel-targets-{}", std::process::id()));
        fs::create_dir_all(folder.join("in")).unwrap();
        let link = |to: &str, from: &str| std::os::unix::fs::symlink(to, folder.join(from)).unwrap();
        fs::write(folder.join("a"), "x").unwrap();
        link("a", "to-a");
        link("in", "to-in");
        let of = |path: &str| target(&folder.join(path));
        for [one, other] in [["a", "./a"], ["a", "in/../a"], ["a", "to-a"], ["in/new", "to-in/new"], ["new", "./new"]] {
            assert_eq!(of(one), of(other), "{one} {other}");
        }
        assert_ne!(of("a"), of("in/a"));
        assert_ne!(of("new"), of("in/new"));
        // A broken link is replaced.
        link("nowhere", "broken");
        assert_ne!(of("broken"), of("nowhere"));
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn temporary_files_are_there_as_long_as_they_are_held() {
        let folder = std::env::temp_dir().join(format!("surfel-held-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let killed = folder.join(name_of_ended());
        fs::write(&killed, "x").unwrap();
        let held = Temporary::write(&folder, |out| out.write_all(b"whole")).unwrap();
        assert!(!killed.exists());
        // Later writers, of any process, don't remove the file.
        let other = Temporary::write(&folder, |out| out.write_all(b"other")).unwrap();
        assert_eq!([&held, &other].map(|file| fs::read(file.path()).unwrap()), [b"whole", b"other"]);
        let path = held.path().to_path_buf();
        drop(held);
        assert!(!path.exists() && other.path().exists());
        let full = || io::Error::from(io::ErrorKind::StorageFull);
        let error = Temporary::write(&folder, |_| Err(full())).unwrap_err().to_string();
        assert_eq!(error, format!("{}: cannot write a temporary file there: {}", folder.display(), full()));
        drop(other);
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 0);
        assert!(Temporary::write(&folder.join("missing"), |_| Ok(())).is_err());
        fs::remove_dir_all(&folder).unwrap();
    }
}
