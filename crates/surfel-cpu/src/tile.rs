//! One tile: lists of its blocks' splats, then block after block from visibility to finished pixels.

use crate::bins::{BLOCK, Grid, Segment, TILE_BLOCKS};
use crate::edge::EdgePlanes;
use crate::lanes::{LANES, Lanes};
use crate::lists::BlockLists;
use crate::raster::{self, Scratch, Shared};
use crate::shade::{self, Lighting};
use crate::target::{Rect, Rows, TileTarget, put_plane};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16};

/// What was counted while tiles were drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counters {
    /// Pairs of block and splat that were computed.
    pub block_pairs: u64,
    /// Fragments inside a filtered footprint.
    pub inside: u64,
    /// Fragments that contributed to a pixel.
    pub kept: u64,
    /// Edge pixels that were blended.
    pub edge_pixels: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, o: Self) {
        self.block_pairs += o.block_pairs;
        self.inside += o.inside;
        self.kept += o.kept;
        self.edge_pixels += o.edge_pixels;
    }
}

/// What a thread reuses from tile to tile.
pub(crate) struct TileScratch<'a> {
    lists: BlockLists<'a>,
    block: Box<Scratch>,
}

impl TileScratch<'_> {
    pub(crate) fn new() -> Self {
        Self { lists: BlockLists::default(), block: Scratch::new() }
    }
}

/// All tiles of a frame.
pub(crate) struct TileJob<'a> {
    pub segments: &'a [Segment],
    pub grid: Grid,
    pub shared: Shared<'a>,
    pub lighting: &'a Lighting,
}

/// The planes of edge antialiasing inside a tile.
pub(crate) struct EdgeRows<'a> {
    pub kept: Rows<'a, f32>,
    pub epsilon: Rows<'a, f32>,
    pub coverage: Rows<'a, f32>,
}

impl<'a> TileJob<'a> {
    /// First pixel of a block of a tile.
    fn block_px(&self, tile: usize, block: u32) -> (i32, i32) {
        let size = self.grid.tile_px();
        let [x, y] = [tile as u32 % self.grid.columns, tile as u32 / self.grid.columns];
        let px = |tile: u32, axis: usize, block: u32| (self.grid.origin[axis] + tile * size + block * BLOCK) as i32;
        (px(x, 0, block % TILE_BLOCKS), px(y, 1, block / TILE_BLOCKS))
    }

    /// Blocks of a tile as bits: those with pixels of the region.
    fn blocks(&self, tile: usize) -> u64 {
        let rect = Rect::of_tile(&self.grid, tile, self.grid.region);
        let (x, y) = self.block_px(tile, 0);
        let block = |px: i32| (px.max(0) as u32).div_ceil(BLOCK);
        let (x0, y0) = ((rect.x - x) as u32 / BLOCK, (rect.y - y) as u32 / BLOCK);
        let row = (1u64 << block(rect.end_x - x)) - (1u64 << x0);
        (y0..block(rect.end_y - y)).fold(0, |bits, y| bits | row << (TILE_BLOCKS * y))
    }

    /// Fills the lists of the `wanted` blocks.
    #[inline(always)]
    fn list(&self, tile: usize, wanted: u64, lists: &mut BlockLists<'a>) {
        lists.clear();
        for segment in self.segments {
            lists.extend(&segment.records, segment.of(tile), wanted);
        }
        lists.finish();
    }

    /// Draws a tile.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        mut edges: Option<&mut EdgeRows<'_>>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let tile = target.tile;
        if self.segments.iter().all(|s| s.of(tile).is_empty()) {
            target.fill_empty(self.lighting.background);
            return counters;
        }
        let mut kept = i32x16::splat(simd, 0);
        let mut left = self.blocks(tile);
        self.list(tile, left, &mut scratch.lists);
        while left != 0 {
            let block = left.trailing_zeros();
            left &= left - 1;
            let at = self.block_px(tile, block);
            let list = scratch.lists.of(block);
            if list.records.is_empty() {
                target.put_empty(at, self.lighting.background);
                continue;
            }
            let sums = raster::block(simd, list, at, &self.shared, None, &mut scratch.block);
            counters.block_pairs += u64::from(sums.tested);
            counters.inside += u64::from(sums.inside);
            kept += sums.fragments.0.to_int::<i32x16<S>>() * target.rect.lanes_inside(simd, at);
            let pixels = shade::resolve(simd, self.lighting, &sums, at);
            target.put(at, &pixels);
            if let Some(edges) = &mut edges {
                put_plane(&mut edges.kept, at, sums.kept);
                put_plane(&mut edges.epsilon, at, sums.kept_epsilon);
                put_plane(&mut edges.coverage, at, sums.coverage);
            }
        }
        counters.kept = kept.to_array().iter().map(|&count| u64::from(count.unsigned_abs())).sum();
        counters
    }

    /// Blends what lies behind into a tile's edge pixels (§5).
    #[inline(always)]
    pub(crate) fn blend_edges<S: Simd>(
        &self,
        simd: S,
        target: &mut TileTarget<'_>,
        planes: &EdgePlanes,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let mut counters = Counters::default();
        let tile = target.tile;
        if self.segments.iter().all(|s| s.of(tile).is_empty()) {
            return counters;
        }
        let mut edges = [0u16; (TILE_BLOCKS * TILE_BLOCKS) as usize];
        let mut wanted = 0u64;
        let mut left = self.blocks(tile);
        while left != 0 {
            let block = left.trailing_zeros();
            left &= left - 1;
            let at = self.block_px(tile, block);
            let bits = planes.edges(simd, at) & target.rect.lanes_of_block(at);
            edges[block as usize] = bits as u16;
            wanted |= u64::from(bits != 0) << block;
        }
        if wanted == 0 {
            return counters;
        }
        self.list(tile, wanted, &mut scratch.lists);
        while wanted != 0 {
            let block = wanted.trailing_zeros();
            wanted &= wanted - 1;
            let at = self.block_px(tile, block);
            let list = scratch.lists.of(block);
            let behind = planes.kept(simd, at);
            let sums = raster::block(simd, list, at, &self.shared, Some(behind), &mut scratch.block);
            counters.block_pairs += u64::from(sums.tested);
            let pixels = shade::resolve(simd, self.lighting, &sums, at);
            let bits = edges[block as usize];
            counters.edge_pixels += u64::from(bits.count_ones());
            blend(target, at, bits, &arrays(pixels.color), planes);
        }
        counters
    }
}

/// colour = min(1, q)·front + (1 − min(1, q))·behind, at the pixels of `bits`.
fn blend(target: &mut TileTarget<'_>, (x, y): (i32, i32), bits: u16, behind: &[[f32; 16]; 4], planes: &EdgePlanes) {
    for j in 0..4 {
        let row: [[f32; 4]; 4] = std::array::from_fn(|i| {
            let (px, py, lane) = (x + i as i32, y + j as i32, 4 * j + i);
            let front = target.color.get(px, py).unwrap_or_default();
            if bits >> lane & 1 == 0 {
                return front;
            }
            let q = planes.coverage_at(px, py).min(1.0);
            std::array::from_fn(|c| q.mul_add(front[c], (1.0 - q) * behind[c][lane]))
        });
        if bits >> (4 * j) & 0xf != 0 {
            target.color.put((x, y + j as i32), row);
        }
    }
}

#[inline(always)]
fn arrays<S: Simd>([r, g, b, a]: [Lanes<S>; 4]) -> [[f32; LANES]; 4] {
    [r.to_array(), g.to_array(), b.to_array(), a.to_array()]
}
