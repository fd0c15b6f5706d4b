//! Which fragments of a block exist, and which add their attributes.

use crate::lanes::Lanes;
use crate::record::Record;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;

/// What keeps fragments of a block from being drawn.
pub(crate) trait Limit<S: Simd> {
    /// Which fragments at these depths exist; `None`: all.
    #[inline(always)]
    fn exists(&self, _z: Lanes<S>) -> Option<mask32x16<S>> {
        None
    }

    /// What a block keeps, −∞ where it doesn't matter since no fragment exists.
    #[inline(always)]
    fn matters(&self, kept: Lanes<S>) -> Lanes<S> {
        kept
    }

    /// Told what the block keeps, before attributes are added.
    #[inline(always)]
    fn settle(&mut self, _kept: Lanes<S>) {}

    /// Which of the fragments of `mask` add their attributes.
    #[inline(always)]
    fn reaches(&self, _z: Lanes<S>, _record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        mask
    }
}

/// Everything is drawn.
pub(crate) struct Unlimited;

impl<S: Simd> Limit<S> for Unlimited {}

/// Fragments up to a depth don't exist, nor do any outside of some pixels.
pub(crate) struct Behind<S: Simd> {
    pub depth: Lanes<S>,
    pub pixels: mask32x16<S>,
}

impl<S: Simd> Limit<S> for Behind<S> {
    #[inline(always)]
    fn exists(&self, z: Lanes<S>) -> Option<mask32x16<S>> {
        Some(self.depth.lt(z) & self.pixels)
    }

    #[inline(always)]
    fn matters(&self, kept: Lanes<S>) -> Lanes<S> {
        Lanes::select(self.pixels, kept, kept.constant(f64::NEG_INFINITY))
    }
}
