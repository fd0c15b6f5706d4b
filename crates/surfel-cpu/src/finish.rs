//! From blocks' sums to their pixels, several at once: each is a long chain of operations, and a processor overlaps such chains
//! where nothing else comes between.

use crate::light::Lighting;
use crate::raster::Sums;
use crate::shade;
use crate::target::TileTarget;
use crate::tile::block_px;
use fearless_simd::Simd;

/// Divides, lights and writes the first of a tile's blocks whose bits are set, one for each of some sums. The tile begins at pixel
/// `origin`.
///
/// Out of line: a short function keeps its numbers in registers.
#[inline(never)]
pub(crate) fn finish<S: Simd>(
    simd: S,
    lighting: &Lighting,
    (sums, blocks): (&[Sums<S>], u64),
    origin: (i32, i32),
    target: &mut TileTarget<'_>,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let mut left = blocks;
            for sums in sums {
                let block = left.trailing_zeros() % u64::BITS;
                left &= left.wrapping_sub(1);
                let at = block_px(origin, block);
                target.put(at, &shade::resolve(simd, lighting, sums, at));
            }
        },
    );
}
