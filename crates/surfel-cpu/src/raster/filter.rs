//! Fragment filters: which fragments of a block exist, and which add their attributes.

use crate::raster::batch::Pixels;
use crate::raster::facing::Shown;
use crate::raster::inputs::RasterInputs;
use crate::setup::record::Record;
use crate::simd::lanes::Lanes;
use crate::tiles::lists::BlockList;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

/// What keeps fragments of a block from being drawn.
pub(crate) trait FragmentFilter<S: Simd> {
    /// Few blocks are drawn by it: no copy of the block loops is made for what it doesn't need.
    const IS_RARE: bool = true;

    /// Front- and back-facing splats of oriented clouds are kept apart.
    const KEEPS_FACINGS: bool = false;

    /// [`Self::track`] does something.
    const TRACKS: bool = false;

    /// Visits a block's splats again, between its two loops: its depth thresholds are known.
    #[inline(always)]
    fn track(
        &mut self,
        _simd: S,
        _list: BlockList<'_, '_, Record>,
        _pixels: &Pixels<S>,
        _inputs: &RasterInputs<'_>,
        _threshold: Lanes<S>,
    ) {
    }

    /// Which fragments at these depths exist; `None`: all.
    #[inline(always)]
    fn exists(&self, _z: Lanes<S>) -> Option<mask32x16<S>> {
        None
    }

    /// A block's depth thresholds, −∞ where they don't matter since no fragment exists.
    #[inline(always)]
    fn relevant(&self, threshold: Lanes<S>) -> Lanes<S> {
        threshold
    }

    /// Takes the block's depth thresholds, before attributes are added.
    #[inline(always)]
    fn settle(&mut self, _threshold: Lanes<S>) {}

    /// Takes which side of oriented surfaces the block's pixels show.
    #[inline(always)]
    fn show(&mut self, _shown: &Shown<S>) {}

    /// Which of the fragments of `mask` add their attributes.
    #[inline(always)]
    fn adds(&self, _z: Lanes<S>, _record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        mask
    }
}

/// Everything is drawn.
pub(crate) struct EveryFragment;

impl<S: Simd> FragmentFilter<S> for EveryFragment {
    const IS_RARE: bool = false;
}

/// Only fragments behind a depth exist, and only in some pixels.
pub(crate) struct BehindDepth<S: Simd> {
    pub depth: Lanes<S>,
    pub pixels: mask32x16<S>,
}

impl<S: Simd> FragmentFilter<S> for BehindDepth<S> {
    #[inline(always)]
    fn exists(&self, z: Lanes<S>) -> Option<mask32x16<S>> {
        Some(self.depth.lt(z) & self.pixels)
    }

    #[inline(always)]
    fn relevant(&self, threshold: Lanes<S>) -> Lanes<S> {
        Lanes::select(self.pixels, threshold, threshold.constant(f64::NEG_INFINITY))
    }
}

/// Splats of a block with polygons (§6): attributes are added up to the nearest polygon that no splat occludes.
pub(crate) struct MeshBlend<'a, S: Simd> {
    /// Depth of the nearest polygon; after the splats' visibility of the one that no splat occludes, +∞ elsewhere.
    pub polygon: &'a mut Lanes<S>,
}

impl<S: Simd> FragmentFilter<S> for MeshBlend<'_, S> {
    #[inline(always)]
    fn settle(&mut self, threshold: Lanes<S>) {
        let shown = self.polygon.le(threshold);
        *self.polygon = Lanes::select(shown, *self.polygon, threshold.constant(f64::INFINITY));
    }

    #[inline(always)]
    fn adds(&self, z: Lanes<S>, record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        mask & (z - z.constant(record.epsilon().into())).le(*self.polygon)
    }
}
