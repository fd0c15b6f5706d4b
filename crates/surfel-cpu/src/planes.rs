//! What a second look at tiles needs of the first, neighbours included: edges (§5, ours after Z01 §7), lines of the shader `toon`,
//! and transparent layers before both.

use crate::bins::Grid;
use crate::lanes::Lanes;
use crate::raster::Sums;
use crate::target::{Rows, cut, put_plane};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use surfel_math::Real;
use surfel_render::{FramePlan, Pass, Region};

/// Planes over the pixels of a region, with a frame of pixels around it that are no one's neighbours. A plane that no pass of
/// the plan needs is empty.
pub(crate) struct NeighbourPlanes {
    region: Region,
    stride: usize,
    planes: Planes<Vec<f32>>,
}

/// One of each.
#[derive(Default)]
pub(crate) struct Planes<T> {
    /// Edge antialiasing: kept value; how far the surface there reaches, and where the nearest begins; coverage.
    pub kept: T,
    pub reach: T,
    pub begin: T,
    pub coverage: T,
    /// Outlines and eye-dome lighting: depth of the front surface. Outlines: how deep a neighbour may be.
    pub depth: T,
    pub limit: T,
    /// Transparent layers: depth of what is opaque.
    pub opaque: T,
}

/// The planes inside a tile.
pub(crate) type NeighbourRows<'a> = Planes<Rows<'a, f32>>;

/// Pixels left and above of the region, and right and below.
const MARGIN: usize = 8;

impl NeighbourRows<'_> {
    /// Writes what edges need of a block: of its splats, and the depth of its nearest polygons, +∞ where there is none.
    #[inline(always)]
    pub(crate) fn put_edges<S: Simd>(&mut self, at: (i32, i32), sums: &Sums<S>, polygon: Option<Lanes<S>>) {
        let begin = sums.kept - sums.kept_epsilon;
        put_plane(&mut self.kept, at, sums.kept);
        put_plane(&mut self.reach, at, sums.kept + sums.kept_epsilon);
        put_plane(&mut self.begin, at, polygon.map_or(begin, |z| begin.min(z)));
        put_plane(&mut self.coverage, at, sums.coverage);
    }
}

impl NeighbourPlanes {
    /// True if a plan needs any.
    pub(crate) fn are_needed(plan: &FramePlan) -> bool {
        plan.reach_px() > 0
    }

    /// Planes for a region, with nothing in it.
    pub(crate) fn new(region: Region, plan: &FramePlan) -> Self {
        let stride = region.width as usize + 2 * MARGIN;
        let size = stride * (region.height as usize + 2 * MARGIN);
        let plane = |wanted: bool, around: f32, inside: f32| {
            let mut plane = vec![around; if wanted { size } else { 0 }];
            for row in plane.chunks_mut(stride).skip(MARGIN).take(region.height as usize) {
                row[MARGIN..MARGIN + region.width as usize].fill(inside);
            }
            plane
        };
        let (edges, lines, dome) =
            (plan.has(Pass::EdgeAntialiasing), plan.has(Pass::Outlines), plan.has(Pass::EyeDome));
        // −∞ is never behind anything, and +∞ never before.
        let no_neighbour = if dome { f32::INFINITY } else { f32::NEG_INFINITY };
        let planes = Planes {
            kept: plane(edges, f32::INFINITY, f32::INFINITY),
            reach: plane(edges, f32::INFINITY, f32::INFINITY),
            begin: plane(edges, f32::NEG_INFINITY, f32::INFINITY),
            coverage: plane(edges, 0.0, 0.0),
            depth: plane(lines || dome, no_neighbour, f32::INFINITY),
            limit: plane(lines, f32::INFINITY, f32::INFINITY),
            opaque: plane(plan.separates_transparent, f32::INFINITY, f32::INFINITY),
        };
        Self { region, stride, planes }
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        let p = &self.planes;
        [&p.kept, &p.reach, &p.begin, &p.coverage, &p.depth, &p.limit, &p.opaque]
            .map(|v| size_of_val(v.as_slice()))
            .iter()
            .sum()
    }

    /// The planes cut into tiles.
    pub(crate) fn cut(&mut self, grid: &Grid) -> Vec<NeighbourRows<'_>> {
        let (region, first, stride) = (self.region, MARGIN * self.stride + MARGIN, self.stride);
        let p = &mut self.planes;
        let cut = |plane| cut(plane, grid, region, first, stride).into_iter();
        let edges = cut(&mut p.kept).zip(cut(&mut p.reach)).zip(cut(&mut p.begin)).zip(cut(&mut p.coverage));
        let others = cut(&mut p.depth).zip(cut(&mut p.limit)).zip(cut(&mut p.opaque));
        let tiles = edges.zip(others);
        tiles
            .map(|((((kept, reach), begin), coverage), ((depth, limit), opaque))| Planes {
                kept,
                reach,
                begin,
                coverage,
                depth,
                limit,
                opaque,
            })
            .collect()
    }

    /// Sixteen numbers of a block at most `MARGIN` outside; 0 of an empty plane.
    #[inline(always)]
    fn block<S: Simd>(&self, simd: S, plane: &[f32], (x, y): (i32, i32)) -> Lanes<S> {
        let mut values = [0.0; 16];
        let column = (x - self.region.x as i32 + MARGIN as i32) as usize;
        for (j, four) in values.chunks_exact_mut(4).enumerate() {
            let row = (y + j as i32 - self.region.y as i32 + MARGIN as i32) as usize;
            let at = row * self.stride + column;
            if let Some(numbers) = plane.get(at..at + 4) {
                four.copy_from_slice(numbers);
            }
        }
        Lanes::load(simd, &values)
    }

    /// Kept values of a block.
    #[inline(always)]
    pub(crate) fn kept<S: Simd>(&self, simd: S, at: (i32, i32)) -> Lanes<S> {
        self.block(simd, &self.planes.kept, at)
    }

    /// Coverage of a block.
    #[inline(always)]
    pub(crate) fn coverage<S: Simd>(&self, simd: S, at: (i32, i32)) -> Lanes<S> {
        self.block(simd, &self.planes.coverage, at)
    }

    /// Depth of a block's front surfaces; +∞ where nothing is, and of an empty plane.
    #[inline(always)]
    pub(crate) fn depth<S: Simd>(&self, simd: S, at: (i32, i32)) -> Lanes<S> {
        match self.planes.depth.is_empty() {
            true => Lanes::splat(simd, f32::INFINITY),
            false => self.block(simd, &self.planes.depth, at),
        }
    }

    /// Depth of what is opaque in a block.
    #[inline(always)]
    pub(crate) fn opaque<S: Simd>(&self, simd: S, at: (i32, i32)) -> Lanes<S> {
        self.block(simd, &self.planes.opaque, at)
    }

    /// Bits of a block's edge pixels: at an 8-neighbour the nearest surface begins beyond the reach of their own, or they have
    /// filtered fragments but nothing kept.
    #[inline(always)]
    pub(crate) fn edges<S: Simd>(&self, simd: S, at: (i32, i32)) -> u64 {
        let p = &self.planes;
        if p.kept.is_empty() {
            return 0;
        }
        let own = self.block(simd, &p.reach, at);
        let farthest = self.farthest(simd, &p.begin, at);
        let nothing_kept = Lanes::splat(simd, f32::MAX).lt(own);
        let covered = Lanes::splat(simd, 0.0).lt(self.coverage(simd, at));
        (own.lt(farthest) | (nothing_kept & covered)).to_bitmask()
    }

    /// Bits of a block's pixels on a line: beside them another surface, or nothing, lies farther back than their own reaches.
    #[inline(always)]
    pub(crate) fn lines<S: Simd>(&self, simd: S, at: (i32, i32)) -> u64 {
        let p = &self.planes;
        if p.limit.is_empty() {
            return 0;
        }
        let farthest = self.farthest(simd, &p.depth, at);
        self.block(simd, &p.limit, at).lt(farthest).to_bitmask()
    }

    /// The greatest of a block's values and those of its neighbours.
    #[inline(always)]
    fn farthest<S: Simd>(&self, simd: S, plane: &[f32], (x, y): (i32, i32)) -> Lanes<S> {
        let mut farthest = Lanes::splat(simd, f32::NEG_INFINITY);
        for dy in -1..=1 {
            for dx in -1..=1 {
                farthest = farthest.max(self.block(simd, plane, (x + dx, y + dy)));
            }
        }
        farthest
    }
}
