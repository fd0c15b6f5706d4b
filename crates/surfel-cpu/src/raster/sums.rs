//! Weighted sums of the fragments in a block's pixels.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat projected to the screen
//! ([`Record`]). A *slot* is the index of a stored splat in the columns of its object
//! ([`StoredObject`](crate::scene::cloud::StoredObject)).

use crate::raster::inputs::{RasterFrame, RasterInputs, Wanted};
use crate::setup::near::NearSplat;
use crate::setup::record::{Class, Record};
use crate::simd::lanes::Lanes;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

/// Smallest sum of weights, Σw, of a pixel that isn't empty. In smaller sums, attributes are lost to underflow. Only
/// splats smaller than 1e-14 pixels weigh less (at the cutoff c = 2; 1e-7 pixels at the greatest cutoff).
const LEAST_WEIGHT: f32 = 1e-36;

/// Depth thresholds and weighted sums of a block's pixels, one lane per pixel. Quantities that the plan doesn't need
/// stay zero.
#[derive(Clone, Copy)]
pub(crate) struct Sums<S: Simd> {
    /// Depth thresholds; +∞ in pixels without visibility fragments. Fragments up to the threshold add their attributes.
    pub threshold: Lanes<S>,
    /// z + ε of the fragments that set the thresholds. It exceeds the threshold where the other side of a surface
    /// limits the threshold.
    pub writer_depth: Lanes<S>,
    /// Depth tolerances ε of the fragments that set the thresholds.
    pub threshold_epsilon: Lanes<S>,
    pub weight: Lanes<S>,
    pub fragments: Lanes<S>,
    pub color: [Lanes<S>; 3],
    pub normal: [Lanes<S>; 3],
    pub depth: Lanes<S>,
    pub material: [Lanes<S>; 4],
    pub coverage: Lanes<S>,
    /// Number of splats that were computed in the block, for statistics.
    pub tested: u32,
    /// Number of fragments inside filtered footprints of the splats counted in `tested`, for statistics.
    pub inside: u32,
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            threshold: Lanes::splat(simd, f32::INFINITY),
            writer_depth: Lanes::splat(simd, f32::INFINITY),
            threshold_epsilon: zero,
            weight: zero,
            fragments: zero,
            color: [zero; 3],
            normal: [zero; 3],
            depth: zero,
            material: [zero; 4],
            coverage: zero,
            tested: 0,
            inside: 0,
        }
    }

    /// Resets the weighted sums to zero. The thresholds and the counts `tested` and `inside` remain.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        let none = Self::new(self.threshold.0.simd);
        let Self { threshold, writer_depth, threshold_epsilon, tested, inside, .. } = *self;
        *self = Self { threshold, writer_depth, threshold_epsilon, tested, inside, ..none };
    }

    /// Returns a mask of the pixels that aren't empty: Σw is at least [`LEAST_WEIGHT`].
    #[inline(always)]
    pub(crate) fn has_weight(&self) -> mask32x16<S> {
        self.weight.constant(f64::from(LEAST_WEIGHT)).le(self.weight)
    }

    /// Computes coverage from Σw, if it is the same multiple of the weight for all splats. Call this after all
    /// fragments are added.
    #[inline(always)]
    pub(crate) fn cover(&mut self, frame: &RasterFrame) {
        if let Some(scale) = frame.coverage_of_weight {
            self.coverage = self.weight * Lanes::splat(self.weight.0.simd, scale);
        }
    }
}

/// Adds `numbers`, the attributes of a splat, times the weights of its fragments to `sums`.
#[inline(always)]
pub(crate) fn add_weighted<S: Simd, const N: usize>(sums: &mut [Lanes<S>; N], weight: Lanes<S>, numbers: [f32; N]) {
    for (sum, number) in sums.iter_mut().zip(numbers) {
        *sum = weight.mul_add(Lanes::splat(weight.0.simd, number), *sum);
    }
}

/// Adds the attributes of a splat's fragments, times their weights, in the lanes of `mask`.
#[inline(always)]
pub(crate) fn accumulate<S: Simd>(
    simd: S,
    sums: &mut Sums<S>,
    record: &Record,
    mask: mask32x16<S>,
    z: Lanes<S>,
    weight: Lanes<S>,
    inputs: &RasterInputs<'_>,
) {
    let RasterFrame { wanted: Wanted { attributes, .. }, factors, coverage, coverage_of_weight, .. } = inputs.frame;
    let k = |v: f32| Lanes::splat(simd, v);
    let zero = k(0.0);
    let weight = Lanes::select(mask, weight, zero);
    sums.weight = sums.weight + weight;
    sums.fragments = sums.fragments + Lanes::select(mask, k(1.0), zero);
    if attributes.color {
        add_weighted(&mut sums.color, weight, [record.red(), record.green(), record.blue()]);
    }
    if attributes.normal {
        add_weighted(&mut sums.normal, weight, [record.normal_x(), record.normal_y(), record.normal_z()]);
    }
    if attributes.depth {
        sums.depth = weight.mul_add(Lanes::select(mask, z, zero), sums.depth);
    }
    if attributes.material | (attributes.coverage & coverage_of_weight.is_none()) {
        let object = inputs.frame.numbers.object_of(number_of(record, inputs.near));
        if attributes.material {
            add_weighted(&mut sums.material, weight, factors[object]);
        }
        if attributes.coverage && coverage_of_weight.is_none() {
            sums.coverage = weight.mul_add(k(record.coverage_scale() * coverage[object]), sums.coverage);
        }
    }
}

/// Returns the number that a record stores: of its slot if slots are numbered, else the index of its object.
#[inline(always)]
pub(crate) fn number_of(record: &Record, near: &[NearSplat]) -> usize {
    match record.class() {
        Class::Near => near[record.object()].object as usize,
        _ => record.object(),
    }
}
