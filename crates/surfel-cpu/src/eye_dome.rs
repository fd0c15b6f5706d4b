//! The shader `edl` (§5): darker the deeper a pixel lies among its neighbours. A look at tiles that are drawn.

use crate::lanes::Lanes;
use crate::planes::NeighbourPlanes;
use fearless_simd::Simd;
use surfel_math::eye_dome::{NEIGHBOURS, brightness, rise_weight};
use surfel_math::projection::Projection;
use surfel_math::{Real, V2};

/// How bright surfaces of depth `z` are among the front surfaces about the block at `(x, y)`. Means nothing where z is infinite.
#[inline(always)]
pub(crate) fn among_neighbours<S: Simd>(
    simd: S,
    planes: &NeighbourPlanes,
    projection: &Projection,
    (x, y): (i32, i32),
    z: Lanes<S>,
) -> Lanes<S> {
    let mut rise = z.zero();
    for [dx, dy] in NEIGHBOURS {
        let weight: f64 = rise_weight(V2::new(f64::from(dx), f64::from(dy)), projection);
        // Outside of the picture, and where nothing is, all is infinitely far.
        let nearer = (z - planes.depth(simd, (x + dx, y + dy))).max(z.zero());
        rise = nearer.mul_add(z.constant(weight), rise);
    }
    brightness(z, rise, projection)
}
