//! Transparent splats over a block (§8): all layers from one traversal of its splats.
//!
//! Depth peeling (G06 §6) draws a layer by two passes over all splats. Here a block's fragments are computed once and remembered;
//! then each layer is two loops over those that no layer before it took, which is the same picture to the bit. The A-buffer is
//! layers without end: a fragment begins a new surface exactly where peeling begins a new layer.

use crate::bins::Segment;
use crate::fragment::{Fragment, four, fragment};
use crate::lanes::{LANES, Lanes};
use crate::light::Lighting;
use crate::raster::{self, Shared, Sums};
use crate::record::{Record, Together};
use crate::shade::{self, Pixels, Shaded, Surface};
use crate::sight::Place;
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use surfel_math::kernel::FULL_COVERAGE;
use surfel_math::{Real, V3};
use surfel_render::{FramePlan, Pass};

/// What a transparent splat has besides its record.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct VeilSplat {
    pub alpha: f32,
    /// View position of its centre.
    pub center: [f32; 3],
    /// Its colour lit at its centre, where the plan has a remaining layer.
    pub lit: [f32; 3],
}

/// Some chunks' transparent splats: their records, sorted into tiles, and what they have besides.
pub(crate) struct VeilSegment {
    pub segment: Segment,
    pub splats: Vec<VeilSplat>,
}

/// A transparent splat in a block's list.
#[derive(Clone, Copy)]
pub(crate) struct Veiled<'a> {
    pub record: &'a Record,
    pub splat: &'a VeilSplat,
}

/// Which layers are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layers {
    /// Layers that are peeled, at most.
    peeled: u32,
    /// The rest is blended into one more.
    remaining: bool,
    /// Surfaces count by their coverage (Z01 §6).
    by_coverage: bool,
    /// Fragments are computed anew for every layer, as by passes over a frame. The same picture.
    anew: bool,
}

impl Layers {
    /// The plan's.
    pub(crate) fn new(plan: &FramePlan, anew: bool) -> Self {
        let abuffer = plan.has(Pass::ABuffer);
        let peeled = if abuffer { u32::MAX } else { plan.peeled_layers() as u32 };
        Self { peeled, remaining: plan.has(Pass::RemainingLayer), by_coverage: abuffer, anew }
    }
}

/// A splat's fragments of a block.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
struct Remembered {
    /// Depth inside the filtered footprint, and inside the unfiltered one; NaN elsewhere.
    inside_z: [f32; LANES],
    visible_z: [f32; LANES],
    weight: [f32; LANES],
    epsilon: f32,
    alpha: f32,
    /// Index in the block's list.
    splat: u32,
}

/// What a thread reuses from block to block.
#[derive(Default)]
pub(crate) struct VeilScratch {
    fragments: Vec<Remembered>,
    /// Those with fragments that no layer has taken.
    left: Vec<u32>,
}

/// What transparent splats add to a block.
pub(crate) struct Veil<S: Simd> {
    /// Premultiplied.
    color: V3<Lanes<S>>,
    /// Share of what lies behind that shows through.
    transmittance: Lanes<S>,
    /// The nearest layer.
    nearest: Shaded<S>,
    pub fragments: Lanes<S>,
    /// Pairs of block and splat that were computed, and fragments of theirs that nothing opaque hides.
    pub tested: u32,
    pub inside: u32,
}

/// A block of transparent splats before what is opaque.
pub(crate) struct VeilBlock<'a, S: Simd> {
    pub simd: S,
    pub list: &'a [Veiled<'a>],
    /// First pixel.
    pub at: (i32, i32),
    pub shared: &'a Shared<'a>,
    pub lighting: &'a Lighting,
    pub layers: Layers,
    pub opaque_depth: Lanes<S>,
}

impl<S: Simd> VeilBlock<'_, S> {
    /// Draws all layers, nearest first.
    #[inline(always)]
    pub(crate) fn draw(&self, scratch: &mut VeilScratch) -> Veil<S> {
        let simd = self.simd;
        let mut veil = Veil::new(simd);
        let mut beyond = Lanes::splat(simd, f32::NEG_INFINITY);
        let mut kept = self.gather(beyond, scratch, &mut veil);
        for _ in 0..self.layers.peeled {
            if scratch.left.is_empty() {
                return veil;
            }
            let (next, sums, alpha) = self.layer(beyond, kept, scratch);
            let surface = shade::divided(simd, self.lighting, &sums);
            let mut alpha = alpha / Lanes::select(surface.covered, sums.weight, alpha.one());
            if self.layers.by_coverage {
                alpha = alpha * (sums.coverage * alpha.constant(1.0 / FULL_COVERAGE)).min(alpha.one());
            }
            let shaded = shade::lit(simd, self.lighting, surface, self.at);
            veil.add_behind(&shaded, alpha, sums.fragments);
            (beyond, kept) = (kept, next);
            if self.layers.anew {
                kept = self.gather(beyond, scratch, &mut veil);
            }
        }
        if self.layers.remaining {
            self.remaining(beyond, scratch, &mut veil);
        }
        veil
    }

    /// Remembers the fragments behind `beyond` that nothing opaque hides; what the layer there keeps.
    #[inline(always)]
    fn gather(&self, beyond: Lanes<S>, scratch: &mut VeilScratch, veil: &mut Veil<S>) -> Lanes<S> {
        let (simd, (x, y)) = (self.simd, self.at);
        let k = |v: f32| Lanes::splat(simd, v);
        let at = (Lanes::block_columns(simd) + k(x as f32), Lanes::block_rows(simd) + k(y as f32));
        let VeilScratch { fragments, left } = scratch;
        if fragments.len() < self.list.len() {
            fragments.resize_with(self.list.len(), Remembered::default);
        }
        let (mut kept, mut count) = (k(f32::INFINITY), 0);
        for (quarter, veiled) in self.list.chunks(4).enumerate() {
            let mut z_min = f32::INFINITY;
            for veiled in veiled {
                z_min = z_min.min(veiled.record.z_min());
            }
            if self.opaque_depth.lt(k(z_min)).all_true() {
                continue;
            }
            veil.tested += veiled.len() as u32;
            let records: Option<[&Record; 4]> = veiled.first_chunk::<4>().map(|v| v.map(|v| v.record));
            let together = records.map(|records| (Together::of(&records), records));
            match together {
                Some((together @ (Together::Simple | Together::Soft), records)) => {
                    let four = match together {
                        Together::Simple => four::<S, false>(simd, records, [at; 4], self.shared),
                        _ => four::<S, true>(simd, records, [at; 4], self.shared),
                    };
                    for (j, f) in four.into_iter().enumerate() {
                        veil.inside += self.remember(fragments, &mut count, (4 * quarter + j, f), beyond, &mut kept);
                    }
                }
                _ => {
                    for (j, veiled) in veiled.iter().enumerate() {
                        let f = fragment(simd, veiled.record, at, self.at, self.shared);
                        veil.inside += self.remember(fragments, &mut count, (4 * quarter + j, f), beyond, &mut kept);
                    }
                }
            }
        }
        left.clear();
        left.extend(0..count as u32);
        kept
    }

    /// Remembers the fragments of splat `i` at a place of their own, if there are any, and counts the splat then: how many are inside
    /// its filtered footprint.
    #[inline(always)]
    fn remember(
        &self,
        fragments: &mut [Remembered],
        count: &mut usize,
        (i, f): (usize, Fragment<S>),
        beyond: Lanes<S>,
        kept: &mut Lanes<S>,
    ) -> u32 {
        let Veiled { record, splat } = self.list[i];
        let exists = beyond.lt(f.z) & f.z.le(self.opaque_depth);
        let (inside, visible) = (f.inside & exists, f.visible & exists);
        let value = f.z + f.z.constant(record.epsilon().into());
        *kept = Lanes::select(visible & value.lt(*kept), value, *kept);
        // Written in any case and counted where there is something: a branch would often be guessed wrong.
        let to = &mut fragments[*count];
        let nan = f.z.constant(f64::NAN);
        Lanes::select(inside, f.z, nan).store(&mut to.inside_z);
        Lanes::select(visible, f.z, nan).store(&mut to.visible_z);
        f.weight.store(&mut to.weight);
        (to.epsilon, to.alpha, to.splat) = (record.epsilon(), splat.alpha, i as u32);
        *count += usize::from((inside | visible).to_bitmask() != 0);
        inside.to_bitmask().count_ones()
    }

    /// The layer behind `beyond` up to what it keeps: its sums and Σwα, and first what the next layer keeps. Fragments that are
    /// taken are left no longer.
    #[inline(always)]
    fn layer(&self, beyond: Lanes<S>, kept: Lanes<S>, scratch: &mut VeilScratch) -> (Lanes<S>, Sums<S>, Lanes<S>) {
        let simd = self.simd;
        let VeilScratch { fragments, left } = scratch;
        let mut next = Lanes::splat(simd, f32::INFINITY);
        let mut sums = Sums::new(simd);
        let mut alpha = Lanes::splat(simd, 0.0);
        let mut count = 0;
        // A closure for `retain` would not be inlined into vector code.
        for k in 0..left.len() {
            let i = left[k];
            let f = &fragments[i as usize];
            let (z, visible_z) = (Lanes::load(simd, &f.inside_z), Lanes::load(simd, &f.visible_z));
            let mask = beyond.lt(z) & z.le(kept);
            if mask.to_bitmask() != 0 {
                let weight = Lanes::load(simd, &f.weight);
                raster::accumulate(simd, &mut sums, self.list[f.splat as usize].record, mask, z, weight, self.shared);
                let weight = Lanes::select(mask, weight, weight.zero());
                alpha = weight.mul_add(Lanes::splat(simd, f.alpha), alpha);
            }
            let behind = kept.lt(visible_z);
            let value = visible_z + Lanes::splat(simd, f.epsilon);
            next = Lanes::select(behind & value.lt(next), value, next);
            left[count] = i;
            count += usize::from((behind | kept.lt(z)).to_bitmask() != 0);
        }
        left.truncate(count);
        sums.cover(self.shared);
        (next, sums, alpha)
    }

    /// The last layer: every fragment that remains, lit per splat and weighted by its alpha, so that the more opaque ones count
    /// for more.
    #[inline(always)]
    fn remaining(&self, beyond: Lanes<S>, scratch: &VeilScratch, veil: &mut Veil<S>) {
        let simd = self.simd;
        let zero = Lanes::splat(simd, 0.0);
        let (mut sums, mut alpha) = (Sums::new(simd), zero);
        for &i in &scratch.left {
            let f = &scratch.fragments[i as usize];
            let z = Lanes::load(simd, &f.inside_z);
            let mask = beyond.lt(z);
            if mask.to_bitmask() == 0 {
                continue;
            }
            let Veiled { record, splat } = &self.list[f.splat as usize];
            let own = zero.constant(splat.alpha.into());
            let weight = Lanes::select(mask, Lanes::load(simd, &f.weight), zero) * own;
            sums.weight = sums.weight + weight;
            sums.fragments = sums.fragments + Lanes::select(mask, zero.one(), zero);
            sums.depth = weight.mul_add(Lanes::select(mask, z, zero), sums.depth);
            alpha = weight.mul_add(own, alpha);
            let normal = [record.normal_x(), record.normal_y(), record.normal_z()];
            for (sum, c) in sums.color.iter_mut().zip(splat.lit) {
                *sum = weight.mul_add(Lanes::splat(simd, c), *sum);
            }
            for (sum, c) in sums.normal.iter_mut().zip(normal) {
                *sum = weight.mul_add(Lanes::splat(simd, c), *sum);
            }
        }
        let Surface { covered, normal, z, weight, .. } = shade::divided(simd, self.lighting, &sums);
        let inverse = zero.one() / Lanes::select(covered, weight, zero.one());
        let [r, g, b] = sums.color;
        let shaded = Shaded { covered, color: V3::new(r, g, b) * inverse, z, normal, weight };
        veil.add_behind(&shaded, alpha * inverse, sums.fragments);
    }
}

impl<S: Simd> Veil<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            color: V3::new(zero, zero, zero),
            transmittance: zero.one(),
            nearest: Shaded::nothing(simd),
            fragments: zero,
            tested: 0,
            inside: 0,
        }
    }

    /// Puts a surface behind the layers there are: the same as blending back to front (Z01 eq. 12).
    #[inline(always)]
    fn add_behind(&mut self, surface: &Shaded<S>, alpha: Lanes<S>, fragments: Lanes<S>) {
        let zero = alpha.zero();
        let alpha = Lanes::select(surface.covered, alpha, zero);
        let color = V3::select(surface.covered, surface.color, V3::new(zero, zero, zero));
        self.color = self.color + color * (alpha * self.transmittance);
        self.transmittance = self.transmittance * (alpha.one() - alpha);
        let (first, n): (mask32x16<S>, _) = (surface.covered & !self.nearest.covered, &mut self.nearest);
        n.z = Lanes::select(first, surface.z, n.z);
        n.normal = V3::select(first, surface.normal, n.normal);
        n.weight = Lanes::select(first, surface.weight, n.weight);
        n.covered |= first;
        self.fragments = self.fragments + fragments;
    }

    /// Pixels seen through the layers.
    #[inline(always)]
    pub(crate) fn over(&self, behind: &Pixels<S>) -> Pixels<S> {
        let t = self.transmittance;
        let [r, g, b, a] = behind.color;
        let (c, n, there) = (&self.color, &self.nearest, self.nearest.covered);
        let [nx, ny, nz] = behind.normal;
        let color = [r.mul_add(t, c.x), g.mul_add(t, c.y), b.mul_add(t, c.z), a.mul_add(t, t.one() - t)];
        Pixels {
            color,
            depth: Lanes::select(there, n.z, behind.depth),
            normal: [
                Lanes::select(there, n.normal.x, nx),
                Lanes::select(there, n.normal.y, ny),
                Lanes::select(there, n.normal.z, nz),
            ],
            weight: Lanes::select(there, n.weight, behind.weight),
            fragments: behind.fragments + self.fragments,
        }
    }
}

/// Lights transparent splats at their centres, sixteen at a time. `factors` are those of a record's material.
#[inline(always)]
pub(crate) fn light_splats<S: Simd>(
    simd: S,
    lighting: &Lighting,
    records: &[Record],
    splats: &mut [VeilSplat],
    factors: impl Fn(&Record) -> [f32; 4],
) {
    for (records, splats) in records.chunks(LANES).zip(splats.chunks_mut(LANES)) {
        let mut fields = [[0.0; LANES]; 14];
        for (i, (record, splat)) in records.iter().zip(splats.iter()).enumerate() {
            let color = [record.red(), record.green(), record.blue()];
            let normal = [record.normal_x(), record.normal_y(), record.normal_z()];
            let position = lighting.world_from_view(splat.center.into()).to_array();
            // Where the centre lies before z_near the stored depth would exceed 1.
            let z = [splat.center[2].max(lighting.near())];
            let numbers = color.into_iter().chain(normal).chain(position).chain(z).chain(factors(record));
            fields.iter_mut().zip(numbers).for_each(|(field, number)| field[i] = number);
        }
        let lane = |i: usize| Lanes::load(simd, &fields[i]);
        let vector = |i: usize| V3::new(lane(i), lane(i + 1), lane(i + 2));
        let one = Lanes::splat(simd, 1.0);
        let surface = Surface {
            covered: one.le(one),
            albedo: vector(0),
            normal: vector(3),
            z: lane(9),
            material: [lane(10), lane(11), lane(12), lane(13)],
            weight: one,
        };
        let lit = shade::shaded(simd, lighting, &surface, Place::Points(vector(6)));
        let (r, g, b) = (lit.x.to_array(), lit.y.to_array(), lit.z.to_array());
        splats.iter_mut().enumerate().for_each(|(i, splat)| splat.lit = [r[i], g[i], b[i]]);
    }
}
