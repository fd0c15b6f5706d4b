//! Fragment filters, which decide which fragments of a block exist and which of them add their attributes.

use crate::raster::batch::Pixels;
use crate::raster::facing::Shown;
use crate::raster::inputs::RasterInputs;
use crate::setup::record::Record;
use crate::simd::lanes::Lanes;
use crate::tiles::lists::BlockList;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

/// A filter of a block's fragments.
pub(crate) trait FragmentFilter<S: Simd> {
    /// True if few blocks use the filter. No specialised copies of the block loops are compiled then.
    const IS_RARE: bool = true;

    /// True if front- and back-facing splats of oriented clouds are separated.
    const KEEPS_FACINGS: bool = false;

    /// True if [`Self::track`] is implemented.
    const TRACKS: bool = false;

    /// Visits a block's splats between its two loops, when the depth thresholds are final.
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

    /// Returns which fragments at these depths exist; `None` for all.
    #[inline(always)]
    fn exists(&self, _z: Lanes<S>) -> Option<mask32x16<S>> {
        None
    }

    /// Returns a block's depth thresholds, with −∞ for pixels in which no fragment exists.
    #[inline(always)]
    fn relevant(&self, threshold: Lanes<S>) -> Lanes<S> {
        threshold
    }

    /// Receives the block's depth thresholds before attributes are added.
    #[inline(always)]
    fn settle(&mut self, _threshold: Lanes<S>) {}

    /// Receives the side of oriented surfaces that the block's pixels show.
    #[inline(always)]
    fn show(&mut self, _shown: &Shown<S>) {}

    /// Returns which of the fragments of `mask` add their attributes.
    #[inline(always)]
    fn adds(&self, _z: Lanes<S>, _record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        mask
    }
}

/// The filter that admits every fragment.
pub(crate) struct EveryFragment;

impl<S: Simd> FragmentFilter<S> for EveryFragment {
    const IS_RARE: bool = false;
}

/// A filter that admits fragments behind a depth, in selected pixels only.
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

/// The filter of a block with polygons (§6): attributes are added up to the nearest polygon that no splat occludes.
pub(crate) struct MeshBlend<'a, S: Simd> {
    /// Depth of the nearest polygon. After visibility, depth of the nearest polygon that no splat occludes, +∞ for
    /// none.
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
