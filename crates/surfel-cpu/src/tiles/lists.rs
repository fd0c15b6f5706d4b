//! Lists of the splats, or of the triangles, that touch each block of a tile, in splat order or scene order.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat, ball or triangle projected to
//! the screen, as setup stores it. A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::simd::compress::{self, BITS};
use crate::tiles::bins::Entry;
use crate::tiles::pool::recycle_vec;
use fearless_simd::Simd;

/// Number of splats in a batch, whose fragments are computed together.
pub(crate) const BATCH: usize = 4;

/// A record that block lists may contain.
pub(crate) trait Listable: 'static {
    /// A record without any fragment, which pads the last batch of a list.
    const EMPTY: &'static Self;

    /// Returns a lower bound of the depth of the record's fragments.
    fn z_min(&self) -> f32;
}

/// A splat's record, and a copy of its [`Listable::z_min`]. With the copy, records behind all depth thresholds needn't
/// be read.
pub(crate) type Listed<'a, R> = (&'a R, f32);

/// The list of the splats that may touch a block, in splat order.
pub(crate) struct BlockList<'a, 'b, R> {
    /// All splats of the tile, followed by a record without fragments.
    splats: &'b [Listed<'a, R>],
    /// Indices in `splats` of the block's splats, in splat order, in batches of 4. Up to three at the end are of the
    /// record without fragments.
    batches: &'b [[u32; BATCH]],
    /// Number of the block's splats, without padding.
    count: usize,
}

impl<R> Clone for BlockList<'_, '_, R> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<R> Copy for BlockList<'_, '_, R> {}

impl<'a, 'b, R> BlockList<'a, 'b, R> {
    /// Returns the number of splats of the block.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns the indices of the block's splats for [`Self::get`], in batches of 4. Up to three at the end are of a
    /// record without fragments.
    #[inline(always)]
    pub(crate) fn batches(&self) -> &'b [[u32; BATCH]] {
        self.batches
    }

    /// Returns the splat with an index from [`Self::batches`].
    #[inline(always)]
    pub(crate) fn get(&self, index: u32) -> Listed<'a, R> {
        self.splats[index as usize]
    }
}

/// Lists of the splats that touch each block of a tile, as a matrix of bits that is filled splat by splat and read
/// block by block.
///
/// Pushing each splat onto the lists of its blocks would cost a mispredicted branch per splat, and a store per pair of
/// a splat and a block. Transposing the masks of 64 splats has a fixed cost. Filling also brings a tile's records into
/// the cache, many at a time, where the blocks' loops would wait for one after another.
pub(crate) struct BlockLists<'a, R> {
    splats: Vec<Listed<'a, R>>,
    /// Matrices of bits, one for every 64 splats. While the lists are filled, a word has the blocks of one splat.
    /// [`Self::finish`] transposes the matrices, and a word then has the splats of one block.
    words: Vec<[u64; BITS]>,
    /// Indices in `splats` of the splats of one row of [`ROW`] blocks, block by block, and room for superfluous writes
    /// beyond the end.
    order: Vec<u32>,
    /// Start and length in `order` of the list of each block of the row `row`.
    parts: [(usize, usize); ROW],
    /// Row of blocks whose lists `order` contains; `None` if it contains none.
    row: Option<usize>,
}

impl<R> Default for BlockLists<'_, R> {
    fn default() -> Self {
        Self { splats: Vec::new(), words: Vec::new(), order: Vec::new(), parts: [(0, 0); ROW], row: None }
    }
}

impl<'a, R: Listable> BlockLists<'a, R> {
    pub(crate) fn clear(&mut self) {
        self.splats.clear();
        self.words.clear();
        self.row = None;
    }

    /// Empties the lists, and returns their memory as lists for records of another lifetime.
    pub(crate) fn for_others<'b>(self) -> BlockLists<'b, R> {
        let Self { splats, words, order, .. } = self;
        BlockLists { splats: recycle_vec(splats), words, order, ..BlockLists::default() }
    }

    /// Appends the splats of a tile's entries to the lists of the blocks that they touch. Only blocks in `wanted` (one
    /// bit per block) get splats.
    #[inline(always)]
    pub(crate) fn extend(&mut self, records: &'a [R], entries: &[Entry], wanted: u64) {
        let first = self.splats.len();
        self.words.resize((first + entries.len()).div_ceil(BITS), [0; BITS]);
        // While one splat is fetched from memory, the CPU requests the next ones.
        self.splats.extend(entries.iter().map(|entry| {
            let record = &records[entry.record as usize];
            (record, record.z_min())
        }));
        for (mask, entry) in self.words.as_flattened_mut()[first..].iter_mut().zip(entries) {
            *mask = entry.blocks & wanted;
        }
    }

    /// Appends splats as [`Self::extend`] does, but skips splats that touch no block in `wanted`. Faster if few bits of
    /// `wanted` are set.
    pub(crate) fn extend_some(&mut self, records: &'a [R], entries: &[Entry], wanted: u64) {
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

    /// Finishes the lists for reading. Call this after the last splat.
    #[inline(always)]
    pub(crate) fn finish(&mut self) {
        self.words.iter_mut().for_each(transpose);
        self.splats.push((R::EMPTY, f32::INFINITY));
    }

    /// Returns bits of the blocks whose lists aren't empty; valid after [`Self::finish`].
    pub(crate) fn touched(&self) -> u64 {
        touched(&self.words)
    }

    /// Returns the list of the splats that may touch a block.
    #[inline(always)]
    pub(crate) fn of<S: Simd>(&mut self, simd: S, block: u32) -> BlockList<'a, '_, R> {
        let block = block as usize % BITS;
        if self.row != Some(block / ROW) {
            self.list_row(simd, block / ROW);
        }
        let (first, count) = self.parts[block % ROW];
        let order = &self.order[first..first + count.next_multiple_of(BATCH)];
        BlockList { splats: &self.splats, batches: order.as_chunks().0, count }
    }

    /// Computes the lists of a row of blocks in `order`. Several blocks are listed together, since reading a list right
    /// after its partial writes would stall.
    #[inline(always)]
    fn list_row<S: Simd>(&mut self, simd: S, row: usize) {
        self.row = Some(row);
        // Room for all splats in each block, and for superfluous writes after them.
        let room = ROW * (BITS * self.words.len() + BATCH) + BITS;
        if self.order.len() < room {
            self.order.resize(room, 0);
        }
        // The last word has no bits past the last splat, which the empty splat follows.
        let empty = self.splats.len().saturating_sub(1) as u32;
        let mut at = 0;
        for (block, part) in (ROW * row..).zip(&mut self.parts) {
            let begin = at;
            for (word, first) in self.words.iter().zip((0..).step_by(BITS)) {
                let bits = word[block % BITS];
                if let Some(to) = self.order.get_mut(at..).and_then(|rest| rest.first_chunk_mut()) {
                    compress::set_bits(simd, bits, first, to);
                }
                at += bits.count_ones() as usize;
            }
            *part = (begin, at - begin);
            if let Some(rest) = self.order.get_mut(at..).and_then(|rest| rest.first_chunk_mut::<BATCH>()) {
                *rest = [empty; BATCH];
            }
            at = begin + (at - begin).next_multiple_of(BATCH);
        }
    }
}

/// Number of blocks, one row of a tile, whose lists are computed together.
const ROW: usize = 8;

/// Returns bits of the blocks whose lists aren't empty, from transposed matrices of bits.
fn touched(words: &[[u64; BITS]]) -> u64 {
    let any = |block: &usize| words.iter().any(|word| word[*block] != 0);
    (0..BITS).filter(any).fold(0, |bits, block| bits | 1 << block)
}

/// Lists of the items that touch each block of a tile, like [`BlockLists`] but of any type, for content that few frames
/// have.
pub(crate) struct ItemLists<T> {
    items: Vec<T>,
    words: Vec<[u64; BITS]>,
    /// The list that [`Self::of`] returned last; reused for the next block.
    list: Vec<T>,
}

impl<T> Default for ItemLists<T> {
    fn default() -> Self {
        Self { items: Vec::new(), words: Vec::new(), list: Vec::new() }
    }
}

impl<T: Copy> ItemLists<T> {
    pub(crate) fn clear(&mut self) {
        self.items.clear();
        self.words.clear();
    }

    /// Empties the lists, and returns their memory as lists for items of another type or lifetime.
    pub(crate) fn for_others<U>(self) -> ItemLists<U> {
        let Self { items, words, list } = self;
        ItemLists { items: recycle_vec(items), words, list: recycle_vec(list) }
    }

    /// Appends an item to the lists of the blocks whose bits are set in `blocks`.
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

    /// Finishes the lists for reading, and returns bits of the blocks whose lists aren't empty. Call this after the
    /// last item.
    pub(crate) fn finish(&mut self) -> u64 {
        self.words.iter_mut().for_each(transpose);
        touched(&self.words)
    }

    /// Returns the items that touch a block, in the order in which they were appended.
    pub(crate) fn of(&mut self, block: u32) -> &[T] {
        self.list.clear();
        for (word, items) in self.words.iter().zip(self.items.chunks(BITS)) {
            // The last word has no bits past the last item.
            self.list.extend(compress::ones(word[block as usize % BITS]).filter_map(|i| items.get(i)));
        }
        &self.list
    }
}

/// Transposes a matrix of bits: bit i of word j becomes bit j of word i (Warren, Hacker's Delight, 7-3).
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
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};
    use crate::simd::xorshift::Xorshift;
    use crate::tiles::bins::Kind;

    /// An item identified by its depth.
    #[derive(Debug, PartialEq)]
    struct At(f32);

    impl Listable for At {
        const EMPTY: &'static Self = &Self(f32::NAN);

        fn z_min(&self) -> f32 {
            self.0
        }
    }

    #[test]
    fn lists_hold_each_blocks_splats_in_order_for_any_number_of_splats() {
        for &level in SimdLevel::ALL {
            let instructions = Instructions::new(level).unwrap();
            with_instructions!(instructions, simd => check_lists(simd));
        }
    }

    fn check_lists<S: Simd>(simd: S) {
        let records: Vec<At> = (0..200u16).map(|i| At(f32::from(i))).collect();
        // Sparse and dense masks, some empty.
        let mut numbers = Xorshift::new();
        let mut random = move || numbers.bits();
        let mut lists = BlockLists::default();
        for count in [0, 1, 63, 64, 65, 128, 200] {
            let masks: Vec<u64> =
                (0..count).map(|i| if i % 3 == 0 { random() & random() } else { 1 << (random() % 64) }).collect();
            let masks: Vec<u64> = masks.iter().enumerate().map(|(i, &m)| if i % 7 == 3 { 0 } else { m }).collect();
            let entries: Vec<Entry> =
                (0..).zip(&masks).map(|(record, &blocks)| Entry::new(blocks, record, 0, Kind::Any)).collect();
            lists.clear();
            // The entries come from two segments.
            lists.extend(&records, &entries[..count / 3], u64::MAX);
            lists.extend(&records, &entries[count / 3..], u64::MAX);
            lists.finish();
            for block in 0..64 {
                let expected: Vec<usize> = (0..count).filter(|&i| masks[i] >> block & 1 == 1).collect();
                let list = lists.of(simd, block);
                assert_eq!(list.len(), expected.len(), "{count} splats, block {block}");
                let listed: Vec<Listed<'_, At>> = list.batches().as_flattened().iter().map(|&i| list.get(i)).collect();
                let (own, rest) = listed.split_at(list.len());
                let found: Vec<usize> = own.iter().map(|(record, _)| record.0 as usize).collect();
                assert_eq!(found, expected, "{count} splats, block {block}");
                assert!(own.iter().all(|(r, z)| r.0 == *z));
                assert!(rest.len() < BATCH && rest.iter().all(|(r, z)| r.0.is_nan() && *z == f32::INFINITY));
            }
        }
    }
}
