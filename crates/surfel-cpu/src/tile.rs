//! Visibility and attributes of one tile (§5): two loops over the same list, sixteen pixels of a row at a time.

use crate::bins::{Grid, Segment, TILE};
use crate::lanes::{LANES, Lanes};
use crate::near::NearSplat;
use crate::record::Record;
use fearless_simd::Simd;
use surfel_math::Real;
use surfel_model::Filter;
use surfel_render::{Attributes, FramePlan, View};

/// Numbers of a row: a tile's pixels, and room for the lanes that run past its last column.
pub(crate) const STRIDE: usize = TILE as usize + LANES;
const ROWS: usize = TILE as usize;

/// A plane of a tile.
pub(crate) type TilePlane = [[f32; STRIDE]; ROWS];

/// Everything that a tile accumulates. Planes that the plan doesn't want stay untouched.
pub(crate) struct TileBuffers {
    pub kept: TilePlane,
    pub weight: TilePlane,
    pub color: [TilePlane; 3],
    pub normal: [TilePlane; 3],
    pub depth: TilePlane,
    pub material: [TilePlane; 4],
    pub fragments: TilePlane,
}

const EMPTY: TilePlane = [[0.0; STRIDE]; ROWS];

impl TileBuffers {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self {
            kept: EMPTY,
            weight: EMPTY,
            color: [EMPTY; 3],
            normal: [EMPTY; 3],
            depth: EMPTY,
            material: [EMPTY; 4],
            fragments: EMPTY,
        })
    }

    /// Clears what the plan uses.
    fn clear(&mut self, wants: &Wants) {
        let Attributes { color, normal, depth, material, .. } = wants.attributes;
        self.kept.as_flattened_mut().fill(f32::INFINITY);
        self.weight.as_flattened_mut().fill(0.0);
        let zero = |planes: &mut [TilePlane]| planes.iter_mut().for_each(|p| p.as_flattened_mut().fill(0.0));
        if color {
            zero(&mut self.color);
        }
        if normal {
            zero(&mut self.normal);
        }
        if depth {
            self.depth.as_flattened_mut().fill(0.0);
        }
        if material {
            zero(&mut self.material);
        }
        if wants.fragments {
            self.fragments.as_flattened_mut().fill(0.0);
        }
    }
}

/// What a tile computes, from the plan.
#[derive(Clone, Copy)]
pub(crate) struct Wants {
    pub attributes: Attributes,
    pub fragments: bool,
    /// Depth is linear over pixels: orthographic, or affine mapping.
    pub linear_depth: bool,
    /// 1/h² of `clamp`'s disk.
    pub clamp: Option<f32>,
    /// −c·log₂e.
    pub exponent: f32,
    pub near: f32,
    pub far: f32,
}

impl Wants {
    pub(crate) fn new(plan: &FramePlan, view: &View) -> Self {
        let settings = &plan.splat_filter;
        let clamp = settings.filter == Filter::Clamp;
        Self {
            attributes: plan.attributes,
            fragments: plan.planes.fragments,
            linear_depth: !settings.projective,
            clamp: clamp.then(|| (1.0 / (settings.radius_px * settings.radius_px)) as f32),
            exponent: (-settings.cutoff * std::f64::consts::LOG2_E) as f32,
            near: view.projection.near as f32,
            far: view.projection.far() as f32,
        }
    }
}

/// Pixels of a tile: first column and row of the image, end column and row.
#[derive(Clone, Copy)]
pub(crate) struct TileRect {
    pub x: i32,
    pub y: i32,
    pub end_x: i32,
    pub end_y: i32,
}

impl TileRect {
    pub(crate) fn new(grid: &Grid, column: u32, row: u32) -> Self {
        let r = grid.region;
        let (x, y) = (r.x + column * TILE, r.y + row * TILE);
        let end = |start: u32, limit: u32| (start + TILE).min(limit) as i32;
        Self { x: x as i32, y: y as i32, end_x: end(x, r.x + r.width), end_y: end(y, r.y + r.height) }
    }

    /// The part of a box of pixels inside the tile.
    #[inline(always)]
    fn clip(&self, pixels: &[i32; 4]) -> Self {
        Self {
            x: pixels[0].max(self.x),
            y: pixels[1].max(self.y),
            end_x: pixels[2].min(self.end_x),
            end_y: pixels[3].min(self.end_y),
        }
    }
}

/// Runs both loops over a tile. Returns the number of fragments that contributed.
#[inline(always)]
pub(crate) fn run<S: Simd>(
    simd: S,
    segments: &[Segment],
    tile: usize,
    rect: TileRect,
    wants: &Wants,
    factors: &[[f32; 4]],
    buffers: &mut TileBuffers,
) -> u64 {
    buffers.clear(wants);
    for segment in segments {
        for record in segment.records_of(tile) {
            visibility(simd, record, rect, wants, &mut buffers.kept);
        }
        for near in segment.near_of(tile) {
            near_visibility(near, rect, &mut buffers.kept);
        }
    }
    let mut fragments = 0;
    for segment in segments {
        for record in segment.records_of(tile) {
            fragments += attributes(simd, record, rect, wants, factors, buffers);
        }
        for near in segment.near_of(tile) {
            fragments += near_attributes(near, rect, wants, factors, buffers);
        }
    }
    fragments
}

/// Offsets and depth of sixteen pixels of a row.
struct RowEvaluator<'a, S: Simd> {
    simd: S,
    record: &'a Record,
    wants: &'a Wants,
    /// First column of a run of sixteen, from the anchor.
    d_y: f32,
}

impl<S: Simd> RowEvaluator<'_, S> {
    #[inline(always)]
    fn d_x(&self, x: i32) -> Lanes<S> {
        // Whole pixels are exact, wherever the run starts; one rounding of an offset, not of a pixel coordinate.
        let whole = Lanes::indices(self.simd) + Lanes::splat(self.simd, (x - self.record.base[0]) as f32);
        whole + Lanes::splat(self.simd, 0.5 - self.record.fraction[0])
    }

    /// gradient·d + constant.
    #[inline(always)]
    fn form(&self, d_x: Lanes<S>, gradient: [f32; 2], constant: f32) -> Lanes<S> {
        let row = gradient[1].mul_add(self.d_y, constant);
        Lanes::splat(self.simd, gradient[0]).mul_add(d_x, Lanes::splat(self.simd, row))
    }

    /// Depth of the splat's plane, within the disk's range. Both passes call this, so that a fragment's depth is the
    /// same number in both.
    #[inline(always)]
    fn depth(&self, d_x: Lanes<S>) -> Lanes<S> {
        let r = self.record;
        let clamp = |v: Lanes<S>| v.max(Lanes::splat(self.simd, r.range[0])).min(Lanes::splat(self.simd, r.range[1]));
        if self.wants.linear_depth {
            clamp(self.form(d_x, r.depth, r.z))
        } else {
            let w = clamp(self.form(d_x, r.depth, 1.0));
            Lanes::splat(self.simd, r.z) * w.reciprocal_near_one()
        }
    }
}

#[inline(always)]
fn row_of(record: &Record, y: i32) -> f32 {
    (y - record.base[1]) as f32 + (0.5 - record.fraction[1])
}

/// Runs of sixteen columns of a clipped box: (first column, index in the tile's row, lanes in use).
#[inline(always)]
fn runs(part: &TileRect, rect: TileRect) -> impl Iterator<Item = (i32, usize, i32)> + use<> {
    let (start, end, left) = (part.x, part.end_x, rect.x);
    (start..end).step_by(LANES).map(move |x| (x, (x - left) as usize, (end - x).min(LANES as i32)))
}

#[inline(always)]
fn visibility<S: Simd>(simd: S, record: &Record, rect: TileRect, wants: &Wants, kept: &mut TilePlane) {
    let part = rect.clip(&record.pixels);
    let epsilon = Lanes::splat(simd, record.epsilon);
    for y in part.y..part.end_y {
        let row = &mut kept[(y - rect.y) as usize];
        let at_row = RowEvaluator { simd, record, wants, d_y: row_of(record, y) };
        for (x, at, count) in runs(&part, rect) {
            let d_x = at_row.d_x(x);
            let u = at_row.form(d_x, record.visible_u, 0.0);
            let v = at_row.form(d_x, record.visible_v, 0.0);
            let square = u.mul_add(u, v * v);
            let one = Lanes::splat(simd, 1.0);
            let inside = if wants.linear_depth {
                square.le(one)
            } else {
                let w = at_row.form(d_x, record.depth, 1.0);
                w.zero().lt(w) & square.le(w * w)
            };
            let in_run = Lanes::indices(simd).lt(Lanes::splat(simd, count as f32));
            let z = at_row.depth(d_x);
            let exists = Lanes::splat(simd, wants.near).le(z) & z.le(Lanes::splat(simd, wants.far));
            let mask = inside & in_run & exists;
            let old = Lanes::load(simd, &row[at..]);
            Lanes::select(mask, (z + epsilon).min(old), old).store(&mut row[at..]);
        }
    }
}

#[inline(always)]
fn attributes<S: Simd>(
    simd: S,
    record: &Record,
    rect: TileRect,
    wants: &Wants,
    factors: &[[f32; 4]],
    buffers: &mut TileBuffers,
) -> u64 {
    let part = rect.clip(&record.pixels);
    let mut fragments = 0;
    for y in part.y..part.end_y {
        let row = (y - rect.y) as usize;
        let at_row = RowEvaluator { simd, record, wants, d_y: row_of(record, y) };
        for (x, at, count) in runs(&part, rect) {
            let d_x = at_row.d_x(x);
            let u = at_row.form(d_x, record.u, 0.0);
            let v = at_row.form(d_x, record.v, 0.0);
            let w = at_row.form(d_x, record.w, 1.0);
            let square = u.mul_add(u, v * v);
            let zero = w.zero();
            let in_run = Lanes::indices(simd).lt(Lanes::splat(simd, count as f32));
            let mut inside = zero.lt(w) & square.le(w * w);
            // Inside the disk w is near one; elsewhere the lane isn't used.
            let inverse = w.reciprocal_near_one();
            let mut rho_squared = square * inverse * inverse;
            if let Some(clamp) = wants.clamp {
                let disk = d_x.mul_add(d_x, Lanes::splat(simd, at_row.d_y * at_row.d_y)) * Lanes::splat(simd, clamp);
                let exact = Lanes::select(inside, rho_squared, disk);
                rho_squared = exact.min(disk);
                inside |= disk.le(disk.one());
            }
            let z = at_row.depth(d_x);
            let exists = Lanes::splat(simd, wants.near).le(z) & z.le(Lanes::splat(simd, wants.far));
            let mask = inside & in_run & exists & z.le(Lanes::load(simd, &buffers.kept[row][at..]));
            let hits = fearless_simd::prelude::SimdMask::to_bitmask(mask);
            if hits == 0 {
                continue;
            }
            fragments += u64::from(hits.count_ones());
            let rho_squared = Lanes::select(mask, rho_squared, zero);
            let kernel = (rho_squared * Lanes::splat(simd, wants.exponent)).max(Lanes::splat(simd, -126.0)).exp2();
            let weight = Lanes::select(mask, kernel * Lanes::splat(simd, record.weight_scale), zero);
            accumulate(simd, weight, z, record, (row, at), wants, factors, buffers);
            if wants.fragments {
                let one = Lanes::select(mask, weight.one(), zero);
                let counted = Lanes::load(simd, &buffers.fragments[row][at..]) + one;
                counted.store(&mut buffers.fragments[row][at..]);
            }
        }
    }
    fragments
}

/// Adds weighted attributes to sixteen pixels.
#[expect(clippy::too_many_arguments, reason = "a part of the attribute loop, split off to be read")]
#[inline(always)]
fn accumulate<S: Simd>(
    simd: S,
    weight: Lanes<S>,
    z: Lanes<S>,
    record: &Record,
    (row, at): (usize, usize),
    wants: &Wants,
    factors: &[[f32; 4]],
    buffers: &mut TileBuffers,
) {
    let add = |plane: &mut TilePlane, value: Lanes<S>| {
        let sum = weight.mul_add(value, Lanes::load(simd, &plane[row][at..]));
        sum.store(&mut plane[row][at..]);
    };
    let constant = |v: f32| Lanes::splat(simd, v);
    add(&mut buffers.weight, constant(1.0));
    if wants.attributes.color {
        for (plane, c) in buffers.color.iter_mut().zip(record.color) {
            add(plane, constant(c));
        }
    }
    if wants.attributes.normal {
        for (plane, c) in buffers.normal.iter_mut().zip(record.normal) {
            add(plane, constant(c));
        }
    }
    if wants.attributes.depth {
        add(&mut buffers.depth, z);
    }
    if wants.attributes.material {
        for (plane, c) in buffers.material.iter_mut().zip(factors[record.object as usize]) {
            add(plane, constant(c));
        }
    }
}

fn near_visibility(near: &NearSplat, rect: TileRect, kept: &mut TilePlane) {
    let part = rect.clip(&near.pixels);
    for y in part.y..part.end_y {
        for x in part.x..part.end_x {
            if let Some((_, z)) = near.hit(x, y) {
                let old = &mut kept[(y - rect.y) as usize][(x - rect.x) as usize];
                *old = old.min(z + near.epsilon);
            }
        }
    }
}

fn near_attributes(
    near: &NearSplat,
    rect: TileRect,
    wants: &Wants,
    factors: &[[f32; 4]],
    buffers: &mut TileBuffers,
) -> u64 {
    let part = rect.clip(&near.pixels);
    let mut fragments = 0;
    for y in part.y..part.end_y {
        for x in part.x..part.end_x {
            let (row, at) = ((y - rect.y) as usize, (x - rect.x) as usize);
            let Some((rho_squared, z)) = near.hit(x, y).filter(|h| h.1 <= buffers.kept[row][at]) else { continue };
            let weight = f64::from(wants.exponent * rho_squared).exp2() as f32;
            fragments += 1;
            let add = |plane: &mut TilePlane, v: f32| plane[row][at] = weight.mul_add(v, plane[row][at]);
            add(&mut buffers.weight, 1.0);
            if wants.attributes.color {
                buffers.color.iter_mut().zip(near.color).for_each(|(p, c)| add(p, c));
            }
            if wants.attributes.normal {
                buffers.normal.iter_mut().zip(near.normal).for_each(|(p, c)| add(p, c));
            }
            if wants.attributes.depth {
                add(&mut buffers.depth, z);
            }
            if wants.attributes.material {
                let material = factors[near.object as usize];
                buffers.material.iter_mut().zip(material).for_each(|(p, c)| add(p, c));
            }
            if wants.fragments {
                buffers.fragments[row][at] += 1.0;
            }
        }
    }
    fragments
}
