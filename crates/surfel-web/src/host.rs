//! Input file that the page's JavaScript reads by HTTP ranges, so that only the necessary parts are transferred.

use std::collections::VecDeque;
use std::io;
use std::sync::{Mutex, PoisonError};
use surfel_io::HostFile;

/// Size in bytes of the blocks in which the file is read and cached. Headers and hierarchies of files are read in small
/// parts; reading whole blocks limits the number of requests. A part larger than a block is read by itself, and not
/// cached.
const BLOCK_BYTES: u64 = 1 << 16;
/// Maximum number of blocks that are cached in memory.
const MAX_BLOCKS: usize = 64;

/// Function that fills a buffer with the bytes of the file from a byte offset on.
type ReadAt = fn(u64, &mut [u8]) -> io::Result<()>;

/// File that the page's JavaScript reads by byte ranges. Small parts are read in blocks, which are cached in memory.
#[derive(Debug)]
pub(crate) struct RangeFile {
    file_bytes: u64,
    read: ReadAt,
    /// Cached blocks with their indices in the file, the least recently used first.
    blocks: Mutex<VecDeque<(u64, Vec<u8>)>>,
}

impl RangeFile {
    /// Creates a file of `file_bytes` bytes, which is read by `read`.
    pub(crate) fn new(file_bytes: u64, read: ReadAt) -> Self {
        Self { file_bytes, read, blocks: Mutex::default() }
    }

    /// Copies the bytes that the block with index `number` has in common with `out`, and reads the block if it isn't
    /// cached. `out` begins at byte offset `at` of the file.
    fn copy_block(&self, number: u64, at: u64, out: &mut [u8]) -> io::Result<()> {
        let mut blocks = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        let found = blocks.iter().position(|(other, _)| *other == number);
        let start = number * BLOCK_BYTES;
        let block = match found.and_then(|i| blocks.remove(i)) {
            Some((_, block)) => block,
            None => {
                let mut block = vec![0; BLOCK_BYTES.min(self.file_bytes - start) as usize];
                (self.read)(start, &mut block)?;
                block
            }
        };
        let (from, to) = (start.max(at), (start + block.len() as u64).min(at + out.len() as u64));
        let part = &block[(from - start) as usize..(to - start) as usize];
        out[(from - at) as usize..(to - at) as usize].copy_from_slice(part);
        blocks.push_back((number, block));
        if blocks.len() > MAX_BLOCKS {
            blocks.pop_front();
        }
        Ok(())
    }
}

impl HostFile for RangeFile {
    fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    fn read_at(&self, at: u64, out: &mut [u8]) -> io::Result<()> {
        let end = at.checked_add(out.len() as u64).filter(|end| *end <= self.file_bytes);
        let Some(end) = end else { return Err(io::ErrorKind::UnexpectedEof.into()) };
        if out.len() as u64 > BLOCK_BYTES {
            return (self.read)(at, out);
        }
        (at / BLOCK_BYTES..end.div_ceil(BLOCK_BYTES)).try_for_each(|number| self.copy_block(number, at, out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    static READS: AtomicU64 = AtomicU64::new(0);

    fn byte(at: u64) -> u8 {
        (at % 251) as u8
    }

    fn read(at: u64, out: &mut [u8]) -> io::Result<()> {
        READS.fetch_add(1, Ordering::Relaxed);
        out.iter_mut().zip(at..).for_each(|(out, at)| *out = byte(at));
        Ok(())
    }

    #[test]
    fn parts_are_exact_and_small_ones_are_read_once() {
        let file = RangeFile::new(3 * BLOCK_BYTES + 100, read);
        let check = |at: u64, count: usize| {
            let mut out = vec![0; count];
            file.read_at(at, &mut out).unwrap();
            assert!(out.iter().zip(at..).all(|(found, at)| *found == byte(at)), "{at} {count}");
            READS.swap(0, Ordering::Relaxed)
        };
        assert_eq!(check(0, 10), 1);
        assert_eq!(check(5, 500), 0, "the block is in memory");
        assert_eq!(check(BLOCK_BYTES - 7, 20), 1, "of two blocks one is new");
        assert_eq!(check(3 * BLOCK_BYTES - 1, 101), 2, "the last block is short");
        assert_eq!(check(9, 2 * BLOCK_BYTES as usize), 1, "a large part is one request");
        assert!(file.read_at(3 * BLOCK_BYTES + 90, &mut [0; 11]).is_err());
        assert!(file.read_at(u64::MAX, &mut [0; 2]).is_err());
    }
}
