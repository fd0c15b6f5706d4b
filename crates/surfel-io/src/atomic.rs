//! Files that appear whole or not at all.

use crate::IoError;
use crate::error::WRITE;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Writes `path` by way of a temporary file in the same folder: synced, then renamed. A reader sees the old file
/// or the whole new one, never a part; on failure the temporary file is removed and `path` is as it was.
///
/// A symbolic link is followed; devices and pipes (`/dev/stdout`) are written directly.
///
/// # Errors
/// [`IoError::Exists`] if there is such a file and `overwrite` is false (also if it appears meanwhile);
/// [`IoError::System`] if the folder can't be written or `content` fails.
pub fn write(
    path: &Path,
    overwrite: bool,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), IoError> {
    let system = |source| IoError::System { path: path.to_path_buf(), action: WRITE, source };
    let existing = fs::metadata(path).ok();
    if let Some(found) = &existing {
        if found.is_dir() {
            return Err(system(io::Error::other("it is a folder")));
        }
        if !found.is_file() {
            let mut sink = BufWriter::new(OpenOptions::new().write(true).open(path).map_err(system)?);
            return content(&mut sink).and_then(|()| sink.flush()).map_err(system);
        }
        if !overwrite {
            return Err(IoError::Exists { path: path.to_path_buf() });
        }
    }
    let target = if existing.is_some() { fs::canonicalize(path).map_err(system)? } else { path.to_path_buf() };
    let temporary = Temporary::create(&target).map_err(system)?;
    let mut sink = BufWriter::with_capacity(1 << 18, &temporary.file);
    content(&mut sink).and_then(|()| sink.flush()).map_err(system)?;
    drop(sink);
    if let Some(found) = existing {
        // A replaced file keeps its permissions; where the system refuses that, the new file's own are fine.
        let _ = temporary.file.set_permissions(found.permissions());
    }
    temporary.file.sync_all().map_err(system)?;
    temporary.publish(&target, overwrite).map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => IoError::Exists { path: path.to_path_buf() },
        _ => system(source),
    })
}

/// Removes its file when dropped, unless that has been renamed away.
struct Temporary {
    file: File,
    path: PathBuf,
}

impl Temporary {
    fn create(target: &Path) -> io::Result<Self> {
        static COUNTER: AtomicU64 = AtomicU64::new(0);
        let folder = folder_of(target);
        loop {
            let unique = COUNTER.fetch_add(1, Ordering::Relaxed);
            // Not derived from the target's name, which may already be as long as the file system allows.
            let path = folder.join(format!(".surfel-{}-{unique}.tmp", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => return Ok(Self { file, path }),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
    }

    fn publish(self, target: &Path, overwrite: bool) -> io::Result<()> {
        // A hard link fails where the target exists, so two writers can't both win; not every file system has it.
        let linked = if overwrite { None } else { Some(fs::hard_link(&self.path, target)) };
        match linked {
            Some(Ok(())) => {}
            Some(Err(e)) if e.kind() == io::ErrorKind::AlreadyExists => return Err(e),
            _ => fs::rename(&self.path, target)?,
        }
        // Makes the new name durable; not every system lets a folder be synced.
        let _ = File::open(folder_of(target)).and_then(|f| f.sync_all());
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // After a rename there is nothing left to remove, and that is no failure.
        let _ = fs::remove_file(&self.path);
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
