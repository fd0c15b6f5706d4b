//! The shader `edl` (§5): darker the deeper a pixel lies among its neighbours. A pass over tiles that are drawn.

use crate::screen::neighbourhood::Neighbourhood;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::grid::{BLOCK, TILE_BLOCKS};
use crate::tiles::target::Target;
use fearless_simd::Simd;
use surfel_math::eye_dome::{NEIGHBOURS, brightness, rise_weight};
use surfel_math::projection::Projection;
use surfel_math::{Real, V2};

/// A tile's depths, with those of its neighbours around them.
pub(crate) struct EyeDome<'a> {
    neighbourhood: &'a Neighbourhood,
    projection: &'a Projection,
    /// What each neighbour counts for.
    weights: [f32; NEIGHBOURS.len()],
}

impl<'a> EyeDome<'a> {
    /// Outside of the image, and where nothing is, all is infinitely far.
    pub(crate) const OUTSIDE: f32 = f32::INFINITY;

    pub(crate) fn new(neighbourhood: &'a Neighbourhood, projection: &'a Projection) -> Self {
        let weights = NEIGHBOURS.map(|offset| {
            let [dx, dy] = offset.map(f64::from);
            rise_weight::<f64>(V2::new(dx, dy), projection) as f32
        });
        Self { neighbourhood, projection, weights }
    }

    /// Darkens what a tile shows, in those of its blocks that are `touched`; its first pixel is `first`.
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

    /// How bright surfaces of depth `z` are among the front surfaces about the block at a pixel of the tile. Means
    /// nothing where z is infinite.
    #[inline(always)]
    pub(crate) fn of_block<S: Simd>(&self, simd: S, (x, y): (i32, i32), z: Lanes<S>) -> Lanes<S> {
        let mut neighbours = [z; NEIGHBOURS.len()];
        for (neighbour, [dx, dy]) in neighbours.iter_mut().zip(NEIGHBOURS) {
            *neighbour = self.neighbourhood.block(simd, x + dx, y + dy);
        }
        self.brightness(z, neighbours)
    }

    /// The same for surfaces that are seen within one pixel of the tile.
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
