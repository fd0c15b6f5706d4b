//! The splats of each block of a tile, in splat order.

use crate::record::Record;

/// Bits of a word, and blocks of a tile at most.
const BITS: usize = 64;

/// A splat in a block's list.
#[derive(Clone, Copy)]
pub(crate) struct Listed<'a> {
    pub record: &'a Record,
    /// [`Record::z_min`]: a splat that lies behind what is kept isn't looked at.
    pub z_min: f32,
}

/// Lists of all blocks of a tile, as a matrix of bits: splat by splat it is filled, block by block it is read.
///
/// Pushing each splat onto the lists of its blocks costs a mispredicted branch a splat and a store a pair; turning 64
/// splats' masks around costs the same whatever is in them. Filling also brings a tile's records near the processor, many
/// at a time, where the blocks' loops would wait for one after another.
#[derive(Default)]
pub(crate) struct BlockLists<'a> {
    splats: Vec<Listed<'a>>,
    /// Of each 64 splats: before they are full, the blocks of each splat; then the splats of each block.
    words: Vec<[u64; BITS]>,
    /// The list asked for last.
    list: Vec<Listed<'a>>,
}

impl<'a> BlockLists<'a> {
    pub(crate) fn clear(&mut self) {
        self.splats.clear();
        self.words.clear();
    }

    /// Appends a splat to the lists of `blocks`, a bit each.
    #[inline(always)]
    pub(crate) fn push(&mut self, record: &'a Record, blocks: u64) {
        if blocks == 0 {
            return;
        }
        let at = self.splats.len() % BITS;
        if at == 0 {
            self.turn_last();
            self.words.push([0; BITS]);
        }
        if let Some(word) = self.words.last_mut() {
            word[at] = blocks;
        }
        self.splats.push(Listed { record, z_min: record.z_min() });
    }

    /// To be called after the last splat.
    #[inline(always)]
    pub(crate) fn finish(&mut self) {
        self.turn_last();
    }

    #[inline(always)]
    fn turn_last(&mut self) {
        if let Some(word) = self.words.last_mut() {
            transpose(word);
        }
    }

    /// The list of a block.
    #[inline(always)]
    pub(crate) fn of(&mut self, block: u32) -> &[Listed<'a>] {
        self.list.clear();
        for (word, splats) in self.words.iter().zip(self.splats.chunks(BITS)) {
            let mut bits = word[block as usize % BITS];
            while bits != 0 {
                // The last word has no bits past the last splat.
                if let Some(&splat) = splats.get(bits.trailing_zeros() as usize) {
                    self.list.push(splat);
                }
                bits &= bits - 1;
            }
        }
        &self.list
    }
}

/// Bit i of word j becomes bit j of word i (Warren, Hacker's Delight, 7-3).
#[inline(always)]
fn transpose(words: &mut [u64; BITS]) {
    let mut width = BITS / 2;
    let mut mask = u64::MAX >> width;
    while width != 0 {
        for pair in words.chunks_exact_mut(2 * width) {
            let (low, high) = pair.split_at_mut(width);
            for (a, b) in low.iter_mut().zip(high) {
                let swap = ((*a >> width) ^ *b) & mask;
                *b ^= swap;
                *a ^= swap << width;
            }
        }
        width /= 2;
        mask ^= mask << width;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A record that can be told from others.
    fn record(i: usize) -> Record {
        Record::near(i, i as f32, [0.0; 3], [0.0; 3], 0.0)
    }

    #[test]
    fn lists_hold_each_blocks_splats_in_order_for_any_number_of_splats() {
        let records: Vec<Record> = (0..200).map(record).collect();
        // An xorshift: sparse and dense masks, some empty.
        let mut state = 0x9e37_79b9_7f4a_7c15u64;
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state
        };
        let mut lists = BlockLists::default();
        for count in [0, 1, 63, 64, 65, 128, 200] {
            let masks: Vec<u64> =
                (0..count).map(|i| if i % 3 == 0 { random() & random() } else { 1 << (random() % 64) }).collect();
            let masks: Vec<u64> = masks.iter().enumerate().map(|(i, &m)| if i % 7 == 3 { 0 } else { m }).collect();
            lists.clear();
            for (record, &mask) in records.iter().zip(&masks) {
                lists.push(record, mask);
            }
            lists.finish();
            for block in 0..64 {
                let expected: Vec<usize> = (0..count).filter(|&i| masks[i] >> block & 1 == 1).collect();
                let found: Vec<usize> = lists.of(block).iter().map(|s| s.record.object()).collect();
                assert_eq!(found, expected, "{count} splats, block {block}");
                assert!(lists.of(block).iter().all(|s| s.z_min == s.record.z_min()));
            }
        }
    }
}
