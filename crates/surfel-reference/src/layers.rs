//! Depth peeling of transparent splats (§8, after G06 §6).

use crate::raster::{Bands, Kept, Limits, Passes, Run};
use crate::shade::{Lighting, Surface};
use crate::splat::ScreenSplat;
use crate::veil::Veil;
use rayon::prelude::*;
use surfel_math::V2;
use surfel_render::{Attributes, Pass, Region};

/// Transparent splats, and what hides them.
pub(crate) struct Through<'a> {
    pub splats: &'a [ScreenSplat],
    pub bands: &'a Bands,
    /// Depth of the opaque surface in each pixel of `rect`; +∞ where there is none.
    pub opaque_depth: &'a [f64],
    pub rect: Region,
}

impl Through<'_> {
    /// Centre of pixel `at` of the rectangle.
    pub(crate) fn center(&self, at: usize) -> V2<f64> {
        crate::frame::center(self.rect, at)
    }
}

/// Draws the plan's layers, nearest first.
pub(crate) fn peel(through: &Through, lighting: &Lighting) -> Vec<Veil> {
    let plan = lighting.plan;
    let mut veils = vec![Veil::default(); through.opaque_depth.len()];
    let mut beyond: Option<Vec<f64>> = None;
    for _ in 0..plan.peeled_layers() {
        let limits = Limits { beyond: beyond.as_deref(), up_to: Some(through.opaque_depth), ..Limits::default() };
        let run = Run { limits, ..Run::new(through.splats, through.bands, lighting.view, plan) };
        let layer = run.passes(run.kept());
        add_layer(&mut veils, &layer, |at| lighting.shade(&layer.sums[at], through.center(at)));
        let kept = layer.kept.iter().map(|kept| kept.value).collect::<Vec<_>>();
        if kept.iter().all(|&value| value == Kept::NOTHING.value) {
            // Where nothing is kept everything that remained was drawn, so there is nothing beyond this layer anywhere.
            return veils;
        }
        beyond = Some(kept);
    }
    if plan.has(Pass::RemainingLayer) {
        remaining(through, lighting, beyond.as_deref(), &mut veils);
    }
    veils
}

/// The last layer: every fragment that remains, lit per splat and weighted by its alpha, so that the more opaque ones
/// count for more.
fn remaining(through: &Through, lighting: &Lighting, beyond: Option<&[f64]>, veils: &mut [Veil]) {
    let (lit, open): (Vec<ScreenSplat>, Vec<bool>) = through
        .splats
        .par_iter()
        .map(|splat| {
            let (lit, marginal) = lighting.lit_splat(splat);
            (ScreenSplat { weight_scale: lit.weight_scale * lit.alpha, ..lit }, marginal)
        })
        .unzip();
    let run = Run {
        attributes: Attributes { color: true, material: false, ..lighting.plan.attributes },
        visibility: false,
        limits: Limits { beyond, up_to: Some(through.opaque_depth), ..Limits::default() },
        ..Run::new(&lit, through.bands, lighting.view, lighting.plan)
    };
    let layer = run.passes(run.kept());
    add_layer(veils, &layer, |at| Lighting::shade_lit(&layer.sums[at]));
    if lighting.plan.planes.margin && open.contains(&true) {
        // Drawn alone, the splats whose highlight could come or go show which pixels that changes.
        let open_splats: Vec<ScreenSplat> = lit.iter().zip(open).filter(|s| s.1).map(|s| s.0.clone()).collect();
        let bands = Bands::new(&open_splats, through.rect);
        let run = Run { splats: &open_splats, bands: &bands, ..run };
        let touched = run.passes(run.kept());
        for (veil, sums) in veils.iter_mut().zip(&touched.sums) {
            veil.marginal |= sums.fragments > 0;
        }
    }
}

fn add_layer(veils: &mut [Veil], layer: &Passes, surface: impl Fn(usize) -> Option<Surface>) {
    for (at, veil) in veils.iter_mut().enumerate() {
        let sums = &layer.sums[at];
        veil.fragments += sums.fragments;
        veil.marginal |= sums.marginal;
        if let Some(surface) = surface(at) {
            veil.add_behind(&surface, surface.alpha);
        }
    }
}
