//! Regular files that are read with seeking, from the file system or from a host program.
//!
//! WebAssembly in a browser has no file system. There the page registers a [`HostFile`], such as a file that a server
//! offers by HTTP ranges, under a name. [`RegularFile::open`] then finds it like any other.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::SystemTime;

/// A file that a host program, such as a web page, reads by ranges of bytes.
pub trait HostFile: std::fmt::Debug + Send + Sync {
    /// Returns the length in bytes.
    fn file_bytes(&self) -> u64;

    /// Fills `out` with the file's bytes from offset `at` on.
    ///
    /// # Errors
    /// The reason why the bytes can't be read.
    fn read_at(&self, at: u64, out: &mut [u8]) -> io::Result<()>;
}

/// The registered host file and its path; `None` if no host file is registered.
static HOST_FILE: RwLock<Option<(PathBuf, Arc<dyn HostFile>)>> = RwLock::new(None);

/// Registers the host's only file under a path, in place of an earlier one; `None` removes it. The host file hides a
/// file of the system with the same path.
pub fn set_host_file(file: Option<(PathBuf, Arc<dyn HostFile>)>) {
    *HOST_FILE.write().unwrap_or_else(PoisonError::into_inner) = file;
}

/// A regular file, opened for reading.
#[derive(Debug)]
pub struct RegularFile(Opened);

#[derive(Debug)]
enum Opened {
    System { file: File, bytes: u64, modified: Option<SystemTime> },
    Host { file: Arc<dyn HostFile>, at: u64 },
}

impl RegularFile {
    /// Opens a file; returns `None` for a folder, a pipe or a device.
    ///
    /// # Errors
    /// The system's reason why the file can't be opened.
    pub fn open(path: &Path) -> io::Result<Option<Self>> {
        let host = HOST_FILE.read().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, file)) = host.as_ref().filter(|(name, _)| name == path) {
            return Ok(Some(Self(Opened::Host { file: file.clone(), at: 0 })));
        }
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        let (bytes, modified) = (metadata.len(), metadata.modified().ok());
        Ok(metadata.is_file().then_some(Self(Opened::System { file, bytes, modified })))
    }

    /// Returns the length in bytes when the file was opened.
    pub fn file_bytes(&self) -> u64 {
        match &self.0 {
            Opened::System { bytes, .. } => *bytes,
            Opened::Host { file, .. } => file.file_bytes(),
        }
    }

    /// Returns the time of the last change; `None` if the system doesn't report it.
    pub fn modified(&self) -> Option<SystemTime> {
        match &self.0 {
            Opened::System { modified, .. } => *modified,
            Opened::Host { .. } => None,
        }
    }
}

impl Read for RegularFile {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        match &mut self.0 {
            Opened::System { file, .. } => file.read(out),
            Opened::Host { file, at } => {
                let rest = usize::try_from(file.file_bytes().saturating_sub(*at)).unwrap_or(usize::MAX);
                let count = out.len().min(rest);
                if count > 0 {
                    file.read_at(*at, &mut out[..count])?;
                }
                *at += count as u64;
                Ok(count)
            }
        }
    }
}

impl Seek for RegularFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match &mut self.0 {
            Opened::System { file, .. } => file.seek(to),
            Opened::Host { file, at } => {
                let moved = match to {
                    SeekFrom::Start(start) => Some(start),
                    SeekFrom::End(by) => file.file_bytes().checked_add_signed(by),
                    SeekFrom::Current(by) => at.checked_add_signed(by),
                };
                *at = moved.ok_or(io::ErrorKind::InvalidInput)?;
                Ok(*at)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    struct Numbers;

    impl HostFile for Numbers {
        fn file_bytes(&self) -> u64 {
            200
        }

        fn read_at(&self, at: u64, out: &mut [u8]) -> io::Result<()> {
            out.iter_mut().zip(at..).for_each(|(out, i)| *out = i as u8);
            Ok(())
        }
    }

    #[test]
    fn host_files_are_read_like_the_system_s() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers");
        std::fs::write(&path, (0..200).collect::<Vec<u8>>()).unwrap();
        let hosted = PathBuf::from("numbers.of.host");
        assert!(RegularFile::open(&hosted).is_err());
        set_host_file(Some((hosted.clone(), Arc::new(Numbers))));
        let open = |path: &Path| RegularFile::open(path).unwrap().unwrap();
        let (mut host, mut system) = (open(&hosted), open(&path));
        assert_eq!((host.file_bytes(), system.file_bytes()), (200, 200));
        assert!(host.modified().is_none() && system.modified().is_some());
        for to in [SeekFrom::Start(7), SeekFrom::Current(10), SeekFrom::End(-9), SeekFrom::Start(500)] {
            assert_eq!(host.seek(to).unwrap(), system.seek(to).unwrap(), "{to:?}");
            let [mut a, mut b] = [[0; 12]; 2];
            assert_eq!(host.read(&mut a).unwrap(), system.read(&mut b).unwrap(), "{to:?}");
            assert_eq!(a, b, "{to:?}");
        }
        assert!(host.seek(SeekFrom::End(-201)).is_err());
        assert!(RegularFile::open(folder.path()).unwrap().is_none(), "a folder");
        set_host_file(None);
        assert!(RegularFile::open(&hosted).is_err());
    }
}
