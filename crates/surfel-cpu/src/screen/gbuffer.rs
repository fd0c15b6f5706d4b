//! The G-buffer: planes of a tile and its neighbours that screen-space passes need. The passes are edges (rendering
//! model §5, Surfel's own, after Z01 §7), outlines of the shader `toon`, eye-dome lighting, and transparent layers over
//! all of them.
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::raster::sums::Sums;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::grid::{BLOCK, Grid, TILE_BLOCKS};
use fearless_simd::Simd;
use surfel_math::Real;
use surfel_render::{FramePlan, Pass};

/// Largest number of blocks in a tile.
pub(crate) const BLOCKS: usize = (TILE_BLOCKS * TILE_BLOCKS) as usize;

/// Side of the largest tile, in pixels.
pub(crate) const SIDE: usize = (TILE_BLOCKS * BLOCK) as usize;

/// Values of a tile's pixels, row by row, for planes whose pixels are compared with their neighbours.
#[derive(Clone)]
#[repr(align(64))]
pub(crate) struct TileRows(pub [[f32; SIDE]; SIDE]);

/// Values of a tile's pixels, block by block, for planes that are read one block at a time.
#[derive(Clone)]
#[repr(align(64))]
pub(crate) struct TileBlocks([[f32; LANES]; BLOCKS]);

/// Depth range of the nearest surface in each pixel of a block, for edges by samples (rendering model §5). The end is
/// −∞ if a pixel without a polygon is covered by unfiltered footprints but not by filtered ones, or the reverse. Such a
/// pixel has a step to every neighbour.
#[derive(Clone, Copy)]
pub(crate) struct Reach<S: Simd> {
    pub begin: Lanes<S>,
    pub end: Lanes<S>,
}

impl<S: Simd> Reach<S> {
    /// Returns the depth range of splats or, in pixels where the nearest polygon begins first, that of the polygon.
    #[inline(always)]
    fn of(sums: &Sums<S>, polygon: Option<Self>) -> Self {
        let (begin, end) = (sums.writer_depth - sums.threshold_epsilon, sums.writer_depth + sums.threshold_epsilon);
        let infinite = begin.constant(f64::INFINITY);
        let (seen, there) = (begin.lt(infinite), sums.has_weight());
        let alone = (seen | there) & !(seen & there);
        let splats = Lanes::select(alone, -infinite, end);
        let Some(polygon) = polygon else { return Self { begin, end: splats } };
        let first = polygon.begin.lt(begin);
        let behind = polygon.begin.lt(infinite);
        Self {
            begin: Lanes::select(first, polygon.begin, begin),
            end: Lanes::select(first, polygon.end, Lanes::select(behind, end, splats)),
        }
    }
}

impl TileRows {
    pub(crate) const EMPTY: Self = Self([[f32::INFINITY; SIDE]; SIDE]);
    pub(crate) const ZERO: Self = Self([[0.0; SIDE]; SIDE]);

    #[inline(always)]
    pub(crate) fn put<S: Simd>(&mut self, block: u32, values: Lanes<S>) {
        let values = values.to_array();
        let (rows, _) = values.as_chunks::<4>();
        let (x, y) = ((block % TILE_BLOCKS * BLOCK) as usize, (block / TILE_BLOCKS * BLOCK) as usize);
        for (row, values) in self.0.iter_mut().skip(y).zip(rows) {
            if let Some(pixels) = row.get_mut(x..x + 4) {
                pixels.copy_from_slice(values);
            }
        }
    }
}

impl TileBlocks {
    const EMPTY: Self = Self([[0.0; LANES]; BLOCKS]);

    #[inline(always)]
    fn put<S: Simd>(&mut self, block: u32, values: Lanes<S>) {
        values.store(&mut self.0[block as usize % BLOCKS]);
    }
}

/// Flags of a tile's blocks, one bit per block.
#[derive(Clone, Copy, Default)]
pub(crate) struct Marks {
    /// Blocks that may contain opaque surfaces. In other blocks, the G-buffer's planes are undefined.
    pub touched: u64,
    /// Blocks with a pixel that has fragments and a coverage below 1, so that the surface behind would show if the
    /// pixel were at an edge. 0 unless edges are antialiased by coverage.
    pub thin: u64,
}

/// Planes of all tiles of a grid that screen-space passes read. Memory is reused between frames. Tiles and blocks that
/// no splat or polygon touches are therefore stale, and so are planes that the plan doesn't need.
#[derive(Default)]
pub(crate) struct GBuffer {
    /// Depth at which each pixel's nearest surface begins, for edge antialiasing by coverage or by samples.
    begin: Vec<TileRows>,
    /// Depth to which each pixel's own surface extends; what begins beyond it is another surface. For antialiasing by
    /// samples this is the end of the nearest surface.
    ///
    /// For antialiasing by coverage it is −∞ if the pixel has fragments but no depth threshold, and +∞ if nothing would
    /// show through an edge.
    reach: Vec<TileRows>,
    /// z + ε of the fragment that sets each pixel's depth threshold, for edge antialiasing by coverage. It exceeds the
    /// threshold where the other side of a surface limits the threshold.
    threshold: Vec<TileBlocks>,
    /// Coverage of each pixel, for edge antialiasing by coverage.
    coverage: Vec<TileBlocks>,
    /// Depth of each pixel's nearest surface, for outlines and eye-dome lighting.
    depth: Vec<TileRows>,
    /// Largest depth that a pixel's neighbour may have without an outline between the two pixels.
    limit: Vec<TileRows>,
    /// Depth of each pixel's nearest opaque surface, up to which transparent layers are visible.
    opaque: Vec<TileBlocks>,
    /// Depth of each pixel's nearest surface, up to which balls are visible.
    front: Vec<TileBlocks>,
    /// Flags of the blocks of each tile.
    marks: Vec<Marks>,
    wanted: Wanted,
}

/// Flags of the passes that need planes of the G-buffer; unneeded planes aren't written.
#[derive(Clone, Copy, Default)]
struct Wanted {
    /// True if edges are antialiased by coverage.
    edges: bool,
    /// True if edges are antialiased by samples.
    samples: bool,
    /// True if outlines of the shader `toon` are drawn.
    lines: bool,
    /// True if the shader is `edl`, eye-dome lighting.
    dome: bool,
    /// True if transparent layers are drawn, which need the depth of the opaque surface.
    opaque: bool,
    /// True if balls are drawn, which need the depth of the nearest surface.
    front: bool,
}

/// The G-buffer's planes of one tile, while the tile is drawn.
pub(crate) struct GBufferTile<'a> {
    all: &'a mut GBuffer,
    tile: usize,
}

impl GBufferTile<'_> {
    /// Resets the tile's flags and, unless the tile is empty, the planes in which pixels are compared with neighbours.
    /// Call this before any block is written. `is_empty` is true if no splat or polygon touches the tile.
    pub(crate) fn begin(&mut self, is_empty: bool) {
        let Self { all, tile } = self;
        all.marks[*tile] = Marks::default();
        if !is_empty {
            let Wanted { edges, samples, .. } = all.wanted;
            let has_depths = all.has_depths();
            for (plane, wanted) in
                [(&mut all.begin, edges || samples), (&mut all.depth, has_depths), (&mut all.reach, samples)]
            {
                if wanted {
                    plane[*tile].0.as_flattened_mut().fill(f32::INFINITY);
                }
            }
        }
    }

    /// Writes the pixels of a block into the planes that edge antialiasing reads. `sums` are the sums of the splats.
    /// `polygon` is the depth range of each pixel's nearest polygon, +∞ where there is none; `None` without polygons.
    #[inline(always)]
    pub(crate) fn put_edges<S: Simd>(&mut self, block: u32, sums: &Sums<S>, polygon: Option<Reach<S>>) {
        let Self { all, tile } = self;
        let tile = *tile;
        if all.wanted.samples {
            let reach = Reach::of(sums, polygon);
            all.marks[tile].touched |= 1 << block;
            all.begin[tile].put(block, reach.begin);
            all.reach[tile].put(block, reach.end);
        } else if all.wanted.edges {
            let begin = sums.writer_depth - sums.threshold_epsilon;
            let q = sums.coverage;
            let (never, always) = (q.constant(f64::INFINITY), q.constant(f64::NEG_INFINITY));
            let without_threshold = Lanes::select(q.zero().lt(q), always, never);
            let reach = Lanes::select(
                sums.writer_depth.lt(never),
                sums.writer_depth + sums.threshold_epsilon,
                without_threshold,
            );
            let reach = Lanes::select(q.lt(q.one()), reach, never);
            all.marks[tile].touched |= 1 << block;
            all.marks[tile].thin |= u64::from(any_below(reach, never)) << block;
            all.begin[tile].put(block, polygon.map_or(begin, |polygon| begin.min(polygon.begin)));
            all.reach[tile].put(block, reach);
            all.threshold[tile].put(block, sums.writer_depth);
            all.coverage[tile].put(block, q);
        }
    }

    /// Writes the depths of a block's nearest opaque surfaces (`opaque`) and of its nearest surfaces (`front`); +∞ for
    /// none.
    #[inline(always)]
    pub(crate) fn put_depths<S: Simd>(&mut self, block: u32, opaque: Lanes<S>, front: Lanes<S>) {
        let Self { all, tile } = self;
        all.marks[*tile].touched |= 1 << block;
        if all.wanted.opaque {
            all.opaque[*tile].put(block, opaque);
        }
        if all.wanted.front {
            all.front[*tile].put(block, front);
        }
        if all.has_depths() {
            all.depth[*tile].put(block, front);
        }
    }

    /// True if outlines are drawn, so that [`Self::put_limit`] must be called.
    pub(crate) fn want_limit(&self) -> bool {
        self.all.wanted.lines
    }

    /// Writes, for each pixel of a block, the largest depth that a neighbour may have without an outline; +∞ in empty
    /// pixels.
    #[inline(always)]
    pub(crate) fn put_limit<S: Simd>(&mut self, block: u32, limit: Lanes<S>) {
        self.all.limit[self.tile].put(block, limit);
    }
}

#[inline(always)]
fn any_below<S: Simd>(a: Lanes<S>, b: Lanes<S>) -> bool {
    use fearless_simd::prelude::SimdMask;
    a.lt(b).to_bitmask() != 0
}

impl GBuffer {
    /// Sets the planes that a plan needs, and resizes them for a grid.
    pub(crate) fn reset_for(&mut self, grid: &Grid, plan: &FramePlan) {
        self.wanted = Wanted {
            edges: plan.has(Pass::EdgeAntialiasing),
            samples: plan.has(Pass::EdgeSamples),
            lines: plan.has(Pass::Outlines),
            dome: plan.has(Pass::EyeDome),
            opaque: plan.separates_transparent,
            front: plan.has(Pass::Balls),
        };
        let Wanted { edges, samples, lines, dome, opaque, front } = self.wanted;
        let tiles = grid.tiles();
        let steps = edges || samples;
        for (plane, wanted) in [
            (&mut self.begin, steps),
            (&mut self.reach, steps),
            (&mut self.depth, lines || dome),
            (&mut self.limit, lines),
        ] {
            if wanted && plane.len() < tiles {
                plane.resize(tiles, TileRows::EMPTY);
            }
        }
        for (plane, wanted) in [
            (&mut self.threshold, edges),
            (&mut self.coverage, edges),
            (&mut self.opaque, opaque),
            (&mut self.front, front),
        ] {
            if wanted && plane.len() < tiles {
                plane.resize(tiles, TileBlocks::EMPTY);
            }
        }
        self.marks.clear();
        self.marks.resize(tiles, Marks::default());
    }

    /// Returns the heap memory that the planes use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let rows = [&self.begin, &self.reach, &self.depth, &self.limit].map(|v| size_of_val(v.as_slice()));
        let blocks = [&self.threshold, &self.coverage, &self.opaque, &self.front].map(|v| size_of_val(v.as_slice()));
        rows.iter().chain(&blocks).sum::<usize>() + size_of_val(self.marks.as_slice())
    }

    /// Returns the planes of a tile for writing.
    pub(crate) fn tile(&mut self, tile: usize) -> GBufferTile<'_> {
        GBufferTile { all: self, tile }
    }

    /// Returns the flags of a tile's blocks.
    pub(crate) fn marks(&self, tile: usize) -> Marks {
        self.marks.get(tile).copied().unwrap_or_default()
    }

    /// Returns the depths at which surfaces begin, of all tiles, and the depths to which the surfaces of tile `tile`
    /// extend. `None` unless edges are antialiased by coverage.
    pub(crate) fn edges(&self, tile: usize) -> Option<(&[TileRows], &TileRows)> {
        self.reach.get(tile).filter(|_| self.wanted.edges).map(|own| (self.begin.as_slice(), own))
    }

    /// Returns the depths at which the nearest surfaces begin and end, of all tiles. `None` unless edges are
    /// antialiased by samples.
    pub(crate) fn reaches(&self) -> Option<[&[TileRows]; 2]> {
        self.wanted.samples.then_some([&self.begin, &self.reach])
    }

    /// Returns the depths of all tiles, and the largest depths that neighbours of the pixels of tile `tile` may have
    /// without an outline. `None` unless outlines are drawn.
    pub(crate) fn lines(&self, tile: usize) -> Option<(&[TileRows], &TileRows)> {
        self.limit.get(tile).filter(|_| self.wanted.lines).map(|own| (self.depth.as_slice(), own))
    }

    /// True if the depths of nearest surfaces are stored, for outlines or eye-dome lighting.
    pub(crate) fn has_depths(&self) -> bool {
        self.wanted.lines || self.wanted.dome
    }

    /// Returns the depths of nearest surfaces of all tiles.
    pub(crate) fn depths(&self) -> &[TileRows] {
        &self.depth
    }

    /// Returns z + ε of the fragments that set the depth thresholds of a block that is touched.
    #[inline(always)]
    pub(crate) fn threshold<S: Simd>(&self, simd: S, tile: usize, block: u32) -> Lanes<S> {
        block_of(simd, &self.threshold, tile, block)
    }

    /// Returns the coverage of a block that is touched.
    #[inline(always)]
    pub(crate) fn coverage<S: Simd>(&self, simd: S, tile: usize, block: u32) -> Lanes<S> {
        block_of(simd, &self.coverage, tile, block)
    }

    /// Returns the depths of a block's nearest surfaces, up to which balls are visible; +∞ for none. Meaningless in
    /// frames without balls.
    #[inline(always)]
    pub(crate) fn front<S: Simd>(&self, simd: S, tile: usize, block: u32) -> Lanes<S> {
        match self.marks(tile).touched >> block & 1 {
            0 => Lanes::splat(simd, f32::INFINITY),
            _ => block_of(simd, &self.front, tile, block),
        }
    }

    /// Returns the depths of a block's nearest opaque surfaces, up to which transparent layers are visible; +∞ for
    /// none. Meaningless in frames without transparent splats.
    #[inline(always)]
    pub(crate) fn opaque<S: Simd>(&self, simd: S, tile: usize, block: u32) -> Lanes<S> {
        match self.marks(tile).touched >> block & 1 {
            0 => Lanes::splat(simd, f32::INFINITY),
            _ => block_of(simd, &self.opaque, tile, block),
        }
    }
}

/// Loads the sixteen numbers of a tile's block from a plane; 0 if the plane doesn't exist.
#[inline(always)]
fn block_of<S: Simd>(simd: S, plane: &[TileBlocks], tile: usize, block: u32) -> Lanes<S> {
    let blocks = plane.get(tile).map_or(&[][..], |tile| &tile.0);
    Lanes::load(simd, blocks.get(block as usize).map_or(&[], |numbers| numbers))
}
