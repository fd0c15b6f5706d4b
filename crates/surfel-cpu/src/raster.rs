//! Visibility and attributes of one block of 4×4 pixels (§5), a lane for each: two loops over the same list of splats,
//! with the block's sums in registers.

use crate::clip::FrameClips;
use crate::fragment::{Fragment, four, fragment};
use crate::kernel::Kernel;
use crate::lanes::{LANES, Lanes};
use crate::limit::Limit;
use crate::lists::BlockList;
use crate::near::NearSplat;
use crate::record::{Class, Record, Together};
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

    /// To be called when all is added: coverage, where it follows from the weight.
    #[inline(always)]
    pub(crate) fn cover(&mut self, shared: &Shared<'_>) {
        if let Some(scale) = shared.coverage_of_weight {
            self.coverage = self.weight * Lanes::splat(self.weight.0.simd, scale);
        }
    }
}

/// The first loop alone: what a block keeps.
#[inline(always)]
pub(crate) fn visibility<S: Simd>(
    simd: S,
    list: BlockList<'_, '_>,
    (x, y): (i32, i32),
    shared: &Shared<'_>,
) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let at = (Lanes::block_columns(simd) + k(x as f32), Lanes::block_rows(simd) + k(y as f32));
    let mut kept = k(f32::INFINITY);
    for (&record, &z_min) in list.records.iter().zip(list.z_min) {
        if kept.lt(k(z_min)).all_true() {
            continue;
        }
        let fragment = fragment(simd, record, at, (x, y), shared);
        let value = fragment.z + k(record.epsilon());
        kept = Lanes::select(fragment.visible & value.lt(kept), value, kept);
    }
    kept
}

/// What the first loop carries along.
struct FirstLoop<'a, S: Simd, L> {
    sums: Sums<S>,
    limit: L,
    wants_epsilon: bool,
    /// Whether fragments are remembered, and how many are.
    remembers: bool,
    count: usize,
    scratch: &'a mut Scratch,
}

impl<S: Simd, L: Limit<S>> Visit<S> for FirstLoop<'_, S, L> {
    #[inline(always)]
    fn add(&mut self, simd: S, mut fragment: Fragment<S>, i: usize, record: &Record) {
        let k = |v: f32| Lanes::splat(simd, v);
        let sums = &mut self.sums;
        if let Some(exists) = self.limit.exists(fragment.z) {
            fragment.visible &= exists;
            fragment.inside &= exists;
        }
        let hits = fragment.inside.to_bitmask();
        sums.inside += hits.count_ones();
        let value = fragment.z + k(record.epsilon());
        let closer = fragment.visible & value.lt(sums.kept);
        sums.kept = Lanes::select(closer, value, sums.kept);
        if self.wants_epsilon {
            sums.kept_epsilon = Lanes::select(closer, k(record.epsilon()), sums.kept_epsilon);
        }
        if self.remembers {
            // Written in any case and counted where there is something: a branch would often be guessed wrong.
            let [z, weight] = &mut self.scratch.fragments[self.count];
            Lanes::select(fragment.inside, fragment.z, k(f32::NAN)).store(z);
            fragment.weight.store(weight);
            self.scratch.splats[self.count] = i as u32;
            self.count += usize::from(hits != 0);
        }
    }
}

/// Runs both loops over the block whose first pixel is (x, y). Only fragments that `limit` leaves exist.
#[inline(always)]
pub(crate) fn block<S: Simd>(
    simd: S,
    list: BlockList<'_, '_>,
    (x, y): (i32, i32),
    shared: &Shared<'_>,
    limit: impl Limit<S>,
    scratch: &mut Scratch,
) -> Sums<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let at = (Lanes::block_columns(simd) + k(x as f32), Lanes::block_rows(simd) + k(y as f32));
    let remembers = list.records.len() <= REMEMBERED;
    let wants_epsilon = shared.wants.epsilon;
    let mut loop_1 = FirstLoop { sums: Sums::new(simd), limit, wants_epsilon, remembers, count: 0, scratch };
    // Nothing of a splat behind all that is kept matters, in either loop. Sixteen are looked at together, with what was kept
    // before them: a test splat by splat would wait for each result, and be guessed wrong.
    let mut farthest = None;
    for first in (0..list.records.len()).step_by(LANES) {
        let mut left = (1u64 << (list.records.len() - first).min(LANES)) - 1;
        if let Some(farthest) = farthest {
            left &= !k(farthest).lt(Lanes::load(simd, &list.z_min[first..])).to_bitmask();
        }
        loop_1.sums.tested += left.count_ones();
        sixteen(simd, list, (first, left), at, (x, y), shared, &mut loop_1);
        if first + LANES < list.records.len() {
            farthest = Some(largest(loop_1.limit.matters(loop_1.sums.kept)));
        }
    }
    let FirstLoop { mut sums, mut limit, count, scratch, .. } = loop_1;
    limit.settle(sums.kept);
    if remembers {
        let remembered = Remembered { list, scratch, count };
        let a = &shared.wants.attributes;
        // Which are summed is known to each loop: sums then stay in registers.
        sums = match (a.color, a.normal, a.depth) {
            _ if a.material | (a.coverage & shared.coverage_of_weight.is_none()) => {
                remembered.add_all(simd, sums, &limit, shared)
            }
            (false, false, false) => remembered.add::<S, false, false, false>(simd, sums, &limit),
            (false, false, true) => remembered.add::<S, false, false, true>(simd, sums, &limit),
            (false, true, false) => remembered.add::<S, false, true, false>(simd, sums, &limit),
            (false, true, true) => remembered.add::<S, false, true, true>(simd, sums, &limit),
            (true, false, false) => remembered.add::<S, true, false, false>(simd, sums, &limit),
            (true, false, true) => remembered.add::<S, true, false, true>(simd, sums, &limit),
            (true, true, false) => remembered.add::<S, true, true, false>(simd, sums, &limit),
            (true, true, true) => remembered.add::<S, true, true, true>(simd, sums, &limit),
        };
    } else {
        sums = second_loop(simd, list, at, (x, y), sums, limit, shared);
    }
    sums.cover(shared);
    sums
}

/// What the first loop remembered.
struct Remembered<'a, 'b, 'c> {
    list: BlockList<'a, 'b>,
    scratch: &'c Scratch,
    count: usize,
}

impl Remembered<'_, '_, '_> {
    fn fragments(&self) -> impl Iterator<Item = (&Record, &[[f32; LANES]; 2])> {
        let splats = self.scratch.splats[..self.count].iter().zip(&self.scratch.fragments);
        splats.map(|(&i, fragment)| (self.list.records[i as usize], fragment))
    }

    /// The second loop over what was remembered, for sums of weights, and of colours, normals and depths if they are wanted.
    #[inline(always)]
    fn add<S: Simd, const COLOR: bool, const NORMAL: bool, const DEPTH: bool>(
        &self,
        simd: S,
        mut sums: Sums<S>,
        limit: &impl Limit<S>,
    ) -> Sums<S> {
        let k = |v: f32| Lanes::splat(simd, v);
        let (zero, one) = (k(0.0), k(1.0));
        let (mut total, mut fragments, mut depth) = (sums.weight, sums.fragments, sums.depth);
        let ([mut r, mut g, mut b], [mut x, mut y, mut z_sum]) = (sums.color, sums.normal);
        for (record, [z, weight]) in self.fragments() {
            let z = Lanes::load(simd, z);
            let mask = limit.reaches(z, record, z.le(sums.kept));
            let weight = Lanes::select(mask, Lanes::load(simd, weight), zero);
            total = total + weight;
            fragments = Lanes::select(mask, fragments + one, fragments);
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
                depth = weight.mul_add(Lanes::select(mask, z, zero), depth);
            }
        }
        (sums.weight, sums.fragments, sums.depth) = (total, fragments, depth);
        (sums.color, sums.normal) = ([r, g, b], [x, y, z_sum]);
        sums
    }

    /// The same for any attributes.
    #[inline(always)]
    fn add_all<S: Simd>(&self, simd: S, mut sums: Sums<S>, limit: &impl Limit<S>, shared: &Shared<'_>) -> Sums<S> {
        for (record, [z, weight]) in self.fragments() {
            let z = Lanes::load(simd, z);
            let mask = limit.reaches(z, record, z.le(sums.kept));
            accumulate(simd, &mut sums, record, mask, z, Lanes::load(simd, weight), shared);
        }
        sums
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
    at: (Lanes<S>, Lanes<S>),
    first_px: (i32, i32),
    sums: Sums<S>,
    limit: impl Limit<S>,
    shared: &Shared<'_>,
) -> Sums<S> {
    simd.vectorize(
        #[inline(always)]
        || {
            let farthest = Lanes::splat(simd, largest(limit.matters(sums.kept)));
            let mut loop_2 = SecondLoop { sums, limit, shared };
            for first in (0..list.records.len()).step_by(LANES) {
                let all = (1u64 << (list.records.len() - first).min(LANES)) - 1;
                let left = all & !farthest.lt(Lanes::load(simd, &list.z_min[first..])).to_bitmask();
                sixteen(simd, list, (first, left), at, first_px, shared, &mut loop_2);
            }
            loop_2.sums
        },
    )
}

/// What the second loop carries along where fragments weren't remembered.
struct SecondLoop<'a, 'b, S: Simd, L> {
    sums: Sums<S>,
    limit: L,
    shared: &'a Shared<'b>,
}

impl<S: Simd, L: Limit<S>> Visit<S> for SecondLoop<'_, '_, S, L> {
    #[inline(always)]
    fn add(&mut self, simd: S, mut fragment: Fragment<S>, _i: usize, record: &Record) {
        if let Some(exists) = self.limit.exists(fragment.z) {
            fragment.inside &= exists;
        }
        let near = fragment.inside & fragment.z.le(self.sums.kept);
        let mask = self.limit.reaches(fragment.z, record, near);
        accumulate(simd, &mut self.sums, record, mask, fragment.z, fragment.weight, self.shared);
    }
}

/// What is done with fragments. Not a closure: one that is called in several places isn't inlined into SIMD code.
trait Visit<S: Simd> {
    /// Takes in splat `i` of the list.
    fn add(&mut self, simd: S, fragment: Fragment<S>, i: usize, record: &Record);
}

/// Computes the fragments of those of sixteen splats from `first` on whose bits are set, four together where they can be.
#[inline(always)]
fn sixteen<S: Simd>(
    simd: S,
    list: BlockList<'_, '_>,
    (first, left): (usize, u64),
    at: (Lanes<S>, Lanes<S>),
    first_px: (i32, i32),
    shared: &Shared<'_>,
    visit: &mut impl Visit<S>,
) {
    let sixteen = &list.records[first..(first + LANES).min(list.records.len())];
    for (quarter, records) in sixteen.chunks(4).enumerate() {
        let bits = left >> (4 * quarter) & 0xf;
        let i = first + 4 * quarter;
        let together = match records.first_chunk::<4>() {
            Some(four) if bits == 0xf => Some((Together::of(four), *four)),
            _ => None,
        };
        match together {
            Some((Together::Simple, records)) => {
                for (j, fragment) in four::<S, false>(simd, records, [at; 4], shared).into_iter().enumerate() {
                    visit.add(simd, fragment, i + j, records[j]);
                }
            }
            Some((Together::Soft, records)) => {
                for (j, fragment) in four::<S, true>(simd, records, [at; 4], shared).into_iter().enumerate() {
                    visit.add(simd, fragment, i + j, records[j]);
                }
            }
            _ => {
                for (j, record) in records.iter().enumerate() {
                    if bits >> j & 1 == 1 {
                        let fragment = fragment(simd, record, at, first_px, shared);
                        visit.add(simd, fragment, i + j, record);
                    }
                }
            }
        }
    }
}

/// The largest lane; none is NaN.
#[inline(always)]
pub(crate) fn largest<S: Simd>(v: Lanes<S>) -> f32 {
    let mut lanes = v.to_array();
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            lanes[i] = if lanes[i] > lanes[i + half] { lanes[i] } else { lanes[i + half] };
        }
        half /= 2;
    }
    lanes[0]
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
