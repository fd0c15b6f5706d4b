//! Tiles of dots: drawn splat by splat, sums in memory, pixel by pixel, where other tiles are drawn block by block.
//!
//! Splats that are no dots are drawn here a block at a time: it costs more than in a tile drawn by blocks, so a tile needs enough
//! dots ([`unfold`](crate::small_dots::unfold)).

use crate::bins::{BLOCK, Kind, TILE_BLOCKS};
use crate::dot_fragments::{drawn, first_three, fragments_of, is_visible, masked};
use crate::dots::first_px;
use crate::fragment::{self, Fragment};
use crate::lanes::{LANES, Lanes};
use crate::pixel_sums::{Aligned, Numbers};
use crate::raster::{Shared, Sums};
use crate::record::{FORMS, Record, Together};
use crate::recycle::emptied;
use crate::shade;
use crate::target::{Rect, TileTarget};
use crate::tile::{Counters, Listing, TileJob, block_px};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4};
use surfel_math::Real;
use surfel_render::Attributes;

/// How far a dot may reach beyond its tile, in pixels.
const BEYOND: usize = 2;

/// Pixels of a row: a tile's and those beyond.
const STRIDE: usize = (TILE_BLOCKS * BLOCK) as usize + 2 * BEYOND;

/// All pixels, and as many as the last dot's last four reach beyond them.
const ALL: usize = STRIDE * STRIDE + 4;

/// A splat that is no dot at a block of the tile.
#[derive(Clone, Copy)]
struct Pair<'a> {
    record: &'a Record,
    first_px: (i32, i32),
    /// Index of its first pixel.
    pixel: u32,
}

/// What a thread reuses from tile to tile.
#[derive(Default)]
pub(crate) struct DotScratch<'a> {
    /// What every pixel keeps so far, min(z + ε); −∞ where none is drawn.
    kept: Vec<f32>,
    /// Of every pixel, one after another: sums of three attributes and of weights; or of six, of weights and of depths.
    sums: Aligned,
    /// Fragments that were added to every pixel.
    counts: Vec<f32>,
    pairs: Vec<Pair<'a>>,
    /// Of every pair, sixteen depths (NaN outside the footprint) and sixteen weights.
    remembered: Aligned,
}

impl DotScratch<'_> {
    /// The same memory, for other splats.
    pub(crate) fn for_others<'b>(self) -> DotScratch<'b> {
        let Self { kept, sums, counts, pairs, remembered } = self;
        DotScratch { kept, sums, counts, pairs: emptied(pairs), remembered }
    }
}

impl<'a> TileJob<'a> {
    /// Draws a tile splat by splat.
    #[inline(always)]
    pub(crate) fn draw_dots<S: Simd>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        scratch: &mut DotScratch<'a>,
    ) -> Counters {
        let attributes = &self.shared.wants.attributes;
        match !attributes.depth & !(attributes.color & attributes.normal) {
            true => self.dots::<S, 4>(simd, target, scratch),
            false => self.dots::<S, 8>(simd, target, scratch),
        }
    }

    #[inline(always)]
    fn dots<S: Simd, const N: usize>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        scratch: &mut DotScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let origin = self.listing.block_px(target.tile, 0);
        let tile = Tile { origin, rect: target.rect };
        let counts = target.has_fragments();
        scratch.clear::<N>(tile, counts);
        let touched = scratch.look_at_dots(simd, &self.listing, target.tile, tile, &mut counters);
        scratch.look_at_pairs(simd, tile, &self.shared, &mut counters);
        scratch.add::<S, N>(
            simd,
            &self.listing,
            (target.tile, tile),
            &self.shared.wants.attributes,
            counts,
            &mut counters,
        );
        self.finish::<S, N>(simd, (tile, touched), scratch, target);
        counters
    }

    /// Lights and writes the blocks that are touched. Out of line: a short function keeps its numbers in registers.
    #[inline(never)]
    fn finish<S: Simd, const N: usize>(
        &self,
        simd: S,
        (tile, touched): (Tile, u64),
        scratch: &mut DotScratch<'a>,
        target: &mut TileTarget<'_>,
    ) {
        let attributes = &self.shared.wants.attributes;
        let counts = target.has_fragments();
        simd.vectorize(
            #[inline(always)]
            || {
                let blocks = self.listing.blocks(target.tile);
                target.put_empty(tile.origin, blocks & !touched, self.lighting.background);
                let mut left = blocks & touched;
                while left != 0 {
                    let block = left.trailing_zeros();
                    left &= left - 1;
                    let at = block_px(tile.origin, block);
                    let sums = scratch.sums_of::<S, N>(simd, tile.index(at), attributes, counts);
                    target.put(at, &shade::resolve(simd, self.lighting, &sums, at));
                }
            },
        );
    }
}

/// Where a tile's first pixel is, and which of them are drawn.
#[derive(Clone, Copy)]
struct Tile {
    origin: (i32, i32),
    rect: Rect,
}

impl Tile {
    /// Index of a pixel.
    #[inline(always)]
    fn index(&self, (x, y): (i32, i32)) -> usize {
        let (x, y) = (x - self.origin.0 + BEYOND as i32, y - self.origin.1 + BEYOND as i32);
        (y.max(0) as usize) * STRIDE + x.max(0) as usize
    }

    /// Index of a dot's first pixel.
    #[inline(always)]
    fn index_of(&self, dot: &Record) -> usize {
        self.index(first_px(dot))
    }
}

/// Pixels from a block's first to its last, and from a dot's.
const OF_BLOCK: usize = 3 * STRIDE + 4;
const OF_DOT: usize = 2 * STRIDE + 4;

impl<'a> DotScratch<'a> {
    /// Nothing is drawn yet.
    fn clear<const N: usize>(&mut self, tile: Tile, counts: bool) {
        self.pairs.clear();
        self.kept.clear();
        self.kept.resize(ALL, f32::NEG_INFINITY);
        let rect = tile.rect;
        for y in rect.y..rect.end_y {
            let row = tile.index((rect.x, y));
            let row = self.kept.get_mut(row..row + (rect.end_x - rect.x).max(0) as usize);
            row.unwrap_or_default().fill(f32::INFINITY);
        }
        self.sums.reserve(ALL * N);
        self.sums.0.fill(0.0);
        self.counts.clear();
        if counts {
            self.counts.resize(ALL, 0.0);
        }
    }

    /// The first loop over dots: what every pixel keeps of them. Lists pairs of other splats and blocks, and returns the
    /// blocks that are touched, a bit each.
    #[inline(always)]
    fn look_at_dots<S: Simd>(
        &mut self,
        simd: S,
        listing: &Listing<'a>,
        number: usize,
        tile: Tile,
        counters: &mut Counters,
    ) -> u64 {
        let mut touched = 0;
        let (infinity, three) = (f32x4::splat(simd, f32::INFINITY), first_three(simd));
        for segment in listing.segments {
            let entries = segment.of(number);
            counters.block_pairs += entries.len() as u64;
            for entry in entries {
                touched |= entry.blocks;
                if entry.kind() == Kind::Small {
                    let dot = &segment.small_dots[entry.record as usize];
                    let first = tile.index(dot.first_px(tile.origin));
                    if let Some(kept) = self.kept.get_mut(first..).and_then(|kept| kept.first_chunk_mut()) {
                        keep_four(simd, dot.fragments(simd), dot.epsilon(), kept);
                    }
                    counters.spared += 12;
                    continue;
                }
                let record = &segment.records[entry.record as usize];
                if entry.kind() == Kind::Any {
                    let mut blocks = entry.blocks;
                    counters.block_pairs += u64::from(blocks.count_ones()) - 1;
                    while blocks != 0 {
                        let (x, y) = listing.block_px(number, blocks.trailing_zeros());
                        blocks &= blocks - 1;
                        self.pairs.push(Pair { record, first_px: (x, y), pixel: tile.index((x, y)) as u32 });
                    }
                    continue;
                }
                let first = tile.index_of(record);
                let Some(kept) = self.kept.get_mut(first..).and_then(|kept| kept.first_chunk_mut::<OF_DOT>()) else {
                    continue;
                };
                if entry.kind() == Kind::Four {
                    keep_four(simd, fragments_of(simd, record, FORMS, FORMS + 4), record.epsilon(), kept);
                    counters.spared += 12;
                } else {
                    let epsilon = f32x4::splat(simd, record.epsilon());
                    for row in 0..3 {
                        let (depths, weights) = fragments_of(simd, record, FORMS + 3 * row, FORMS + 9 + 3 * row);
                        let values = (is_visible(weights) & three).select(depths + epsilon, infinity);
                        let kept = &mut kept[STRIDE * row..STRIDE * row + 4];
                        values.min(f32x4::from_slice(simd, kept)).store_slice(kept);
                    }
                    counters.spared += 7;
                }
            }
        }
        touched
    }

    /// The first loop over pairs: what every pixel keeps, and their fragments.
    #[inline(always)]
    fn look_at_pairs<S: Simd>(&mut self, simd: S, tile: Tile, shared: &Shared<'_>, counters: &mut Counters) {
        self.remembered.reserve(2 * LANES * self.pairs.len());
        let remembered = self.remembered.numbers();
        for (pairs, to) in self.pairs.chunks(4).zip(remembered.chunks_mut(8 * LANES)) {
            let mut values = [[0.0; LANES]; 4];
            let four = match pairs {
                [a, b, c, d] => Some((pairs, [a.record, b.record, c.record, d.record])),
                _ => None,
            };
            match four {
                Some(([a, b, c, d], records)) if Together::of(&records) != Together::Nothing => {
                    let at = [a.at(simd), b.at(simd), c.at(simd), d.at(simd)];
                    let fragments = fragment::four::<S, true>(simd, records, at, shared);
                    for i in 0..4 {
                        counters.inside += inside(tile, at[i], &fragments[i]);
                        take_in(simd, records[i], &fragments[i], &mut to[2 * LANES * i..], &mut values[i]);
                    }
                }
                _ => {
                    for (i, (pair, values)) in pairs.iter().zip(&mut values).enumerate() {
                        let at = pair.at(simd);
                        let fragment = fragment::fragment(simd, pair.record, at, pair.first_px, shared);
                        counters.inside += inside(tile, at, &fragment);
                        take_in(simd, pair.record, &fragment, &mut to[2 * LANES * i..], values);
                    }
                }
            }
            for (pair, values) in pairs.iter().zip(&values) {
                let kept = self.kept.get_mut(pair.pixel as usize..).and_then(|kept| kept.first_chunk_mut::<OF_BLOCK>());
                let Some(kept) = kept else { continue };
                for row in 0..4 {
                    let kept = &mut kept[STRIDE * row..STRIDE * row + 4];
                    let values = f32x4::from_slice(simd, &values[4 * row..4 * row + 4]);
                    values.min(f32x4::from_slice(simd, kept)).store_slice(kept);
                }
            }
        }
    }

    /// The second loop: adds what pixels keep, in splat order.
    #[inline(always)]
    fn add<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        listing: &Listing<'a>,
        (number, tile): (usize, Tile),
        attributes: &Attributes,
        counts: bool,
        counters: &mut Counters,
    ) {
        let Self { kept, sums, counts: all_counts, pairs, remembered } = self;
        let sums = sums.numbers().as_chunks_mut::<N>().0;
        let three = first_three(simd);
        let mut pairs = pairs.iter().zip(remembered.numbers().as_chunks::<{ 2 * LANES }>().0);
        for segment in listing.segments {
            for entry in segment.of(number) {
                if entry.kind() == Kind::Small {
                    let dot = &segment.small_dots[entry.record as usize];
                    let numbers = Numbers::<S, N>::of(simd, dot.attributes(), attributes);
                    let pixel = tile.index(dot.first_px(tile.origin));
                    let (inside, bits) = add_four(simd, dot.fragments(simd), &numbers, (kept, sums), pixel);
                    counters.inside += inside;
                    counters.kept += u64::from(bits.count_ones());
                    if counts {
                        count(all_counts, pixel, (0..4).map(|i| (i % 2, i / 2, bits >> i & 1)));
                    }
                    continue;
                }
                let record = &segment.records[entry.record as usize];
                let numbers = Numbers::<S, N>::of(simd, record.attributes(), attributes);
                if entry.kind() == Kind::Any {
                    for (pair, remembered) in pairs.by_ref().take(entry.blocks.count_ones() as usize) {
                        let pixel = pair.pixel as usize;
                        let bits = add_pair(simd, remembered, &numbers, (kept, sums), pixel);
                        counters.kept += u64::from(bits.count_ones());
                        if counts {
                            count(all_counts, pixel, (0..16).map(|i| (i % 4, i / 4, bits >> i & 1)));
                        }
                    }
                    continue;
                }
                let pixel = tile.index_of(record);
                let side = if entry.kind() == Kind::Four { 2 } else { 3 };
                let mut bits = 0;
                if side == 2 {
                    let fragments = fragments_of(simd, record, FORMS, FORMS + 4);
                    let (inside, is_kept) = add_four(simd, fragments, &numbers, (kept, sums), pixel);
                    counters.inside += inside;
                    bits = is_kept;
                } else {
                    let kept = kept.get(pixel..).and_then(|kept| kept.first_chunk::<OF_DOT>());
                    let to = sums.get_mut(pixel..).and_then(|sums| sums.first_chunk_mut::<OF_DOT>());
                    let (Some(kept), Some(to)) = (kept, to) else { continue };
                    for row in 0..3 {
                        let (depths, weights) = fragments_of(simd, record, FORMS + 3 * row, FORMS + 9 + 3 * row);
                        let has = weights.simd_le(weights) & three;
                        let here = f32x4::from_slice(simd, &kept[STRIDE * row..STRIDE * row + 4]);
                        let (depths, weights, is_kept) = masked::<S, N>(simd, depths, weights, has, here);
                        for i in 0..3 {
                            numbers.add(simd, weights[i], depths[i], &mut to[STRIDE * row + i]);
                        }
                        counters.inside += drawn(simd, has, here);
                        bits |= is_kept << (3 * row);
                    }
                }
                counters.kept += u64::from(bits.count_ones());
                if counts {
                    count(all_counts, pixel, (0..side * side).map(|i| (i % side, i / side, bits >> i & 1)));
                }
            }
        }
    }

    /// The sums of the block whose first pixel has an index.
    #[inline(always)]
    fn sums_of<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        pixel: usize,
        attributes: &Attributes,
        counts: bool,
    ) -> Sums<S> {
        let mut planes = [Lanes::splat(simd, 0.0); N];
        for (row, planes) in planes.chunks_exact_mut(N / 4).enumerate() {
            let numbers = self.sums.numbers().get((pixel + row * STRIDE) * N..).unwrap_or_default();
            for (plane, numbers) in planes.iter_mut().zip(numbers.chunks_exact(LANES)) {
                *plane = Lanes::load(simd, numbers);
            }
        }
        // From pixel by pixel to number by number.
        let planes = Lanes::transpose(planes);
        let mut sums = Sums::new(simd);
        let three = |at: usize| [planes[at], planes[at + 1], planes[at + 2]];
        if N == 8 {
            (sums.color, sums.normal, sums.weight, sums.depth) = (three(0), three(3), planes[6], planes[7]);
        } else {
            sums.weight = planes[3];
            if attributes.normal {
                sums.normal = three(0);
            } else {
                sums.color = three(0);
            }
        }
        if counts {
            sums.fragments = rows(simd, self.counts.get(pixel..).unwrap_or_default());
        }
        sums
    }
}

/// Numbers of the pixels of a block, given from its first one on.
#[inline(always)]
fn rows<S: Simd>(simd: S, numbers: &[f32]) -> Lanes<S> {
    let Some(numbers) = numbers.first_chunk::<OF_BLOCK>() else { return Lanes::splat(simd, f32::NEG_INFINITY) };
    let row = |i: usize| f32x4::from_slice(simd, &numbers[STRIDE * i..STRIDE * i + 4]);
    Lanes(row(0).combine(row(1)).combine(row(2).combine(row(3))))
}

/// Numbers of the pixels of a dot, given from its first one on.
#[inline(always)]
fn four_of<S: Simd>(simd: S, numbers: &[f32; OF_DOT]) -> f32x4<S> {
    f32x4::load_array(simd, [numbers[0], numbers[1], numbers[STRIDE], numbers[STRIDE + 1]])
}

/// What the pixels of a dot of four keep, with it: depths of pixels from its first one on.
#[inline(always)]
fn keep_four<S: Simd>(simd: S, (depths, weights): (f32x4<S>, f32x4<S>), epsilon: f32, kept: &mut [f32; OF_DOT]) {
    let infinity = f32x4::splat(simd, f32::INFINITY);
    let values = is_visible(weights).select(depths + f32x4::splat(simd, epsilon), infinity);
    let nearest = values.min(four_of(simd, kept)).to_array();
    (kept[0], kept[1], kept[STRIDE], kept[STRIDE + 1]) = (nearest[0], nearest[1], nearest[2], nearest[3]);
}

/// Adds a dot of four at its first pixel: how many of its fragments are drawn, and which are kept, as bits.
#[inline(always)]
fn add_four<S: Simd, const N: usize>(
    simd: S,
    (depths, weights): (f32x4<S>, f32x4<S>),
    numbers: &Numbers<S, N>,
    (kept, sums): (&[f32], &mut [[f32; N]]),
    pixel: usize,
) -> (u64, u32) {
    let kept = kept.get(pixel..).and_then(|kept| kept.first_chunk::<OF_DOT>());
    let to = sums.get_mut(pixel..).and_then(|sums| sums.first_chunk_mut::<OF_DOT>());
    let (Some(kept), Some(to)) = (kept, to) else { return (0, 0) };
    let has = weights.simd_le(weights);
    let here = four_of(simd, kept);
    let (depths, weights, is_kept) = masked::<S, N>(simd, depths, weights, has, here);
    for i in 0..4 {
        numbers.add(simd, weights[i], depths[i], &mut to[STRIDE * (i / 2) + i % 2]);
    }
    (drawn(simd, has, here), is_kept)
}

/// How many fragments of a block's pixels are drawn.
#[inline(always)]
fn inside<S: Simd>(tile: Tile, at: (Lanes<S>, Lanes<S>), fragment: &Fragment<S>) -> u64 {
    u64::from((fragment.inside & tile.rect.holds(at)).to_bitmask().count_ones())
}

impl Pair<'_> {
    /// Its pixels.
    #[inline(always)]
    fn at<S: Simd>(&self, simd: S) -> (Lanes<S>, Lanes<S>) {
        let (x, y) = self.first_px;
        let (x, y) = (Lanes::splat(simd, x as f32), Lanes::splat(simd, y as f32));
        (Lanes::block_columns(simd) + x, Lanes::block_rows(simd) + y)
    }
}

/// Remembers a splat's fragments; what pixels may keep of it.
#[inline(always)]
fn take_in<S: Simd>(
    simd: S,
    record: &Record,
    fragment: &Fragment<S>,
    remembered: &mut [f32],
    values: &mut [f32; LANES],
) {
    let nan = Lanes::splat(simd, f32::NAN);
    if let Some(to) = remembered.first_chunk_mut::<{ 2 * LANES }>() {
        Lanes::select(fragment.inside, fragment.z, nan).store(to);
        fragment.weight.store(&mut to[LANES..]);
    }
    let value = fragment.z + Lanes::splat(simd, record.epsilon());
    Lanes::select(fragment.visible, value, Lanes::splat(simd, f32::INFINITY)).store(values);
}

/// Adds a splat at a block: which of its fragments are kept, as bits.
#[inline(always)]
fn add_pair<S: Simd, const N: usize>(
    simd: S,
    remembered: &[f32; 2 * LANES],
    numbers: &Numbers<S, N>,
    (kept, sums): (&[f32], &mut [[f32; N]]),
    pixel: usize,
) -> u32 {
    let Some(sums) = sums.get_mut(pixel..).and_then(|sums| sums.first_chunk_mut::<OF_BLOCK>()) else { return 0 };
    let (depths, weights) = (Lanes::load(simd, remembered), Lanes::load(simd, &remembered[LANES..]));
    let is_kept = depths.le(rows(simd, kept.get(pixel..).unwrap_or_default()));
    let zero = Lanes::splat(simd, 0.0);
    let weights = Lanes::select(is_kept, weights, zero).to_array();
    let depths = if N == 8 { Lanes::select(is_kept, depths, zero).to_array() } else { [0.0; LANES] };
    for i in 0..LANES {
        numbers.add(simd, weights[i], depths[i], &mut sums[STRIDE * (i / 4) + i % 4]);
    }
    is_kept.to_bitmask() as u32
}

/// Counts fragments at columns and rows from a pixel on.
fn count(counts: &mut [f32], pixel: usize, fragments: impl Iterator<Item = (usize, usize, u32)>) {
    for (column, row, is_kept) in fragments {
        if let Some(count) = counts.get_mut(pixel + STRIDE * row + column) {
            *count += is_kept as f32;
        }
    }
}
