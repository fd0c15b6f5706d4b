//! Visibility and attributes of a block of 4×4 pixels (rendering model §5), one lane per pixel. Two loops run over the
//! same list of splats, with the block's sums in registers.
//!
//! A *record* is a splat projected to the screen ([`Record`]).

use crate::raster::batch::{Pixels, Visit, for_each_batch};
use crate::raster::facing::Sides;
use crate::raster::filter::FragmentFilter;
use crate::raster::inputs::{RasterInputs, Wanted};
use crate::raster::sums::{Sums, accumulate};
use crate::setup::evaluate::Fragment;
use crate::setup::record::Record;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::largest;
use crate::tiles::lists::{BATCH, BlockList};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use surfel_math::Real;

/// Largest number of splats in a block whose fragments are stored between the two loops. In a block with more,
/// fragments are computed twice.
const REMEMBERED: usize = 256;

/// Fragments of a block that the first loop stores for the second. The alignment is that of cache lines: an access that
/// crosses two lines costs twice.
#[repr(align(64))]
pub(crate) struct BlockScratch {
    /// Depths (+∞ outside the filtered footprint) and weights of the stored fragments. The indices are the batch, the
    /// splat in the batch, 0 for depths or 1 for weights, and the pixel.
    fragments: [[[[f32; LANES]; 2]; BATCH]; REMEMBERED / BATCH],
    /// Number of each stored batch in the block's list of splats.
    batches: [u32; REMEMBERED / BATCH],
}

impl Default for BlockScratch {
    fn default() -> Self {
        Self { fragments: [[[[0.0; LANES]; 2]; BATCH]; REMEMBERED / BATCH], batches: [0; REMEMBERED / BATCH] }
    }
}

/// State of the first loop over a block's splats, which finds the depth thresholds min(z + ε).
struct FirstLoop<'a, 'b, S: Simd, L, const EPSILON: bool, const COUNT: bool, const STORES: bool> {
    threshold: Lanes<S>,
    threshold_epsilon: Lanes<S>,
    /// Thresholds of the front- and the back-facing side, used in place of `threshold` if sides are kept apart.
    sides: Sides<S>,
    largest_epsilon: f32,
    inside: u32,
    filter: &'a L,
    /// Number of batches whose fragments are stored in `scratch`.
    count: usize,
    scratch: &'b mut BlockScratch,
}

impl<S: Simd, L: FragmentFilter<S>, const EPSILON: bool, const COUNT: bool, const STORES: bool> Visit<S>
    for FirstLoop<'_, '_, S, L, EPSILON, COUNT, STORES>
{
    #[inline(always)]
    fn begin(&mut self, number: usize) {
        if STORES && let Some(batch) = self.scratch.batches.get_mut(self.count) {
            *batch = number as u32;
            self.count += 1;
        }
    }

    #[inline(always)]
    fn add(&mut self, simd: S, mut fragment: Fragment<S>, j: usize, record: &Record) {
        let k = |v: f32| Lanes::splat(simd, v);
        if let Some(exists) = self.filter.exists(fragment.z) {
            fragment.visible &= exists;
            fragment.inside &= exists;
        }
        if COUNT {
            // A saturating sum, so that the compiler doesn't vectorise it: the vector units are busy enough.
            self.inside = self.inside.saturating_add(fragment.inside.to_bitmask().count_ones());
        }
        let infinity = k(f32::INFINITY);
        let visible = Lanes::select(fragment.visible, fragment.z, infinity);
        if L::KEEPS_FACINGS {
            self.sides.add::<EPSILON>(simd, record, visible);
        } else {
            let value = visible + k(record.epsilon());
            if EPSILON {
                self.threshold_epsilon =
                    Lanes::select(value.lt(self.threshold), k(record.epsilon()), self.threshold_epsilon);
            }
            self.threshold = self.threshold.min(value);
        }
        if STORES {
            // The index is always in range; a branch here would evict masks from their registers.
            let batch = &mut self.scratch.fragments[self.count.wrapping_sub(1) % (REMEMBERED / BATCH)];
            let [z, weight] = &mut batch[j % BATCH];
            Lanes::select(fragment.inside, fragment.z, infinity).store(z);
            fragment.weight.store(weight);
        }
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        let threshold = match L::KEEPS_FACINGS {
            true => self.sides.farthest_within(self.largest_epsilon),
            false => self.threshold,
        };
        Some(largest(self.filter.relevant(threshold)))
    }
}

/// Draws a block's splats into `sums` by two loops: depth thresholds, then weighted sums. `first_px` is the block's
/// first pixel. Fragments that `filter` rejects are ignored. Sums that the plan doesn't need aren't touched.
#[inline(always)]
pub(crate) fn draw<S: Simd, L: FragmentFilter<S>>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    first_px: (i32, i32),
    inputs: &RasterInputs<'_>,
    filter: L,
    scratch: &mut BlockScratch,
    sums: &mut Sums<S>,
) {
    let Wanted { epsilon, counts, .. } = inputs.frame.wanted;
    let few = BATCH * list.batches().len() <= REMEMBERED;
    // Separate copies of the loops exist where they measurably pay; rare cases share one.
    match (epsilon || L::IS_RARE, counts, few) {
        (false, false, true) => {
            both_loops::<S, L, false, false, true>(simd, list, first_px, inputs, filter, scratch, sums);
        }
        (true, false, true) => {
            both_loops::<S, L, true, false, true>(simd, list, first_px, inputs, filter, scratch, sums);
        }
        (_, true, true) => both_loops::<S, L, true, true, true>(simd, list, first_px, inputs, filter, scratch, sums),
        (_, _, false) => both_loops::<S, L, true, true, false>(simd, list, first_px, inputs, filter, scratch, sums),
    }
}

/// Runs both loops over a block. The constants select whether the threshold's ε is found, fragments are counted, and
/// fragments are stored between the loops.
///
/// Not inlined: all callers of [`draw`] share the code.
#[inline(never)]
fn both_loops<S: Simd, L: FragmentFilter<S>, const EPSILON: bool, const COUNT: bool, const STORES: bool>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    first_px: (i32, i32),
    inputs: &RasterInputs<'_>,
    filter: L,
    scratch: &mut BlockScratch,
    sums: &mut Sums<S>,
) {
    simd.vectorize(
        #[inline(always)]
        || loops::<S, L, EPSILON, COUNT, STORES>(simd, list, first_px, inputs, filter, scratch, sums),
    );
}

#[inline(always)]
fn loops<S: Simd, L: FragmentFilter<S>, const EPSILON: bool, const COUNT: bool, const STORES: bool>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    first_px: (i32, i32),
    inputs: &RasterInputs<'_>,
    mut filter: L,
    scratch: &mut BlockScratch,
    sums: &mut Sums<S>,
) {
    let pixels = Pixels::new(simd, first_px);
    let (threshold, threshold_epsilon) = (Lanes::splat(simd, f32::INFINITY), Lanes::splat(simd, 0.0));
    let mut first = FirstLoop::<_, _, EPSILON, COUNT, STORES> {
        threshold,
        threshold_epsilon,
        sides: Sides::new(simd),
        largest_epsilon: inputs.largest_epsilon,
        inside: 0,
        filter: &filter,
        count: 0,
        scratch,
    };
    // The loop starts without a bound, and lowers it to the farthest depth threshold so far. A splat behind all
    // thresholds matters in neither loop.
    sums.tested = for_each_batch(simd, list, f32::INFINITY, &pixels, inputs, &mut first);
    let FirstLoop { mut threshold, mut threshold_epsilon, sides, inside, count, scratch, .. } = first;
    let mut writer_depth = threshold;
    if L::KEEPS_FACINGS {
        let shown = sides.shown();
        (threshold, writer_depth, threshold_epsilon) = (shown.threshold, shown.writer_depth, shown.epsilon);
        filter.show(&shown);
    }
    (sums.threshold, sums.inside) = (threshold, inside);
    if EPSILON {
        (sums.writer_depth, sums.threshold_epsilon) = (writer_depth, threshold_epsilon);
    }
    filter.settle(sums.threshold);
    if L::TRACKS {
        filter.track(simd, list, &pixels, inputs, sums.threshold);
    }
    if STORES {
        let remembered = Remembered { list, scratch, count };
        let a = &inputs.frame.wanted.attributes;
        // Each copy of the loop has its sums fixed at compile time, so that they stay in registers.
        let generic = COUNT | a.material | (a.coverage & inputs.frame.coverage_of_weight.is_none());
        match (a.color, a.normal, a.depth) {
            (false, true, false) if !generic => remembered.add::<S, false, true, false>(simd, sums, &filter),
            (true, false, false) if !generic => remembered.add::<S, true, false, false>(simd, sums, &filter),
            (true, true, false) if !generic => remembered.add::<S, true, true, false>(simd, sums, &filter),
            (true, true, true) if !generic => remembered.add::<S, true, true, true>(simd, sums, &filter),
            _ => remembered.add_all(simd, sums, &filter, inputs),
        }
    } else {
        second_loop(simd, list, &pixels, sums, filter, inputs);
    }
    sums.cover(inputs.frame);
}

/// Returns the depth, per pixel, up to which fragments add their attributes. Without a threshold the depth is the
/// largest finite number, since a depth of +∞ marks a missing fragment.
#[inline(always)]
fn reach<S: Simd>(threshold: Lanes<S>) -> Lanes<S> {
    threshold.min(threshold.constant(f64::from(f32::MAX)))
}

/// Fragments of a block that the first loop has stored, with the block's list of splats.
struct Remembered<'a, 'b, 'c> {
    list: BlockList<'a, 'b, Record>,
    scratch: &'c BlockScratch,
    count: usize,
}

impl<'a> Remembered<'a, '_, '_> {
    /// Returns the stored batches: the records of four splats, and the depths and weights of their fragments.
    #[inline(always)]
    fn batches(&self) -> impl Iterator<Item = ([&'a Record; BATCH], &[[[f32; LANES]; 2]; BATCH])> {
        let batches = self.scratch.batches[..self.count].iter().zip(&self.scratch.fragments);
        batches.map(|(&number, fragments)| {
            let [i, j, k, l] = self.list.batches()[number as usize];
            let record = |i| self.list.get(i).0;
            ([record(i), record(j), record(k), record(l)], fragments)
        })
    }

    /// Runs the second loop over stored fragments, for frames that need only weights and some of colours, normals and
    /// depths.
    #[inline(always)]
    fn add<S: Simd, const COLOR: bool, const NORMAL: bool, const DEPTH: bool>(
        &self,
        simd: S,
        sums: &mut Sums<S>,
        filter: &impl FragmentFilter<S>,
    ) {
        let k = |v: f32| Lanes::splat(simd, v);
        let zero = k(0.0);
        let [mut total, mut depth, mut r, mut g, mut b, mut x, mut y, mut z_sum] = [zero; 8];
        let threshold = reach(sums.threshold);
        for (records, fragments) in self.batches() {
            for (record, [z, weight]) in records.into_iter().zip(fragments) {
                let z = Lanes::load(simd, z);
                let mask = filter.adds(z, record, z.le(threshold));
                let weight = Lanes::select(mask, Lanes::load(simd, weight), zero);
                total = total + weight;
                if COLOR {
                    r = weight.mul_add(k(record.red()), r);
                    g = weight.mul_add(k(record.green()), g);
                    b = weight.mul_add(k(record.blue()), b);
                }
                if NORMAL {
                    x = weight.mul_add(k(record.normal_x()), x);
                    y = weight.mul_add(k(record.normal_y()), y);
                    z_sum = weight.mul_add(k(record.normal_z()), z_sum);
                }
                if DEPTH {
                    depth = Lanes::select(mask, weight.mul_add(z, depth), depth);
                }
            }
        }
        sums.weight = total;
        if COLOR {
            sums.color = [r, g, b];
        }
        if NORMAL {
            sums.normal = [x, y, z_sum];
        }
        if DEPTH {
            sums.depth = depth;
        }
    }

    /// Runs the second loop over stored fragments, for frames that need any attributes.
    #[inline(always)]
    fn add_all<S: Simd>(
        &self,
        simd: S,
        sums: &mut Sums<S>,
        filter: &impl FragmentFilter<S>,
        inputs: &RasterInputs<'_>,
    ) {
        let threshold = reach(sums.threshold);
        sums.clear();
        for (records, fragments) in self.batches() {
            for (record, [z, weight]) in records.into_iter().zip(fragments) {
                let z = Lanes::load(simd, z);
                let mask = filter.adds(z, record, z.le(threshold));
                accumulate(simd, sums, record, mask, z, Lanes::load(simd, weight), inputs);
            }
        }
    }
}

/// Runs the second loop (weighted sums) without stored fragments: evaluates the splats again, except those behind the
/// depth thresholds of all pixels of the block.
///
/// Not inlined: the loop is long, and most blocks don't need it.
#[cold]
#[inline(never)]
fn second_loop<S: Simd>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    pixels: &Pixels<S>,
    sums: &mut Sums<S>,
    filter: impl FragmentFilter<S>,
    inputs: &RasterInputs<'_>,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let farthest = largest(filter.relevant(sums.threshold));
            sums.clear();
            for_each_batch(simd, list, farthest, pixels, inputs, &mut SecondLoop { sums, filter, inputs });
        },
    );
}

/// State of the second loop (weighted sums) over a block's splats if their fragments aren't stored.
struct SecondLoop<'a, 'b, S: Simd, L> {
    sums: &'a mut Sums<S>,
    filter: L,
    inputs: &'a RasterInputs<'b>,
}

impl<S: Simd, L: FragmentFilter<S>> Visit<S> for SecondLoop<'_, '_, S, L> {
    #[inline(always)]
    fn add(&mut self, simd: S, mut fragment: Fragment<S>, _: usize, record: &Record) {
        if let Some(exists) = self.filter.exists(fragment.z) {
            fragment.inside &= exists;
        }
        let near = fragment.inside & fragment.z.le(self.sums.threshold);
        let mask = self.filter.adds(fragment.z, record, near);
        accumulate(simd, self.sums, record, mask, fragment.z, fragment.weight, self.inputs);
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        None
    }
}
