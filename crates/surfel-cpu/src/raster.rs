//! Visibility and attributes of one block of 4×4 pixels (§5), a lane for each: two loops over the same list of splats,
//! with the block's sums in registers.

use crate::clip::FrameClips;
use crate::fours::{Pixels, Visit, each_four, largest};
use crate::fragment::Fragment;
use crate::kernel::Kernel;
use crate::lanes::{LANES, Lanes};
use crate::limit::Limit;
use crate::lists::{BlockList, FOUR};
use crate::near::NearSplat;
use crate::record::{Class, Record};
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;
use surfel_model::Filter;
use surfel_render::{Attributes, FramePlan, Pass, View};

/// What a block computes, from the plan.
#[derive(Clone, Copy)]
pub(crate) struct Wants {
    pub attributes: Attributes,
    /// The ε of the splat that wrote the kept value.
    pub epsilon: bool,
    /// How many fragments are inside footprints, and how many are added.
    pub counts: bool,
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
            counts: plan.planes.fragments,
            linear_depth: !settings.projective,
            clamp: clamp.then(|| (1.0 / (settings.radius_px * settings.radius_px)) as f32),
            kernel: Kernel::new(settings.cutoff),
            near: view.projection.near as f32,
            far: view.projection.far().min(f64::from(f32::MAX)) as f32,
        }
    }

    /// Nearest and farthest depth that is drawn.
    pub(crate) fn exists(&self) -> [f32; 2] {
        [self.near, self.far]
    }
}

/// What all blocks of a frame share.
#[derive(Clone, Copy)]
pub(crate) struct Shared<'a> {
    pub wants: Wants,
    pub near: &'a [NearSplat],
    pub clips: &'a FrameClips,
    /// Ambient, diffuse, specular, shininess of every object.
    pub factors: &'a [[f32; 4]],
    /// 1/W0 of every object.
    pub coverage: &'a [f32],
    /// Coverage of a unit of weight, where it is the same for all splats: it isn't summed then.
    pub coverage_of_weight: Option<f32>,
}

/// Most splats of a block whose fragments are remembered between the loops; past that they are computed twice.
const REMEMBERED: usize = 256;

/// Fragments of a block between the loops. Aligned as the lines of a processor's memory: what crosses two costs twice.
#[repr(align(64))]
pub(crate) struct Scratch {
    /// Depths (+∞ outside the footprint) and weights of four splats after four.
    fragments: [[[[f32; LANES]; 2]; FOUR]; REMEMBERED / FOUR],
    /// Which four they are.
    fours: [u32; REMEMBERED / FOUR],
}

impl Scratch {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self { fragments: [[[[0.0; LANES]; 2]; FOUR]; REMEMBERED / FOUR], fours: [0; REMEMBERED / FOUR] })
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

    /// Nothing is added yet.
    #[inline(always)]
    fn clear(&mut self) {
        let none = Self::new(self.kept.0.simd);
        let Self { kept, kept_epsilon, tested, inside, .. } = *self;
        *self = Self { kept, kept_epsilon, tested, inside, ..none };
    }

    /// To be called when all is added: coverage, where it follows from the weight.
    #[inline(always)]
    pub(crate) fn cover(&mut self, shared: &Shared<'_>) {
        if let Some(scale) = shared.coverage_of_weight {
            self.coverage = self.weight * Lanes::splat(self.weight.0.simd, scale);
        }
    }
}

/// What the first loop carries along.
struct FirstLoop<'a, 'b, S: Simd, L, const EPSILON: bool, const COUNT: bool, const REMEMBER: bool> {
    kept: Lanes<S>,
    kept_epsilon: Lanes<S>,
    inside: u32,
    limit: &'a L,
    /// How many fours are remembered.
    count: usize,
    scratch: &'b mut Scratch,
}

impl<S: Simd, L: Limit<S>, const EPSILON: bool, const COUNT: bool, const REMEMBER: bool> Visit<S>
    for FirstLoop<'_, '_, S, L, EPSILON, COUNT, REMEMBER>
{
    #[inline(always)]
    fn begin(&mut self, number: usize) {
        if REMEMBER && let Some(four) = self.scratch.fours.get_mut(self.count) {
            *four = number as u32;
            self.count += 1;
        }
    }

    #[inline(always)]
    fn add(&mut self, simd: S, mut fragment: Fragment<S>, j: usize, record: &Record) {
        let k = |v: f32| Lanes::splat(simd, v);
        if let Some(exists) = self.limit.exists(fragment.z) {
            fragment.visible &= exists;
            fragment.inside &= exists;
        }
        if COUNT {
            // Not an ordinary sum, of which the compiler would make one of lanes: they have enough to do.
            self.inside = self.inside.saturating_add(fragment.inside.to_bitmask().count_ones());
        }
        let infinity = k(f32::INFINITY);
        let value = Lanes::select(fragment.visible, fragment.z, infinity) + k(record.epsilon());
        if EPSILON {
            self.kept_epsilon = Lanes::select(value.lt(self.kept), k(record.epsilon()), self.kept_epsilon);
        }
        self.kept = self.kept.min(value);
        if REMEMBER {
            // Always within: a branch here would keep masks from staying in their registers.
            let four = &mut self.scratch.fragments[self.count.wrapping_sub(1) % (REMEMBERED / FOUR)];
            let [z, weight] = &mut four[j % FOUR];
            Lanes::select(fragment.inside, fragment.z, infinity).store(z);
            fragment.weight.store(weight);
        }
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        Some(largest(self.limit.matters(self.kept)))
    }
}

/// Runs both loops over the block whose first pixel is given: its sums. Only fragments that `limit` leaves exist. What the plan
/// doesn't want of the sums isn't touched.
#[inline(always)]
pub(crate) fn block<S: Simd>(
    simd: S,
    list: BlockList<'_, '_>,
    first_px: (i32, i32),
    shared: &Shared<'_>,
    limit: impl Limit<S>,
    scratch: &mut Scratch,
    sums: &mut Sums<S>,
) {
    let Wants { epsilon, counts, .. } = shared.wants;
    match (epsilon, counts, FOUR * list.fours().len() <= REMEMBERED) {
        (false, false, true) => {
            both_loops::<S, _, false, false, true>(simd, list, first_px, shared, limit, scratch, sums);
        }
        (false, true, true) => {
            both_loops::<S, _, false, true, true>(simd, list, first_px, shared, limit, scratch, sums);
        }
        (true, _, true) => both_loops::<S, _, true, true, true>(simd, list, first_px, shared, limit, scratch, sums),
        (_, _, false) => both_loops::<S, _, true, true, false>(simd, list, first_px, shared, limit, scratch, sums),
    }
}

/// [`block`], with ε of what is kept and fragments counted if that is wanted, and fragments remembered if there are few enough.
///
/// Out of line, for all who draw blocks.
#[inline(never)]
fn both_loops<S: Simd, L: Limit<S>, const EPSILON: bool, const COUNT: bool, const REMEMBER: bool>(
    simd: S,
    list: BlockList<'_, '_>,
    first_px: (i32, i32),
    shared: &Shared<'_>,
    limit: L,
    scratch: &mut Scratch,
    sums: &mut Sums<S>,
) {
    simd.vectorize(
        #[inline(always)]
        || loops::<S, L, EPSILON, COUNT, REMEMBER>(simd, list, first_px, shared, limit, scratch, sums),
    );
}

#[inline(always)]
fn loops<S: Simd, L: Limit<S>, const EPSILON: bool, const COUNT: bool, const REMEMBER: bool>(
    simd: S,
    list: BlockList<'_, '_>,
    first_px: (i32, i32),
    shared: &Shared<'_>,
    mut limit: L,
    scratch: &mut Scratch,
    sums: &mut Sums<S>,
) {
    let pixels = Pixels::new(simd, first_px);
    let (kept, kept_epsilon) = (Lanes::splat(simd, f32::INFINITY), Lanes::splat(simd, 0.0));
    let mut first =
        FirstLoop::<_, _, EPSILON, COUNT, REMEMBER> { kept, kept_epsilon, inside: 0, limit: &limit, count: 0, scratch };
    // Nothing of a splat behind all that is kept matters, in either loop.
    sums.tested = each_four(simd, list, f32::INFINITY, &pixels, shared, &mut first);
    let FirstLoop { kept, kept_epsilon, inside, count, scratch, .. } = first;
    (sums.kept, sums.inside) = (kept, inside);
    if EPSILON {
        sums.kept_epsilon = kept_epsilon;
    }
    limit.settle(sums.kept);
    if REMEMBER {
        let remembered = Remembered { list, scratch, count };
        let a = &shared.wants.attributes;
        // Which are summed is known to each loop: sums then stay in registers.
        match (a.color, a.normal, a.depth) {
            _ if a.material | (a.coverage & shared.coverage_of_weight.is_none()) => {
                remembered.add_all(simd, sums, &limit, shared);
            }
            (false, false, false) => remembered.add::<S, COUNT, false, false, false>(simd, sums, &limit),
            (false, false, true) => remembered.add::<S, COUNT, false, false, true>(simd, sums, &limit),
            (false, true, false) => remembered.add::<S, COUNT, false, true, false>(simd, sums, &limit),
            (false, true, true) => remembered.add::<S, COUNT, false, true, true>(simd, sums, &limit),
            (true, false, false) => remembered.add::<S, COUNT, true, false, false>(simd, sums, &limit),
            (true, false, true) => remembered.add::<S, COUNT, true, false, true>(simd, sums, &limit),
            (true, true, false) => remembered.add::<S, COUNT, true, true, false>(simd, sums, &limit),
            (true, true, true) => remembered.add::<S, COUNT, true, true, true>(simd, sums, &limit),
        }
    } else {
        second_loop(simd, list, &pixels, sums, limit, shared);
    }
    sums.cover(shared);
}

/// The depths up to which fragments are added: any where nothing is kept, but not +∞, which is none.
#[inline(always)]
fn reach<S: Simd>(kept: Lanes<S>) -> Lanes<S> {
    kept.min(kept.constant(f64::from(f32::MAX)))
}

/// What the first loop remembered.
struct Remembered<'a, 'b, 'c> {
    list: BlockList<'a, 'b>,
    scratch: &'c Scratch,
    count: usize,
}

impl<'a> Remembered<'a, '_, '_> {
    /// Four splats after four, with their fragments.
    #[inline(always)]
    fn fours(&self) -> impl Iterator<Item = ([&'a Record; FOUR], &[[[f32; LANES]; 2]; FOUR])> {
        let fours = self.scratch.fours[..self.count].iter().zip(&self.scratch.fragments);
        fours.map(|(&number, fragments)| {
            let [i, j, k, l] = self.list.fours()[number as usize];
            let record = |i| self.list.get(i).0;
            ([record(i), record(j), record(k), record(l)], fragments)
        })
    }

    /// The second loop over what was remembered, for sums of weights, and of colours, normals and depths if they are wanted.
    #[inline(always)]
    fn add<S: Simd, const COUNT: bool, const COLOR: bool, const NORMAL: bool, const DEPTH: bool>(
        &self,
        simd: S,
        sums: &mut Sums<S>,
        limit: &impl Limit<S>,
    ) {
        let k = |v: f32| Lanes::splat(simd, v);
        let (zero, one) = (k(0.0), k(1.0));
        let [mut total, mut fragments, mut depth, mut r, mut g, mut b, mut x, mut y, mut z_sum] = [zero; 9];
        let kept = reach(sums.kept);
        for (records, four) in self.fours() {
            for (record, [z, weight]) in records.into_iter().zip(four) {
                let z = Lanes::load(simd, z);
                let mask = limit.reaches(z, record, z.le(kept));
                let weight = Lanes::select(mask, Lanes::load(simd, weight), zero);
                total = total + weight;
                if COUNT {
                    fragments = Lanes::select(mask, fragments + one, fragments);
                }
                if COLOR {
                    r = weight.mul_add(k(record.red()), r);
                    g = weight.mul_add(k(record.green()), g);
                    b = weight.mul_add(k(record.blue()), b);
                }
                if NORMAL {
                    x = weight.mul_add(k(record.normal_x()), x);
                    y = weight.mul_add(k(record.normal_y()), y);
                    z_sum = weight.mul_add(k(record.normal_z()), z_sum);
                }
                if DEPTH {
                    depth = Lanes::select(mask, weight.mul_add(z, depth), depth);
                }
            }
        }
        (sums.weight, sums.fragments) = (total, fragments);
        if COLOR {
            sums.color = [r, g, b];
        }
        if NORMAL {
            sums.normal = [x, y, z_sum];
        }
        if DEPTH {
            sums.depth = depth;
        }
    }

    /// The same for any attributes.
    #[inline(always)]
    fn add_all<S: Simd>(&self, simd: S, sums: &mut Sums<S>, limit: &impl Limit<S>, shared: &Shared<'_>) {
        let kept = reach(sums.kept);
        sums.clear();
        for (records, four) in self.fours() {
            for (record, [z, weight]) in records.into_iter().zip(four) {
                let z = Lanes::load(simd, z);
                let mask = limit.reaches(z, record, z.le(kept));
                accumulate(simd, sums, record, mask, z, Lanes::load(simd, weight), shared);
            }
        }
    }
}

/// The second loop where fragments weren't remembered: what is kept is known now, and what lies behind it passed over.
///
/// Out of line: it is long, and most blocks don't come here.
#[cold]
#[inline(never)]
fn second_loop<S: Simd>(
    simd: S,
    list: BlockList<'_, '_>,
    pixels: &Pixels<S>,
    sums: &mut Sums<S>,
    limit: impl Limit<S>,
    shared: &Shared<'_>,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let farthest = largest(limit.matters(sums.kept));
            sums.clear();
            each_four(simd, list, farthest, pixels, shared, &mut SecondLoop { sums, limit, shared });
        },
    );
}

/// What the second loop carries along where fragments weren't remembered.
struct SecondLoop<'a, 'b, S: Simd, L> {
    sums: &'a mut Sums<S>,
    limit: L,
    shared: &'a Shared<'b>,
}

impl<S: Simd, L: Limit<S>> Visit<S> for SecondLoop<'_, '_, S, L> {
    #[inline(always)]
    fn add(&mut self, simd: S, mut fragment: Fragment<S>, _: usize, record: &Record) {
        if let Some(exists) = self.limit.exists(fragment.z) {
            fragment.inside &= exists;
        }
        let near = fragment.inside & fragment.z.le(self.sums.kept);
        let mask = self.limit.reaches(fragment.z, record, near);
        accumulate(simd, self.sums, record, mask, fragment.z, fragment.weight, self.shared);
    }

    #[inline(always)]
    fn farthest(&self) -> Option<f32> {
        None
    }
}

/// Adds weighted attributes where `mask` says so.
#[inline(always)]
pub(crate) fn accumulate<S: Simd>(
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
    if attributes.material | (attributes.coverage & shared.coverage_of_weight.is_none()) {
        let object = object_of(record, shared.near);
        if attributes.material {
            for (sum, c) in sums.material.iter_mut().zip(shared.factors[object]) {
                *sum = weight.mul_add(k(c), *sum);
            }
        }
        if attributes.coverage && shared.coverage_of_weight.is_none() {
            sums.coverage = weight.mul_add(k(record.coverage_scale() * shared.coverage[object]), sums.coverage);
        }
    }
}

/// Index of a record's object.
#[inline(always)]
pub(crate) fn object_of(record: &Record, near: &[NearSplat]) -> usize {
    match record.class() {
        Class::Near => near[record.object()].object as usize,
        _ => record.object(),
    }
}
