//! Reading of whole files within size limits, and of other files that a file refers to.

use crate::error::{Fault, IoError, Problem, READ, unwritable};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

/// Largest size, in bytes, of an input file that is loaded as a whole. Larger files are refused.
pub const MAX_BYTES: u64 = 64 << 30;
/// Maximum number of bytes that are read from a pipe or another source whose size isn't known in advance, or from a
/// file to which another file refers. Longer ones are refused.
const MAX_STREAM_BYTES: u64 = 1 << 30;
/// Constant part, in bytes, of the limit of [`most_unpacked`] on unpacked data.
const UNPACKED_BYTES: u64 = 64 << 20;
/// Part of the limit of [`most_unpacked`] that depends on the file: unpacked bytes per byte of the compressed file.
const UNPACKED_TIMES: u64 = 64;

/// Returns the maximum number of bytes that a compressed file of `bytes` bytes may unpack to. Ordinary files stay far
/// below it. Readers refuse files that exceed it, because tiny hostile files could otherwise fill the memory or disk.
pub fn most_unpacked(bytes: usize) -> u64 {
    UNPACKED_BYTES + UNPACKED_TIMES * bytes as u64
}

/// Returns the limit of [`most_unpacked`] as text for messages.
pub fn most_unpacked_in_words() -> String {
    format!("at most {} MiB and {UNPACKED_TIMES} times the file's size", UNPACKED_BYTES >> 20)
}

/// Copies at most `most` bytes from a decompressing reader to `out`. Returns the number of copied bytes, and the
/// reader's error if it failed.
///
/// # Errors
/// [`Problem`] if `out` can't be written.
pub fn pour(reader: impl Read, most: u64, out: &mut dyn Write) -> Result<(u64, Option<io::Error>), Problem> {
    let (mut reader, mut buffer, mut poured) = (reader.take(most), vec![0; 1 << 16], 0);
    loop {
        let count = match reader.read(&mut buffer) {
            Ok(0) => return Ok((poured, None)),
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Ok((poured, Some(error))),
        };
        out.write_all(&buffer[..count]).map_err(unwritable)?;
        poured += count as u64;
    }
}

/// Reads a file of at most `limit` bytes as a whole. A pipe may have at most 1 GiB, too.
///
/// # Errors
/// [`IoError::System`] if the file doesn't exist, is a folder, can't be read or doesn't fit into memory;
/// [`IoError::Invalid`] if it is larger than the limit.
pub fn read(path: &Path, limit: u64) -> Result<Vec<u8>, IoError> {
    let system = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
    let file = File::open(path).map_err(system)?;
    let metadata = file.metadata().map_err(system)?;
    if metadata.is_dir() {
        return Err(system(io::Error::other("it is a folder")));
    }
    let limit = if metadata.is_file() { limit } else { limit.min(MAX_STREAM_BYTES) };
    let mut bytes = Vec::new();
    let expected = metadata.len().min(limit) as usize;
    bytes.try_reserve_exact(expected).map_err(|_| system(io::ErrorKind::OutOfMemory.into()))?;
    file.take(limit + 1).read_to_end(&mut bytes).map_err(system)?;
    if bytes.len() as u64 > limit {
        let problem = Problem::new(format!("is larger than {limit} bytes")).expected("a smaller file of this kind");
        return Err(Fault::from(problem).of(path));
    }
    Ok(bytes)
}

/// Access to the files that a file refers to: materials, textures, buffers.
#[derive(Clone, Debug)]
pub enum Siblings {
    /// No access, for bytes in memory without a path.
    None,
    /// Access to the files below a folder, or anywhere.
    Folder {
        /// The folder that relative references start from.
        path: PathBuf,
        /// Canonical paths of the two folders that may be read: the folder of the file's path and, if the path is a
        /// link, the folder of the link's target. `None` allows files anywhere.
        inside: Option<[PathBuf; 2]>,
        /// Files that were requested so far, whether they exist or not. Clones of this access share the set.
        asked: Rc<RefCell<BTreeSet<PathBuf>>>,
    },
}

/// Message for a reference that isn't followed, because it leads out of the file's folder.
const OUTSIDE: &str = "it is outside of the file's folder, where only `allow_outside` reads";

/// True if a relative path leads out of the folder from which it starts, as `../x` does. Absolute paths do, too.
fn leaves_folder(reference: &Path) -> bool {
    let mut depth = 0_usize;
    for part in reference.components() {
        match part {
            Component::Normal(_) => depth += 1,
            Component::CurDir => {}
            Component::ParentDir if depth > 0 => depth -= 1,
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => return true,
        }
    }
    false
}

impl Siblings {
    /// Returns the access for the file at `path`: to the files in its folder and the folders below, or to any file if
    /// `allow_outside`.
    pub fn of(path: &Path, allow_outside: bool) -> Self {
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        let here = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        let real = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        let of_link = real(path).parent().map(Path::to_path_buf).unwrap_or_default();
        let inside = (!allow_outside).then(|| [real(here), of_link]);
        Self::Folder { path: folder, inside, asked: Rc::default() }
    }

    /// Returns the same access, but with references that start from the subfolder `folder`: for a file that lies there.
    pub fn below(&self, folder: &str) -> Self {
        let mut siblings = self.clone();
        if let Self::Folder { path, .. } = &mut siblings {
            path.push(folder);
        }
        siblings
    }

    /// Returns the paths that [`Self::read`] requested and was allowed to read, whether the files exist or not. Callers
    /// list them as inputs.
    pub fn asked(&self) -> Vec<PathBuf> {
        match self {
            Self::None => Vec::new(),
            Self::Folder { asked, .. } => asked.borrow().iter().cloned().collect(),
        }
    }

    /// True if the file exists and [`Self::read`] may read it.
    pub fn has(&self, reference: &str) -> bool {
        self.locate(reference).is_ok_and(|path| path.is_file())
    }

    /// Reads a referenced file of at most 1 GiB. The file must be regular: reading a device would never end.
    ///
    /// # Errors
    /// A message with the reason, if the file may not or can't be read.
    pub fn read(&self, reference: &str) -> Result<Vec<u8>, String> {
        let path = self.locate(reference)?;
        if let Self::Folder { asked, .. } = self {
            asked.borrow_mut().insert(path.clone());
        }
        let metadata = std::fs::metadata(&path).map_err(|e| e.to_string())?;
        if !metadata.is_file() {
            return Err("it is not a regular file".into());
        }
        read(&path, MAX_STREAM_BYTES).map_err(|e| match e {
            IoError::System { source, .. } => source.to_string(),
            other => other.to_string(),
        })
    }

    /// Returns the path of a referenced file, which may not exist, or the reason why it may not be read.
    fn locate(&self, reference: &str) -> Result<PathBuf, String> {
        let Self::Folder { path: folder, inside, .. } = self else {
            return Err("files beside the data are not available here".into());
        };
        // Exporters on Windows write backslashes, which are part of a name on other systems.
        let reference = reference.replace('\\', "/");
        let path = folder.join(&reference);
        if let Some(inside) = inside {
            // First checks the text of the path, so that nothing outside is accessed; then the target of links.
            let real = || std::fs::canonicalize(&path);
            let leaves = leaves_folder(Path::new(&reference));
            if leaves || real().is_ok_and(|real| !inside.iter().any(|folder| real.starts_with(folder))) {
                return Err(OUTSIDE.into());
            }
        }
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_stay_within_the_folder() {
        let root = std::env::temp_dir().join(format!("surfel-outside-{}", std::process::id()));
        std::fs::create_dir_all(root.join("in/sub")).unwrap();
        for name in ["secret", "in/a", "in/sub/b"] {
            std::fs::write(root.join(name), name).unwrap();
        }
        let absolute = root.join("in/a");
        let absolute = absolute.to_str().unwrap();
        let read = |allow: bool, reference: &str| {
            let siblings = Siblings::of(&root.join("in/x.gltf"), allow);
            (siblings.read(reference), siblings.asked().len())
        };
        for inside in ["a", "./a", "sub/b", "sub\\b", "sub/../a"] {
            assert!(read(false, inside).0.is_ok(), "{inside}");
        }
        for outside in ["../secret", "..\\secret", "sub/../../secret", "/etc/passwd", "../in/a", absolute] {
            let (result, asked) = read(false, outside);
            assert!(result.unwrap_err().contains("`allow_outside`"), "{outside}");
            assert_eq!(asked, 0, "{outside}: what isn't read isn't an input");
        }
        assert_eq!(read(true, "../secret"), (Ok(b"secret".to_vec()), 1));
        assert!(read(true, absolute).0.is_ok());
        assert!(!read(false, "missing").0.unwrap_err().contains("outside"));
        #[cfg(unix)]
        {
            use std::os::unix::fs::symlink;
            symlink(root.join("secret"), root.join("in/link")).unwrap();
            assert!(read(false, "link").0.unwrap_err().contains("`allow_outside`"));
            assert!(read(true, "link").0.is_ok());
            // If the named file is a link, the folder that it leads to may be read, too.
            std::fs::create_dir_all(root.join("named")).unwrap();
            std::fs::write(root.join("in/x.gltf"), "{}").unwrap();
            symlink(root.join("in/x.gltf"), root.join("named/x.gltf")).unwrap();
            symlink(root.join("in/a"), root.join("named/a")).unwrap();
            assert!(Siblings::of(&root.join("named/x.gltf"), false).read("a").is_ok());
        }
        std::fs::remove_dir_all(&root).unwrap();
    }
}
