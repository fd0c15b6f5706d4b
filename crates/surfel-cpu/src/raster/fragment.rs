//! Evaluation of a splat at the pixels of a 4×4 block, one lane per pixel.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *lane* is one of the 16 numbers that SIMD
//! instructions compute at once.

use crate::raster::inputs::RasterInputs;
use crate::setup::evaluate::{Fragment, cheap, form, general, inverse_near_one};
use crate::setup::kernel::Kernel;
use crate::setup::near::NearSplat;
use crate::setup::record::{Class, FORMS, Record, RecordLanes};
use crate::setup::tiny;
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::{Simd, mask32x16};
use surfel_math::{Real, V2};

#[inline(always)]
pub(crate) fn fragment<S: Simd>(
    simd: S,
    record: &Record,
    at: (Lanes<S>, Lanes<S>),
    first: (i32, i32),
    inputs: &RasterInputs<'_>,
) -> Fragment<S> {
    let mut fragment = unclipped(simd, record, at, first, inputs);
    fragment.clip(simd, record, at, inputs);
    fragment
}

impl<S: Simd> Fragment<S> {
    /// Removes the fragments outside the splat's clip, if it has one. A filter that stretches the footprint also
    /// stretches its clip, which may then exclude pixels where the clipped splat was visible without the filter. In
    /// oriented clouds, [`Self::inside`] keeps these pixels: otherwise the splat could hide what is behind it and leave
    /// the pixel empty.
    #[inline(always)]
    pub(crate) fn clip(&mut self, simd: S, record: &Record, at: (Lanes<S>, Lanes<S>), inputs: &RasterInputs<'_>) {
        if let Some(([visible, inside], holds_visible)) = clipped(simd, record, at, inputs) {
            self.visible &= visible;
            self.inside &= if holds_visible { inside | self.visible } else { inside };
        }
    }
}

/// Returns masks of the pixels that a splat's clip retains, for the unfiltered and the filtered footprint. The flag is
/// true if the filtered footprint must include the unfiltered one. `None` if the splat has no clip.
#[inline(always)]
fn clipped<S: Simd>(
    simd: S,
    record: &Record,
    at: (Lanes<S>, Lanes<S>),
    inputs: &RasterInputs<'_>,
) -> Option<([mask32x16<S>; 2], bool)> {
    let clip = record.clip().and_then(|number| inputs.clips.get(number))?;
    let (d_x, d_y) = offsets(simd, record, at);
    let (mut x, mut y) = (d_x, d_y);
    if inputs.frame.constants.clamp.is_some() {
        // A disk drawn by `clamp` may reach beyond the horizon; its centre decides there.
        let k = |v: f32| Lanes::splat(simd, v);
        let before = k(0.0).lt(k(record.w_x()).mul_add(d_x, k(record.w_y()).mul_add(d_y, k(1.0))));
        (x, y) = (Lanes::select(before, d_x, k(0.0)), Lanes::select(before, d_y, k(0.0)));
    }
    Some((clip.keeps(V2::new(d_x, d_y), V2::new(x, y)), clip.holds_visible()))
}

/// Returns the offsets of a block's pixels from the splat's projected centre. Whole pixels are exact, so each offset is
/// rounded once.
#[inline(always)]
fn offsets<S: Simd>(simd: S, record: &Record, (columns, rows): (Lanes<S>, Lanes<S>)) -> (Lanes<S>, Lanes<S>) {
    let k = |v: f32| Lanes::splat(simd, v);
    ((columns - k(record.base_x())) + k(record.offset_x()), (rows - k(record.base_y())) + k(record.offset_y()))
}

#[inline(always)]
fn unclipped<S: Simd>(
    simd: S,
    record: &Record,
    at: (Lanes<S>, Lanes<S>),
    first: (i32, i32),
    inputs: &RasterInputs<'_>,
) -> Fragment<S> {
    let frame = &inputs.frame.constants;
    let k = |v: f32| Lanes::splat(simd, v);
    let d = offsets(simd, record, at);
    let class = record.class();
    if class == Class::Near {
        let [z, weight] = near_fragment(&inputs.near[record.object()], first, &frame.kernel);
        let (z, weight) = (Lanes::load(simd, &z), Lanes::load(simd, &weight));
        let inside = z.le(z);
        return Fragment { visible: inside, inside, z, weight };
    }
    if class == Class::Tiny {
        let [z, weight] = tiny_at_block(record, first);
        let (z, weight) = (Lanes::load(simd, &z), Lanes::load(simd, &weight));
        let visible = k(1.0).copysign(weight).lt(k(0.0));
        return Fragment { visible, inside: weight.le(weight), z, weight: weight.abs() };
    }
    let r = RecordLanes::splat(simd, record);
    if class == Class::Cheap { cheap(&r, d, frame) } else { general(&r, d, frame) }
}

/// Evaluates a near splat ([`near`](crate::setup::near)) in f64 at the 16 pixels of a block. Returns depths, NaN
/// outside the footprint, and weights.
///
/// Arrays rather than lanes: a function that returns lanes through memory would force those of ordinary splats into
/// memory.
#[cold]
#[inline(never)]
fn near_fragment(near: &NearSplat, (x, y): (i32, i32), kernel: &Kernel) -> [[f32; LANES]; 2] {
    let (mut depths, mut weights) = ([f32::NAN; LANES], [0.0; LANES]);
    for i in 0..LANES {
        if let Some((rho_squared, z)) = near.hit(x + (i % 4) as i32, y + (i / 4) as i32) {
            (depths[i], weights[i]) = (z, kernel.at_one(rho_squared));
        }
    }
    [depths, weights]
}

/// Evaluates four cheap splats ([`Class::Cheap`]) as [`fragment`] does, each at its own pixels. `FILTERED` must be true
/// if some splat's filtered footprint differs from its unfiltered one. The steps of all four are interleaved: a CPU
/// looks ahead over about two splats, too few for the long dependency chain of each.
#[inline(always)]
pub(crate) fn cheap_batch<S: Simd, const FILTERED: bool>(
    simd: S,
    records: [&Record; 4],
    at: [(Lanes<S>, Lanes<S>); 4],
    inputs: &RasterInputs<'_>,
) -> [Fragment<S>; 4] {
    let k = |v: f32| Lanes::splat(simd, v);
    let one = k(1.0);
    let [mut d_x, mut d_y, mut square, mut inverse] = [[one; 4]; 4];
    for j in 0..4 {
        (d_x[j], d_y[j]) = offsets(simd, records[j], at[j]);
    }
    for j in 0..4 {
        let (r, d) = (records[j], (d_x[j], d_y[j]));
        let (u, v) = (form(d, k(r.u_x()), k(r.u_y())), form(d, k(r.v_x()), k(r.v_y())));
        square[j] = u.mul_add(u, v * v);
    }
    for j in 0..4 {
        let mut e = form((d_x[j], d_y[j]), k(records[j].depth_x()), k(records[j].depth_y()));
        if FILTERED {
            // Outside the disk, the depth is clamped to the disk's depth range.
            e = e.max(k(records[j].range_min())).min(k(records[j].range_max()));
        }
        inverse[j] = inverse_near_one(e);
    }
    let mut visible = [one; 4];
    if FILTERED {
        for j in 0..4 {
            let (r, d) = (records[j], (d_x[j], d_y[j]));
            let (u, v) =
                (form(d, k(r.visible_u_x()), k(r.visible_u_y())), form(d, k(r.visible_v_x()), k(r.visible_v_y())));
            visible[j] = u.mul_add(u, v * v) * (inverse[j] * inverse[j]);
        }
        for j in 0..4 {
            let filtered = inverse_near_one(form((d_x[j], d_y[j]), k(records[j].w_x()), k(records[j].w_y())));
            square[j] = square[j] * (filtered * filtered);
        }
    } else {
        for j in 0..4 {
            square[j] = square[j] * (inverse[j] * inverse[j]);
        }
    }
    let mut weights = inputs.frame.constants.kernel.at_four(square);
    if FILTERED {
        for j in 0..4 {
            weights[j] = weights[j] * k(records[j].weight_scale());
        }
    }
    let fragment = |j: usize| {
        let inside = square[j].le(one);
        let visible = if FILTERED { visible[j].le(one) } else { inside };
        Fragment { visible, inside, z: k(records[j].z()) * inverse[j], weight: weights[j] }
    };
    [fragment(0), fragment(1), fragment(2), fragment(3)]
}

/// Evaluates a tiny splat at the pixels of a block. Returns depths and signed weights, NaN in pixels without a
/// fragment.
///
/// Arrays rather than lanes: a function that returns lanes through memory would force those of other splats into
/// memory.
#[cold]
#[inline(never)]
fn tiny_at_block(record: &Record, (x, y): (i32, i32)) -> [[f32; LANES]; 2] {
    let mut numbers = [[f32::NAN; LANES]; 2];
    let (first_px, side) = (tiny::first_px(record), record.tiny_side());
    for i in 0..side * side {
        let (x, y) = (first_px.0 - x + (i % side) as i32, first_px.1 - y + (i / side) as i32);
        if (0..4).contains(&x) && (0..4).contains(&y) {
            let lane = (4 * y + x) as usize;
            (numbers[0][lane], numbers[1][lane]) = (record.0[FORMS + i], record.0[FORMS + side * side + i]);
        }
    }
    numbers
}
