//! Files that appear whole or not at all.

use crate::error::{IoError, WRITE};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// Writes `path` by way of a temporary file in the same folder: synced, then renamed. A reader sees the old file
/// or the whole new one, never a part; on failure the temporary file is removed and `path` is as it was.
///
/// A symbolic link is followed; devices and pipes (`/dev/stdout`) are written directly. A file that is replaced keeps
/// its permissions, a new one gets those that any new file of the process gets.
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
    let temporary = temporary_in(folder_of(&target)).map_err(system)?;
    let mut sink = BufWriter::with_capacity(1 << 18, temporary.as_file());
    content(&mut sink).and_then(|()| sink.flush()).map_err(system)?;
    drop(sink);
    if let Some(found) = existing {
        // Where the system refuses the old permissions, the new file's own are fine.
        let _ = temporary.as_file().set_permissions(found.permissions());
    }
    temporary.as_file().sync_all().map_err(system)?;
    publish(temporary, &target, overwrite).map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => IoError::Exists { path: path.to_path_buf() },
        _ => system(source),
    })
}

/// A new file that is removed when dropped. Its name isn't derived from the target's, which may already be as long as
/// the file system allows.
fn temporary_in(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".surfel-").suffix(".tmp");
    // Otherwise nobody else could read the file; the system takes away what the process's umask says.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

fn publish(temporary: NamedTempFile, target: &Path, overwrite: bool) -> io::Result<()> {
    if overwrite {
        temporary.persist(target)?;
    } else if let Err(failed) = temporary.persist_noclobber(target) {
        // Of two writers one wins, because publishing fails where the target exists. Not every file system can do it.
        if failed.error.kind() == io::ErrorKind::AlreadyExists {
            return Err(failed.error);
        }
        failed.file.persist(target)?;
    }
    // Makes the new name durable; not every system lets a folder be synced.
    let _ = File::open(folder_of(target)).and_then(|folder| folder.sync_all());
    Ok(())
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
