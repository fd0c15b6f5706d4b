//! Tiles of frames with more than opaque splats: polygons (§6), transparent layers (§8), and what needs a second look, edges and
//! lines (§5). A frame without any of them is drawn by `tile` alone.

use crate::between::Between;
use crate::eye_dome::Dome;
use crate::lanes::Lanes;
use crate::level::{Instructions, with_instructions};
use crate::limit::{Behind, Unlimited};
use crate::lists::ItemLists;
use crate::mesh::{ScreenTriangle, StoredMesh, TriangleSegment};
use crate::planes::{BLOCKS, NeighbourPlanes, TilePlanes};
use crate::polygon;
use crate::raster::{self, Sums};
use crate::shade::{self, Pixels, Shaded};
use crate::target::TileTarget;
use crate::tile::{Counters, TileJob, TileScratch};
use crate::veil::{Layers, VeilBlock, VeilScratch, VeilSegment, Veiled};
use crate::window::Window;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::kernel::FULL_COVERAGE;
use surfel_math::{Real, eye_dome};
use surfel_model::Shader;

/// What a frame has besides opaque splats.
pub(crate) struct Extras<'a> {
    pub meshes: &'a [StoredMesh],
    pub triangles: &'a [TriangleSegment],
    pub veils: &'a [VeilSegment],
    pub layers: Layers,
}

/// All tiles of such a frame.
pub(crate) struct CompositeJob<'a> {
    pub tiles: TileJob<'a>,
    pub extras: Extras<'a>,
    /// Nothing but opaque splats is drawn.
    pub plain: bool,
}

/// What a thread reuses from tile to tile.
pub(crate) struct CompositeScratch<'a> {
    pub triangles: ItemLists<&'a ScreenTriangle>,
    veils: ItemLists<Veiled<'a>>,
    veil: VeilScratch,
    window: Box<Window>,
}

impl Default for CompositeScratch<'_> {
    fn default() -> Self {
        let (triangles, veils) = (ItemLists::new(), ItemLists::new());
        Self { triangles, veils, veil: VeilScratch::default(), window: Window::new() }
    }
}

impl CompositeScratch<'_> {
    /// The same memory, for tiles of other things.
    pub(crate) fn for_others<'b>(self) -> CompositeScratch<'b> {
        let Self { triangles, veils, veil, window } = self;
        CompositeScratch { triangles: triangles.for_others(), veils: veils.for_others(), veil, window }
    }
}

/// The opaque surfaces of a block.
struct Front<S: Simd> {
    sums: Sums<S>,
    /// Depth of the nearest polygons, whatever hides them, where the block has any.
    polygon: Option<Lanes<S>>,
    shaded: Shaded<S>,
    /// +∞ where nothing is.
    opaque_depth: Lanes<S>,
}

/// Fills the lists of the `wanted` blocks of a tile with triangles, in scene order; which blocks have any.
pub(crate) fn list_triangles<'a>(
    segments: &'a [TriangleSegment],
    tile: usize,
    wanted: u64,
    lists: &mut ItemLists<&'a ScreenTriangle>,
) -> u64 {
    lists.clear();
    for segment in segments {
        for entry in segment.lists.of(tile) {
            lists.push(&segment.triangles[entry.record as usize], entry.blocks & wanted);
        }
    }
    lists.finish()
}

impl<'a> CompositeJob<'a> {
    fn is_empty(&self, tile: usize) -> bool {
        self.tiles.listing.is_empty(tile)
            && self.extras.triangles.iter().all(|s| s.lists.of(tile).is_empty())
            && self.extras.veils.iter().all(|s| s.segment.of(tile).is_empty())
    }

    fn list_veils(&self, tile: usize, wanted: u64, lists: &mut ItemLists<Veiled<'a>>) -> u64 {
        lists.clear();
        for VeilSegment { segment, splats } in self.extras.veils {
            for entry in segment.of(tile) {
                let i = entry.record as usize;
                let veiled = Veiled { record: &segment.records[i], splat: &splats[i] };
                lists.push(veiled, entry.blocks & wanted);
            }
        }
        lists.finish()
    }

    /// Draws a tile, transparent layers included unless a second look comes first.
    ///
    /// The one place where the tiles' loops are called from: all that they do is inlined into them, once for each level.
    #[inline(never)]
    pub(crate) fn draw(
        &self,
        instructions: Instructions,
        target: &mut TileTarget<'_>,
        planes: Option<&mut TilePlanes<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        if self.plain {
            with_instructions!(instructions, simd => simd.vectorize(#[inline(always)] || self.tiles.draw(simd, target, planes, scratch)))
        } else {
            with_instructions!(instructions, simd => simd.vectorize(#[inline(always)] || self.draw_all(simd, target, planes, scratch)))
        }
    }

    #[inline(always)]
    fn draw_all<S: Simd>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        mut planes: Option<&mut TilePlanes<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let (tile, background) = (target.tile, self.tiles.lighting.background);
        let is_empty = self.is_empty(tile);
        if let Some(planes) = &mut planes {
            planes.begin(is_empty);
        }
        if is_empty {
            target.fill_empty(background);
            return counters;
        }
        let mut left = self.tiles.listing.blocks(tile);
        self.tiles.listing.list(tile, left, &mut scratch.lists);
        let with_triangles = list_triangles(self.extras.triangles, tile, left, &mut scratch.composite.triangles);
        let opaque = scratch.lists.touched() | with_triangles;
        let veiled = if planes.is_none() { self.list_veils(tile, left, &mut scratch.composite.veils) } else { 0 };
        let mut kept = i32x16::splat(simd, 0);
        while left != 0 {
            let block = left.trailing_zeros();
            left &= left - 1;
            let at = self.tiles.listing.block_px(tile, block);
            if (opaque | veiled) >> block & 1 == 0 {
                target.put_empty(self.tiles.listing.block_px(tile, 0), 1 << block, background);
                continue;
            }
            let front = self.front(simd, block, at, scratch);
            counters.block_pairs += u64::from(front.sums.tested);
            counters.inside += u64::from(front.sums.inside);
            let mut pixels = front.shaded.over_background(simd, self.tiles.lighting, front.sums.fragments);
            if let Some(planes) = &mut planes {
                self.put_planes(simd, planes, (block, at), &front);
            } else if veiled >> block & 1 != 0 {
                pixels = self.veil(simd, block, at, front.opaque_depth, scratch, &mut counters).over(&pixels);
            }
            let counts: i32x16<S> = pixels.fragments.0.to_int();
            kept += counts * target.rect.lanes_inside(simd, at);
            target.put(at, &pixels);
        }
        counters.kept = kept.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }

    /// What is opaque in a block: splats, polygons, or the ones blended over the others.
    #[inline(always)]
    fn front<S: Simd>(&self, simd: S, block: u32, at: (i32, i32), scratch: &mut TileScratch<'a>) -> Front<S> {
        let (job, lighting) = (&self.tiles, self.tiles.lighting);
        let (splats, triangles) = (scratch.lists.of(simd, block), scratch.composite.triangles.of(block));
        let infinite = Lanes::splat(simd, f32::INFINITY);
        if triangles.is_empty() && splats.is_empty() {
            let sums = Sums::new(simd);
            return Front { sums, polygon: None, shaded: Shaded::nothing(simd), opaque_depth: infinite };
        }
        let mut polygon = None;
        let mut sums = Sums::new(simd);
        if triangles.is_empty() {
            raster::block(simd, splats, at, &job.shared, Unlimited, &mut scratch.block, &mut sums);
        } else {
            let nearest = polygon::nearest(simd, triangles, at, job.shared.wants.exists());
            let mut shown = nearest.z;
            let limit = Between { polygon: &mut shown };
            raster::block(simd, splats, at, &job.shared, limit, &mut scratch.block, &mut sums);
            polygon = Some((nearest, shown));
        }
        let mut shaded = shade::lit(simd, lighting, shade::divided(simd, lighting, &sums), at);
        let mut opaque_depth = Lanes::select(shaded.covered, shaded.z, infinite);
        let polygon_z = polygon.as_ref().map(|(nearest, _)| nearest.z);
        if let Some((nearest, shown)) = polygon {
            let mask = shown.lt(infinite);
            if mask.to_bitmask() != 0 {
                let surface = nearest.surface(simd, triangles, self.extras.meshes, at, mask);
                let behind = shade::lit(simd, lighting, surface, at);
                let share = (sums.coverage * shown.constant(1.0 / FULL_COVERAGE)).min(shown.one());
                shaded = shaded.blended_over(&behind, share);
                opaque_depth = opaque_depth.min(shown);
            }
        }
        Front { sums, polygon: polygon_z, shaded, opaque_depth }
    }

    #[inline(always)]
    fn put_planes<S: Simd>(
        &self,
        simd: S,
        planes: &mut TilePlanes<'_>,
        (block, at): (u32, (i32, i32)),
        front: &Front<S>,
    ) {
        let infinite = Lanes::splat(simd, f32::INFINITY);
        planes.put_edges(block, &front.sums, front.polygon);
        planes.put_opaque(block, front.opaque_depth);
        planes.put_depth(block, Lanes::select(front.shaded.covered, front.shaded.z, infinite));
        if planes.want_limit() {
            let limit = shade::line_limit(simd, self.tiles.lighting, &front.shaded, at);
            planes.put_limit(block, Lanes::select(front.shaded.covered, limit, infinite));
        }
    }

    /// A block's transparent layers.
    #[inline(always)]
    fn veil<S: Simd>(
        &self,
        simd: S,
        block: u32,
        at: (i32, i32),
        opaque_depth: Lanes<S>,
        scratch: &mut TileScratch<'a>,
        counters: &mut Counters,
    ) -> crate::veil::Veil<S> {
        let CompositeScratch { veils, veil, .. } = &mut scratch.composite;
        let (shared, lighting) = (&self.tiles.shared, self.tiles.lighting);
        let veil =
            VeilBlock { simd, list: veils.of(block), at, shared, lighting, layers: self.extras.layers, opaque_depth }
                .draw(veil);
        counters.block_pairs += u64::from(veil.tested);
        counters.inside += u64::from(veil.inside);
        veil
    }

    /// [`Self::finish`] by these instructions.
    #[inline(never)]
    pub(crate) fn finish_on(
        &self,
        instructions: Instructions,
        target: &mut TileTarget<'_>,
        planes: &NeighbourPlanes,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        with_instructions!(instructions, simd => simd.vectorize(#[inline(always)] || self.finish(simd, target, planes, scratch)))
    }

    /// A second look at a tile: lines or eye-dome lighting, then edges with what lies behind them, then transparent layers before all
    /// of it.
    #[inline(always)]
    fn finish<S: Simd>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        planes: &NeighbourPlanes,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let tile = target.tile;
        if self.is_empty(tile) {
            return counters;
        }
        let listing = &self.tiles.listing;
        let mut edges = [0u16; BLOCKS];
        let (stepped, deep) = self.edges(simd, target, planes, scratch, &mut edges);
        self.draw_over(simd, target, planes, scratch);
        let veiled = self.list_veils(tile, listing.blocks(tile), &mut scratch.composite.veils);
        if stepped != 0 {
            listing.list_some(tile, deep, &mut scratch.lists);
            list_triangles(self.extras.triangles, tile, stepped, &mut scratch.composite.triangles);
        }
        let mut added = i32x16::splat(simd, 0);
        let mut wanted = stepped | veiled;
        while wanted != 0 {
            let block = wanted.trailing_zeros();
            wanted &= wanted - 1;
            let at = listing.block_px(tile, block);
            let mut color = target.color(simd, at);
            if stepped >> block & 1 != 0 {
                let edges = (edges[block as usize % BLOCKS], deep >> block & 1 != 0);
                let (behind, edge) = self.behind(simd, (tile, block), edges, planes, scratch, &mut counters);
                let q = planes.coverage(simd, tile, block);
                let q = q.min(q.one());
                for (front, behind) in color.iter_mut().zip(behind) {
                    *front = Lanes::select(edge, q.mul_add(*front, (q.one() - q) * behind), *front);
                }
            }
            if veiled >> block & 1 == 0 {
                target.put_color(at, color);
                continue;
            }
            let veil = self.veil(simd, block, at, planes.opaque(simd, tile, block), scratch, &mut counters);
            let counts: i32x16<S> = veil.fragments.0.to_int();
            added += counts * target.rect.lanes_inside(simd, at);
            let behind = Pixels { color, ..target.get(simd, at) };
            target.put(at, &veil.over(&behind));
        }
        counters.kept = added.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }

    /// A tile's edge pixels that may show what lies behind them: bits of each block's; the blocks that have any, and those of them
    /// where anything is kept.
    #[inline(always)]
    fn edges<S: Simd>(
        &self,
        simd: S,
        target: &TileTarget<'_>,
        planes: &NeighbourPlanes,
        scratch: &mut TileScratch<'a>,
        edges: &mut [u16; BLOCKS],
    ) -> (u64, u64) {
        let (tile, listing) = (target.tile, &self.tiles.listing);
        let (mut stepped, mut deep) = (0, 0);
        let mut left = planes.marks(tile).thin;
        let Some((begins, reach)) = planes.edges(tile).filter(|_| left != 0) else { return (stepped, deep) };
        let window = &mut scratch.composite.window;
        // −∞ is never behind anything.
        window.look((begins, &listing.grid, tile), |tile| planes.marks(tile), 1, f32::NEG_INFINITY);
        window.steps(simd, reach, left, edges);
        let infinite = Lanes::splat(simd, f32::INFINITY);
        while left != 0 {
            let block = left.trailing_zeros();
            left &= left - 1;
            let own = &mut edges[block as usize % BLOCKS];
            if *own != 0 {
                *own &= target.rect.lanes_of_block(listing.block_px(tile, block)) as u16;
                let kept = planes.kept(simd, tile, block).lt(infinite).to_bitmask() as u16;
                stepped |= u64::from(*own != 0) << block;
                deep |= u64::from(*own & kept != 0) << block;
            }
        }
        (stepped, deep)
    }

    /// Lines, or eye-dome lighting, over what a tile shows. The window then has its depths.
    #[inline(always)]
    fn draw_over<S: Simd>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        planes: &NeighbourPlanes,
        scratch: &mut TileScratch<'a>,
    ) {
        let (tile, listing) = (target.tile, &self.tiles.listing);
        let (first, touched) = (listing.block_px(tile, 0), planes.marks(tile).touched);
        let window = &mut scratch.composite.window;
        let marks = |tile| planes.marks(tile);
        if touched == 0 {
            return;
        }
        if self.tiles.lighting.shader == Shader::Edl && planes.has_depths() {
            window.look((planes.depths(), &listing.grid, tile), marks, eye_dome::REACH_PX, Dome::OUTSIDE);
            Dome::new(window, self.tiles.lighting.projection()).darken(simd, target, touched, first);
        }
        let Some((depths, limits)) = planes.lines(tile) else { return };
        let mut lines = [0u16; BLOCKS];
        window.look((depths, &listing.grid, tile), marks, 1, f32::NEG_INFINITY);
        window.steps(simd, limits, touched, &mut lines);
        for (block, &line) in (0..).zip(&lines).filter(|(_, line)| **line != 0) {
            target.blacken(listing.block_px(tile, block), line);
        }
    }

    /// What lies behind a block's edges, and which pixels are edges: none that a polygon covers, which splats are blended over
    /// anyway (§6). With the bits of what may be an edge comes whether anything is kept there.
    #[inline(always)]
    fn behind<S: Simd>(
        &self,
        simd: S,
        (tile, block): (usize, u32),
        (edges, deep): (u16, bool),
        planes: &NeighbourPlanes,
        scratch: &mut TileScratch<'a>,
        counters: &mut Counters,
    ) -> ([Lanes<S>; 4], mask32x16<S>) {
        let (job, lighting) = (&self.tiles, self.tiles.lighting);
        let at = job.listing.block_px(tile, block);
        let kept = planes.kept(simd, tile, block);
        let infinite = Lanes::splat(simd, f32::INFINITY);
        let mut edge = mask32x16::from_bitmask(simd, edges.into());
        let mut sums = Sums::new(simd);
        if deep {
            let limit = Behind { depth: kept, pixels: edge & kept.lt(infinite) };
            raster::block(simd, scratch.lists.of(simd, block), at, &job.shared, limit, &mut scratch.block, &mut sums);
            counters.block_pairs += u64::from(sums.tested);
            counters.inside += u64::from(sums.inside);
        }
        let mut shaded = shade::lit(simd, lighting, shade::divided(simd, lighting, &sums), at);
        let triangles = scratch.composite.triangles.of(block);
        if !triangles.is_empty() {
            let nearest = polygon::nearest(simd, triangles, at, job.shared.wants.exists());
            edge &= !(nearest.z.le(kept) & nearest.z.lt(infinite));
            let before = nearest.z.lt(Lanes::select(shaded.covered, shaded.z, infinite));
            // Where nothing is kept the background alone lies behind.
            let mask = edge & before & kept.lt(infinite);
            if mask.to_bitmask() != 0 {
                let surface = nearest.surface(simd, triangles, self.extras.meshes, at, mask);
                shaded = shade::lit(simd, lighting, surface, at).or(&shaded);
            }
        }
        if lighting.shader == Shader::Edl && planes.has_depths() {
            let (x, y) = job.listing.block_px(tile, 0);
            let dome = Dome::new(&scratch.composite.window, lighting.projection());
            shaded.color = shaded.color * dome.of_block(simd, (at.0 - x, at.1 - y), shaded.z);
        }
        counters.edge_pixels += u64::from(edge.to_bitmask().count_ones());
        (shaded.over_background(simd, lighting, sums.fragments).color, edge)
    }
}
