//! Sequences of bytes in memory or in a file, parts of which are read on demand.

use crate::files::MAX_BYTES;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

/// A regular file that several threads read in parts.
#[derive(Debug)]
pub(crate) struct OpenFile {
    file: Mutex<File>,
    length: usize,
    failure: OnceLock<io::Error>,
}

impl OpenFile {
    /// Opens the file at `path`; returns `None` if it can't be opened, isn't regular or is larger than [`MAX_BYTES`].
    pub(crate) fn open(path: &Path) -> Option<Self> {
        Self::open_any(path).filter(|file| file.length as u64 <= MAX_BYTES)
    }

    /// Opens the file at `path`, like [`Self::open`], but without a limit of its size.
    pub(crate) fn open_any(path: &Path) -> Option<Self> {
        let file = File::open(path).ok()?;
        let metadata = file.metadata().ok().filter(std::fs::Metadata::is_file)?;
        let length = usize::try_from(metadata.len()).ok()?;
        Some(Self { file: Mutex::new(file), length, failure: OnceLock::new() })
    }

    /// Wraps an open file of `length` bytes.
    #[cfg(feature = "laz")]
    pub(crate) fn of(file: File, length: usize) -> Self {
        Self { file: Mutex::new(file), length, failure: OnceLock::new() }
    }

    /// Returns all bytes of the file.
    pub(crate) fn bytes(&self) -> Bytes<'_> {
        Bytes::File { file: self, start: 0, length: self.length }
    }

    /// Closes the file, and returns the first error that occurred while a part of it was read; `None` if there was
    /// none. Data that were read after the error are invalid.
    pub(crate) fn failure(self) -> Option<io::Error> {
        self.failure.into_inner()
    }

    /// Returns a copy of the first error that occurred while a part of the file was read; `None` if there was none. The
    /// file stays open, unlike with [`Self::failure`].
    #[cfg(feature = "laz")]
    pub(crate) fn failed(&self) -> Option<io::Error> {
        self.failure.get().map(|error| io::Error::new(error.kind(), error.to_string()))
    }

    /// Fills `out` with the file's bytes from offset `start` on. An error is recorded for [`Self::failure`].
    fn fill(&self, start: usize, out: &mut [u8]) {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let read = file.seek(SeekFrom::Start(start as u64)).and_then(|_| file.read_exact(out));
        if let Err(error) = read {
            // Only the first error is reported.
            let _ = self.failure.set(error);
        }
    }
}

/// A sequence of bytes, in memory or in a file, from which readers of formats read parts on demand.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Bytes<'a> {
    Memory(&'a [u8]),
    /// A part of an open file, which is read when it is needed.
    File {
        file: &'a OpenFile,
        start: usize,
        length: usize,
    },
}

impl<'a> Bytes<'a> {
    pub(crate) fn len(self) -> usize {
        match self {
            Self::Memory(bytes) => bytes.len(),
            Self::File { length, .. } => length,
        }
    }

    /// Returns the bytes of a range, without reading them; `None` if the range is out of bounds.
    pub(crate) fn part(self, range: Range<usize>) -> Option<Self> {
        match self {
            Self::Memory(bytes) => bytes.get(range).map(Self::Memory),
            Self::File { file, start, length } => (range.start <= range.end && range.end <= length)
                .then_some(Self::File { file, start: start + range.start, length: range.end - range.start }),
        }
    }

    /// Reads at most `most` bytes from offset `start` on; fewer if the bytes end before. Returns an empty slice if
    /// there isn't enough memory, like [`Self::read`].
    pub(crate) fn at_most(self, start: usize, most: usize) -> Cow<'a, [u8]> {
        let start = start.min(self.len());
        let part = self.part(start..start.saturating_add(most).min(self.len()));
        part.map_or(Cow::Borrowed(&[]), Self::read)
    }

    /// Reads all bytes. If there isn't enough memory, returns an empty slice and records an error in the file.
    pub(crate) fn read(self) -> Cow<'a, [u8]> {
        let (file, length) = match self {
            Self::Memory(bytes) => return bytes.into(),
            Self::File { file, length, .. } => (file, length),
        };
        let mut all = Vec::new();
        if all.try_reserve_exact(length).is_err() {
            let _ = file.failure.set(io::ErrorKind::OutOfMemory.into());
            return Cow::Borrowed(&[]);
        }
        self.read_into(&mut all);
        all.into()
    }

    /// Returns all bytes. Bytes of a file are read into `buffer`; an error is recorded in the file
    /// ([`OpenFile::failure`]).
    pub(crate) fn read_into<'b>(self, buffer: &'b mut Vec<u8>) -> &'b [u8]
    where
        'a: 'b,
    {
        match self {
            Self::Memory(bytes) => bytes,
            Self::File { file, start, length } => {
                buffer.resize(length, 0);
                file.fill(start, buffer);
                buffer
            }
        }
    }

    /// Returns a reader of the bytes that is buffered and can't seek.
    pub(crate) fn reader(self) -> impl io::BufRead {
        io::BufReader::with_capacity(1 << 18, self.source())
    }

    /// Returns a reader of the bytes that can seek.
    pub(crate) fn source(self) -> Reader<'a> {
        Reader { bytes: self, position: 0 }
    }

    /// Returns the shortest range of a file that contains all `parts`, and the offset of each part in the range.
    /// Reading this range once replaces a read for each part. Returns `None` if the range is longer than the parts
    /// together: reading them one by one is then faster. Also returns `None` if there are no parts, if a part is in
    /// memory, or if the parts are from different files.
    pub(crate) fn hull(parts: &[Self]) -> Option<(Self, Vec<usize>)> {
        let Self::File { file, start, .. } = *parts.first()? else { return None };
        let (mut first, mut end, mut total) = (start, start, 0_usize);
        for part in parts {
            let Self::File { file: of, start, length } = *part else { return None };
            if !std::ptr::eq(of, file) {
                return None;
            }
            (first, end, total) = (first.min(start), end.max(start + length), total.saturating_add(length));
        }
        let starts = parts.iter().map(|part| if let Self::File { start, .. } = part { start - first } else { 0 });
        let starts = starts.collect();
        (end - first <= total).then_some((Self::File { file, start: first, length: end - first }, starts))
    }
}

/// A reader of a sequence of bytes, with its current position.
pub(crate) struct Reader<'a> {
    bytes: Bytes<'a>,
    position: usize,
}

impl Seek for Reader<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => usize::try_from(at).ok(),
            SeekFrom::End(by) => self.bytes.len().checked_add_signed(by as isize),
            SeekFrom::Current(by) => self.position.checked_add_signed(by as isize),
        };
        self.position = at.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.position as u64)
    }
}

impl Read for Reader<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let now = out.len().min(self.bytes.len().saturating_sub(self.position));
        let end = self.position + now;
        match self.bytes {
            _ if now == 0 => {}
            Bytes::Memory(bytes) => out[..now].copy_from_slice(&bytes[self.position..end]),
            Bytes::File { file, start, .. } => file.fill(start + self.position, &mut out[..now]),
        }
        self.position = end;
        Ok(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_files_are_those_of_memory() {
        let path = std::env::temp_dir().join(format!("surfel-bytes-{}", std::process::id()));
        let content: Vec<u8> = (0..200).collect();
        std::fs::write(&path, &content).unwrap();
        let file = OpenFile::open(&path).unwrap();
        let (memory, there) = (Bytes::Memory(&content), file.bytes());
        assert_eq!(there.len(), 200);
        for (range, inner) in [(0..200, 3..5), (10..20, 0..10), (200..200, 0..0), (7..7, 0..0)] {
            let [a, b] = [memory, there].map(|bytes| bytes.part(range.clone()).unwrap().part(inner.clone()).unwrap());
            assert_eq!(a.read(), b.read());
            assert_eq!(b.len(), inner.len());
        }
        for outside in [0..201, 199..201, 201..201, 5..usize::MAX] {
            assert!(memory.part(outside.clone()).is_none() && there.part(outside).is_none());
        }
        assert_eq!(there.part(10..20).unwrap().at_most(8, 100), &content[18..20]);
        assert_eq!(there.at_most(300, 1).len(), 0);
        // Interleaved columns are read together, others separately.
        let part = |range| there.part(range).unwrap();
        let (hull, starts) = Bytes::hull(&[part(4..104), part(0..100), part(8..108)]).unwrap();
        assert_eq!((hull.read().into_owned(), starts), (content[..108].to_vec(), vec![4, 0, 8]));
        assert!(Bytes::hull(&[part(0..10), part(50..60)]).is_none());
        for bytes in [memory, there] {
            let (mut source, mut found) = (bytes.source(), [0; 4]);
            for (to, at) in [(SeekFrom::Start(7), 7), (SeekFrom::Current(-1), 10), (SeekFrom::End(-4), 196)] {
                assert_eq!(source.seek(to).unwrap(), at);
                source.read_exact(&mut found).unwrap();
                assert_eq!(found, content[at as usize..][..4]);
            }
            assert_eq!((source.seek(SeekFrom::Start(999)).unwrap(), source.read(&mut found).unwrap()), (999, 0));
            assert!(source.seek(SeekFrom::Current(-1000)).is_err());
        }
        // A file that is truncated meanwhile gives an error.
        std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(50).unwrap();
        assert_eq!(there.part(0..50).unwrap().read(), &content[..50]);
        assert!(file.failure.get().is_none());
        assert_eq!(there.part(40..60).unwrap().read().len(), 20);
        assert_eq!(file.failure().unwrap().kind(), io::ErrorKind::UnexpectedEof);
        std::fs::remove_file(&path).unwrap();
        assert!(OpenFile::open(&path).is_none() && OpenFile::open(&std::env::temp_dir()).is_none());
    }
}
