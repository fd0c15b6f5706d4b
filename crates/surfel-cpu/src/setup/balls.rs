//! Projection of balls and dots to the screen, sorted into tiles (rendering model §11).
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *cell* is a part of the view that one thread draws alone
//! ([`Cell`](crate::cull::cells::Cell)). A ball's *record* is a [`BallRecord`]. A *slot* is the index of a ball in the
//! columns of its object ([`StoredBalls`](crate::scene::balls::StoredBalls)). A *tile* is a square of blocks
//! ([`Grid`](crate::tiles::grid::Grid)).

use crate::cull::balls::{BallPart, BallView};
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::level::{Instructions, with_instructions};
use crate::simd::math::transform;
use crate::tiles::bins::{Entries, Entry, Kind, TileLists};
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::grid::{BLOCK, Grid, TILE_BLOCKS};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use glam::Vec3;
use surfel_math::ball::{LARGE_PX, Outline};
use surfel_math::{Real, V2, V3};
use surfel_render::Region;

/// A ball or dot projected to the screen, in the form in which tiles draw it.
#[derive(Clone, Copy)]
pub(crate) struct BallRecord {
    /// Column and row of the pixel that contains the projected centre. `anchor` and `middle` are offsets from its upper
    /// left corner, so that they are precise in f32.
    pub base: [f32; 2],
    /// Projected centre of the ball, relative to `base`, in pixels.
    pub anchor: [f32; 2],
    /// Centre of the outline, the ellipse that the ball covers, relative to `base`, in pixels.
    pub middle: [f32; 2],
    /// Half extents of the outline along x and y, in pixels.
    pub extent: [f32; 2],
    /// Slant of the outline: correlation of x and y, in (−1, 1) ([`Outline::skew`]).
    pub skew: f32,
    /// √(1 − skew²), as in [`Outline::width`].
    pub width: f32,
    /// Slopes x/z and y/z of the view ray to the centre; in an orthographic view, the centre's x and y in view space.
    pub slope: [f32; 2],
    /// Radius divided by the centre's depth (perspective), or radius in world units (orthographic).
    pub size: f32,
    /// Planar depth of the centre, in world units.
    pub z: f32,
    /// Lower bound of the depth of the ball's fragments, in world units.
    pub z_min: f32,
    pub color: [f32; 3],
    /// Opacity; 1 if balls are drawn as opaque.
    pub alpha: f32,
    /// Number of the ball among all stored splats ([`SplatNumbers`](crate::scene::numbers::SplatNumbers)); meaningless
    /// unless the frame outputs the nearest splat.
    pub number: u32,
    /// Index of the object among the scene's objects of balls.
    pub object: u32,
    /// Slot of the ball, its index in the object's columns.
    pub slot: u32,
    /// True for a dot, which is parallel to the image; false for a ball.
    pub flat: bool,
    /// True if the outline is so large that its coverage of pixels must be computed by [`Outline::coverage_of_large`].
    pub is_large: bool,
}

/// The balls of a cell, projected, and for each tile the list of balls that touch it.
#[derive(Default)]
pub(crate) struct BallSegment {
    pub records: Vec<BallRecord>,
    pub lists: TileLists,
    /// Number of balls in the chunks that were projected, for statistics.
    pub set_up: usize,
}

impl BallSegment {
    /// Returns the heap memory that records and lists use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.records.as_slice()) + self.lists.bytes()
    }

    /// Returns the number of balls whose centre is in `cell`, after it is clamped to the view's region `whole`. Each
    /// ball thereby counts in one cell of the view.
    pub(crate) fn counted(&self, whole: Region, cell: Region) -> usize {
        let is_in = |pixel: f32, [first, length]: [u32; 2], [start, count]: [u32; 2]| {
            let pixel = pixel.clamp(first as f32, (first + length).saturating_sub(1) as f32);
            (start as f32..(start + count) as f32).contains(&pixel)
        };
        let is_counted = |ball: &&BallRecord| {
            let [x, y] = ball.base;
            is_in(x, [whole.x, whole.width], [cell.x, cell.width])
                && is_in(y, [whole.y, whole.height], [cell.y, cell.height])
        };
        self.records.iter().filter(is_counted).count()
    }

    /// Projects the balls of the chunks `parts` that may touch the `drawn` blocks of the grid's region. If `alphas` is
    /// false, all balls are opaque.
    pub(crate) fn project(
        instructions: Instructions,
        views: &[BallView<'_>],
        parts: &[BallPart],
        (grid, drawn): (&Grid, DrawnBlocks<'_>),
        alphas: bool,
    ) -> Self {
        let mut segment = Self::default();
        let mut entries = Entries::default();
        for part in parts {
            let chunk = ChunkSetup { view: &views[part.object as usize], chunk: part.chunk as usize, alphas };
            with_instructions!(instructions, simd => simd.vectorize(
                #[inline(always)]
                || chunk.add(simd, (grid, drawn), &mut segment, &mut entries)));
        }
        segment.lists.sort(&mut entries, grid);
        segment
    }
}

/// A chunk of balls to project: its object in a view, its index in the object, and whether balls are blended by their
/// alphas (`alphas`) or all are opaque.
struct ChunkSetup<'a, 'b> {
    view: &'b BallView<'a>,
    chunk: usize,
    alphas: bool,
}

/// Sixteen balls in view space: their centres, and their radii in world units.
struct Projected<S: Simd> {
    p: V3<Lanes<S>>,
    radius: Lanes<S>,
    /// Bits of the balls within the range of depths that the view draws. The front of a ball, or the plane of a dot,
    /// must be at or beyond z_near, and the centre at or before z_far.
    there: u64,
}

impl ChunkSetup<'_, '_> {
    #[inline(always)]
    fn add<S: Simd>(
        &self,
        simd: S,
        target: (&Grid, DrawnBlocks<'_>),
        segment: &mut BallSegment,
        entries: &mut Entries,
    ) {
        let chunk = &self.view.balls.chunks[self.chunk];
        segment.set_up += chunk.count;
        for group in (0..chunk.count).step_by(LANES) {
            let first = chunk.first + group;
            let projected = self.place(simd, first);
            let there = projected.there & (u64::MAX >> (64 - (chunk.count - group).min(LANES)));
            self.push(simd, &projected, (first, there), target, segment, entries);
        }
    }

    /// Transforms sixteen balls to view space; `first` is the slot of the first one.
    #[inline(always)]
    fn place<S: Simd>(&self, simd: S, first: usize) -> Projected<S> {
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let (balls, projection) = (self.view.balls, &self.view.view.projection);
        let chunk = &balls.chunks[self.chunk];
        let (linear, origin) = self.view.placement(chunk);
        let [x, y, z] = [0, 1, 2].map(|axis: usize| Lanes::load(simd, &balls.centers[axis][first..]));
        let local = V3::new(x, y, z);
        let turned = transform(&linear.as_mat3(), local);
        let p = V3::new(turned.x + k(origin.x), turned.y + k(origin.y), turned.z + k(origin.z));
        let mut radius = Lanes::load(simd, &balls.radii[first..]);
        if let Some(pixel) = self.view.pixel(chunk) {
            let length = dot(simd, pixel.slope.as_vec3(), local) + k(pixel.constant);
            radius = radius * length.max(k(pixel.least));
        }
        if self.view.least_px > 0.0 {
            let [fx, fy] = projection.focal_px;
            let pixel = k(self.view.least_px / (fx * fy).sqrt());
            radius = radius.max(if projection.is_perspective() { pixel * p.z } else { pixel });
        }
        let front = if balls.flat { p.z } else { p.z - radius };
        let there = k(projection.near).le(front) & p.z.le(k(projection.far().min(f64::from(f32::MAX))));
        Projected { p, radius, there: there.to_bitmask() }
    }

    /// Appends the records of sixteen balls, and entries for the tiles that they touch.
    #[inline(always)]
    fn push<S: Simd>(
        &self,
        simd: S,
        projected: &Projected<S>,
        (first, there): (usize, u64),
        (grid, drawn): (&Grid, DrawnBlocks<'_>),
        segment: &mut BallSegment,
        entries: &mut Entries,
    ) {
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let (balls, projection) = (self.view.balls, &self.view.view.projection);
        let (one, perspective) = (k(1.0), projection.is_perspective());
        let exists = fearless_simd::mask32x16::from_bitmask(simd, there);
        // Balls outside the range of depths are replaced, so that nothing is divided by zero.
        let p = V3::select(exists, projected.p, V3::new(k(0.0), k(0.0), one));
        let radius = Lanes::select(exists, projected.radius, k(1e-3));
        let outline =
            if balls.flat { Outline::of_dot(p, radius, projection) } else { Outline::of_ball(p, radius, projection) };
        let inverse = if perspective { one / p.z } else { one };
        let slope = V2::new(p.x * inverse, p.y * inverse);
        let ([fx, fy], [cx, cy]) = (projection.focal_px.map(&k), projection.principal_px.map(&k));
        let whole = |v: Lanes<S>| {
            use fearless_simd::prelude::SimdFloat;
            // Far outside of any image nothing is drawn.
            Lanes(v.max(k(-1e7)).min(k(1e7)).0.floor())
        };
        let base = V2::new(whole(slope.x.mul_add(fx, cx)), whole(slope.y.mul_add(fy, cy)));
        let anchor = projection.offset_from(p, base);
        let middle = anchor + outline.center;
        let z_min = if balls.flat { p.z } else { p.z - radius } * k(1.0 - 1e-6);
        let large = k(LARGE_PX * LARGE_PX).lt(outline.extent.x * outline.extent.y).to_bitmask();
        let fields = [base.x, base.y, anchor.x, anchor.y, middle.x, middle.y, outline.extent.x, outline.extent.y]
            .map(Lanes::to_array);
        let more = [outline.skew, outline.width, slope.x, slope.y, radius * inverse, p.z, z_min].map(Lanes::to_array);
        for i in crate::simd::compress::ones(there) {
            let [bx, by, ax, ay, mx, my, ex, ey] = fields.map(|field| field[i]);
            let [skew, width, sx, sy, size, z, z_min] = more.map(|field| field[i]);
            let before = entries.len();
            let extent = [bx + mx - ex, bx + mx + ex, by + my - ey, by + my + ey];
            for_tiles(extent, segment.records.len() as u32, (grid, drawn), entries);
            if entries.len() == before {
                continue;
            }
            let slot = first + i;
            segment.records.push(BallRecord {
                base: [bx, by],
                anchor: [ax, ay],
                middle: [mx, my],
                extent: [ex, ey],
                skew,
                width,
                slope: [sx, sy],
                size,
                z,
                z_min,
                color: balls.colors.as_ref().map_or([1.0; 3], |colors| colors[slot]),
                alpha: balls.alphas.as_ref().filter(|_| self.alphas).map_or(1.0, |alphas| alphas[slot]),
                number: self.view.first_number + slot as u32,
                object: self.view.index,
                slot: slot as u32,
                flat: balls.flat,
                is_large: large >> i & 1 != 0,
            });
        }
    }
}

#[inline(always)]
fn dot<S: Simd>(simd: S, v: Vec3, p: V3<Lanes<S>>) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    k(v.x).mul_add(p.x, k(v.y).mul_add(p.y, k(v.z) * p.z))
}

/// Adds an entry for every tile with pixels that an ellipse may touch. `extent` is the ellipse's smallest and largest
/// x, then y, in pixels.
#[inline(always)]
fn for_tiles(extent: [f32; 4], index: u32, (grid, drawn): (&Grid, DrawnBlocks<'_>), entries: &mut Entries) {
    let (r, size) = (grid.region, grid.tile_blocks);
    let Some([x0, x1]) = blocks(extent[0], extent[1], [r.x, r.width], grid.origin[0]) else { return };
    let Some([y0, y1]) = blocks(extent[2], extent[3], [r.y, r.height], grid.origin[1]) else { return };
    for row in y0 / size..=y1 / size {
        for column in x0 / size..=x1 / size {
            let tile = row * grid.columns + column;
            let range = |low: u32, high: u32, first: u32| {
                let (low, high) = (low.max(first) - first, high.min(first + size - 1) - first);
                (1u64 << (high + 1)) - (1u64 << low)
            };
            let (across, down) = (range(x0, x1, column * size), range(y0, y1, row * size));
            let mut bits = 0;
            for y in crate::simd::compress::ones(down) {
                bits |= across << (u64::from(TILE_BLOCKS) * y as u64);
            }
            bits &= drawn.of(tile);
            if bits != 0 {
                entries.push(Entry::new(bits, index, tile, Kind::Any));
            }
        }
    }
}

/// Returns the first and last block with pixels in the interval from `min` to `max` along one axis. Only the `length`
/// pixels from `start` on count. Blocks are numbered from the grid's `origin`. `None` if there is no such pixel.
#[inline(always)]
fn blocks(min: f32, max: f32, [start, length]: [u32; 2], origin: u32) -> Option<[u32; 2]> {
    let (low, high) = (start as f32, (start + length) as f32);
    // Saturating casts: a box that isn't finite is clipped to the region.
    let first = min.floor().clamp(low, high) as u32;
    let end = (max.floor() + 1.0).clamp(low, high) as u32;
    (first < end).then(|| [(first - origin) / BLOCK, (end - 1 - origin) / BLOCK])
}
