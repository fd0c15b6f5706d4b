//! Tiles of frames with more than opaque splats: polygons (rendering model §6), transparent layers (§8), and the
//! screen-space passes for edges and outlines (§5). A frame without any of them is drawn by `tile` alone.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::raster::balls::{BallList, list_balls};
use crate::raster::block;
use crate::raster::filter::BehindDepth;
use crate::raster::layers::{TransparentBlock, TransparentItem};
use crate::raster::listing::list_triangles;
use crate::raster::sums::Sums;
use crate::raster::triangles;
use crate::scene::mesh::StoredMesh;
use crate::scene::numbers::SplatNumbers;
use crate::screen::eye_dome::EyeDome;
use crate::screen::gbuffer::{BLOCKS, GBuffer, GBufferTile, Reach};
use crate::screen::layer_steps::LayerSteps;
use crate::screen::tile::{TileJob, TileScratch};
use crate::setup::balls::BallSegment;
use crate::setup::segment::TransparentSegment;
use crate::setup::triangles::TriangleSegment;
use crate::shade::balls::{BallBlock, BallShading, Composited};
use crate::shade::resolve::{divided, lit, outline_limit};
use crate::shade::surface::Shaded;
use crate::shade::transparent::{CompositedLayers, Layers, composite};
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::driver::Counters;
use crate::tiles::lists::ItemLists;
use crate::tiles::target::{Pixels, Target};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::depth::step_allowance;
use surfel_math::kernel::FULL_COVERAGE;
use surfel_math::{Real, eye_dome};
use surfel_model::Shader;

/// Content of a cell in addition to opaque splats.
pub(crate) struct Extras<'a> {
    pub meshes: &'a [StoredMesh],
    pub triangles: &'a [TriangleSegment],
    pub transparent: &'a [TransparentSegment],
    pub layers: Layers,
    pub balls: &'a BallSegment,
    /// Material factors and stored light of each object of balls.
    pub ball_looks: &'a [BallShading<'a>],
}

/// Inputs for drawing a cell's tiles: opaque splats, and all other content.
pub(crate) struct CompositeJob<'a> {
    pub tiles: TileJob<'a>,
    pub extras: Extras<'a>,
    /// True if the frame has only opaque splats, so that no extras are drawn.
    pub opaque_splats_only: bool,
}

/// Depths up to which balls and transparent layers are visible in a block's pixels; +∞ where nothing hides them.
#[derive(Clone, Copy)]
pub(super) struct HiddenBeyond<S: Simd> {
    /// Depth of the visible surface, beyond which balls are hidden.
    pub front: Lanes<S>,
    /// Depth of the opaque surface, beyond which transparent layers are hidden; `None` if the block has no layers.
    pub layers: Option<Lanes<S>>,
}

/// Destinations, besides the pixels themselves, of the results of drawing a block's balls.
pub(super) struct BallOutputs<'a, 'b> {
    /// Target for the plane of the nearest splats; `None` for samples, of which only the colours are used.
    pub target: Option<&'a mut Target<'b>>,
    /// Planes in which the depth ranges of transparent layers are stored, and the tile's index; `None` if not needed.
    pub steps: Option<(&'a mut LayerSteps, usize)>,
    pub counters: &'a mut Counters,
}

/// The opaque surfaces of a block's pixels, after lighting.
pub(super) struct Front<S: Simd> {
    pub sums: Sums<S>,
    /// Depth range of each pixel's nearest polygon, even if splats occlude it; `None` if the block has no polygons.
    polygon: Option<Reach<S>>,
    pub shaded: Shaded<S>,
    /// Numbers of the nearest splats or polygons, if the frame outputs them.
    numbers: Option<[u32; LANES]>,
    /// Depth of the nearest opaque surface; +∞ for none.
    pub opaque_depth: Lanes<S>,
}

impl<'a> CompositeJob<'a> {
    fn is_empty(&self, tile: usize) -> bool {
        self.tiles.listing.is_empty(tile)
            && self.extras.triangles.iter().all(|s| s.lists.of(tile).is_empty())
            && self.extras.transparent.iter().all(|s| s.segment.lists.of(tile).is_empty())
            && self.extras.balls.lists.of(tile).is_empty()
    }

    pub(super) fn list_transparent(&self, tile: usize, wanted: u64, lists: &mut ItemLists<TransparentItem<'a>>) -> u64 {
        lists.clear();
        for TransparentSegment { segment, splats } in self.extras.transparent {
            for entry in segment.lists.of(tile) {
                let i = entry.record as usize;
                let item = TransparentItem { record: &segment.records[i], splat: &splats[i] };
                lists.push(item, entry.blocks & wanted);
            }
        }
        lists.finish()
    }

    /// Draws a tile, including balls and transparent layers unless a screen-space pass precedes them.
    ///
    /// The tiles' loops are called only from here: all their code is inlined into them, once for each SIMD level.
    #[inline(never)]
    pub(crate) fn draw(
        &self,
        instructions: Instructions,
        target: &mut Target<'_>,
        gbuffer: Option<&mut GBufferTile<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        if self.opaque_splats_only {
            with_instructions!(instructions, simd =>
                simd.vectorize(#[inline(always)] || self.tiles.draw(simd, target, gbuffer, scratch)))
        } else {
            with_instructions!(instructions, simd =>
                simd.vectorize(#[inline(always)] || self.draw_all(simd, target, gbuffer, scratch)))
        }
    }

    #[inline(always)]
    fn draw_all<S: Simd>(
        &self,
        simd: S,
        target: &mut Target<'_>,
        mut gbuffer: Option<&mut GBufferTile<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let (tile, background) = (target.tile, self.tiles.lighting.background);
        let is_empty = self.is_empty(tile);
        if let Some(gbuffer) = &mut gbuffer {
            gbuffer.begin(is_empty);
        }
        if is_empty {
            target.fill_empty(background);
            return counters;
        }
        let blocks = self.tiles.listing.grid.blocks(tile);
        self.tiles.listing.list(tile, blocks, &mut scratch.lists.splats);
        let with_triangles = list_triangles(self.extras.triangles, tile, blocks, &mut scratch.lists.triangles);
        let opaque = scratch.lists.splats.touched() | with_triangles;
        let transparent =
            if gbuffer.is_none() { self.list_transparent(tile, blocks, &mut scratch.transparent) } else { 0 };
        let balls = if gbuffer.is_none() { list_balls(self.extras.balls, tile, blocks, &mut scratch.balls) } else { 0 };
        let mut contributing = i32x16::splat(simd, 0);
        for block in ones(blocks).map(|block| block as u32) {
            let at = self.tiles.listing.grid.block_px(tile, block);
            if (opaque | transparent | balls) >> block & 1 == 0 {
                target.put_empty(self.tiles.listing.grid.block_px(tile, 0), 1 << block, background);
                continue;
            }
            let front = self.front(simd, block, at, scratch);
            counters.block_pairs += u64::from(front.sums.tested);
            counters.inside += u64::from(front.sums.inside);
            let mut pixels =
                front.shaded.over_background(simd, self.tiles.lighting.background_color(), front.sums.fragments);
            if let Some(numbers) = front.numbers {
                target.put_index(at, numbers);
            }
            if let Some(gbuffer) = &mut gbuffer {
                self.put_gbuffer(simd, gbuffer, (block, at), &front);
            } else if (transparent | balls) >> block & 1 != 0 {
                let (opaque_depth, place) = (front.opaque_depth, (block, at));
                if balls >> block & 1 == 0 {
                    let layers = self.layers(simd, place, opaque_depth, scratch, &mut counters);
                    layers.put_index(target, at);
                    pixels = layers.over(&pixels);
                } else {
                    let layers = (transparent >> block & 1 != 0).then_some(opaque_depth);
                    let ends = HiddenBeyond { front: front.shaded.depth_or_infinite(), layers };
                    let outputs = BallOutputs { target: Some(&mut *target), steps: None, counters: &mut counters };
                    self.draw_balls(simd, place, ends, &mut pixels, outputs, scratch);
                }
            }
            let counts: i32x16<S> = pixels.fragments.0.to_int();
            contributing += counts * target.rect.lanes_inside(simd, at);
            target.put(at, &pixels);
        }
        counters.contributing = contributing.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }

    /// Draws and lights a block's opaque surfaces: splats, polygons, or splats blended over polygons. `at` is the
    /// block's first pixel.
    #[inline(always)]
    pub(super) fn front<S: Simd>(
        &self,
        simd: S,
        block: u32,
        at: (i32, i32),
        scratch: &mut TileScratch<'a>,
    ) -> Front<S> {
        let (job, lighting) = (&self.tiles, self.tiles.lighting);
        let (splats, triangles) = (scratch.lists.splats.of(simd, block), scratch.lists.triangles.of(block));
        let infinite = Lanes::splat(simd, f32::INFINITY);
        if triangles.is_empty() && splats.is_empty() {
            let sums = Sums::new(simd);
            let numbers = job.inputs.frame.wanted.nearest.then_some([SplatNumbers::NOTHING; LANES]);
            return Front { sums, polygon: None, shaded: Shaded::nothing(simd), numbers, opaque_depth: infinite };
        }
        let mut polygon = None;
        if !triangles.is_empty() {
            let nearest = triangles::nearest(simd, triangles, at, job.inputs.frame.constants.depth_range());
            polygon = Some((nearest, nearest.z));
        }
        let (mut sums, mut numbers) = (Sums::new(simd), None);
        let shown = polygon.as_mut().map(|(_, shown)| shown);
        if let Some(found) = job.draw_splats(simd, splats, at, shown, &mut scratch.block, &mut sums) {
            let mut found_numbers = found.numbers();
            if let Some((nearest, shown)) = &polygon {
                let which = nearest.indices();
                for lane in ones(shown.lt(found.z).to_bitmask()) {
                    let mesh = triangles.get(which[lane]).map_or(0, |triangle| triangle.mesh);
                    found_numbers[lane] = SplatNumbers::POLYGON | mesh;
                }
            }
            numbers = Some(found_numbers);
        }
        let mut shaded = lit(simd, lighting, divided(simd, lighting, &sums), at);
        let mut opaque_depth = Lanes::select(shaded.covered, shaded.z, infinite);
        let reach = polygon.as_ref().map(|(nearest, _)| {
            let ends = if job.inputs.frame.wanted.polygon_ends { nearest.z.lt(infinite).to_bitmask() } else { 0 };
            let step = |z, gradient| step_allowance(z, gradient, lighting.projection());
            Reach { begin: nearest.z, end: nearest.moved_back(simd, triangles, at, ends, step) }
        });
        if let Some((nearest, shown)) = polygon {
            let mask = shown.lt(infinite);
            if mask.to_bitmask() != 0 {
                let surface = nearest.surface(simd, triangles, self.extras.meshes, at, mask);
                let behind = lit(simd, lighting, surface, at);
                let share = (sums.coverage * shown.constant(1.0 / FULL_COVERAGE)).min(shown.one());
                shaded = shaded.blended_over(&behind, share);
                opaque_depth = opaque_depth.min(shown);
            }
        }
        Front { sums, polygon: reach, shaded, numbers, opaque_depth }
    }

    #[inline(always)]
    fn put_gbuffer<S: Simd>(
        &self,
        simd: S,
        gbuffer: &mut GBufferTile<'_>,
        (block, at): (u32, (i32, i32)),
        front: &Front<S>,
    ) {
        let infinite = Lanes::splat(simd, f32::INFINITY);
        gbuffer.put_edges(block, &front.sums, front.polygon);
        gbuffer.put_depths(block, front.opaque_depth, Lanes::select(front.shaded.covered, front.shaded.z, infinite));
        if gbuffer.want_limit() {
            let limit = outline_limit(simd, self.tiles.lighting, &front.shaded, at);
            gbuffer.put_limit(block, Lanes::select(front.shaded.covered, limit, infinite));
        }
    }

    /// Draws and composites the transparent layers of a block in front of `opaque_depth`.
    #[inline(always)]
    pub(super) fn layers<S: Simd>(
        &self,
        simd: S,
        (block, at): (u32, (i32, i32)),
        opaque_depth: Lanes<S>,
        scratch: &mut TileScratch<'a>,
        counters: &mut Counters,
    ) -> CompositedLayers<S> {
        let TileScratch { transparent, layers, .. } = scratch;
        let block =
            TransparentBlock { simd, list: transparent.of(block), at, inputs: &self.tiles.inputs, opaque_depth };
        let composited = composite(&block, self.extras.layers, self.tiles.lighting, layers, None);
        counters.block_pairs += u64::from(composited.tested);
        counters.inside += u64::from(composited.inside);
        composited
    }

    /// Composites a block's balls, together with its transparent layers if it has any, over its pixels.
    #[inline(never)]
    pub(super) fn draw_balls<S: Simd>(
        &self,
        simd: S,
        (block_number, at): (u32, (i32, i32)),
        ends: HiddenBeyond<S>,
        pixels: &mut Pixels<S>,
        BallOutputs { target, steps, counters }: BallOutputs<'_, '_>,
        scratch: &mut TileScratch<'a>,
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let TileScratch { transparent, layers, balls, ball_fragments, .. } = scratch;
                let lighting = self.tiles.lighting;
                let list = BallList { balls: balls.of(block_number), at, projection: lighting.projection() };
                ball_fragments.gather(simd, list, ends.front);
                counters.block_pairs += u64::from(ball_fragments.tested);
                counters.inside += u64::from(ball_fragments.inside);
                let full = ball_fragments.full_depth(simd, list.balls);
                let looks = self.extras.ball_looks;
                let mut balls = BallBlock { simd, list, lighting, looks, fragments: ball_fragments };
                if let Some(opaque_depth) = ends.layers {
                    let block = TransparentBlock {
                        simd,
                        list: transparent.of(block_number),
                        at,
                        inputs: &self.tiles.inputs,
                        opaque_depth: opaque_depth.min(full),
                    };
                    let mut composited = composite(&block, self.extras.layers, lighting, layers, Some(&mut balls));
                    counters.block_pairs += u64::from(composited.tested);
                    counters.inside += u64::from(composited.inside);
                    if let Some((steps, tile)) = steps {
                        steps.put(tile, block_number, &composited);
                    }
                    balls.composite(ends.front, &mut composited.colors);
                    *pixels = composited.over(pixels);
                    if let Some(target) = target {
                        composited.put_index(target, at);
                        balls.show(ends.front, pixels, target);
                    }
                    return;
                }
                let mut composited = Composited::nothing(simd);
                balls.composite(ends.front, &mut composited);
                pixels.color = composited.over(pixels.color);
                pixels.fragments = pixels.fragments + composited.fragments;
                if let Some(target) = target {
                    balls.show(ends.front, pixels, target);
                }
            },
        );
    }

    /// Composites a block's balls between two depths over colours, for the surfaces behind edge pixels.
    #[inline(never)]
    fn balls_behind<S: Simd>(
        &self,
        simd: S,
        (block, at): (u32, (i32, i32)),
        (from, until): (Lanes<S>, Lanes<S>),
        color: [Lanes<S>; 4],
        scratch: &mut TileScratch<'a>,
    ) -> [Lanes<S>; 4] {
        let TileScratch { balls, ball_fragments, .. } = scratch;
        let lighting = self.tiles.lighting;
        let list = BallList { balls: balls.of(block), at, projection: lighting.projection() };
        ball_fragments.gather(simd, list, until);
        let mut balls = BallBlock { simd, list, lighting, looks: self.extras.ball_looks, fragments: ball_fragments };
        balls.fragments.skip(&from.to_array());
        let mut composited = Composited::nothing(simd);
        balls.composite(until, &mut composited);
        composited.over(color)
    }

    /// Runs the screen-space passes over a tile ([`Self::finish`]) with these SIMD instructions.
    #[inline(never)]
    pub(crate) fn finish_on(
        &self,
        instructions: Instructions,
        target: &mut Target<'_>,
        gbuffer: &GBuffer,
        layer_steps: Option<&mut LayerSteps>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        with_instructions!(instructions, simd =>
            simd.vectorize(#[inline(always)] || self.finish(simd, target, gbuffer, layer_steps, scratch)))
    }

    /// Runs the screen-space passes over a tile: outlines or eye-dome lighting, then edges with the surfaces behind
    /// them, then balls and transparent layers over both.
    #[inline(always)]
    fn finish<S: Simd>(
        &self,
        simd: S,
        target: &mut Target<'_>,
        gbuffer: &GBuffer,
        mut layer_steps: Option<&mut LayerSteps>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let tile = target.tile;
        if self.is_empty(tile) {
            return counters;
        }
        let listing = &self.tiles.listing;
        let mut edges = [0u16; BLOCKS];
        let (stepped, deep) = self.edges(simd, target, gbuffer, scratch, &mut edges);
        self.draw_over(simd, target, gbuffer, scratch);
        let transparent = self.list_transparent(tile, listing.grid.blocks(tile), &mut scratch.transparent);
        let balls = list_balls(self.extras.balls, tile, listing.grid.blocks(tile), &mut scratch.balls);
        if stepped != 0 {
            listing.list_some(tile, deep, &mut scratch.lists.splats);
            list_triangles(self.extras.triangles, tile, stepped, &mut scratch.lists.triangles);
        }
        let mut added = i32x16::splat(simd, 0);
        for block in ones(stepped | transparent | balls).map(|block| block as u32) {
            let at = listing.grid.block_px(tile, block);
            let mut color = target.color(simd, at);
            let opaque_depth = gbuffer.opaque(simd, tile, block);
            let mut front = gbuffer.front(simd, tile, block);
            if stepped >> block & 1 != 0 {
                let edges = (edges[block as usize % BLOCKS], deep >> block & 1 != 0);
                let (shaded, mut behind, edge) =
                    self.behind(simd, (tile, block), edges, gbuffer, scratch, &mut counters);
                if balls >> block & 1 != 0 {
                    let end = shaded.depth_or_infinite();
                    let range = (front.min(end), Lanes::select(edge, end, end.zero()));
                    behind = self.balls_behind(simd, (block, at), range, behind, scratch);
                    front = Lanes::select(edge, front.min(end), front);
                }
                let q = gbuffer.coverage(simd, tile, block);
                let q = q.min(q.one());
                for (front, behind) in color.iter_mut().zip(behind) {
                    *front = Lanes::select(edge, q.mul_add(*front, (q.one() - q) * behind), *front);
                }
            }
            if balls >> block & 1 != 0 {
                let mut pixels = Pixels { color, ..target.get(simd, at) };
                let before = pixels.fragments;
                let layers = (transparent >> block & 1 != 0).then_some(opaque_depth);
                let steps = layer_steps.as_deref_mut().map(|steps| (steps, tile));
                let outputs = BallOutputs { target: Some(&mut *target), steps, counters: &mut counters };
                self.draw_balls(simd, (block, at), HiddenBeyond { front, layers }, &mut pixels, outputs, scratch);
                let counts: i32x16<S> = (pixels.fragments - before).0.to_int();
                added += counts * target.rect.lanes_inside(simd, at);
                target.put(at, &pixels);
                continue;
            }
            if transparent >> block & 1 == 0 {
                target.put_color(at, color);
                continue;
            }
            let layers = self.layers(simd, (block, at), opaque_depth, scratch, &mut counters);
            if let Some(steps) = &mut layer_steps {
                steps.put(tile, block, &layers);
            }
            let counts: i32x16<S> = layers.fragments.0.to_int();
            added += counts * target.rect.lanes_inside(simd, at);
            layers.put_index(target, at);
            let behind = Pixels { color, ..target.get(simd, at) };
            target.put(at, &layers.over(&behind));
        }
        counters.contributing = added.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }

    /// Finds the edge pixels of a tile whose coverage is below 1, so that the surface behind may show. Sets their bits
    /// in `edges`, block by block. Returns bits of the blocks that have such pixels, and bits of the blocks in which
    /// one of these pixels has a depth threshold.
    #[inline(always)]
    fn edges<S: Simd>(
        &self,
        simd: S,
        target: &Target<'_>,
        gbuffer: &GBuffer,
        scratch: &mut TileScratch<'a>,
        edges: &mut [u16; BLOCKS],
    ) -> (u64, u64) {
        let (tile, listing) = (target.tile, &self.tiles.listing);
        let (mut stepped, mut deep) = (0, 0);
        let thin = gbuffer.marks(tile).thin;
        let Some((begins, reach)) = gbuffer.edges(tile).filter(|_| thin != 0) else { return (stepped, deep) };
        let neighbourhood = &mut scratch.neighbourhood;
        // Pixels outside the image are at −∞, so that they are never behind a pixel's surface.
        neighbourhood.load(begins, &listing.grid, tile, |tile| gbuffer.marks(tile), 1, f32::NEG_INFINITY);
        neighbourhood.steps(simd, reach, thin, edges);
        let infinite = Lanes::splat(simd, f32::INFINITY);
        for block in ones(thin).map(|block| block as u32) {
            let own = &mut edges[block as usize % BLOCKS];
            if *own != 0 {
                *own &= target.rect.lanes_of_block(listing.grid.block_px(tile, block)) as u16;
                let has_threshold = gbuffer.threshold(simd, tile, block).lt(infinite).to_bitmask() as u16;
                stepped |= u64::from(*own != 0) << block;
                deep |= u64::from(*own & has_threshold != 0) << block;
            }
        }
        (stepped, deep)
    }

    /// Draws outlines or eye-dome lighting over a tile. If either is drawn, the scratch's neighbourhood contains the
    /// tile's depths afterwards.
    #[inline(always)]
    fn draw_over<S: Simd>(&self, simd: S, target: &mut Target<'_>, gbuffer: &GBuffer, scratch: &mut TileScratch<'a>) {
        let (tile, listing) = (target.tile, &self.tiles.listing);
        let (first, touched) = (listing.grid.block_px(tile, 0), gbuffer.marks(tile).touched);
        let neighbourhood = &mut scratch.neighbourhood;
        let marks = |tile| gbuffer.marks(tile);
        if touched == 0 {
            return;
        }
        if self.tiles.lighting.shader == Shader::Edl && gbuffer.has_depths() {
            neighbourhood.load(gbuffer.depths(), &listing.grid, tile, marks, eye_dome::REACH_PX, EyeDome::OUTSIDE);
            EyeDome::new(neighbourhood, self.tiles.lighting.projection()).darken(simd, target, touched, first);
        }
        let Some((depths, limits)) = gbuffer.lines(tile) else { return };
        let mut lines = [0u16; BLOCKS];
        neighbourhood.load(depths, &listing.grid, tile, marks, 1, f32::NEG_INFINITY);
        neighbourhood.steps(simd, limits, touched, &mut lines);
        for (block, &line) in (0..).zip(&lines).filter(|(_, line)| **line != 0) {
            target.blacken(listing.grid.block_px(tile, block), line);
        }
    }

    /// Returns the surfaces behind the edge pixels of a block, their colours over the background, and the mask of edge
    /// pixels. Pixels with a polygon at or before their depth threshold aren't edge pixels, because splats are blended
    /// over polygons anyway (rendering model §6). `edges` has the bits of candidate pixels; `deep` is true if one of
    /// them has a depth threshold.
    #[inline(always)]
    fn behind<S: Simd>(
        &self,
        simd: S,
        (tile, block): (usize, u32),
        (edges, deep): (u16, bool),
        gbuffer: &GBuffer,
        scratch: &mut TileScratch<'a>,
        counters: &mut Counters,
    ) -> (Shaded<S>, [Lanes<S>; 4], mask32x16<S>) {
        let (job, lighting) = (&self.tiles, self.tiles.lighting);
        let at = job.listing.grid.block_px(tile, block);
        let threshold = gbuffer.threshold(simd, tile, block);
        let infinite = Lanes::splat(simd, f32::INFINITY);
        let mut edge = mask32x16::from_bitmask(simd, edges.into());
        let mut sums = Sums::new(simd);
        if deep {
            let filter = BehindDepth { depth: threshold, pixels: edge & threshold.lt(infinite) };
            block::draw(
                simd,
                scratch.lists.splats.of(simd, block),
                at,
                &job.inputs,
                filter,
                &mut scratch.block,
                &mut sums,
            );
            counters.block_pairs += u64::from(sums.tested);
            counters.inside += u64::from(sums.inside);
        }
        let mut shaded = lit(simd, lighting, divided(simd, lighting, &sums), at);
        let triangles = scratch.lists.triangles.of(block);
        if !triangles.is_empty() {
            let nearest = triangles::nearest(simd, triangles, at, job.inputs.frame.constants.depth_range());
            edge &= !(nearest.z.le(threshold) & nearest.z.lt(infinite));
            let before = nearest.z.lt(Lanes::select(shaded.covered, shaded.z, infinite));
            // Behind a pixel without a depth threshold there is only the background.
            let mask = edge & before & threshold.lt(infinite);
            if mask.to_bitmask() != 0 {
                let surface = nearest.surface(simd, triangles, self.extras.meshes, at, mask);
                shaded = lit(simd, lighting, surface, at).or(&shaded);
            }
        }
        if lighting.shader == Shader::Edl && gbuffer.has_depths() {
            let (x, y) = job.listing.grid.block_px(tile, 0);
            let dome = EyeDome::new(&scratch.neighbourhood, lighting.projection());
            shaded.color = shaded.color * dome.of_block(simd, (at.0 - x, at.1 - y), shaded.z);
        }
        counters.edge_pixels += u64::from(edge.to_bitmask().count_ones());
        (shaded, shaded.over_background(simd, lighting.background_color(), sums.fragments).color, edge)
    }
}
