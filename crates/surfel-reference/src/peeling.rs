//! Depth peeling of transparent splats (rendering model §8, after G06 §6).

use crate::layer_compositor::LayerCompositor;
use crate::pixels;
use crate::raster::{Bands, DepthLimits, Passes, Run};
use crate::shade::{Lighting, Surface};
use crate::splat::ScreenSplat;
use crate::threshold::Threshold;
use rayon::prelude::*;
use surfel_math::V2;
use surfel_render::{Attributes, Pass, Region};

/// Transparent splats of a frame, and the depths of the opaque surfaces that occlude them.
pub(crate) struct TransparentSplats<'a> {
    pub splats: &'a [ScreenSplat],
    pub bands: &'a Bands,
    /// Depth of the nearest opaque surface in each pixel of `rect`; +∞ without one.
    pub opaque_depth: &'a [f64],
    pub rect: Region,
}

impl TransparentSplats<'_> {
    /// Returns the centre of pixel `at` of the rectangle.
    pub(crate) fn center(&self, at: usize) -> V2<f64> {
        pixels::center_in(self.rect, at)
    }
}

/// Draws the transparent layers that the plan asks for. Each layer has the nearest surface of every pixel behind the
/// previous layer. Returns the layers of each pixel, nearest first; pixels are in row order.
pub(crate) fn peel(transparent: &TransparentSplats, lighting: &Lighting) -> Vec<LayerCompositor> {
    let plan = lighting.plan;
    let mut layers = vec![LayerCompositor::default(); transparent.opaque_depth.len()];
    let mut beyond: Option<Vec<f64>> = None;
    for _ in 0..plan.peeled_layers() {
        let limits =
            DepthLimits { beyond: beyond.as_deref(), up_to: Some(transparent.opaque_depth), ..DepthLimits::default() };
        let run = Run { limits, ..Run::new(transparent.splats, transparent.bands, lighting.view, plan) };
        let layer = run.accumulate(run.thresholds());
        add_layer(&mut layers, &layer, |at| lighting.shade(&layer.sums[at], transparent.center(at)));
        let thresholds: Vec<f64> = layer.thresholds.iter().map(|threshold| threshold.depth).collect();
        if thresholds.iter().all(|&depth| depth == Threshold::NONE.depth) {
            // Pixels without a threshold have no fragments left, so this layer is the last.
            return layers;
        }
        beyond = Some(thresholds);
    }
    if plan.has(Pass::RemainingLayer) {
        remaining(transparent, lighting, beyond.as_deref(), &mut layers);
    }
    layers
}

/// Draws all fragments deeper than `beyond` as the last layer. Each splat is lit on its own, and weighted by alpha, so
/// that more opaque splats count more.
fn remaining(
    transparent: &TransparentSplats,
    lighting: &Lighting,
    beyond: Option<&[f64]>,
    layers: &mut [LayerCompositor],
) {
    let (lit, open): (Vec<ScreenSplat>, Vec<bool>) = transparent
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
        limits: DepthLimits { beyond, up_to: Some(transparent.opaque_depth), ..DepthLimits::default() },
        ..Run::new(&lit, transparent.bands, lighting.view, lighting.plan)
    };
    let layer = run.accumulate(run.thresholds());
    add_layer(layers, &layer, |at| Lighting::shade_lit(&layer.sums[at]));
    if lighting.plan.planes.margin && open.contains(&true) {
        // Splats with an uncertain highlight are drawn again on their own, to mark the pixels that they touch.
        let undecided: Vec<ScreenSplat> = lit.iter().zip(open).filter(|s| s.1).map(|s| s.0.clone()).collect();
        let bands = Bands::new(&undecided, transparent.rect);
        let run = Run { splats: &undecided, bands: &bands, ..run };
        let touched = run.accumulate(run.thresholds());
        for (pixel, sums) in layers.iter_mut().zip(&touched.sums) {
            pixel.marginal |= sums.fragments > 0;
        }
    }
}

fn add_layer(layers: &mut [LayerCompositor], layer: &Passes, surface: impl Fn(usize) -> Option<Surface>) {
    for (at, pixel) in layers.iter_mut().enumerate() {
        let sums = &layer.sums[at];
        pixel.fragments += sums.fragments;
        pixel.marginal |= sums.marginal;
        if let Some(surface) = surface(at) {
            pixel.add_behind(&surface, surface.alpha);
        }
    }
}
