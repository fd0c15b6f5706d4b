//! The G-buffer: what screen-space passes need of a tile and its neighbours: edges (§5, ours after Z01 §7), outlines of
//! the shader `toon`, eye-dome lighting, and transparent layers before all of it.

use crate::raster::sums::Sums;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::grid::{BLOCK, Grid, TILE_BLOCKS};
use fearless_simd::Simd;
use surfel_math::Real;
use surfel_render::{FramePlan, Pass};

/// Blocks of a tile at most.
pub(crate) const BLOCKS: usize = (TILE_BLOCKS * TILE_BLOCKS) as usize;

/// Pixels along the side of the largest tile.
pub(crate) const SIDE: usize = (TILE_BLOCKS * BLOCK) as usize;

/// A tile's numbers, pixel by pixel in rows: what is compared with neighbours.
#[derive(Clone)]
#[repr(align(64))]
pub(crate) struct TileRows(pub [[f32; SIDE]; SIDE]);

/// A tile's numbers, block by block.
#[derive(Clone)]
#[repr(align(64))]
pub(crate) struct TileBlocks([[f32; LANES]; BLOCKS]);

/// From where to where the nearest surfaces of a block may lie (§5, edges by samples). The end is −∞ where only one of
/// a pixel's footprints has one: a step to every neighbour.
#[derive(Clone, Copy)]
pub(crate) struct Reach<S: Simd> {
    pub begin: Lanes<S>,
    pub end: Lanes<S>,
}

impl<S: Simd> Reach<S> {
    /// Of splats, and of the nearest polygons where they begin first.
    #[inline(always)]
    fn of(sums: &Sums<S>, polygon: Option<Self>) -> Self {
        let (begin, end) = (sums.threshold - sums.threshold_epsilon, sums.threshold + sums.threshold_epsilon);
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

/// One of each.
#[derive(Default)]
struct Planes<R, B> {
    /// Edge antialiasing: where the nearest surface begins; how far the pixel's own reaches, −∞ where there are
    /// fragments but no threshold, and +∞ where nothing would show through an edge; the depth threshold; coverage.
    /// Edges by samples: where the nearest surface begins and ends.
    begin: R,
    reach: R,
    threshold: B,
    coverage: B,
    /// Outlines and eye-dome lighting: depth of the front surface. Outlines: how deep a neighbour may be.
    depth: R,
    limit: R,
    /// Transparent layers: depth of what is opaque.
    opaque: B,
}

/// What is known of a tile's blocks, a bit each.
#[derive(Clone, Copy, Default)]
pub(crate) struct Marks {
    /// Something opaque may be there. Of other blocks no number means anything.
    pub touched: u64,
    /// Has pixels that would show what lies behind, were they edges.
    pub thin: u64,
}

/// Numbers of all tiles of a grid. Their memory lasts from frame to frame: those of tiles and blocks that nothing
/// touches are an earlier frame's.
#[derive(Default)]
pub(crate) struct GBuffer {
    planes: Planes<Vec<TileRows>, Vec<TileBlocks>>,
    marks: Vec<Marks>,
    wanted: Wanted,
}

/// Which passes need planes.
#[derive(Clone, Copy, Default)]
struct Wanted {
    edges: bool,
    samples: bool,
    lines: bool,
    dome: bool,
    opaque: bool,
}

/// A tile's part, while it is drawn.
pub(crate) struct GBufferTile<'a> {
    wanted: Wanted,
    planes: Planes<Option<&'a mut TileRows>, Option<&'a mut TileBlocks>>,
    marks: &'a mut Marks,
}

impl GBufferTile<'_> {
    /// To be called before anything is put: nothing is there, or something.
    pub(crate) fn begin(&mut self, is_empty: bool) {
        *self.marks = Marks::default();
        if !is_empty {
            let ends = if self.wanted.samples { &mut self.planes.reach } else { &mut None };
            let planes = [&mut self.planes.begin, &mut self.planes.depth, ends];
            planes.into_iter().flatten().for_each(|plane| plane.0.as_flattened_mut().fill(f32::INFINITY));
        }
    }

    /// Writes what edges need of a block: of its splats, and where its nearest polygons are, +∞ where there is none.
    #[inline(always)]
    pub(crate) fn put_edges<S: Simd>(&mut self, block: u32, sums: &Sums<S>, polygon: Option<Reach<S>>) {
        if self.wanted.samples {
            self.put_reach(block, Reach::of(sums, polygon));
            return;
        }
        let polygon = polygon.map(|polygon| polygon.begin);
        let Planes {
            begin: Some(begins),
            reach: Some(reaches),
            threshold: Some(thresholds),
            coverage: Some(coverage),
            ..
        } = &mut self.planes
        else {
            return;
        };
        let begin = sums.threshold - sums.threshold_epsilon;
        self.marks.touched |= 1 << block;
        begins.put(block, polygon.map_or(begin, |z| begin.min(z)));
        let q = sums.coverage;
        let (never, always) = (q.constant(f64::INFINITY), q.constant(f64::NEG_INFINITY));
        let without_threshold = Lanes::select(q.zero().lt(q), always, never);
        let reach = Lanes::select(sums.threshold.lt(never), sums.threshold + sums.threshold_epsilon, without_threshold);
        let reach = Lanes::select(q.lt(q.one()), reach, never);
        reaches.put(block, reach);
        self.marks.thin |= u64::from(any_below(reach, never)) << block;
        thresholds.put(block, sums.threshold);
        coverage.put(block, q);
    }

    /// Writes where a block's nearest surfaces begin and end.
    #[inline(always)]
    fn put_reach<S: Simd>(&mut self, block: u32, reach: Reach<S>) {
        self.marks.touched |= 1 << block;
        if let Planes { begin: Some(begins), reach: Some(ends), .. } = &mut self.planes {
            begins.put(block, reach.begin);
            ends.put(block, reach.end);
        }
    }

    /// Writes the depth of what is opaque in a block.
    #[inline(always)]
    pub(crate) fn put_opaque<S: Simd>(&mut self, block: u32, depth: Lanes<S>) {
        self.marks.touched |= 1 << block;
        if let Some(plane) = &mut self.planes.opaque {
            plane.put(block, depth);
        }
    }

    /// Writes depths of a block's front surfaces, +∞ where there is none.
    #[inline(always)]
    pub(crate) fn put_depth<S: Simd>(&mut self, block: u32, depth: Lanes<S>) {
        self.marks.touched |= 1 << block;
        if let Some(plane) = &mut self.planes.depth {
            plane.put(block, depth);
        }
    }

    /// True if it is needed how deep a block's neighbours may be.
    pub(crate) fn want_limit(&self) -> bool {
        self.planes.limit.is_some()
    }

    /// Writes how deep a block's neighbours may be, +∞ where nothing is.
    #[inline(always)]
    pub(crate) fn put_limit<S: Simd>(&mut self, block: u32, limit: Lanes<S>) {
        if let Some(plane) = &mut self.planes.limit {
            plane.put(block, limit);
        }
    }
}

#[inline(always)]
fn any_below<S: Simd>(a: Lanes<S>, b: Lanes<S>) -> bool {
    use fearless_simd::prelude::SimdMask;
    a.lt(b).to_bitmask() != 0
}

impl GBuffer {
    /// Makes them those of a grid and a plan.
    pub(crate) fn reset_for(&mut self, grid: &Grid, plan: &FramePlan) {
        self.wanted = Wanted {
            edges: plan.has(Pass::EdgeAntialiasing),
            samples: plan.has(Pass::EdgeSamples),
            lines: plan.has(Pass::Outlines),
            dome: plan.has(Pass::EyeDome),
            opaque: plan.separates_transparent,
        };
        let Wanted { edges, samples, lines, dome, opaque } = self.wanted;
        let tiles = grid.tiles();
        let steps = edges || samples;
        let p = &mut self.planes;
        for (plane, wanted) in
            [(&mut p.begin, steps), (&mut p.reach, steps), (&mut p.depth, lines || dome), (&mut p.limit, lines)]
        {
            if wanted && plane.len() < tiles {
                plane.resize(tiles, TileRows::EMPTY);
            }
        }
        for (plane, wanted) in [(&mut p.threshold, edges), (&mut p.coverage, edges), (&mut p.opaque, opaque)] {
            if wanted && plane.len() < tiles {
                plane.resize(tiles, TileBlocks::EMPTY);
            }
        }
        self.marks.clear();
        self.marks.resize(tiles, Marks::default());
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        let p = &self.planes;
        let rows = [&p.begin, &p.reach, &p.depth, &p.limit].map(|v| size_of_val(v.as_slice()));
        let blocks = [&p.threshold, &p.coverage, &p.opaque].map(|v| size_of_val(v.as_slice()));
        rows.iter().chain(&blocks).sum::<usize>() + size_of_val(self.marks.as_slice())
    }

    /// Each tile's part.
    pub(crate) fn cut(&mut self) -> Vec<GBufferTile<'_>> {
        let Wanted { edges, samples, lines, dome, opaque } = self.wanted;
        let steps = edges || samples;
        fn wanted<T>(plane: &mut [T], wanted: bool) -> std::slice::IterMut<'_, T> {
            if wanted { plane.iter_mut() } else { Default::default() }
        }
        let p = &mut self.planes;
        let (mut begin, mut reach) = (wanted(&mut p.begin, steps), wanted(&mut p.reach, steps));
        let (mut threshold, mut coverage) = (wanted(&mut p.threshold, edges), wanted(&mut p.coverage, edges));
        let (mut depth, mut limit) = (wanted(&mut p.depth, lines || dome), wanted(&mut p.limit, lines));
        let mut opaque = wanted(&mut p.opaque, opaque);
        let all = self.wanted;
        let tile = |marks| GBufferTile {
            wanted: all,
            planes: Planes {
                begin: begin.next(),
                reach: reach.next(),
                threshold: threshold.next(),
                coverage: coverage.next(),
                depth: depth.next(),
                limit: limit.next(),
                opaque: opaque.next(),
            },
            marks,
        };
        self.marks.iter_mut().map(tile).collect()
    }

    /// What is known of a tile's blocks.
    pub(crate) fn marks(&self, tile: usize) -> Marks {
        self.marks.get(tile).copied().unwrap_or_default()
    }

    /// Where the nearest surfaces begin, and how far a tile's own reach.
    pub(crate) fn edges(&self, tile: usize) -> Option<(&[TileRows], &TileRows)> {
        let Planes { begin, reach, .. } = &self.planes;
        reach.get(tile).filter(|_| self.wanted.edges).map(|own| (begin.as_slice(), own))
    }

    /// Where the nearest surfaces begin, and where they end, for edges by samples.
    pub(crate) fn reaches(&self) -> Option<[&[TileRows]; 2]> {
        self.wanted.samples.then_some([&self.planes.begin, &self.planes.reach])
    }

    /// Depths of front surfaces, and how deep a tile's neighbours may be.
    pub(crate) fn lines(&self, tile: usize) -> Option<(&[TileRows], &TileRows)> {
        let Planes { depth, limit, .. } = &self.planes;
        limit.get(tile).filter(|_| self.wanted.lines).map(|own| (depth.as_slice(), own))
    }

    /// True if there are depths of front surfaces.
    pub(crate) fn has_depths(&self) -> bool {
        self.wanted.lines || self.wanted.dome
    }

    /// Depths of front surfaces.
    pub(crate) fn depths(&self) -> &[TileRows] {
        &self.planes.depth
    }

    /// Depth thresholds of a block that is touched.
    #[inline(always)]
    pub(crate) fn threshold<S: Simd>(&self, simd: S, tile: usize, block: u32) -> Lanes<S> {
        block_of(simd, &self.planes.threshold, tile, block)
    }

    /// Coverage of a block that is touched.
    #[inline(always)]
    pub(crate) fn coverage<S: Simd>(&self, simd: S, tile: usize, block: u32) -> Lanes<S> {
        block_of(simd, &self.planes.coverage, tile, block)
    }

    /// Depth of what is opaque in a block; +∞ where nothing is.
    #[inline(always)]
    pub(crate) fn opaque<S: Simd>(&self, simd: S, tile: usize, block: u32) -> Lanes<S> {
        match self.marks(tile).touched >> block & 1 {
            0 => Lanes::splat(simd, f32::INFINITY),
            _ => block_of(simd, &self.planes.opaque, tile, block),
        }
    }
}

/// Sixteen numbers of a block; 0 of a plane that isn't there.
#[inline(always)]
fn block_of<S: Simd>(simd: S, plane: &[TileBlocks], tile: usize, block: u32) -> Lanes<S> {
    let blocks = plane.get(tile).map_or(&[][..], |tile| &tile.0);
    Lanes::load(simd, blocks.get(block as usize).map_or(&[], |numbers| numbers))
}
