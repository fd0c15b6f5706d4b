//! The splats, or triangles, of each block of a tile, in their order.

use crate::bins::Entry;
use crate::lanes::LANES;
use crate::record::Record;
use crate::recycle::emptied;

/// Bits of a word, and blocks of a tile at most.
const BITS: usize = 64;

/// The splats of a block.
#[derive(Clone, Copy)]
pub(crate) struct BlockList<'a, 'b> {
    pub records: &'b [&'a Record],
    /// [`Record::z_min`] of each, for looking at sixteen together: a splat that lies behind what is kept isn't looked at. As
    /// many numbers as there are lanes follow.
    pub z_min: &'b [f32],
}

/// Lists of all blocks of a tile, as a matrix of bits: splat by splat it is filled, block by block it is read.
///
/// Pushing each splat onto the lists of its blocks costs a mispredicted branch a splat and a store a pair; turning 64
/// splats' masks around costs the same whatever is in them. Filling also brings a tile's records near the processor, many
/// at a time, where the blocks' loops would wait for one after another.
#[derive(Default)]
pub(crate) struct BlockLists<'a> {
    splats: Vec<(&'a Record, f32)>,
    /// Of each 64 splats: before they are full, the blocks of each splat; then the splats of each block.
    words: Vec<[u64; BITS]>,
    /// The list asked for last.
    records: Vec<&'a Record>,
    z_min: Vec<f32>,
}

impl<'a> BlockLists<'a> {
    pub(crate) fn clear(&mut self) {
        self.splats.clear();
        self.words.clear();
    }

    /// The same memory, for other splats.
    pub(crate) fn for_others<'b>(self) -> BlockLists<'b> {
        let Self { splats, words, records, z_min } = self;
        BlockLists { splats: emptied(splats), words, records: emptied(records), z_min }
    }

    /// Appends the splats of a tile's entries to the lists of those of their blocks that are `wanted`.
    #[inline(always)]
    pub(crate) fn extend(&mut self, records: &'a [Record], entries: &[Entry], wanted: u64) {
        let first = self.splats.len();
        self.words.resize((first + entries.len()).div_ceil(BITS), [0; BITS]);
        // Where a splat is found late, the next ones are looked for meanwhile.
        self.splats.extend(entries.iter().map(|entry| {
            let record = &records[entry.record as usize];
            (record, record.z_min())
        }));
        for (mask, entry) in self.words.as_flattened_mut()[first..].iter_mut().zip(entries) {
            *mask = entry.blocks & wanted;
        }
    }

    /// [`Self::extend`] for few blocks: splats that touch none of them are left out.
    pub(crate) fn extend_some(&mut self, records: &'a [Record], entries: &[Entry], wanted: u64) {
        for entry in entries.iter().filter(|entry| entry.blocks & wanted != 0) {
            let at = self.splats.len() % BITS;
            if at == 0 {
                self.words.push([0; BITS]);
            }
            if let Some(word) = self.words.last_mut() {
                word[at] = entry.blocks & wanted;
            }
            let record = &records[entry.record as usize];
            self.splats.push((record, record.z_min()));
        }
    }

    /// To be called after the last splat.
    #[inline(always)]
    pub(crate) fn finish(&mut self) {
        self.words.iter_mut().for_each(transpose);
    }

    /// Blocks whose lists aren't empty, a bit each.
    pub(crate) fn touched(&self) -> u64 {
        touched(&self.words)
    }

    /// The list of a block.
    #[inline(always)]
    pub(crate) fn of(&mut self, block: u32) -> BlockList<'a, '_> {
        let block = block as usize % BITS;
        let count = self.words.iter().map(|word| word[block].count_ones() as usize).sum::<usize>();
        if let Some(&(any, _)) = self.splats.first()
            && self.records.len() < count
        {
            self.records.resize(count, any);
        }
        if self.z_min.len() < count + LANES {
            self.z_min.resize(count + LANES, 0.0);
        }
        let mut slots = self.records.iter_mut().zip(&mut self.z_min);
        for (word, splats) in self.words.iter().zip(self.splats.chunks(BITS)) {
            let mut bits = word[block];
            while bits != 0 {
                // The last word has no bits past the last splat, and there are as many slots as bits.
                if let (Some(&(record, z_min)), Some(slot)) = (splats.get(bits.trailing_zeros() as usize), slots.next())
                {
                    (*slot.0, *slot.1) = (record, z_min);
                }
                bits &= bits - 1;
            }
        }
        BlockList { records: &self.records[..count], z_min: &self.z_min[..count + LANES] }
    }
}

/// Blocks whose lists aren't empty, a bit each, from turned words.
fn touched(words: &[[u64; BITS]]) -> u64 {
    let any = |block: &usize| words.iter().any(|word| word[*block] != 0);
    (0..BITS).filter(any).fold(0, |bits, block| bits | 1 << block)
}

/// [`BlockLists`] of anything: of what few frames have.
pub(crate) struct ItemLists<T> {
    items: Vec<T>,
    words: Vec<[u64; BITS]>,
    /// The list asked for last.
    list: Vec<T>,
}

impl<T: Copy> ItemLists<T> {
    pub(crate) fn new() -> Self {
        Self { items: Vec::new(), words: Vec::new(), list: Vec::new() }
    }

    pub(crate) fn clear(&mut self) {
        self.items.clear();
        self.words.clear();
    }

    /// The same memory, for other items.
    pub(crate) fn for_others<U>(self) -> ItemLists<U> {
        let Self { items, words, list } = self;
        ItemLists { items: emptied(items), words, list: emptied(list) }
    }

    /// Appends an item to the lists of `blocks`, a bit each.
    #[inline(always)]
    pub(crate) fn push(&mut self, item: T, blocks: u64) {
        let at = self.items.len() % BITS;
        if at == 0 {
            self.words.push([0; BITS]);
        }
        if let Some(word) = self.words.last_mut() {
            word[at] = blocks;
        }
        self.items.push(item);
    }

    /// To be called after the last item: blocks whose lists aren't empty, a bit each.
    pub(crate) fn finish(&mut self) -> u64 {
        self.words.iter_mut().for_each(transpose);
        touched(&self.words)
    }

    /// The list of a block.
    pub(crate) fn of(&mut self, block: u32) -> &[T] {
        self.list.clear();
        for (word, items) in self.words.iter().zip(self.items.chunks(BITS)) {
            let mut bits = word[block as usize % BITS];
            while bits != 0 {
                // The last word has no bits past the last item.
                self.list.extend(items.get(bits.trailing_zeros() as usize));
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
    use crate::bins::Kind;

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
            let entries: Vec<Entry> =
                (0..).zip(&masks).map(|(record, &blocks)| Entry::new(blocks, record, 0, Kind::Any)).collect();
            lists.clear();
            // From two segments.
            lists.extend(&records, &entries[..count / 3], u64::MAX);
            lists.extend(&records, &entries[count / 3..], u64::MAX);
            lists.finish();
            for block in 0..64 {
                let expected: Vec<usize> = (0..count).filter(|&i| masks[i] >> block & 1 == 1).collect();
                let list = lists.of(block);
                let found: Vec<usize> = list.records.iter().map(|r| r.object()).collect();
                assert_eq!(found, expected, "{count} splats, block {block}");
                assert!(list.records.iter().zip(list.z_min).all(|(r, &z)| r.z_min() == z));
                assert_eq!(list.z_min.len(), found.len() + LANES);
            }
        }
    }
}
