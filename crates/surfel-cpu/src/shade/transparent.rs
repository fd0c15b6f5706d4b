//! Lighting and compositing of transparent layers, front to back (rendering model §8).
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat projected to the screen
//! ([`Record`]).

use crate::raster::layers::{Layer, LayerScratch, TransparentBlock};
use crate::setup::record::Record;
use crate::setup::segment::TransparentSplat;
use crate::shade::balls::{BallBlock, Composited};
use crate::shade::lighting::Lighting;
use crate::shade::resolve::{divided, lit, shaded};
use crate::shade::surface::{Shaded, Surface, limited};
use crate::shade::view_ray::Place;
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::target::{Pixels, Target};
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use surfel_math::kernel::FULL_COVERAGE;
use surfel_math::{Real, V3};
use surfel_render::{FramePlan, Pass};

/// Kinds and number of the transparent layers that a plan draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layers {
    /// Largest number of layers that are drawn one by one, front to back; unlimited for an A-buffer.
    peeled: u32,
    /// True if the fragments behind the peeled layers are blended into one more layer.
    remaining: bool,
    /// True if a layer's opacity is multiplied by its coverage, as in an A-buffer (Z01 §6).
    by_coverage: bool,
}

impl Layers {
    /// Returns the layers that a plan selects.
    pub(crate) fn new(plan: &FramePlan) -> Self {
        let abuffer = plan.has(Pass::ABuffer);
        let peeled = if abuffer { u32::MAX } else { plan.peeled_layers() as u32 };
        Self { peeled, remaining: plan.has(Pass::RemainingLayer), by_coverage: abuffer }
    }
}

/// A block's transparent layers, composited.
pub(crate) struct CompositedLayers<S: Simd> {
    /// Composited colours of the layers, and of the balls between them.
    pub colors: Composited<S>,
    /// Depth, normal and weight of the nearest layer in each pixel.
    nearest: Shaded<S>,
    pub fragments: Lanes<S>,
    /// Numbers of the nearest transparent splats, if the frame outputs them.
    numbers: Option<[u32; LANES]>,
    /// Number of layers in each pixel that aren't empty.
    pub count: Lanes<S>,
    /// Depth at which the nearest layer begins, for edges by samples: its depth threshold minus ε; +∞ without a layer.
    pub begin: Lanes<S>,
    /// Depth at which the nearest layer ends, for edges by samples: its depth threshold plus ε; +∞ without a layer.
    pub end: Lanes<S>,
    /// Number of transparent splats computed in the block, for statistics.
    pub tested: u32,
    /// Number of transparent fragments inside filtered footprints that nothing opaque occludes, for statistics.
    pub inside: u32,
}

/// Computes, lights and composites all transparent layers of a block, nearest first.
#[inline(always)]
pub(crate) fn composite<S: Simd>(
    block: &TransparentBlock<'_, S>,
    layers: Layers,
    lighting: &Lighting,
    scratch: &mut LayerScratch,
    mut balls: Option<&mut BallBlock<'_, S>>,
) -> CompositedLayers<S> {
    let simd = block.simd;
    let gathered = block.gather(scratch);
    let mut composited = CompositedLayers::new(simd, gathered.tested, gathered.inside);
    composited.begin = gathered.threshold - gathered.threshold_epsilon;
    composited.end = gathered.threshold + gathered.threshold_epsilon;
    if block.inputs.frame.wanted.nearest {
        composited.numbers = Some(block.nearest(scratch).numbers());
    }
    let (mut beyond, mut threshold) = (Lanes::splat(simd, f32::NEG_INFINITY), gathered.threshold);
    let is_numbered = layers.by_coverage && scratch.number_surfaces();
    for _ in 0..layers.peeled {
        let layer = match is_numbered {
            true => block.surface(scratch),
            false => (!scratch.is_empty()).then(|| block.layer(beyond, threshold, scratch)),
        };
        let Some(Layer { sums, alpha, next }) = layer else { return composited };
        let surface = divided(simd, lighting, &sums);
        let mut alpha = alpha / Lanes::select(surface.covered, sums.weight, alpha.one());
        if layers.by_coverage {
            alpha = alpha * (sums.coverage * alpha.constant(1.0 / FULL_COVERAGE)).min(alpha.one());
        }
        composited.add_behind(&lit(simd, lighting, surface, block.at), alpha, (sums.fragments, balls.as_deref_mut()));
        (beyond, threshold) = (threshold, next);
    }
    if layers.remaining {
        let Layer { sums, alpha, .. } = block.remaining(beyond, scratch);
        let Surface { covered, normal, z, weight, .. } = divided(simd, lighting, &sums);
        let inverse = alpha.one() / Lanes::select(covered, weight, alpha.one());
        let [r, g, b] = sums.color;
        let shaded = Shaded { covered, color: limited(V3::new(r, g, b) * inverse), z, normal, weight };
        composited.add_behind(&shaded, alpha * inverse, (sums.fragments, balls));
    }
    composited
}

impl<S: Simd> CompositedLayers<S> {
    #[inline(always)]
    fn new(simd: S, tested: u32, inside: u32) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            colors: Composited::nothing(simd),
            nearest: Shaded::nothing(simd),
            fragments: zero,
            numbers: None,
            count: zero,
            begin: zero.constant(f64::INFINITY),
            end: zero.constant(f64::INFINITY),
            tested,
            inside,
        }
    }

    /// Composites a layer's surface behind the layers so far, after the balls in front of the surface. The result
    /// equals blending back to front (Z01 eq. 12).
    #[inline(always)]
    fn add_behind(
        &mut self,
        surface: &Shaded<S>,
        alpha: Lanes<S>,
        (fragments, balls): (Lanes<S>, Option<&mut BallBlock<'_, S>>),
    ) {
        let zero = alpha.zero();
        let alpha = Lanes::select(surface.covered, alpha, zero);
        let color = V3::select(surface.covered, surface.color, V3::new(zero, zero, zero));
        if let Some(balls) = balls {
            balls.composite(Lanes::select(surface.covered, surface.z, zero), &mut self.colors);
        }
        self.colors.add_behind(color, alpha);
        let (first, n): (mask32x16<S>, _) = (surface.covered & !self.nearest.covered, &mut self.nearest);
        n.z = Lanes::select(first, surface.z, n.z);
        n.normal = V3::select(first, surface.normal, n.normal);
        n.weight = Lanes::select(first, surface.weight, n.weight);
        n.covered |= first;
        self.count = self.count + Lanes::select(surface.covered, alpha.one(), zero);
        self.fragments = self.fragments + fragments;
    }

    /// Writes the numbers of the nearest splats to the pixels that have a layer, if the frame outputs them.
    pub(crate) fn put_index(&self, target: &mut Target<'_>, at: (i32, i32)) {
        let Some(numbers) = self.numbers else { return };
        let mut shown = target.index(at);
        ones(self.nearest.covered.to_bitmask()).for_each(|i| shown[i] = numbers[i]);
        target.put_index(at, shown);
    }

    /// Returns finished pixels: the layers over the pixels behind them.
    #[inline(always)]
    pub(crate) fn over(&self, behind: &Pixels<S>) -> Pixels<S> {
        let (n, there) = (&self.nearest, self.nearest.covered);
        let [x, y, z] = behind.normal;
        let normal = V3::select(there, n.normal, V3::new(x, y, z));
        Pixels {
            color: self.colors.over(behind.color),
            depth: Lanes::select(there, n.z, behind.depth),
            normal: [normal.x, normal.y, normal.z],
            weight: Lanes::select(there, n.weight, behind.weight),
            fragments: behind.fragments + self.fragments + self.colors.fragments,
        }
    }
}

/// Lights transparent splats at their centres, sixteen at a time. `factors` returns the factors of a record's material.
#[inline(always)]
pub(crate) fn light_splats<S: Simd>(
    simd: S,
    lighting: &Lighting,
    records: &[Record],
    splats: &mut [TransparentSplat],
    factors: impl Fn(&Record) -> [f32; 4],
) {
    for (records, splats) in records.chunks(LANES).zip(splats.chunks_mut(LANES)) {
        let mut fields = [[0.0; LANES]; 14];
        for (i, (record, splat)) in records.iter().zip(splats.iter()).enumerate() {
            let color = [record.red(), record.green(), record.blue()];
            let normal = [record.normal_x(), record.normal_y(), record.normal_z()];
            let position = lighting.world_from_view(splat.center.into()).to_array();
            // The depth is at least z_near, because the shader `depth` would show a nearer centre by a stored depth
            // above 1.
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
        let lit = shaded(simd, lighting, &surface, Place::Points(vector(6)));
        let (r, g, b) = (lit.x.to_array(), lit.y.to_array(), lit.z.to_array());
        splats.iter_mut().enumerate().for_each(|(i, splat)| splat.lit = [r[i], g[i], b[i]]);
    }
}
