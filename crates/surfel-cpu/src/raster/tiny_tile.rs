//! Tiles of tiny splats, drawn splat by splat with each pixel's sums in memory. Other tiles are drawn block by block.
//!
//! Splats that aren't tiny are drawn here block by block too, at a higher cost than in a tile drawn by blocks. A tile
//! therefore needs enough tiny splats ([`is_faster_by_splats`]).
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::raster::fragment::{self, cheap_batch};
use crate::raster::inputs::RasterInputs;
use crate::raster::listing::Listing;
use crate::raster::pixel_sums::{Aligned, Numbers};
use crate::raster::sums::Sums;
use crate::raster::tiny_fragments::{Contributing, contributing, drawn, first_three, fragments_of, is_visible};
use crate::setup::evaluate::Fragment;
use crate::setup::record::{Batch, FORMS, Record};
use crate::setup::segment::Segment;
use crate::setup::tiny::first_px;
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::bins::Kind;
use crate::tiles::driver::Counters;
use crate::tiles::grid::{BLOCK, Rect, TILE_BLOCKS};
use crate::tiles::pool::recycle_vec;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4};
use surfel_math::Real;
use surfel_render::Attributes;

/// Largest distance, in pixels, by which a tiny splat that touches a tile may extend beyond it.
const TILE_MARGIN_PX: usize = 2;

/// Number of pixels in a row of a tile's buffers: the tile's own, and a margin of [`TILE_MARGIN_PX`] pixels on either
/// side.
const STRIDE: usize = (TILE_BLOCKS * BLOCK) as usize + 2 * TILE_MARGIN_PX;

/// Number of pixels in a tile's buffers: all rows, and four more, because fragments are read and written four at a
/// time.
const ALL: usize = STRIDE * STRIDE + 4;

/// A pair of a block and a splat that isn't tiny and touches the block.
#[derive(Clone, Copy)]
struct Pair<'a> {
    record: &'a Record,
    first_px: (i32, i32),
    /// Index of the block's first pixel in the tile's buffers.
    pixel: u32,
}

/// Per-thread buffers of a tile's pixels and fragments, reused between tiles.
#[derive(Default)]
pub(crate) struct TinyScratch<'a> {
    /// Depth threshold min(z + ε) per pixel, of the splats so far; −∞ in pixels outside the drawn region.
    thresholds: Vec<f32>,
    /// Sums per pixel, consecutive for each pixel, in one of two layouts. With 4 numbers: weighted colour or weighted
    /// normal, then the weight. With 8: weighted colour, weighted normal, weight and weighted depth.
    sums: Aligned,
    /// Number of fragments added to each pixel; empty if they aren't counted.
    counts: Vec<f32>,
    pairs: Vec<Pair<'a>>,
    /// Stored fragments of each pair: sixteen depths (NaN outside the footprint), then sixteen weights.
    remembered: Aligned,
}

impl TinyScratch<'_> {
    /// Empties the buffers and returns their memory for splats of another lifetime.
    pub(crate) fn for_others<'b>(self) -> TinyScratch<'b> {
        let Self { thresholds, sums, counts, pairs, remembered } = self;
        TinyScratch { thresholds, sums, counts, pairs: recycle_vec(pairs), remembered }
    }
}

/// A tile that is drawn splat by splat, because enough of its splats are tiny ([`is_faster_by_splats`]).
pub(crate) struct TinyTile<'a, 'b> {
    pub listing: &'b Listing<'a>,
    pub inputs: &'b RasterInputs<'a>,
    pub number: usize,
    /// The tile's pixels that are inside the target and are drawn.
    pub rect: Rect,
    /// True if the fragments added to each pixel are counted.
    pub counts: bool,
}

impl<'a> TinyTile<'a, '_> {
    /// True if 8 numbers are summed per pixel: colour, normal, weight and depth. False if 4 suffice.
    pub(crate) fn sums_all(&self) -> bool {
        let attributes = &self.inputs.frame.wanted.attributes;
        attributes.depth | (attributes.color & attributes.normal)
    }

    /// Draws all splats of the tile into the buffers of `scratch`, with `N` sums per pixel. Returns bits of the blocks
    /// touched.
    #[inline(always)]
    pub(crate) fn draw<S: Simd, const N: usize>(
        &self,
        simd: S,
        scratch: &mut TinyScratch<'a>,
        counters: &mut Counters,
    ) -> u64 {
        let tile = Tile { origin: self.listing.grid.block_px(self.number, 0), rect: self.rect };
        scratch.clear::<N>(tile, self.counts);
        let touched = scratch.lower_thresholds_by_tiny(simd, self.listing, self.number, tile, counters);
        scratch.lower_thresholds_by_pairs(simd, tile, self.inputs, counters);
        scratch.add::<S, N>(simd, self, tile, counters);
        touched
    }

    /// Returns the sums of the block whose first pixel is `at`.
    #[inline(always)]
    pub(crate) fn sums_of<S: Simd, const N: usize>(
        &self,
        simd: S,
        at: (i32, i32),
        scratch: &mut TinyScratch<'a>,
    ) -> Sums<S> {
        let tile = Tile { origin: self.listing.grid.block_px(self.number, 0), rect: self.rect };
        scratch.sums_of::<S, N>(simd, tile.index(at), &self.inputs.frame.wanted.attributes, self.counts)
    }
}

/// First pixel of a tile, and the rectangle of the tile's pixels that are drawn.
#[derive(Clone, Copy)]
struct Tile {
    origin: (i32, i32),
    rect: Rect,
}

impl Tile {
    /// Returns the index of a pixel in the tile's buffers.
    #[inline(always)]
    fn index(&self, (x, y): (i32, i32)) -> usize {
        let (x, y) = (x - self.origin.0 + TILE_MARGIN_PX as i32, y - self.origin.1 + TILE_MARGIN_PX as i32);
        (y.max(0) as usize) * STRIDE + x.max(0) as usize
    }

    /// Returns the index of a tiny splat's first pixel in the tile's buffers.
    #[inline(always)]
    fn index_of(&self, record: &Record) -> usize {
        self.index(first_px(record))
    }
}

/// Number of consecutive pixels in a tile's buffers that contain all rows of a block.
const OF_BLOCK: usize = 3 * STRIDE + 4;
/// Number of consecutive pixels in a tile's buffers that contain all rows of a tiny splat, four pixels each.
const OF_TINY: usize = 2 * STRIDE + 4;

impl<'a> TinyScratch<'a> {
    /// Resets the buffers for a tile: sums of zero, and thresholds of +∞ in the pixels that are drawn.
    fn clear<const N: usize>(&mut self, tile: Tile, counts: bool) {
        self.pairs.clear();
        self.thresholds.clear();
        self.thresholds.resize(ALL, f32::NEG_INFINITY);
        let rect = tile.rect;
        for y in rect.y..rect.end_y {
            let row = tile.index((rect.x, y));
            let row = self.thresholds.get_mut(row..row + (rect.end_x - rect.x).max(0) as usize);
            row.unwrap_or_default().fill(f32::INFINITY);
        }
        self.sums.reserve(ALL * N);
        self.sums.0.fill(0.0);
        self.counts.clear();
        if counts {
            self.counts.resize(ALL, 0.0);
        }
    }

    /// Runs the first loop over the tile's tiny splats, which lowers depth thresholds. Lists the pairs of blocks and
    /// splats that aren't tiny. Returns bits of the blocks touched.
    #[inline(always)]
    fn lower_thresholds_by_tiny<S: Simd>(
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
            let entries = segment.lists.of(number);
            counters.block_pairs += entries.len() as u64;
            for entry in entries {
                touched |= entry.blocks;
                let record = &segment.records[entry.record as usize];
                if entry.kind() == Kind::Any {
                    counters.block_pairs += u64::from(entry.blocks.count_ones()) - 1;
                    for block in ones(entry.blocks) {
                        let first_px = listing.grid.block_px(number, block as u32);
                        self.pairs.push(Pair { record, first_px, pixel: tile.index(first_px) as u32 });
                    }
                    continue;
                }
                let first = tile.index_of(record);
                let own = self.thresholds.get_mut(first..).and_then(|pixels| pixels.first_chunk_mut::<OF_TINY>());
                let Some(thresholds) = own else { continue };
                if entry.kind() == Kind::Tiny2 {
                    lower_thresholds(simd, fragments_of(simd, record, FORMS, FORMS + 4), record.epsilon(), thresholds);
                    counters.skipped_pixels += 12;
                } else {
                    let epsilon = f32x4::splat(simd, record.epsilon());
                    for row in 0..3 {
                        let (depths, weights) = fragments_of(simd, record, FORMS + 3 * row, FORMS + 9 + 3 * row);
                        let values = (is_visible(weights) & three).select(depths + epsilon, infinity);
                        let thresholds = &mut thresholds[STRIDE * row..STRIDE * row + 4];
                        values.min(f32x4::from_slice(simd, thresholds)).store_slice(thresholds);
                    }
                    counters.skipped_pixels += 7;
                }
            }
        }
        touched
    }

    /// Runs the first loop over the listed pairs, which lowers depth thresholds and stores the pairs' fragments.
    #[inline(always)]
    fn lower_thresholds_by_pairs<S: Simd>(
        &mut self,
        simd: S,
        tile: Tile,
        inputs: &RasterInputs<'_>,
        counters: &mut Counters,
    ) {
        self.remembered.reserve(2 * LANES * self.pairs.len());
        let remembered = self.remembered.numbers();
        for (pairs, to) in self.pairs.chunks(4).zip(remembered.chunks_mut(8 * LANES)) {
            let mut values = [[0.0; LANES]; 4];
            let four = match pairs {
                [a, b, c, d] => Some((pairs, [a.record, b.record, c.record, d.record])),
                _ => None,
            };
            match four {
                Some(([a, b, c, d], records)) if Batch::of(&records) != Batch::Scalar => {
                    let at = [
                        Lanes::block_pixels(simd, a.first_px),
                        Lanes::block_pixels(simd, b.first_px),
                        Lanes::block_pixels(simd, c.first_px),
                        Lanes::block_pixels(simd, d.first_px),
                    ];
                    let fragments = cheap_batch::<S, true>(simd, records, at, inputs);
                    for i in 0..4 {
                        counters.inside += inside(tile, at[i], &fragments[i]);
                        store_pair(simd, records[i], &fragments[i], &mut to[2 * LANES * i..], &mut values[i]);
                    }
                }
                _ => {
                    for (i, (pair, values)) in pairs.iter().zip(&mut values).enumerate() {
                        let at = Lanes::block_pixels(simd, pair.first_px);
                        let fragment = fragment::fragment(simd, pair.record, at, pair.first_px, inputs);
                        counters.inside += inside(tile, at, &fragment);
                        store_pair(simd, pair.record, &fragment, &mut to[2 * LANES * i..], values);
                    }
                }
            }
            for (pair, values) in pairs.iter().zip(&values) {
                let own = self.thresholds.get_mut(pair.pixel as usize..);
                let own = own.and_then(|pixels| pixels.first_chunk_mut::<OF_BLOCK>());
                let Some(thresholds) = own else { continue };
                for row in 0..4 {
                    let thresholds = &mut thresholds[STRIDE * row..STRIDE * row + 4];
                    let values = f32x4::from_slice(simd, &values[4 * row..4 * row + 4]);
                    values.min(f32x4::from_slice(simd, thresholds)).store_slice(thresholds);
                }
            }
        }
    }

    /// Runs the second loop, which adds fragments up to the depth thresholds to the pixels' sums, in splat order.
    #[inline(always)]
    fn add<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        drawn_tile: &TinyTile<'a, '_>,
        tile: Tile,
        counters: &mut Counters,
    ) {
        let TinyTile { listing, inputs, number, counts, .. } = *drawn_tile;
        let attributes = &inputs.frame.wanted.attributes;
        let Self { thresholds, sums, counts: all_counts, pairs, remembered } = self;
        let sums = sums.numbers().as_chunks_mut::<N>().0;
        let three = first_three(simd);
        let mut pairs = pairs.iter().zip(remembered.numbers().as_chunks::<{ 2 * LANES }>().0);
        for segment in listing.segments {
            for entry in segment.lists.of(number) {
                let record = &segment.records[entry.record as usize];
                let numbers = Numbers::<S, N>::of(simd, record.attributes(), attributes);
                if entry.kind() == Kind::Any {
                    for (pair, remembered) in pairs.by_ref().take(entry.blocks.count_ones() as usize) {
                        let pixel = pair.pixel as usize;
                        let bits = add_pair(simd, remembered, &numbers, (thresholds, sums), pixel);
                        counters.contributing += u64::from(bits.count_ones());
                        if counts {
                            count(all_counts, pixel, (0..16).map(|i| (i % 4, i / 4, bits >> i & 1)));
                        }
                    }
                    continue;
                }
                let pixel = tile.index_of(record);
                let side = if entry.kind() == Kind::Tiny2 { 2 } else { 3 };
                let mut bits = 0;
                if side == 2 {
                    let fragments = fragments_of(simd, record, FORMS, FORMS + 4);
                    let (inside, contributing) = add_four(simd, fragments, &numbers, (thresholds, sums), pixel);
                    counters.inside += inside;
                    bits = contributing;
                } else {
                    let own = thresholds.get(pixel..).and_then(|pixels| pixels.first_chunk::<OF_TINY>());
                    let to = sums.get_mut(pixel..).and_then(|sums| sums.first_chunk_mut::<OF_TINY>());
                    let (Some(own), Some(to)) = (own, to) else { continue };
                    for row in 0..3 {
                        let (depths, weights) = fragments_of(simd, record, FORMS + 3 * row, FORMS + 9 + 3 * row);
                        let has = weights.simd_le(weights) & three;
                        let here = f32x4::from_slice(simd, &own[STRIDE * row..STRIDE * row + 4]);
                        let found = contributing::<S, N>(simd, depths, weights, has, here);
                        for i in 0..3 {
                            numbers.add(simd, found.weights[i], found.depths[i], &mut to[STRIDE * row + i]);
                        }
                        counters.inside += drawn(simd, has, here);
                        bits |= found.bits << (3 * row);
                    }
                }
                counters.contributing += u64::from(bits.count_ones());
                if counts {
                    count(all_counts, pixel, (0..side * side).map(|i| (i % side, i / side, bits >> i & 1)));
                }
            }
        }
    }

    /// Returns the sums of the block whose first pixel has index `pixel` in the buffers.
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
        // Transposes the numbers of each pixel to a plane for each number.
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

/// Loads the sixteen numbers of a block's pixels from a buffer; `numbers` begins at the block's first pixel.
#[inline(always)]
fn rows<S: Simd>(simd: S, numbers: &[f32]) -> Lanes<S> {
    let Some(numbers) = numbers.first_chunk::<OF_BLOCK>() else { return Lanes::splat(simd, f32::NEG_INFINITY) };
    let row = |i: usize| f32x4::from_slice(simd, &numbers[STRIDE * i..STRIDE * i + 4]);
    Lanes(row(0).combine(row(1)).combine(row(2).combine(row(3))))
}

/// Loads the numbers of a tiny splat's 2×2 pixels from a buffer; `numbers` begins at the splat's first pixel.
#[inline(always)]
fn four_of<S: Simd>(simd: S, numbers: &[f32; OF_TINY]) -> f32x4<S> {
    f32x4::load_array(simd, [numbers[0], numbers[1], numbers[STRIDE], numbers[STRIDE + 1]])
}

/// Lowers the depth thresholds of a tiny splat's 2×2 pixels; `thresholds` begins at the splat's first pixel.
#[inline(always)]
fn lower_thresholds<S: Simd>(
    simd: S,
    (depths, weights): (f32x4<S>, f32x4<S>),
    epsilon: f32,
    thresholds: &mut [f32; OF_TINY],
) {
    let infinity = f32x4::splat(simd, f32::INFINITY);
    let values = is_visible(weights).select(depths + f32x4::splat(simd, epsilon), infinity);
    let nearest = values.min(four_of(simd, thresholds)).to_array();
    for (i, nearest) in nearest.into_iter().enumerate() {
        thresholds[STRIDE * (i / 2) + i % 2] = nearest;
    }
}

/// Adds the fragments of a tiny splat of 2×2 pixels to the sums; `pixel` is the index of its first pixel. Returns the
/// number of its fragments inside the drawn region, and bits of the fragments that contribute.
#[inline(always)]
fn add_four<S: Simd, const N: usize>(
    simd: S,
    (depths, weights): (f32x4<S>, f32x4<S>),
    numbers: &Numbers<S, N>,
    (thresholds, sums): (&[f32], &mut [[f32; N]]),
    pixel: usize,
) -> (u64, u32) {
    let own = thresholds.get(pixel..).and_then(|pixels| pixels.first_chunk::<OF_TINY>());
    let to = sums.get_mut(pixel..).and_then(|sums| sums.first_chunk_mut::<OF_TINY>());
    let (Some(own), Some(to)) = (own, to) else { return (0, 0) };
    let has = weights.simd_le(weights);
    let here = four_of(simd, own);
    let Contributing { depths, weights, bits } = contributing::<S, N>(simd, depths, weights, has, here);
    for i in 0..4 {
        numbers.add(simd, weights[i], depths[i], &mut to[STRIDE * (i / 2) + i % 2]);
    }
    (drawn(simd, has, here), bits)
}

/// Returns the number of a splat's fragments inside its filtered footprint, in the block's pixels that are drawn.
#[inline(always)]
fn inside<S: Simd>(tile: Tile, at: (Lanes<S>, Lanes<S>), fragment: &Fragment<S>) -> u64 {
    u64::from((fragment.inside & tile.rect.contains_lanes(at)).to_bitmask().count_ones())
}

/// Stores the fragments of a splat in a block to `remembered`. Writes to `values` the depths z + ε to which they may
/// lower the thresholds; +∞ for none.
#[inline(always)]
fn store_pair<S: Simd>(
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

/// Adds the stored fragments of a splat in a block to the sums. Returns bits of the fragments that contribute.
#[inline(always)]
fn add_pair<S: Simd, const N: usize>(
    simd: S,
    remembered: &[f32; 2 * LANES],
    numbers: &Numbers<S, N>,
    (thresholds, sums): (&[f32], &mut [[f32; N]]),
    pixel: usize,
) -> u32 {
    let Some(sums) = sums.get_mut(pixel..).and_then(|sums| sums.first_chunk_mut::<OF_BLOCK>()) else { return 0 };
    let (depths, weights) = (Lanes::load(simd, remembered), Lanes::load(simd, &remembered[LANES..]));
    let mask = depths.le(rows(simd, thresholds.get(pixel..).unwrap_or_default()));
    let zero = Lanes::splat(simd, 0.0);
    let weights = Lanes::select(mask, weights, zero).to_array();
    let depths = if N == 8 { Lanes::select(mask, depths, zero).to_array() } else { [0.0; LANES] };
    for i in 0..LANES {
        numbers.add(simd, weights[i], depths[i], &mut sums[STRIDE * (i / 4) + i % 4]);
    }
    mask.to_bitmask() as u32
}

/// Adds 1 to the counts of pixels whose fragment contributes. Each item of `fragments` is a column and a row relative
/// to `pixel`, and 1 if the fragment contributes, else 0.
fn count(counts: &mut [f32], pixel: usize, fragments: impl Iterator<Item = (usize, usize, u32)>) {
    for (column, row, contributes) in fragments {
        if let Some(count) = counts.get_mut(pixel + STRIDE * row + column) {
            *count += contributes as f32;
        }
    }
}

/// Largest number of values in a tile's stored fragments. A tile with more is drawn block by block, where fragments are
/// computed twice instead.
const REMEMBERED: usize = 1 << 22;

/// Relative drawing times, by which the method for a tile is chosen. The first two are for drawing block by block: of a
/// tiny splat, and of a larger splat in one block. The last two are the same for drawing splat by splat.
const COSTS: [usize; 4] = [40, 30, 10, 45];

/// True if the tile is faster drawn splat by splat, because it has enough tiny splats. False if the stored fragments
/// would exceed [`REMEMBERED`].
pub(crate) fn is_faster_by_splats(segments: &[Segment], tile: usize) -> bool {
    let [tiny_by_blocks, by_blocks, tiny, pair] = COSTS;
    let [mut splats, mut pairs] = [0; 2];
    for entry in segments.iter().flat_map(|segment| segment.lists.of(tile)) {
        if entry.kind() != Kind::Any {
            splats += 1;
            continue;
        }
        pairs += entry.blocks.count_ones() as usize;
        if 2 * LANES * pairs > REMEMBERED {
            return false;
        }
    }
    splats > 0 && splats * tiny + pairs * pair < splats * tiny_by_blocks + pairs * by_blocks
}
