//! Fragments of balls in a block's pixels, in the order of depth (rendering model §11).
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::setup::balls::{BallRecord, BallSegment};
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::largest;
use crate::tiles::lists::ItemLists;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, mask32x16};
use surfel_math::ball::{BallHit, Outline, Rounded, SOLID};
use surfel_math::projection::Projection;
use surfel_math::{Real, V2, V3};

/// Fills the block lists of a tile with the balls that touch each block in `wanted` (one bit per block). Returns bits
/// of the blocks whose lists aren't empty.
pub(crate) fn list_balls<'a>(
    segment: &'a BallSegment,
    tile: usize,
    wanted: u64,
    lists: &mut ItemLists<&'a BallRecord>,
) -> u64 {
    lists.clear();
    for entry in segment.lists.of(tile) {
        lists.push(&segment.records[entry.record as usize], entry.blocks & wanted);
    }
    lists.finish()
}

/// Number of balls between updates of a block's farthest visible depth, behind which balls are skipped. A ball that
/// covers the whole block updates it at once.
const OCCLUDED_EVERY: u32 = 8;

/// A block of 4×4 pixels, and the balls that touch it.
#[derive(Clone, Copy)]
pub(crate) struct BallList<'a> {
    pub balls: &'a [&'a BallRecord],
    /// Column and row of the block's first pixel.
    pub at: (i32, i32),
    pub projection: &'a Projection,
}

/// The fragments of one ball in a block, one lane per pixel.
#[derive(Clone, Copy)]
pub(crate) struct BlockFragments {
    /// Index of the ball in the block's [`BallList`].
    pub ball: u32,
    /// Bits of the pixels that have a fragment. `z` and `coverage` are meaningless in other pixels.
    there: u32,
    pub z: [f32; LANES],
    pub coverage: [f32; LANES],
}

/// The fragments of all balls in a block, sorted by depth in each pixel. The memory is reused between blocks.
#[derive(Default)]
pub(crate) struct BallFragments {
    pub fragments: Vec<BlockFragments>,
    /// Sort keys of each pixel's fragments, from near to far: the bits of the depth in the high half, the index in
    /// `fragments` in the low half.
    pixels: [Vec<u64>; LANES],
    /// Number of each pixel's fragments, the nearest ones, that [`Self::next`] has returned or [`Self::skip`] has
    /// skipped.
    taken: [usize; LANES],
    /// Number of balls that were evaluated in the block, for statistics.
    pub tested: u32,
    /// Number of fragments of the evaluated balls in the block, for statistics. Fragments behind an opaque surface that
    /// was known when their ball was evaluated don't count.
    pub inside: u32,
}

/// Returns the index in [`BallFragments::fragments`] that a sort key contains.
#[inline(always)]
fn index_of(key: u64) -> usize {
    key as u32 as usize
}

impl BallFragments {
    /// Evaluates the balls of a list in their block's pixels, and sorts the fragments. Skips fragments behind `limit`,
    /// and fragments behind an opaque ball that covers the whole pixel.
    #[inline(always)]
    pub(crate) fn gather<S: Simd>(&mut self, simd: S, list: BallList<'_>, limit: Lanes<S>) {
        let BallList { balls, at, projection } = list;
        self.fragments.clear();
        (self.tested, self.inside) = (0, 0);
        let mut end = limit;
        let (mut farthest, mut is_nearer) = (largest(end), false);
        for (index, ball) in (0..).zip(balls) {
            if is_nearer && index % OCCLUDED_EVERY == 0 {
                (farthest, is_nearer) = (largest(end), false);
            }
            if ball.z_min > farthest {
                continue;
            }
            self.tested += 1;
            let from = offset(simd, ball, at, ball.middle);
            let (coverage, is_whole) = coverage(simd, ball, from);
            let z = if ball.flat { Lanes::splat(simd, ball.z) } else { hit(simd, ball, at, projection).0 };
            let there = coverage.zero().lt(coverage) & z.lt(end);
            let bits = there.to_bitmask() as u32;
            if bits == 0 {
                continue;
            }
            self.inside += bits.count_ones();
            if ball.alpha >= 1.0 {
                let full = there & coverage.one().le(coverage);
                if full.to_bitmask() != 0 {
                    // A fragment as near as the end still counts.
                    end = Lanes::select(full, end.min(after(z)), end);
                    is_nearer = true;
                    if is_whole {
                        farthest = largest(end);
                    }
                }
            }
            let (z, coverage) = (z.to_array(), coverage.to_array());
            self.fragments.push(BlockFragments { ball: index, there: bits, z, coverage });
        }
        self.sort(end.to_array());
    }

    fn sort(&mut self, ends: [f32; LANES]) {
        self.taken = [0; LANES];
        self.pixels.iter_mut().for_each(Vec::clear);
        for (index, of) in (0u64..).zip(&self.fragments) {
            for lane in ones(of.there.into()) {
                if of.z[lane] < ends[lane] {
                    // Depths are positive, so their bits have their order.
                    self.pixels[lane].push(u64::from(of.z[lane].to_bits()) << 32 | index);
                }
            }
        }
        self.pixels.iter_mut().filter(|pixel| pixel.len() > 1).for_each(|pixel| pixel.sort_unstable());
    }

    /// Takes each pixel's nearest remaining fragment if it is nearer than `until`. Returns the fragments' indices in
    /// `fragments`, and bits of the pixels that have one.
    #[inline(always)]
    pub(crate) fn next(&mut self, until: &[f32; LANES]) -> ([usize; LANES], u64) {
        let (mut found, mut bits) = ([0; LANES], 0);
        for lane in 0..LANES {
            if let Some(&key) = self.pixels[lane].get(self.taken[lane])
                && f32::from_bits((key >> 32) as u32) < until[lane]
            {
                (found[lane], self.taken[lane]) = (index_of(key), self.taken[lane] + 1);
                bits |= 1 << lane;
            }
        }
        (found, bits)
    }

    /// Skips the fragments of each pixel that are nearer than `from`, so that [`Self::next`] doesn't return them.
    pub(crate) fn skip(&mut self, from: &[f32; LANES]) {
        for (lane, pixel) in self.pixels.iter().enumerate() {
            self.taken[lane] = pixel.partition_point(|key| f32::from_bits((key >> 32) as u32) < from[lane]);
        }
    }

    /// Returns the depth, per pixel, of the nearest opaque ball that covers the whole pixel; +∞ if there is none.
    #[inline(always)]
    pub(crate) fn full_depth<S: Simd>(&self, simd: S, balls: &[&BallRecord]) -> Lanes<S> {
        let full = |lane: usize| {
            let last = self.pixels[lane].last().map(|&key| &self.fragments[index_of(key)]);
            let is_full = |of: &&BlockFragments| of.coverage[lane] >= 1.0 && balls[of.ball as usize].alpha >= 1.0;
            last.filter(is_full).map_or(f32::INFINITY, |of| of.z[lane])
        };
        Lanes::load(simd, &std::array::from_fn::<f32, LANES, _>(full))
    }

    /// Returns the index of each pixel's nearest solid fragment in front of `until`, and bits of the pixels that have
    /// one. A fragment is solid if it covers half of the pixel or the pixel contains the ball's centre. The planes of
    /// depth, normal and nearest splat show it.
    pub(crate) fn shown(
        &self,
        balls: &[&BallRecord],
        (x, y): (i32, i32),
        until: &[f32; LANES],
    ) -> ([usize; LANES], u64) {
        let (mut found, mut bits) = ([0; LANES], 0);
        for (lane, pixel) in self.pixels.iter().enumerate() {
            let at = (x + (lane % 4) as i32, y + (lane / 4) as i32);
            let is_solid = |&key: &u64| {
                let of = &self.fragments[index_of(key)];
                let is_near = of.z[lane] < until[lane];
                is_near && (f64::from(of.coverage[lane]) >= SOLID || has_center(balls[of.ball as usize], at))
            };
            if let Some(&key) = pixel.iter().find(|key| is_solid(key)) {
                found[lane] = index_of(key);
                bits |= 1 << lane;
            }
        }
        (found, bits)
    }
}

/// True if a pixel contains the projection of a ball's centre.
fn has_center(ball: &BallRecord, (x, y): (i32, i32)) -> bool {
    let inside = |base: f32, anchor: f32, pixel: i32| (0.0..1.0).contains(&((base - pixel as f32) + anchor));
    inside(ball.base[0], ball.anchor[0], x) && inside(ball.base[1], ball.anchor[1], y)
}

/// Returns the next greater f32 of each positive depth.
#[inline(always)]
fn after<S: Simd>(z: Lanes<S>) -> Lanes<S> {
    let bits: fearless_simd::i32x16<S> = z.0.bitcast();
    Lanes((bits + 1).bitcast())
}

/// Returns the offsets, in pixels, of the upper left corners of a block's pixels from a point that is given relative to
/// the ball's base pixel.
#[inline(always)]
fn offset<S: Simd>(simd: S, ball: &BallRecord, at: (i32, i32), point: [f32; 2]) -> V2<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    let (x, y) = Lanes::block_pixels(simd, at);
    V2::new((x - k(ball.base[0])) - k(point[0]), (y - k(ball.base[1])) - k(point[1]))
}

/// Returns a ball's outline with the same numbers in all lanes, relative to the outline's centre.
#[inline(always)]
fn outline<S: Simd>(simd: S, ball: &BallRecord) -> Outline<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    Outline {
        center: V2::new(k(0.0), k(0.0)),
        extent: V2::new(k(ball.extent[0]), k(ball.extent[1])),
        skew: k(ball.skew),
        width: k(ball.width),
    }
}

/// Returns the coverage of a block's pixels by a ball, and true if all are covered wholly. `from` is the offset of the
/// pixels' corners from the centre of the ball's outline.
#[inline(always)]
fn coverage<S: Simd>(simd: S, ball: &BallRecord, from: V2<Lanes<S>>) -> (Lanes<S>, bool) {
    let outline = outline(simd, ball);
    // Only a ball wider than a block's diagonal can cover a block.
    if ball.extent[0].min(ball.extent[1]) > 2.8 {
        let (zero, four) = (from.x.zero(), from.x.constant(4.0));
        let corners = mask32x16::from_bitmask(simd, 0b1001);
        let left = Lanes::splat(simd, from.x.to_array()[0]);
        let top = Lanes::splat(simd, from.y.to_array()[0]);
        let (right, bottom) = (left + four, top + four);
        let column = Lanes::block_columns(simd);
        let x = Lanes::select(column.le(zero), left, right);
        let (y_top, y_bottom) = (outline.contains(V2::new(x, top)), outline.contains(V2::new(x, bottom)));
        if (y_top & y_bottom & corners).to_bitmask() == 0b1001 {
            return (zero.one(), true);
        }
    }
    if ball.is_large {
        return (outline.coverage_of_large(from), false);
    }
    let area = outline.coverage::<Rounded>(from);
    (Lanes::select(outline.rounding().lt(area), area, area.zero()), false)
}

/// Returns a ball's planar depths and view-space normals at the centres of a block's pixels.
#[inline(always)]
fn hit<S: Simd>(simd: S, ball: &BallRecord, at: (i32, i32), projection: &Projection) -> (Lanes<S>, V3<Lanes<S>>) {
    let k = |v: f32| Lanes::splat(simd, v);
    let from = offset(simd, ball, at, ball.anchor);
    hit_of([from.x, from.y, k(ball.slope[0]), k(ball.slope[1]), k(ball.size), k(ball.z)], projection)
}

/// Returns the planar depths and view-space normals of balls at pixels' centres. The arguments are the offset of the
/// pixel's corner from the ball's projected centre, the centre's slopes x/z and y/z, the ball's [`BallRecord::size`],
/// and the centre's depth.
#[inline(always)]
pub(crate) fn hit_of<S: Simd>(
    [x, y, slope_x, slope_y, size, z]: [Lanes<S>; 6],
    projection: &Projection,
) -> (Lanes<S>, V3<Lanes<S>>) {
    let half = x.constant(0.5);
    let (fx, fy) = (x.constant(1.0 / projection.focal_px[0]), x.constant(1.0 / projection.focal_px[1]));
    let hit = BallHit::new(V2::new(slope_x, slope_y), size, V2::new((x + half) * fx, (y + half) * fy), projection);
    (if projection.is_perspective() { z * hit.depth } else { z + hit.depth }, hit.normal)
}

/// Returns a mask of the texels, in a 4×4 block of a shadow map, whose centres a ball covers. `at` is the block's first
/// texel.
#[inline(always)]
pub(crate) fn hides<S: Simd>(simd: S, ball: &BallRecord, at: (i32, i32)) -> mask32x16<S> {
    let from = offset(simd, ball, at, ball.middle);
    let half = from.x.constant(0.5);
    outline(simd, ball).contains(V2::new(from.x + half, from.y + half))
}
