//! Fragment filters, which decide which fragments of a block exist and which of them add their attributes.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::raster::batch::Pixels;
use crate::raster::facing::VisibleSide;
use crate::raster::inputs::RasterInputs;
use crate::setup::record::Record;
use crate::simd::lanes::Lanes;
use crate::tiles::lists::BlockList;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

/// A filter that decides which fragments of a block exist, and which of them add their attributes.
pub(crate) trait FragmentFilter<S: Simd> {
    /// True if few blocks use the filter, so that no specialised copies of the block loops are compiled for it.
    const IS_RARE: bool = true;

    /// True if front- and back-facing splats of oriented clouds are kept apart, so that each pixel shows one side.
    const KEEPS_FACINGS: bool = false;

    /// True if [`Self::track`] must be called between the loop that finds depth thresholds and the loop that adds
    /// attributes.
    const TRACKS: bool = false;

    /// Visits a block's splats once the depth thresholds are final, before the loop that adds attributes.
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

    /// Returns a mask of the pixels whose fragments at depths `z` exist; `None` if all do.
    #[inline(always)]
    fn exists(&self, _z: Lanes<S>) -> Option<mask32x16<S>> {
        None
    }

    /// Returns a block's depth thresholds for skipping splats behind them; −∞ in pixels in which no fragment can exist.
    #[inline(always)]
    fn relevant(&self, threshold: Lanes<S>) -> Lanes<S> {
        threshold
    }

    /// Receives the final depth thresholds of a block, before attributes are added.
    #[inline(always)]
    fn settle(&mut self, _threshold: Lanes<S>) {}

    /// Receives the side, front or back, of oriented surfaces that each pixel of the block shows.
    #[inline(always)]
    fn show(&mut self, _shown: &VisibleSide<S>) {}

    /// Returns a mask of those fragments of `mask` that add their attributes.
    #[inline(always)]
    fn adds(&self, _z: Lanes<S>, _record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        mask
    }
}

/// The fragment filter that admits every fragment.
pub(crate) struct EveryFragment;

impl<S: Simd> FragmentFilter<S> for EveryFragment {
    const IS_RARE: bool = false;
}

/// A fragment filter that admits fragments behind a depth, in selected pixels only. It draws what is behind edge
/// pixels.
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

/// The fragment filter of a block with polygons (rendering model §6). In pixels that show a polygon, splats add their
/// attributes only up to ε behind it.
pub(crate) struct MeshBlend<'a, S: Simd> {
    /// Depth of each pixel's nearest polygon; +∞ for none. After visibility, also +∞ if splats occlude the polygon.
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
