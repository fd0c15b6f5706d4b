//! Transparent splats over a block (rendering model §8): the sums of all layers from one traversal of the block's
//! splats.
//!
//! Depth peeling (G06 §6) draws a layer by two passes over all splats. Here a block's fragments are computed once and
//! stored. Each layer is then two loops over the fragments that belong to no earlier layer. The image is the same to
//! the bit. The A-buffer has the same layers, without a limit of their number: a fragment begins a new surface exactly
//! where peeling begins a new layer.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::raster::fragment::{cheap_batch, fragment};
use crate::raster::inputs::RasterInputs;
use crate::raster::nearest::Nearest;
use crate::raster::sums::{Sums, accumulate, add_weighted, number_of};
use crate::raster::surfaces::{Surface, SurfaceNumbers};
use crate::setup::evaluate::Fragment;
use crate::setup::record::{Batch, Record};
use crate::setup::segment::TransparentSplat;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::lists::{BATCH, Listable};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use surfel_math::Real;

/// An element of a block's list of transparent splats: a splat's record, and the data that the record doesn't contain.
#[derive(Clone, Copy)]
pub(crate) struct TransparentItem<'a> {
    pub record: &'a Record,
    pub splat: &'a TransparentSplat,
}

/// The fragments of one transparent splat in a block, stored for all layers.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
pub(super) struct Remembered {
    /// Depths of the fragments inside the filtered footprint; NaN elsewhere.
    pub inside_z: [f32; LANES],
    /// Depths of the fragments inside the unfiltered footprint, which set depth thresholds; NaN elsewhere.
    pub visible_z: [f32; LANES],
    pub weight: [f32; LANES],
    pub epsilon: f32,
    pub alpha: f32,
    /// Index of the splat in the block's list of transparent splats.
    pub splat: u32,
}

/// Per-thread scratch buffers for transparent layers, reused between blocks.
#[derive(Default)]
pub(crate) struct LayerScratch {
    /// Stored fragments; entries past `count` are left over from other blocks.
    fragments: Vec<Remembered>,
    /// Number of entries of `fragments` in use by the current block.
    count: usize,
    /// Indices in `fragments` of the splats some of whose fragments belong to no layer yet.
    left: Vec<u32>,
    surfaces: SurfaceNumbers,
}

impl LayerScratch {
    /// True if every stored fragment belongs to a layer already.
    pub(crate) fn is_empty(&self) -> bool {
        self.left.is_empty()
    }

    /// Numbers the surfaces of an A-buffer for [`TransparentBlock::surface`] if the block has many fragments, and
    /// returns true. Returns false for few fragments, because finding their layers one by one is faster.
    pub(crate) fn number_surfaces(&mut self) -> bool {
        let is_numbered = self.count >= NUMBERED_FROM;
        if is_numbered {
            self.surfaces.number(&self.fragments[..self.count]);
        }
        is_numbered
    }
}

/// Smallest number of splats with fragments in a block at which its surfaces are numbered together. With fewer splats,
/// finding them one by one is faster.
const NUMBERED_FROM: usize = 128;

/// Results of storing a block's transparent fragments.
pub(crate) struct Gathered<S: Simd> {
    /// Depth thresholds of the nearest transparent layer, per pixel.
    pub threshold: Lanes<S>,
    /// Depth tolerances ε of the splats that set these thresholds.
    pub threshold_epsilon: Lanes<S>,
    /// Number of transparent splats computed in the block, for statistics.
    pub tested: u32,
    /// Number of transparent fragments inside filtered footprints that nothing opaque occludes, for statistics.
    pub inside: u32,
}

/// One transparent layer of a block, before it is lit.
pub(crate) struct Layer<S: Simd> {
    pub sums: Sums<S>,
    /// Sum Σwα of the fragments' weights times their opacities α.
    pub alpha: Lanes<S>,
    /// Depth thresholds of the layer behind this one, per pixel. Only [`TransparentBlock::layer`] computes them.
    pub next: Lanes<S>,
}

/// The transparent splats of a block in front of its opaque surface.
pub(crate) struct TransparentBlock<'a, S: Simd> {
    pub simd: S,
    pub list: &'a [TransparentItem<'a>],
    /// Column and row of the block's first pixel.
    pub at: (i32, i32),
    pub inputs: &'a RasterInputs<'a>,
    pub opaque_depth: Lanes<S>,
}

impl<S: Simd> TransparentBlock<'_, S> {
    /// Stores in `scratch` those fragments of the block's splats that nothing opaque occludes.
    #[inline(always)]
    pub(crate) fn gather(&self, scratch: &mut LayerScratch) -> Gathered<S> {
        let simd = self.simd;
        let k = |v: f32| Lanes::splat(simd, v);
        let at = Lanes::block_pixels(simd, self.at);
        let LayerScratch { fragments: remembered, left, count: of_block, .. } = scratch;
        if remembered.len() < self.list.len() {
            remembered.resize_with(self.list.len(), Remembered::default);
        }
        let mut gathered = Gathered { threshold: k(f32::INFINITY), threshold_epsilon: k(0.0), tested: 0, inside: 0 };
        let mut count = 0;
        for (number, items) in self.list.chunks(BATCH).enumerate() {
            let mut z_min = f32::INFINITY;
            for item in items {
                z_min = z_min.min(item.record.z_min());
            }
            if self.opaque_depth.lt(k(z_min)).all_true() {
                continue;
            }
            gathered.tested += items.len() as u32;
            let records = items.first_chunk::<BATCH>().map(|items| items.map(|item| item.record));
            let batch = records.map(|records| (Batch::of(&records), records));
            match batch {
                Some((batch @ (Batch::Unfiltered | Batch::Filtered), records)) => {
                    let fragments = match batch {
                        Batch::Unfiltered => cheap_batch::<S, false>(simd, records, [at; BATCH], self.inputs),
                        _ => cheap_batch::<S, true>(simd, records, [at; BATCH], self.inputs),
                    };
                    for (j, f) in fragments.into_iter().enumerate() {
                        self.store_fragments(remembered, &mut count, BATCH * number + j, f, &mut gathered);
                    }
                }
                _ => {
                    for (j, item) in items.iter().enumerate() {
                        let f = fragment(simd, item.record, at, self.at, self.inputs);
                        self.store_fragments(remembered, &mut count, BATCH * number + j, f, &mut gathered);
                    }
                }
            }
        }
        *of_block = count;
        left.clear();
        left.extend(0..count as u32);
        gathered
    }

    /// Stores the fragments of splat `i` of the block's list in the next free entry, and counts the entry if it has any
    /// fragments.
    #[inline(always)]
    fn store_fragments(
        &self,
        remembered: &mut [Remembered],
        count: &mut usize,
        i: usize,
        f: Fragment<S>,
        gathered: &mut Gathered<S>,
    ) {
        let TransparentItem { record, splat } = self.list[i];
        let exists = f.z.le(self.opaque_depth);
        let (inside, visible) = (f.inside & exists, f.visible & exists);
        let epsilon = f.z.constant(record.epsilon().into());
        let value = f.z + epsilon;
        let nearer = visible & value.lt(gathered.threshold);
        gathered.threshold = Lanes::select(nearer, value, gathered.threshold);
        gathered.threshold_epsilon = Lanes::select(nearer, epsilon, gathered.threshold_epsilon);
        // The entry is written in any case and counted if it isn't empty: a branch would often be mispredicted.
        let to = &mut remembered[*count];
        let nan = f.z.constant(f64::NAN);
        Lanes::select(inside, f.z, nan).store(&mut to.inside_z);
        Lanes::select(visible, f.z, nan).store(&mut to.visible_z);
        f.weight.store(&mut to.weight);
        (to.epsilon, to.alpha, to.splat) = (record.epsilon(), splat.alpha, i as u32);
        *count += usize::from((inside | visible).to_bitmask() != 0);
        gathered.inside += inside.to_bitmask().count_ones();
    }

    /// Returns the layer of the stored fragments behind `beyond` and up to `threshold`, and removes them from the
    /// remaining fragments.
    #[inline(always)]
    pub(crate) fn layer(&self, beyond: Lanes<S>, threshold: Lanes<S>, scratch: &mut LayerScratch) -> Layer<S> {
        let simd = self.simd;
        let LayerScratch { fragments, left, .. } = scratch;
        let mut next = Lanes::splat(simd, f32::INFINITY);
        let mut sums = Sums::new(simd);
        let mut alpha = Lanes::splat(simd, 0.0);
        let mut count = 0;
        // A closure for `retain` would not be inlined into vector code.
        for k in 0..left.len() {
            let i = left[k];
            let f = &fragments[i as usize];
            let (z, visible_z) = (Lanes::load(simd, &f.inside_z), Lanes::load(simd, &f.visible_z));
            let mask = beyond.lt(z) & z.le(threshold);
            if mask.to_bitmask() != 0 {
                let weight = Lanes::load(simd, &f.weight);
                accumulate(simd, &mut sums, self.list[f.splat as usize].record, mask, z, weight, self.inputs);
                let weight = Lanes::select(mask, weight, weight.zero());
                alpha = weight.mul_add(Lanes::splat(simd, f.alpha), alpha);
            }
            let behind = threshold.lt(visible_z);
            let value = visible_z + Lanes::splat(simd, f.epsilon);
            next = Lanes::select(behind & value.lt(next), value, next);
            left[count] = i;
            count += usize::from((behind | threshold.lt(z)).to_bitmask() != 0);
        }
        left.truncate(count);
        sums.cover(self.inputs.frame);
        Layer { sums, alpha, next }
    }

    /// Returns the next surface of an A-buffer whose surfaces are numbered; `None` after the last one. The result is
    /// bit-identical to [`Self::layer`]'s, except that `next` is +∞.
    #[inline(always)]
    pub(crate) fn surface(&self, scratch: &mut LayerScratch) -> Option<Layer<S>> {
        let simd = self.simd;
        let LayerScratch { fragments, surfaces, .. } = scratch;
        let Surface { number, numbers, members } = surfaces.next()?;
        let number = Lanes::splat(simd, number as f32);
        let (mut sums, mut alpha) = (Sums::new(simd), Lanes::splat(simd, 0.0));
        for member in members {
            let f = &fragments[member.fragment as usize];
            let own = Lanes::load(simd, &numbers[member.fragment as usize].0);
            let mask = number.le(own) & own.le(number);
            let (z, weight) = (Lanes::load(simd, &f.inside_z), Lanes::load(simd, &f.weight));
            accumulate(simd, &mut sums, self.list[f.splat as usize].record, mask, z, weight, self.inputs);
            let weight = Lanes::select(mask, weight, weight.zero());
            alpha = weight.mul_add(Lanes::splat(simd, f.alpha), alpha);
        }
        sums.cover(self.inputs.frame);
        Some(Layer { sums, alpha, next: Lanes::splat(simd, f32::INFINITY) })
    }

    /// Returns the nearest stored fragment in each pixel.
    #[inline(never)]
    pub(crate) fn nearest(&self, scratch: &LayerScratch) -> Nearest<S> {
        let mut nearest = Nearest::new(self.simd);
        for f in &scratch.fragments[..scratch.count] {
            let z = Lanes::load(self.simd, &f.inside_z);
            let number = number_of(self.list[f.splat as usize].record, self.inputs.near);
            nearest.add(z, z.le(z), number as u32, &self.inputs.frame.numbers);
        }
        nearest
    }

    /// Returns the last layer, which blends all fragments behind `beyond`, in colours lit per splat. Fragments are
    /// weighted by alpha, so that more opaque splats contribute more.
    #[inline(always)]
    pub(crate) fn remaining(&self, beyond: Lanes<S>, scratch: &LayerScratch) -> Layer<S> {
        let simd = self.simd;
        let zero = Lanes::splat(simd, 0.0);
        let (mut sums, mut alpha) = (Sums::new(simd), zero);
        for &i in &scratch.left {
            let f = &scratch.fragments[i as usize];
            let z = Lanes::load(simd, &f.inside_z);
            let mask = beyond.lt(z);
            if mask.to_bitmask() == 0 {
                continue;
            }
            let TransparentItem { record, splat } = &self.list[f.splat as usize];
            let own = zero.constant(splat.alpha.into());
            let weight = Lanes::select(mask, Lanes::load(simd, &f.weight), zero) * own;
            sums.weight = sums.weight + weight;
            sums.fragments = sums.fragments + Lanes::select(mask, zero.one(), zero);
            sums.depth = weight.mul_add(Lanes::select(mask, z, zero), sums.depth);
            alpha = weight.mul_add(own, alpha);
            add_weighted(&mut sums.color, weight, splat.lit);
            add_weighted(&mut sums.normal, weight, [record.normal_x(), record.normal_y(), record.normal_z()]);
        }
        Layer { sums, alpha, next: zero }
    }
}
