//! The shader `edl` (rendering model §5), which darkens a pixel the more, the farther it is behind its neighbours. It
//! is a pass over finished tiles.
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::screen::neighbourhood::Neighbourhood;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::grid::{BLOCK, TILE_BLOCKS};
use crate::tiles::target::Target;
use fearless_simd::Simd;
use surfel_math::eye_dome::{NEIGHBOURS, brightness, rise_weight};
use surfel_math::projection::Projection;
use surfel_math::{Real, V2};

/// Eye-dome lighting of a tile: depths of its pixels and of those around it, and the weights of neighbours.
pub(crate) struct EyeDome<'a> {
    neighbourhood: &'a Neighbourhood,
    projection: &'a Projection,
    /// Weight of each of a pixel's eight neighbours in the mean rise ([`rise_weight`]).
    weights: [f32; NEIGHBOURS.len()],
}

impl<'a> EyeDome<'a> {
    /// Depth that pixels outside the image and empty pixels have as neighbours: infinitely far, so that they darken
    /// nothing.
    pub(crate) const OUTSIDE: f32 = f32::INFINITY;

    pub(crate) fn new(neighbourhood: &'a Neighbourhood, projection: &'a Projection) -> Self {
        let weights = NEIGHBOURS.map(|offset| {
            let [dx, dy] = offset.map(f64::from);
            rise_weight::<f64>(V2::new(dx, dy), projection) as f32
        });
        Self { neighbourhood, projection, weights }
    }

    /// Darkens a tile's blocks whose bits are set in `touched`. `first` is the tile's first pixel.
    #[inline(always)]
    pub(crate) fn darken<S: Simd>(&self, simd: S, target: &mut Target<'_>, touched: u64, first: (i32, i32)) {
        for blocks in (0..u64::BITS).step_by(LANES / BLOCK as usize) {
            if touched >> blocks & 0xf == 0 {
                continue;
            }
            let x = (blocks % TILE_BLOCKS * BLOCK) as i32;
            let top = (blocks / TILE_BLOCKS * BLOCK) as i32;
            for y in top..top + BLOCK as i32 {
                let z = self.neighbourhood.row(simd, x, y);
                let there = z.lt(z.constant(f64::INFINITY));
                let mut neighbours = [z; NEIGHBOURS.len()];
                for (neighbour, [dx, dy]) in neighbours.iter_mut().zip(NEIGHBOURS) {
                    *neighbour = self.neighbourhood.row(simd, x + dx, y + dy);
                }
                let bright = Lanes::select(there, self.brightness(z, neighbours), z.one());
                target.dim(simd, (first.0 + x, first.1 + y), bright);
            }
        }
    }

    /// Returns the brightness of surfaces at depths `z` in a block, among the nearest surfaces around each pixel. (x,
    /// y) is the block's first pixel, relative to the tile. The result is meaningless where `z` is infinite.
    #[inline(always)]
    pub(crate) fn of_block<S: Simd>(&self, simd: S, (x, y): (i32, i32), z: Lanes<S>) -> Lanes<S> {
        let mut neighbours = [z; NEIGHBOURS.len()];
        for (neighbour, [dx, dy]) in neighbours.iter_mut().zip(NEIGHBOURS) {
            *neighbour = self.neighbourhood.block(simd, x + dx, y + dy);
        }
        self.brightness(z, neighbours)
    }

    /// Returns the brightness, like [`Self::of_block`], of surfaces that are all within the same pixel (x, y) of the
    /// tile, such as samples.
    #[inline(always)]
    pub(crate) fn of_pixel<S: Simd>(&self, (x, y): (i32, i32), z: Lanes<S>) -> Lanes<S> {
        let neighbour = |[dx, dy]: [i32; 2]| z.constant(self.neighbourhood.at(x + dx, y + dy).into());
        self.brightness(z, NEIGHBOURS.map(neighbour))
    }

    #[inline(always)]
    fn brightness<S: Simd>(&self, z: Lanes<S>, neighbours: [Lanes<S>; NEIGHBOURS.len()]) -> Lanes<S> {
        let mut rise = z.zero();
        for (neighbour, weight) in neighbours.into_iter().zip(self.weights) {
            rise = (z - neighbour).max(z.zero()).mul_add(Lanes::splat(z.0.simd, weight), rise);
        }
        brightness(z, rise, self.projection)
    }
}
