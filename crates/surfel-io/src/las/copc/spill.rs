//! Lists of records that are larger than memory, stored in a temporary file. The file usually has no name, so that the
//! system removes it when the process ends for any reason.

use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::hash::Hash;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Number of bytes in memory at which a list's records are written to the file, as one block.
const BLOCK_BYTES: usize = 256 << 10;
/// Number of bytes in memory of all lists together at which all of them are written to the file.
const HELD_BYTES: usize = 32 << 20;

/// Creates a temporary file without a name in `folder`.
pub(super) fn unnamed(folder: &Path) -> io::Result<File> {
    tempfile::tempfile_in(folder)
}

/// A list of records. The last records are in memory, the others in blocks of the file.
#[derive(Debug, Default)]
pub(super) struct List {
    held: Vec<u8>,
    blocks: Blocks,
    pub(super) bytes: u64,
}

/// Lists of records by key, most of which are in a temporary file.
pub(super) struct Spill<K> {
    file: File,
    end: u64,
    index: HashMap<K, usize>,
    lists: Vec<List>,
    held: usize,
    /// Key of the last record, and its list's index. The next record usually goes to the same list.
    last: Option<(K, usize)>,
}

/// A block of a list's records in the file: byte offset, number of bytes and checksum.
pub(super) type Block = (u64, usize, u32);
/// Blocks of a list, in order of writing.
pub(super) type Blocks = Vec<Block>;

/// Returns a 32-bit checksum of a block, which detects damage on the disk. A damaged block is accepted with a
/// probability of about 2⁻³².
pub(super) fn checksum(bytes: &[u8]) -> u32 {
    let mix = |sum: u64, word: u64| (sum ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    let (words, rest) = bytes.as_chunks::<8>();
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    let sum = words.iter().chain([&last]).fold(bytes.len() as u64, |sum, word| mix(sum, u64::from_le_bytes(*word)));
    (sum ^ sum >> 32) as u32
}

/// Positions of all lists in a file. From them, another run can open the lists after an interruption.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct Index<K> {
    /// Number of bytes at the start of the file that contain valid blocks. Later bytes are ignored.
    pub(super) end: u64,
    /// Keys in order of their first record, with the blocks of each key's list.
    pub(super) lists: Vec<(K, Blocks)>,
}

/// Error for a block, at this byte offset, that has changed since it was written.
#[derive(Debug, thiserror::Error)]
#[error("bytes from {0} on have changed since they were written")]
pub(super) struct Changed(pub(super) u64);

impl<K> Default for Index<K> {
    fn default() -> Self {
        Self { end: 0, lists: Vec::new() }
    }
}

impl<K: Copy + Eq + Hash> Spill<K> {
    pub(super) fn new(folder: &Path) -> io::Result<Self> {
        Ok(Self::of(unnamed(folder)?, Index::default()))
    }

    /// Opens the lists in a file, at the positions that `stored` states.
    pub(super) fn of(file: File, stored: Index<K>) -> Self {
        let (mut index, mut lists) = (HashMap::new(), Vec::new());
        for (key, blocks) in stored.lists {
            index.insert(key, lists.len());
            let bytes = blocks.iter().map(|(_, length, _)| *length as u64).sum();
            lists.push(List { held: Vec::new(), blocks, bytes });
        }
        Self { file, end: stored.end, index, lists, held: 0, last: None }
    }

    /// Writes all records to the file, syncs it to disk, and returns the positions of the lists.
    pub(super) fn stored(&mut self) -> io::Result<Index<K>> {
        self.flush()?;
        self.file.sync_data()?;
        let mut lists: Vec<(K, usize)> = self.index.iter().map(|(key, at)| (*key, *at)).collect();
        lists.sort_unstable_by_key(|(_, at)| *at);
        let lists = lists.into_iter().map(|(key, at)| (key, self.lists[at].blocks.clone())).collect();
        Ok(Index { end: self.end, lists })
    }

    pub(super) fn append(&mut self, key: K, records: &[u8]) -> io::Result<()> {
        let at = match self.last {
            Some((last, at)) if last == key => at,
            _ => *self.index.entry(key).or_insert_with(|| {
                self.lists.push(List::default());
                self.lists.len() - 1
            }),
        };
        self.last = Some((key, at));
        let list = &mut self.lists[at];
        list.held.extend_from_slice(records);
        list.bytes += records.len() as u64;
        self.held += records.len();
        if list.held.len() >= BLOCK_BYTES {
            self.write(at)?;
        } else if self.held >= HELD_BYTES {
            self.flush()?;
        }
        Ok(())
    }

    fn write(&mut self, at: usize) -> io::Result<()> {
        let list = &mut self.lists[at];
        if list.held.is_empty() {
            return Ok(());
        }
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(&list.held)?;
        list.blocks.push((self.end, list.held.len(), checksum(&list.held)));
        self.end += list.held.len() as u64;
        self.held -= list.held.len();
        list.held = Vec::new();
        Ok(())
    }

    /// Writes all records that are in memory to the file.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        (0..self.lists.len()).try_for_each(|at| self.write(at))
    }

    /// Returns the number of lists.
    pub(super) fn count(&self) -> usize {
        self.index.len()
    }

    /// Changes the key of each list to `key(old key)`. Lists that get the same key are joined.
    pub(super) fn merge(&mut self, key: impl Fn(K) -> K) -> io::Result<()> {
        self.flush()?;
        let mut old: Vec<(K, usize)> = std::mem::take(&mut self.index).into_iter().collect();
        old.sort_unstable_by_key(|(_, at)| *at);
        let mut lists = std::mem::take(&mut self.lists);
        for (old_key, at) in old {
            let list = std::mem::take(&mut lists[at]);
            let into = *self.index.entry(key(old_key)).or_insert_with(|| {
                self.lists.push(List::default());
                self.lists.len() - 1
            });
            self.lists[into].blocks.extend(list.blocks);
            self.lists[into].bytes += list.bytes;
        }
        self.last = None;
        Ok(())
    }

    /// Returns the key of each list, with the list's number of bytes.
    pub(super) fn sizes(&self) -> impl Iterator<Item = (K, u64)> + '_ {
        self.index.iter().map(|(key, at)| (*key, self.lists[*at].bytes))
    }

    /// Removes a list and returns it; it is empty if there is none with this key.
    pub(super) fn take(&mut self, key: K) -> List {
        self.last = None;
        let list = self.index.remove(&key).map(|at| std::mem::take(&mut self.lists[at])).unwrap_or_default();
        self.held -= list.held.len();
        list
    }

    /// Reads the records of `lists` into memory, one list after another.
    pub(super) fn bytes_of(&mut self, lists: &[List]) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(lists.iter().map(|list| list.bytes).sum::<u64>() as usize);
        for list in lists {
            self.read(list, &mut |block| {
                bytes.extend_from_slice(block);
                Ok(())
            })?;
        }
        Ok(bytes)
    }

    /// Passes the records of a list, block by block in order of writing, to `each`. Returns the error [`Changed`] if a
    /// block has changed since it was written.
    pub(super) fn read(&mut self, list: &List, each: &mut dyn FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        let mut bytes = Vec::new();
        for (at, length, sum) in &list.blocks {
            bytes.resize(*length, 0);
            self.file.seek(SeekFrom::Start(*at))?;
            self.file.read_exact(&mut bytes)?;
            if checksum(&bytes) != *sum {
                return Err(io::Error::other(Changed(*at)));
            }
            each(&bytes)?;
        }
        each(&list.held)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_changed_byte_changes_the_checksum() {
        let bytes: Vec<u8> = (0..21).collect();
        let sum = checksum(&bytes);
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut changed = bytes.clone();
                changed[at] ^= 1 << bit;
                assert_ne!(checksum(&changed), sum, "{at}, {bit}");
            }
        }
        assert_ne!(checksum(&[0]), checksum(&[0, 0]));
        assert_ne!(checksum(&bytes[..20]), sum);
    }

    #[test]
    fn changed_blocks_are_refused() {
        let mut spill = Spill::new(&std::env::temp_dir()).unwrap();
        spill.append(1, &[7; 3 * BLOCK_BYTES]).unwrap();
        spill.file.seek(SeekFrom::Start(1000)).unwrap();
        spill.file.write_all(&[8]).unwrap();
        let list = spill.take(1);
        let error = spill.read(&list, &mut |_| Ok(())).unwrap_err();
        assert!(error.get_ref().unwrap().is::<Changed>(), "{error}");
    }

    #[test]
    fn lists_come_back_whole_and_in_order_and_memory_holds_few_of_them() {
        let mut spill = Spill::new(&std::env::temp_dir()).unwrap();
        let record = |i: u32| [i; 64].map(u32::to_le_bytes).concat();
        let most = 600_000_u32;
        for i in 0..most {
            spill.append(i * 7 % 5 % 3, &record(i)).unwrap();
            assert!(spill.held < HELD_BYTES);
        }
        assert_eq!(spill.sizes().map(|(_, bytes)| bytes).sum::<u64>(), u64::from(most) * 256);
        for key in 0..3 {
            if key == 1 {
                spill.merge(|key| key + 10).unwrap();
            }
            let list = spill.take(if key == 0 { 0 } else { key + 10 });
            let mut expected = (0..most).filter(|i| i * 7 % 5 % 3 == key);
            let mut each = |bytes: &[u8]| {
                bytes.chunks_exact(256).for_each(|r| assert_eq!(r, record(expected.next().unwrap())));
                Ok(())
            };
            spill.read(&list, &mut each).unwrap();
            assert_eq!(expected.next(), None);
        }
    }
}
