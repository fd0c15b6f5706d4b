//! Tiles of frames with more than opaque splats: polygons (§6), transparent layers (§8), and what needs a second look, edges and
//! lines (§5). A frame without any of them is drawn by `tile` alone.

use crate::between::Between;
use crate::bins::TILE_BLOCKS;
use crate::eye_dome;
use crate::lanes::Lanes;
use crate::level::{Instructions, with_instructions};
use crate::lists::ItemLists;
use crate::mesh::{ScreenTriangle, StoredMesh, TriangleSegment};
use crate::planes::{NeighbourPlanes, NeighbourRows};
use crate::polygon;
use crate::raster::{self, Behind, Sums, Unlimited};
use crate::shade::{self, Shaded};
use crate::target::{TileTarget, put_plane};
use crate::tile::{Counters, TileJob, TileScratch};
use crate::veil::{Layers, VeilBlock, VeilScratch, VeilSegment, Veiled};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::Real;
use surfel_math::kernel::FULL_COVERAGE;
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
}

impl CompositeScratch<'_> {
    pub(crate) fn new() -> Self {
        Self { triangles: ItemLists::new(), veils: ItemLists::new(), veil: VeilScratch::default() }
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
        planes: Option<&mut NeighbourRows<'_>>,
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
        mut planes: Option<&mut NeighbourRows<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let (tile, background) = (target.tile, self.tiles.lighting.background);
        if self.is_empty(tile) {
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
                target.put_empty(at, background);
                continue;
            }
            let front = self.front(simd, block, at, scratch);
            counters.block_pairs += u64::from(front.sums.tested);
            counters.inside += u64::from(front.sums.inside);
            let mut pixels = front.shaded.over_background(simd, self.tiles.lighting, front.sums.fragments);
            if let Some(planes) = &mut planes {
                self.put_planes(simd, planes, at, &front);
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
        let (splats, triangles) = (scratch.lists.of(block), scratch.composite.triangles.of(block));
        let infinite = Lanes::splat(simd, f32::INFINITY);
        if triangles.is_empty() && splats.records.is_empty() {
            let sums = Sums::new(simd);
            return Front { sums, polygon: None, shaded: Shaded::nothing(simd), opaque_depth: infinite };
        }
        let mut polygon = None;
        let sums = if triangles.is_empty() {
            raster::block(simd, splats, at, &job.shared, Unlimited, &mut scratch.block)
        } else {
            let nearest = polygon::nearest(simd, triangles, at, job.shared.wants.exists());
            let mut shown = nearest.z;
            let limit = Between { polygon: &mut shown };
            let sums = raster::block(simd, splats, at, &job.shared, limit, &mut scratch.block);
            polygon = Some((nearest, shown));
            sums
        };
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
    fn put_planes<S: Simd>(&self, simd: S, planes: &mut NeighbourRows<'_>, at: (i32, i32), front: &Front<S>) {
        planes.put_edges(at, &front.sums, front.polygon);
        put_plane(&mut planes.opaque, at, front.opaque_depth);
        if !planes.depth.is_empty() {
            let infinite = Lanes::splat(simd, f32::INFINITY);
            let or_nothing = |v| Lanes::select(front.shaded.covered, v, infinite);
            put_plane(&mut planes.depth, at, or_nothing(front.shaded.z));
            if !planes.limit.is_empty() {
                let limit = shade::line_limit(simd, self.tiles.lighting, &front.shaded, at);
                put_plane(&mut planes.limit, at, or_nothing(limit));
            }
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
        veil
    }

    /// A second look at a tile: lines, then edges with what lies behind them, then transparent layers before all of it.
    #[inline(always)]
    pub(crate) fn finish<S: Simd>(
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
        const BLOCKS: usize = (TILE_BLOCKS * TILE_BLOCKS) as usize;
        let (mut lines, mut edges) = ([0u16; BLOCKS], [0u16; BLOCKS]);
        let (mut wanted, mut behind, mut domed) = (0u64, 0u64, 0u64);
        let infinite = Lanes::splat(simd, f32::INFINITY);
        let all = self.tiles.listing.blocks(tile);
        let mut left = all;
        while left != 0 {
            let block = left.trailing_zeros();
            left &= left - 1;
            let at = self.tiles.listing.block_px(tile, block);
            let inside = target.rect.lanes_of_block(at);
            lines[block as usize] = (planes.lines(simd, at) & inside) as u16;
            edges[block as usize] = (planes.edges(simd, at) & inside) as u16;
            wanted |= u64::from(lines[block as usize] != 0) << block;
            behind |= u64::from(edges[block as usize] != 0) << block;
            if self.tiles.lighting.shader == Shader::Edl {
                domed |= u64::from(planes.depth(simd, at).lt(infinite).to_bitmask() & inside != 0) << block;
            }
        }
        let veiled = self.list_veils(tile, all, &mut scratch.composite.veils);
        wanted |= behind | veiled | domed;
        if wanted == 0 {
            return counters;
        }
        self.tiles.listing.list(tile, behind, &mut scratch.lists);
        list_triangles(self.extras.triangles, tile, behind, &mut scratch.composite.triangles);
        let mut added = i32x16::splat(simd, 0);
        while wanted != 0 {
            let block = wanted.trailing_zeros();
            wanted &= wanted - 1;
            let at = self.tiles.listing.block_px(tile, block);
            let (lines, edges) = (lines[block as usize], edges[block as usize]);
            let mut pixels = target.get(simd, at);
            if domed >> block & 1 != 0 {
                let z = planes.depth(simd, at);
                let bright = self.brightness(simd, planes, at, z);
                for c in &mut pixels.color[..3] {
                    *c = Lanes::select(z.lt(infinite), *c * bright, *c);
                }
            }
            if lines != 0 {
                let line = mask32x16::from_bitmask(simd, lines.into());
                for c in &mut pixels.color[..3] {
                    *c = Lanes::select(line, c.zero(), *c);
                }
            }
            if edges != 0 {
                let (color, edge) = self.behind(simd, (block, edges), at, planes, scratch, &mut counters);
                let q = planes.coverage(simd, at);
                let q = q.min(q.one());
                for (front, behind) in pixels.color.iter_mut().zip(color) {
                    *front = Lanes::select(edge, q.mul_add(*front, (q.one() - q) * behind), *front);
                }
            }
            if veiled >> block & 1 != 0 {
                let veil = self.veil(simd, block, at, planes.opaque(simd, at), scratch, &mut counters);
                let counts: i32x16<S> = veil.fragments.0.to_int();
                added += counts * target.rect.lanes_inside(simd, at);
                pixels = veil.over(&pixels);
            }
            target.put(at, &pixels);
        }
        counters.kept = added.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }

    /// How bright depths are among the front surfaces about a block (§5, `edl`).
    #[inline(always)]
    fn brightness<S: Simd>(&self, simd: S, planes: &NeighbourPlanes, at: (i32, i32), z: Lanes<S>) -> Lanes<S> {
        eye_dome::among_neighbours(simd, planes, self.tiles.lighting.projection(), at, z)
    }

    /// What lies behind a block's edges, and which pixels are edges: none that a polygon covers, which splats are blended over
    /// anyway (§6).
    #[inline(always)]
    fn behind<S: Simd>(
        &self,
        simd: S,
        (block, edges): (u32, u16),
        at: (i32, i32),
        planes: &NeighbourPlanes,
        scratch: &mut TileScratch<'a>,
        counters: &mut Counters,
    ) -> ([Lanes<S>; 4], mask32x16<S>) {
        let (job, lighting) = (&self.tiles, self.tiles.lighting);
        let kept = planes.kept(simd, at);
        let mut edge = mask32x16::from_bitmask(simd, edges.into());
        let splats = scratch.lists.of(block);
        let sums = raster::block(simd, splats, at, &job.shared, Behind(kept), &mut scratch.block);
        counters.block_pairs += u64::from(sums.tested);
        let mut shaded = shade::lit(simd, lighting, shade::divided(simd, lighting, &sums), at);
        let triangles = scratch.composite.triangles.of(block);
        if !triangles.is_empty() {
            let infinite = Lanes::splat(simd, f32::INFINITY);
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
        if lighting.shader == Shader::Edl {
            shaded.color = shaded.color * self.brightness(simd, planes, at, shaded.z);
        }
        counters.edge_pixels += u64::from(edge.to_bitmask().count_ones());
        (shaded.over_background(simd, lighting, sums.fragments).color, edge)
    }
}
