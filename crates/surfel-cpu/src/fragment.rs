//! A splat at the pixels of a block of 4×4, a lane for each.

use crate::dots;
use crate::kernel::Kernel;
use crate::lanes::{LANES, Lanes};
use crate::near::NearSplat;
use crate::raster::{Shared, Wants};
use crate::record::{Class, Record, RecordLanes};
use fearless_simd::{Simd, mask32x16};
use surfel_math::{Real, V2};

/// A splat at the pixels of a block.
pub(crate) struct Fragment<S: Simd> {
    /// Inside the unfiltered footprint.
    pub visible: mask32x16<S>,
    /// Inside the filtered footprint.
    pub inside: mask32x16<S>,
    pub z: Lanes<S>,
    /// Means nothing outside the footprint.
    pub weight: Lanes<S>,
}

#[inline(always)]
pub(crate) fn fragment<S: Simd>(
    simd: S,
    record: &Record,
    at: (Lanes<S>, Lanes<S>),
    first: (i32, i32),
    shared: &Shared<'_>,
) -> Fragment<S> {
    let mut fragment = unclipped(simd, record, at, first, shared);
    fragment.clip(simd, record, at, shared);
    fragment
}

impl<S: Simd> Fragment<S> {
    /// Takes away what the splat's clip removes, if it has one.
    #[inline(always)]
    pub(crate) fn clip(&mut self, simd: S, record: &Record, at: (Lanes<S>, Lanes<S>), shared: &Shared<'_>) {
        if let Some([visible, inside]) = kept_of(simd, record, at, shared) {
            self.visible &= visible;
            self.inside &= inside;
        }
    }
}

/// Pixels that a splat's clip keeps of its unfiltered and its filtered footprint.
#[inline(always)]
fn kept_of<S: Simd>(
    simd: S,
    record: &Record,
    at: (Lanes<S>, Lanes<S>),
    shared: &Shared<'_>,
) -> Option<[mask32x16<S>; 2]> {
    let clip = record.clip().and_then(|number| shared.clips.get(number))?;
    let (d_x, d_y) = offsets(simd, record, at);
    let (mut x, mut y) = (d_x, d_y);
    if shared.wants.clamp.is_some() {
        // The disk of `clamp` may reach beyond the horizon, where the centre decides.
        let k = |v: f32| Lanes::splat(simd, v);
        let before = k(0.0).lt(k(record.w_x()).mul_add(d_x, k(record.w_y()).mul_add(d_y, k(1.0))));
        (x, y) = (Lanes::select(before, d_x, k(0.0)), Lanes::select(before, d_y, k(0.0)));
    }
    Some(clip.keeps(V2::new(d_x, d_y), V2::new(x, y)))
}

/// Offsets of a block's pixels from the anchor. Whole pixels are exact; one rounding of an offset, not of a pixel
/// coordinate.
#[inline(always)]
fn offsets<S: Simd>(simd: S, record: &Record, (columns, rows): (Lanes<S>, Lanes<S>)) -> (Lanes<S>, Lanes<S>) {
    let k = |v: f32| Lanes::splat(simd, v);
    ((columns - k(record.base_x())) + k(record.offset_x()), (rows - k(record.base_y())) + k(record.offset_y()))
}

/// x·d_x + y·d_y.
#[inline(always)]
fn form<S: Simd>((d_x, d_y): (Lanes<S>, Lanes<S>), x: Lanes<S>, y: Lanes<S>) -> Lanes<S> {
    x.mul_add(d_x, y * d_y)
}

/// x·d_x + y·d_y + c.
#[inline(always)]
fn form_at<S: Simd>((d_x, d_y): (Lanes<S>, Lanes<S>), x: Lanes<S>, y: Lanes<S>, c: Lanes<S>) -> Lanes<S> {
    x.mul_add(d_x, y.mul_add(d_y, c))
}

#[inline(always)]
fn unclipped<S: Simd>(
    simd: S,
    record: &Record,
    at: (Lanes<S>, Lanes<S>),
    first: (i32, i32),
    shared: &Shared<'_>,
) -> Fragment<S> {
    let wants = &shared.wants;
    let k = |v: f32| Lanes::splat(simd, v);
    let d = offsets(simd, record, at);
    let class = record.class();
    if class == Class::Near {
        let [z, weight] = near_fragment(&shared.near[record.object()], first, &wants.kernel);
        let (z, weight) = (Lanes::load(simd, &z), Lanes::load(simd, &weight));
        let inside = z.le(z);
        return Fragment { visible: inside, inside, z, weight };
    }
    if class == Class::Dot {
        let [z, weight] = dots::at_block(record, first);
        let (z, weight) = (Lanes::load(simd, &z), Lanes::load(simd, &weight));
        let visible = k(1.0).copysign(weight).lt(k(0.0));
        return Fragment { visible, inside: weight.le(weight), z, weight: weight.abs() };
    }
    let r = RecordLanes::splat(simd, record);
    match class {
        Class::Shallow => shallow(&r, d, wants),
        Class::Soft => soft(&r, d, wants),
        Class::Plain => plain(&r, d, wants),
        _ => general(&r, d, wants),
    }
}

/// u² + v² of the filtered footprint.
#[inline(always)]
fn square_of<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>)) -> Lanes<S> {
    let (u, v) = (form(d, r.u_x, r.u_y), form(d, r.v_x, r.v_y));
    u.mul_add(u, v * v)
}

/// u² + v² of the unfiltered footprint.
#[inline(always)]
fn visible_square_of<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>)) -> Lanes<S> {
    let (u, v) = (form(d, r.visible_u_x, r.visible_u_y), form(d, r.visible_v_x, r.visible_v_y));
    u.mul_add(u, v * v)
}

/// Shallow splats, or one, at offsets from their anchors.
#[inline(always)]
fn shallow<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>), wants: &Wants) -> Fragment<S> {
    let inverse = inverse_near_one(form(d, r.depth_x, r.depth_y));
    let rho_squared = square_of(r, d) * (inverse * inverse);
    let inside = rho_squared.le(r.z.one());
    Fragment { visible: inside, inside, z: r.z * inverse, weight: wants.kernel.at(rho_squared) }
}

/// Shallow or soft ones.
#[inline(always)]
pub(crate) fn soft<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>), wants: &Wants) -> Fragment<S> {
    let one = r.z.one();
    // A fragment outside the disk lies no farther from its centre than the disk does.
    let inverse = inverse_near_one(form(d, r.depth_x, r.depth_y).max(r.range_min).min(r.range_max));
    let visible = visible_square_of(r, d) * (inverse * inverse);
    let filtered = inverse_near_one(form(d, r.w_x, r.w_y));
    let rho_squared = square_of(r, d) * (filtered * filtered);
    let weight = wants.kernel.at(rho_squared) * r.weight_scale;
    Fragment { visible: visible.le(one), inside: rho_squared.le(one), z: r.z * inverse, weight }
}

/// The plane's depth within the disk's range, and p_z/z and z/p_z where that is what is linear. The disk ends just where
/// |(u, v)| reaches the clamped p_z/z, so that the test needs no look at the sign of w.
#[inline(always)]
fn depth_of<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>), wants: &Wants) -> (Lanes<S>, Option<[Lanes<S>; 2]>) {
    if wants.linear_depth {
        return (form_at(d, r.depth_x, r.depth_y, r.z).max(r.range_min).min(r.range_max), None);
    }
    let w = form_at(d, r.depth_x, r.depth_y, r.z.one()).max(r.range_min).min(r.range_max);
    let inverse = w.reciprocal_near_one();
    (r.z * inverse, Some([w, inverse]))
}

/// Plain ones.
#[inline(always)]
pub(crate) fn plain<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>), wants: &Wants) -> Fragment<S> {
    let (z, ratio) = depth_of(r, d, wants);
    let square = square_of(r, d);
    let (inside, rho_squared) = match ratio {
        Some([w, inverse]) => (square.le(w * w), square * (inverse * inverse)),
        None => (square.le(r.z.one()), square),
    };
    Fragment { visible: inside, inside, z, weight: wants.kernel.at(rho_squared) }
}

/// Any that are set up in lanes.
#[inline(always)]
pub(crate) fn general<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>), wants: &Wants) -> Fragment<S> {
    let (zero, one) = (r.z.zero(), r.z.one());
    let k = |v: f32| Lanes::splat(r.z.0.simd, v);
    let (z, ratio) = depth_of(r, d, wants);
    let exists = k(wants.near).le(z) & z.le(k(wants.far));
    let limit = match ratio {
        Some([w, _]) => w,
        None => one,
    };
    let visible = visible_square_of(r, d).le(limit * limit) & exists;
    let square = square_of(r, d);
    let w = form_at(d, r.w_x, r.w_y, one);
    let mut inside = zero.lt(w) & square.le(w * w);
    // Inside the disk w is near one; elsewhere the lane isn't used.
    let inverse = w.reciprocal_near_one();
    let mut rho_squared = square * inverse * inverse;
    if let Some(clamp) = wants.clamp {
        let (d_x, d_y) = d;
        let disk = d_x.mul_add(d_x, d_y * d_y) * k(clamp);
        rho_squared = Lanes::select(inside, rho_squared, disk).min(disk);
        inside |= disk.le(one);
    }
    let weight = wants.kernel.at(rho_squared) * r.weight_scale;
    Fragment { visible, inside: inside & exists, z, weight }
}

/// Near splats are evaluated pixel by pixel in f64: depths, NaN where there is nothing, and weights.
///
/// Not lanes: what is returned through memory stays in memory, of ordinary splats too.
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

/// [`fragment`] of four splats that are shallow or, if `SOFT`, soft, each at its own pixels, step by step together: a
/// processor looks ahead over two or so, too few for the long chain of each.
#[inline(always)]
pub(crate) fn four<S: Simd, const SOFT: bool>(
    simd: S,
    records: [&Record; 4],
    at: [(Lanes<S>, Lanes<S>); 4],
    shared: &Shared<'_>,
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
        if SOFT {
            // A fragment outside the disk lies no farther from its centre than the disk does.
            e = e.max(k(records[j].range_min())).min(k(records[j].range_max()));
        }
        inverse[j] = inverse_near_one(e);
    }
    let mut visible = [one; 4];
    if SOFT {
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
    let mut weights = shared.wants.kernel.at_four(square);
    if SOFT {
        for j in 0..4 {
            weights[j] = weights[j] * k(records[j].weight_scale());
        }
    }
    let fragment = |j: usize| {
        let inside = square[j].le(one);
        let visible = if SOFT { visible[j].le(one) } else { inside };
        Fragment { visible, inside, z: k(records[j].z()) * inverse[j], weight: weights[j] }
    };
    [fragment(0), fragment(1), fragment(2), fragment(3)]
}

/// 1/(1 + e) = (1 − e)(1 + e²)/(1 − e⁴), with |e| < 1/48 or so within a shallow disk and small enough all over its blocks.
#[inline(always)]
fn inverse_near_one<S: Simd>(e: Lanes<S>) -> Lanes<S> {
    let one = e.one();
    (one - e) * e.mul_add(e, one)
}
