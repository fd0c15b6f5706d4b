//! What a block keeps, where nothing else is asked for: shadow maps, and what hides other splats.

use crate::fours::{Pixels, Visit, each_four, largest};
use crate::fragment::Fragment;
use crate::lanes::Lanes;
use crate::lists::BlockList;
use crate::raster::Shared;
use crate::record::Record;
use fearless_simd::Simd;
use surfel_math::Real;

/// The first loop alone: what a block keeps.
#[inline(always)]
pub(crate) fn visibility<S: Simd>(
    simd: S,
    list: BlockList<'_, '_>,
    first_px: (i32, i32),
    shared: &Shared<'_>,
) -> Lanes<S> {
    let mut keeping = Keeping { kept: Lanes::splat(simd, f32::INFINITY) };
    each_four(simd, list, f32::INFINITY, &Pixels::new(simd, first_px), shared, &mut keeping);
    keeping.kept
}

/// What [`visibility`] carries along.
struct Keeping<S: Simd> {
    kept: Lanes<S>,
}

impl<S: Simd> Visit<S> for Keeping<S> {
    #[inline(always)]
    fn add(&mut self, simd: S, fragment: Fragment<S>, _: usize, record: &Record) {
        let k = |v: f32| Lanes::splat(simd, v);
        self.kept = self.kept.min(Lanes::select(fragment.visible, fragment.z, k(f32::INFINITY)) + k(record.epsilon()));
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        Some(largest(self.kept))
    }
}
