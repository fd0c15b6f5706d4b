//! Visibility and attributes of one block of 4×4 pixels (§5), a lane for each: two loops over the same list of splats,
//! with the block's sums in registers.

use crate::clip::ScreenClip;
use crate::kernel::Kernel;
use crate::lanes::{LANES, Lanes};
use crate::lists::Listed;
use crate::near::NearSplat;
use crate::record::{Class, Record};
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use surfel_math::{Real, V2};
use surfel_model::Filter;
use surfel_render::{Attributes, FramePlan, Pass, View};

/// What a block computes, from the plan.
#[derive(Clone, Copy)]
pub(crate) struct Wants {
    pub attributes: Attributes,
    /// The ε of the splat that wrote the kept value.
    pub epsilon: bool,
    /// Depth is linear over pixels: orthographic, or affine mapping.
    pub linear_depth: bool,
    /// 1/h² of `clamp`'s disk.
    pub clamp: Option<f32>,
    pub kernel: Kernel,
    pub near: f32,
    pub far: f32,
}

impl Wants {
    pub(crate) fn new(plan: &FramePlan, view: &View) -> Self {
        let settings = &plan.splat_filter;
        let clamp = settings.filter == Filter::Clamp;
        Self {
            attributes: plan.attributes,
            epsilon: plan.has(Pass::EdgeAntialiasing),
            linear_depth: !settings.projective,
            clamp: clamp.then(|| (1.0 / (settings.radius_px * settings.radius_px)) as f32),
            kernel: Kernel::new(settings.cutoff),
            near: view.projection.near as f32,
            far: view.projection.far().min(f64::from(f32::MAX)) as f32,
        }
    }
}

/// What all blocks of a frame share.
#[derive(Clone, Copy)]
pub(crate) struct Shared<'a> {
    pub wants: Wants,
    pub near: &'a [NearSplat],
    pub clips: &'a [ScreenClip],
    /// Ambient, diffuse, specular, shininess of every object.
    pub factors: &'a [[f32; 4]],
    /// 1/W0 of every object.
    pub coverage: &'a [f32],
}

/// Most splats of a block whose fragments are remembered between the loops; past that they are computed twice.
const REMEMBERED: usize = 256;

/// Fragments of a block between the loops.
pub(crate) struct Scratch {
    /// Indices in the block's list of the splats with fragments.
    splats: [u32; REMEMBERED + 1],
    /// Their depths (NaN outside the footprint) and weights.
    fragments: [[[f32; LANES]; 2]; REMEMBERED + 1],
}

impl Scratch {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self { splats: [0; REMEMBERED + 1], fragments: [[[0.0; LANES]; 2]; REMEMBERED + 1] })
    }
}

/// Sums of a block. What the plan doesn't want stays zero.
#[derive(Clone, Copy)]
pub(crate) struct Sums<S: Simd> {
    /// min(z + ε), +∞ where nothing is.
    pub kept: Lanes<S>,
    pub kept_epsilon: Lanes<S>,
    pub weight: Lanes<S>,
    pub fragments: Lanes<S>,
    pub color: [Lanes<S>; 3],
    pub normal: [Lanes<S>; 3],
    pub depth: Lanes<S>,
    pub material: [Lanes<S>; 4],
    pub coverage: Lanes<S>,
    /// Pairs of block and splat that were computed, and lanes of them inside a filtered footprint.
    pub tested: u32,
    pub inside: u32,
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            kept: Lanes::splat(simd, f32::INFINITY),
            kept_epsilon: zero,
            weight: zero,
            fragments: zero,
            color: [zero; 3],
            normal: [zero; 3],
            depth: zero,
            material: [zero; 4],
            coverage: zero,
            tested: 0,
            inside: 0,
        }
    }
}

/// A splat at the pixels of a block.
struct Fragment<S: Simd> {
    /// Inside the unfiltered footprint.
    visible: mask32x16<S>,
    /// Inside the filtered footprint.
    inside: mask32x16<S>,
    z: Lanes<S>,
    /// Means nothing outside the footprint.
    weight: Lanes<S>,
}

/// Runs both loops over the block whose first pixel is (x, y). With `behind`, fragments up to that depth don't exist.
#[inline(always)]
pub(crate) fn block<S: Simd>(
    simd: S,
    list: &[Listed<'_>],
    (x, y): (i32, i32),
    shared: &Shared<'_>,
    behind: Option<Lanes<S>>,
    scratch: &mut Scratch,
) -> Sums<S> {
    let wants = &shared.wants;
    let k = |v: f32| Lanes::splat(simd, v);
    let mut sums = Sums::new(simd);
    let at = (Lanes::block_columns(simd) + k(x as f32), Lanes::block_rows(simd) + k(y as f32));
    let remembers = list.len() <= REMEMBERED;
    let mut count = 0;
    for (i, &Listed { record, z_min }) in list.iter().enumerate() {
        // Nothing of a splat behind all that is kept matters, in either loop.
        if sums.kept.lt(k(z_min)).all_true() {
            continue;
        }
        let mut fragment = fragment(simd, record, at, (x, y), shared);
        if let Some(behind) = behind {
            let exists = behind.lt(fragment.z);
            fragment.visible &= exists;
            fragment.inside &= exists;
        }
        sums.tested += 1;
        let hits = fragment.inside.to_bitmask();
        sums.inside += hits.count_ones();
        let value = fragment.z + k(record.epsilon());
        let closer = fragment.visible & value.lt(sums.kept);
        sums.kept = Lanes::select(closer, value, sums.kept);
        if wants.epsilon {
            sums.kept_epsilon = Lanes::select(closer, k(record.epsilon()), sums.kept_epsilon);
        }
        if remembers {
            // Written in any case and counted where there is something: a branch would often be guessed wrong.
            let [z, weight] = &mut scratch.fragments[count];
            Lanes::select(fragment.inside, fragment.z, k(f32::NAN)).store(z);
            fragment.weight.store(weight);
            scratch.splats[count] = i as u32;
            count += usize::from(hits != 0);
        }
    }
    if remembers {
        for (i, [z, weight]) in scratch.splats[..count].iter().zip(&scratch.fragments) {
            let z = Lanes::load(simd, z);
            let mask = z.le(sums.kept);
            accumulate(simd, &mut sums, list[*i as usize].record, mask, z, Lanes::load(simd, weight), shared);
        }
    } else {
        for &Listed { record, .. } in list {
            let mut fragment = fragment(simd, record, at, (x, y), shared);
            if let Some(behind) = behind {
                fragment.inside &= behind.lt(fragment.z);
            }
            let mask = fragment.inside & fragment.z.le(sums.kept);
            accumulate(simd, &mut sums, record, mask, fragment.z, fragment.weight, shared);
        }
    }
    sums
}

#[inline(always)]
fn fragment<S: Simd>(
    simd: S,
    record: &Record,
    at: (Lanes<S>, Lanes<S>),
    first: (i32, i32),
    shared: &Shared<'_>,
) -> Fragment<S> {
    let mut fragment = unclipped(simd, record, at, first, shared);
    if let Some(index) = record.clip() {
        let (d_x, d_y) = offsets(simd, record, at);
        let (mut x, mut y) = (d_x, d_y);
        if shared.wants.clamp.is_some() {
            // The disk of `clamp` may reach beyond the horizon, where the centre decides.
            let k = |v: f32| Lanes::splat(simd, v);
            let before = k(0.0).lt(k(record.w_x()).mul_add(d_x, k(record.w_y()).mul_add(d_y, k(1.0))));
            (x, y) = (Lanes::select(before, d_x, k(0.0)), Lanes::select(before, d_y, k(0.0)));
        }
        let [visible, inside] = shared.clips[index].keeps(V2::new(d_x, d_y), V2::new(x, y));
        fragment.visible &= visible;
        fragment.inside &= inside;
    }
    fragment
}

/// Offsets of a block's pixels from the anchor. Whole pixels are exact; one rounding of an offset, not of a pixel
/// coordinate.
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
    shared: &Shared<'_>,
) -> Fragment<S> {
    let wants = &shared.wants;
    let k = |v: f32| Lanes::splat(simd, v);
    let (d_x, d_y) = offsets(simd, record, at);
    let form = |x: f32, y: f32, c: f32| k(x).mul_add(d_x, k(y).mul_add(d_y, k(c)));
    let form0 = |x: f32, y: f32| k(x).mul_add(d_x, k(y) * d_y);
    let class = record.class();
    if class == Class::Near {
        return near_fragment(simd, &shared.near[record.object()], first, &wants.kernel);
    }
    let u = form0(record.u_x(), record.u_y());
    let v = form0(record.v_x(), record.v_y());
    let square = u.mul_add(u, v * v);
    let (low, high) = (k(record.range_min()), k(record.range_max()));
    let one = k(1.0);
    // The plane's depth within the disk's range, and p_z/z and z/p_z where that is what is linear. The disk ends just
    // where |(u, v)| reaches the clamped p_z/z, so that the test needs no look at the sign of w.
    let (z, ratio, inverse) = if wants.linear_depth {
        (form(record.depth_x(), record.depth_y(), record.z()).max(low).min(high), None, None)
    } else {
        let w = form(record.depth_x(), record.depth_y(), 1.0).max(low).min(high);
        let inverse = if class == Class::Shallow {
            // (1 − e)(1 + e²) = (1 − e⁴)/(1 + e), with |e| < 1/63.
            let e = w - one;
            (one - e) * e.mul_add(e, one)
        } else {
            w.reciprocal_near_one()
        };
        (k(record.z()) * inverse, Some(w), Some(inverse))
    };
    if matches!(class, Class::Shallow | Class::Plain) {
        let (inside, rho_squared) = match (ratio, inverse) {
            (Some(w), Some(inverse)) => (square.le(w * w), square * (inverse * inverse)),
            _ => (square.le(one), square),
        };
        return Fragment { visible: inside, inside, z, weight: wants.kernel.at(rho_squared) };
    }
    let exists = k(wants.near).le(z) & z.le(k(wants.far));
    let visible_u = form0(record.visible_u_x(), record.visible_u_y());
    let visible_v = form0(record.visible_v_x(), record.visible_v_y());
    let limit = match ratio {
        Some(w) => w,
        None => one,
    };
    let visible = visible_u.mul_add(visible_u, visible_v * visible_v).le(limit * limit) & exists;
    let zero = k(0.0);
    let w = form(record.w_x(), record.w_y(), 1.0);
    let mut inside = zero.lt(w) & square.le(w * w);
    // Inside the disk w is near one; elsewhere the lane isn't used.
    let inverse = w.reciprocal_near_one();
    let mut rho_squared = square * inverse * inverse;
    if let Some(clamp) = wants.clamp {
        let disk = d_x.mul_add(d_x, d_y * d_y) * k(clamp);
        rho_squared = Lanes::select(inside, rho_squared, disk).min(disk);
        inside |= disk.le(one);
    }
    let weight = wants.kernel.at(rho_squared) * k(record.weight_scale());
    Fragment { visible, inside: inside & exists, z, weight }
}

/// Near splats are evaluated pixel by pixel in f64.
#[cold]
fn near_fragment<S: Simd>(simd: S, near: &NearSplat, (x, y): (i32, i32), kernel: &Kernel) -> Fragment<S> {
    let (mut depths, mut weights) = ([f32::NAN; LANES], [0.0; LANES]);
    for i in 0..LANES {
        if let Some((rho_squared, z)) = near.hit(x + (i % 4) as i32, y + (i / 4) as i32) {
            (depths[i], weights[i]) = (z, kernel.at_one(rho_squared));
        }
    }
    let (z, weight) = (Lanes::load(simd, &depths), Lanes::load(simd, &weights));
    let inside = z.le(z);
    Fragment { visible: inside, inside, z, weight }
}

/// Adds weighted attributes where `mask` says so.
#[inline(always)]
fn accumulate<S: Simd>(
    simd: S,
    sums: &mut Sums<S>,
    record: &Record,
    mask: mask32x16<S>,
    z: Lanes<S>,
    weight: Lanes<S>,
    shared: &Shared<'_>,
) {
    let attributes = &shared.wants.attributes;
    let k = |v: f32| Lanes::splat(simd, v);
    let zero = k(0.0);
    let weight = Lanes::select(mask, weight, zero);
    sums.weight = sums.weight + weight;
    sums.fragments = sums.fragments + Lanes::select(mask, k(1.0), zero);
    if attributes.color {
        let color = [record.red(), record.green(), record.blue()];
        for (sum, c) in sums.color.iter_mut().zip(color) {
            *sum = weight.mul_add(k(c), *sum);
        }
    }
    if attributes.normal {
        let normal = [record.normal_x(), record.normal_y(), record.normal_z()];
        for (sum, c) in sums.normal.iter_mut().zip(normal) {
            *sum = weight.mul_add(k(c), *sum);
        }
    }
    if attributes.depth {
        sums.depth = weight.mul_add(Lanes::select(mask, z, zero), sums.depth);
    }
    if attributes.material | attributes.coverage {
        let object = object_of(record, shared);
        if attributes.material {
            for (sum, c) in sums.material.iter_mut().zip(shared.factors[object]) {
                *sum = weight.mul_add(k(c), *sum);
            }
        }
        if attributes.coverage {
            sums.coverage = weight.mul_add(k(record.coverage_scale() * shared.coverage[object]), sums.coverage);
        }
    }
}

#[inline(always)]
fn object_of(record: &Record, shared: &Shared<'_>) -> usize {
    match record.class() {
        Class::Near => shared.near[record.object()].object as usize,
        _ => record.object(),
    }
}
