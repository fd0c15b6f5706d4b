//! Reading whole files without trusting their size, and the files that a file refers to.

use crate::error::{Fault, IoError, Problem, READ};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Largest file that is loaded, in bytes.
pub(crate) const MAX_BYTES: u64 = 64 << 30;
/// Most that is taken from something without a size, such as a pipe, in bytes.
const MAX_STREAM_BYTES: u64 = 1 << 30;
/// Bytes that any compressed file may have, and times its own size beyond these.
const UNPACKED_BYTES: u64 = 64 << 20;
const UNPACKED_TIMES: u64 = 64;

/// Most bytes that are made of a compressed file of `bytes` bytes: real ones come nowhere near.
pub(crate) fn most_unpacked(bytes: usize) -> u64 {
    UNPACKED_BYTES + UNPACKED_TIMES * bytes as u64
}

/// What [`most_unpacked`] is, in words.
pub(crate) fn most_unpacked_in_words() -> String {
    format!("at most {} MiB and {UNPACKED_TIMES} times the file's size", UNPACKED_BYTES >> 20)
}

/// The whole of a file of at most `limit` bytes, or of a pipe.
pub(crate) fn read(path: &Path, limit: u64) -> Result<Vec<u8>, IoError> {
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

/// Where the files that a file refers to (materials, textures, buffers) are looked for.
#[derive(Clone, Debug)]
pub(crate) enum Siblings {
    /// Nowhere: the bytes came without a place.
    None,
    /// In a folder.
    Folder {
        /// The folder.
        path: PathBuf,
        /// The files that were asked for, found or not.
        asked: RefCell<BTreeSet<PathBuf>>,
    },
}

impl Siblings {
    pub(crate) fn of(path: &Path) -> Self {
        let path = path.parent().map(Path::to_path_buf).unwrap_or_default();
        Self::Folder { path, asked: RefCell::default() }
    }

    /// The files that were asked for, found or not.
    pub(crate) fn asked(&self) -> Vec<PathBuf> {
        match self {
            Self::None => Vec::new(),
            Self::Folder { asked, .. } => asked.borrow().iter().cloned().collect(),
        }
    }

    /// A referenced file, at most 1 GiB and regular (a device would never end), or why it can't be had.
    pub(crate) fn read(&self, reference: &str) -> Result<Vec<u8>, String> {
        let Self::Folder { path: folder, asked } = self else {
            return Err("files beside the data are not available here".into());
        };
        // Exporters on Windows write backslashes, which elsewhere are part of a name.
        let path = folder.join(reference.replace('\\', "/"));
        asked.borrow_mut().insert(path.clone());
        let metadata = std::fs::metadata(&path).map_err(|e| e.to_string())?;
        if !metadata.is_file() {
            return Err("it is not a regular file".into());
        }
        read(&path, MAX_STREAM_BYTES).map_err(|e| match e {
            IoError::System { source, .. } => source.to_string(),
            other => other.to_string(),
        })
    }
}
