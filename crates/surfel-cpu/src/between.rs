//! Splats and polygons in one block (§6): the polygons that no splat hides, and the splats' attributes up to them.

use crate::lanes::Lanes;
use crate::limit::Limit;
use crate::record::Record;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

/// A block's nearest polygons, while its splats are drawn.
pub(crate) struct Between<'a, S: Simd> {
    /// Depth of the nearest polygon; after the splats' visibility of the one that no splat hides, +∞ elsewhere.
    pub polygon: &'a mut Lanes<S>,
}

impl<S: Simd> Limit<S> for Between<'_, S> {
    #[inline(always)]
    fn settle(&mut self, kept: Lanes<S>) {
        *self.polygon = Lanes::select(self.polygon.le(kept), *self.polygon, kept.constant(f64::INFINITY));
    }

    #[inline(always)]
    fn reaches(&self, z: Lanes<S>, record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        mask & (z - z.constant(record.epsilon().into())).le(*self.polygon)
    }
}
