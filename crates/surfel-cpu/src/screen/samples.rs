//! Samples of the pixels at edges (rendering model §5). Each such pixel is a block of a view that is four times as
//! fine, and is drawn like any other block. The pixel's colour is the mean of the block.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::raster::balls::list_balls;
use crate::raster::listing::list_triangles;
use crate::screen::composite::{BallOutputs, CompositeJob, HiddenBeyond};
use crate::screen::eye_dome::EyeDome;
use crate::screen::gbuffer::GBuffer;
use crate::screen::neighbourhood::Neighbourhood;
use crate::screen::tile::TileScratch;
use crate::shade::lighting::Lighting;
use crate::shade::resolve::outline_limit;
use crate::shade::surface::Shaded;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::drawn::BlockSet;
use crate::tiles::driver::Counters;
use crate::tiles::grid::Grid;
use crate::tiles::target::{Pixels, Target};
use fearless_simd::Simd;
use surfel_math::{Real, V3, eye_dome};
use surfel_model::Shader;
use surfel_render::SAMPLES_SIDE;

/// The sampled pixels of a cell, and the inputs to draw their samples.
pub(crate) struct SampleJob<'a, 'b> {
    /// Inputs for drawing tiles of the view whose pixels are samples.
    pub tiles: CompositeJob<'a>,
    /// Sampled pixels, as blocks of the view whose pixels are samples.
    pub sampled: &'b BlockSet,
    /// Grid of the image's own pixels in the cell.
    pub grid: Grid,
    /// G-buffer of the image's own pixels, in which screen-space shaders read neighbours.
    pub gbuffer: &'b GBuffer,
    /// Lighting of the image's own view.
    pub lighting: &'b Lighting,
}

impl<'a> SampleJob<'a, '_> {
    /// Draws the samples of all sampled pixels, and writes the means to `target`.
    pub(crate) fn draw(
        &self,
        instructions: Instructions,
        target: &mut Target<'_>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        for (tile, wanted) in self.sampled.tiles() {
            let (x, y) = pixel_of(self.sampled.grid.block_px(tile, wanted.trailing_zeros()));
            target.select_tile(&self.grid, self.grid.tile_of(x, y));
            counters += self.draw_tile(instructions, (tile, wanted), target, scratch);
        }
        counters
    }

    #[inline(never)]
    fn draw_tile(
        &self,
        instructions: Instructions,
        tile: (usize, u64),
        target: &mut Target<'_>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        with_instructions!(instructions, simd =>
            simd.vectorize(#[inline(always)] || self.draw_blocks(simd, tile, target, scratch)))
    }

    #[inline(always)]
    fn draw_blocks<S: Simd>(
        &self,
        simd: S,
        (tile, wanted): (usize, u64),
        target: &mut Target<'_>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let (job, listing) = (&self.tiles, &self.tiles.tiles.listing);
        listing.list_some(tile, wanted, &mut scratch.lists.splats);
        list_triangles(job.extras.triangles, tile, wanted, &mut scratch.lists.triangles);
        let transparent = job.list_transparent(tile, wanted, &mut scratch.transparent);
        let balls = list_balls(job.extras.balls, tile, wanted, &mut scratch.balls);
        let looks_around = self.load_depths(target.tile, &mut scratch.neighbourhood);
        let mut left = wanted;
        while left != 0 {
            let block = left.trailing_zeros();
            left &= left - 1;
            let at = listing.grid.block_px(tile, block);
            let mut front = job.front(simd, block, at, scratch);
            counters.block_pairs += u64::from(front.sums.tested);
            counters.inside += u64::from(front.sums.inside);
            let pixel = pixel_of(at);
            if looks_around {
                self.under_screen_space(simd, &mut front.shaded, at, pixel, target.tile, &scratch.neighbourhood);
            }
            let background = self.lighting.background_color();
            let mut samples = front.shaded.over_background(simd, background, front.sums.fragments);
            if balls >> block & 1 != 0 {
                let layers = (transparent >> block & 1 != 0).then_some(front.opaque_depth);
                let ends = HiddenBeyond { front: front.shaded.depth_or_infinite(), layers };
                let outputs = BallOutputs { target: None, steps: None, counters: &mut counters };
                job.draw_balls(simd, (block, at), ends, &mut samples, outputs, scratch);
            } else if transparent >> block & 1 != 0 {
                samples = job.layers(simd, (block, at), front.opaque_depth, scratch, &mut counters).over(&samples);
            }
            target.put_one(pixel, mean(&samples));
        }
        counters.edge_pixels = u64::from(wanted.count_ones());
        counters
    }

    /// Loads the depths of a tile of the image and around it, if a screen-space shader needs them. Returns false if
    /// none does.
    fn load_depths(&self, tile: usize, neighbourhood: &mut Neighbourhood) -> bool {
        let (reach, outside) = match self.lighting.shader {
            Shader::Edl => (eye_dome::REACH_PX, EyeDome::OUTSIDE),
            Shader::Toon => (1, f32::NEG_INFINITY),
            _ => return false,
        };
        let marks = |tile| self.gbuffer.marks(tile);
        let has_depths = self.gbuffer.has_depths();
        if has_depths {
            neighbourhood.load(self.gbuffer.depths(), &self.grid, tile, marks, reach, outside);
        }
        has_depths
    }

    /// Applies outlines or eye-dome lighting to the samples of a pixel, by the depths of the image's pixels around it.
    #[inline(always)]
    fn under_screen_space<S: Simd>(
        &self,
        simd: S,
        shaded: &mut Shaded<S>,
        at: (i32, i32),
        pixel: (i32, i32),
        tile: usize,
        neighbourhood: &Neighbourhood,
    ) {
        let first = self.grid.block_px(tile, 0);
        let (x, y) = (pixel.0 - first.0, pixel.1 - first.1);
        if self.lighting.shader == Shader::Edl {
            let dome = EyeDome::new(neighbourhood, self.lighting.projection());
            shaded.color = shaded.color * dome.of_pixel((x, y), shaded.z);
            return;
        }
        let others = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|offset| *offset != (0, 0));
        let farthest = others.map(|(dx, dy)| neighbourhood.at(x + dx, y + dy)).fold(f32::NEG_INFINITY, f32::max);
        let limit = outline_limit(simd, self.tiles.tiles.lighting, shaded, at);
        let zero = limit.zero();
        let line = limit.lt(Lanes::splat(simd, farthest));
        shaded.color = V3::select(line, V3::new(zero, zero, zero), shaded.color);
    }
}

/// Returns the pixel of the image whose samples form the block with this first sample.
fn pixel_of((x, y): (i32, i32)) -> (i32, i32) {
    (x / SAMPLES_SIDE as i32, y / SAMPLES_SIDE as i32)
}

/// Returns the mean colour of a block of samples, summed in lane order.
#[inline(always)]
fn mean<S: Simd>(samples: &Pixels<S>) -> [f32; 4] {
    // Each colour is divided before the sum, which might otherwise overflow f32.
    samples.color.map(|channel| channel.to_array().iter().map(|c| c * (1.0 / LANES as f32)).sum::<f32>())
}
