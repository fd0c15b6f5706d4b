//! The splats, or triangles, of each block of a tile, in their order.

use crate::bins::Entry;
use crate::record::{NOWHERE, Record};
use crate::recycle::emptied;
use crate::set_bits::{self, BITS};
use fearless_simd::Simd;

/// Splats that are drawn together.
pub(crate) const FOUR: usize = 4;

/// A splat, and [`Record::z_min`] of its record: one that lies behind what is kept isn't looked at.
pub(crate) type Listed<'a> = (&'a Record, f32);

/// The splats of a block.
#[derive(Clone, Copy)]
pub(crate) struct BlockList<'a, 'b> {
    /// All of the tile's, and one that is nowhere.
    splats: &'b [Listed<'a>],
    /// Indices of the block's, in their order, four after four; the last up to three are nowhere.
    fours: &'b [[u32; FOUR]],
    count: usize,
}

impl<'a, 'b> BlockList<'a, 'b> {
    /// Splats of the block.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Indices of the block's splats, four after four. The last up to three are of a splat that is nowhere.
    #[inline(always)]
    pub(crate) fn fours(&self) -> &'b [[u32; FOUR]] {
        self.fours
    }

    /// A splat by its index.
    #[inline(always)]
    pub(crate) fn get(&self, index: u32) -> Listed<'a> {
        self.splats[index as usize]
    }
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
    /// Indices of the splats of [`ROW`] blocks, block after block, and room for what is written beyond their end.
    order: Vec<u32>,
    /// Where each block's begin, and how many they are.
    parts: [(usize, usize); ROW],
    /// Which blocks these are.
    row: Option<usize>,
}

impl<'a> BlockLists<'a> {
    pub(crate) fn clear(&mut self) {
        self.splats.clear();
        self.words.clear();
        self.row = None;
    }

    /// The same memory, for other splats.
    pub(crate) fn for_others<'b>(self) -> BlockLists<'b> {
        let Self { splats, words, order, .. } = self;
        BlockLists { splats: emptied(splats), words, order, ..BlockLists::default() }
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
        self.splats.push((&NOWHERE, f32::INFINITY));
    }

    /// Blocks whose lists aren't empty, a bit each.
    pub(crate) fn touched(&self) -> u64 {
        touched(&self.words)
    }

    /// The list of a block.
    #[inline(always)]
    pub(crate) fn of<S: Simd>(&mut self, simd: S, block: u32) -> BlockList<'a, '_> {
        let block = block as usize % BITS;
        if self.row != Some(block / ROW) {
            self.list_row(simd, block / ROW);
        }
        let (first, count) = self.parts[block % ROW];
        let order = &self.order[first..first + count.next_multiple_of(FOUR)];
        BlockList { splats: &self.splats, fours: order.as_chunks().0, count }
    }

    /// Lists the splats of a row of blocks: several together, since what has just been written in parts can't be read in others.
    #[inline(always)]
    fn list_row<S: Simd>(&mut self, simd: S, row: usize) {
        self.row = Some(row);
        // Every block may have every splat, and what means nothing after them.
        let room = ROW * (BITS * self.words.len() + FOUR) + BITS;
        if self.order.len() < room {
            self.order.resize(room, 0);
        }
        // The last word has no bits past the last splat, after which comes the one that is nowhere.
        let nowhere = self.splats.len().saturating_sub(1) as u32;
        let mut at = 0;
        for (block, part) in (ROW * row..).zip(&mut self.parts) {
            let begin = at;
            for (word, first) in self.words.iter().zip((0..).step_by(BITS)) {
                let bits = word[block % BITS];
                if let Some(to) = self.order.get_mut(at..).and_then(|rest| rest.first_chunk_mut()) {
                    set_bits::number(simd, bits, first, to);
                }
                at += bits.count_ones() as usize;
            }
            *part = (begin, at - begin);
            if let Some(rest) = self.order.get_mut(at..).and_then(|rest| rest.first_chunk_mut::<FOUR>()) {
                *rest = [nowhere; FOUR];
            }
            at = begin + (at - begin).next_multiple_of(FOUR);
        }
    }
}

/// Blocks that are listed together.
const ROW: usize = 8;

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
    use crate::level::{Instructions, SimdLevel, with_instructions};

    /// A record that can be told from others.
    fn record(i: usize) -> Record {
        Record::near(i, i as f32, [0.0; 3], [0.0; 3], 0.0)
    }

    #[test]
    fn lists_hold_each_blocks_splats_in_order_for_any_number_of_splats() {
        for level in [SimdLevel::Best, SimdLevel::Baseline] {
            let Some(instructions) = Instructions::new(level) else { continue };
            with_instructions!(instructions, simd => check_lists(simd));
        }
    }

    fn check_lists<S: Simd>(simd: S) {
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
                let list = lists.of(simd, block);
                assert_eq!(list.len(), expected.len(), "{count} splats, block {block}");
                let listed: Vec<Listed<'_>> = list.fours().as_flattened().iter().map(|&i| list.get(i)).collect();
                let (own, rest) = listed.split_at(list.len());
                let found: Vec<usize> = own.iter().map(|(r, _)| r.object()).collect();
                assert_eq!(found, expected, "{count} splats, block {block}");
                assert!(own.iter().all(|(r, z)| r.z_min() == *z));
                assert!(rest.len() < FOUR && rest.iter().all(|(r, z)| r.base_x().is_nan() && *z == f32::INFINITY));
            }
        }
    }
}
