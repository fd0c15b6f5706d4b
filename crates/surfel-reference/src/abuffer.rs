//! A-buffer (rendering model §8, after Z01 §6), in which a pixel's transparent fragments are grouped into surfaces.
//!
//! Deviation from the paper: fragments are processed in the order of depth, not of drawing, so that a surface is
//! complete before the next one begins. Merging fragments then loses nothing, and the image doesn't depend on the
//! drawing order.

use crate::layer_compositor::LayerCompositor;
use crate::margin;
use crate::peeling::TransparentSplats;
use crate::raster::{Fragment, Run, Sums};
use crate::shade::{Lighting, Surface};
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::V2;
use surfel_math::kernel::FULL_COVERAGE;
use surfel_render::Pass;

/// Transparent surface of a pixel after shading, or several such surfaces merged into one.
#[derive(Clone, Copy)]
struct Shaded {
    /// Nearest of the merged surfaces, which gives depth and normal.
    surface: Surface,
    /// Colour of the merged surfaces, premultiplied by their opacity.
    color: DVec3,
    /// Opacity of the merged surfaces.
    alpha: f64,
}

/// Groups the transparent fragments of every pixel into surfaces. Returns the surfaces of each pixel as layers, nearest
/// first; pixels are in row order.
pub(crate) fn gather(transparent: &TransparentSplats, lighting: &Lighting) -> Vec<LayerCompositor> {
    let run = Run::new(transparent.splats, transparent.bands, lighting.view, lighting.plan);
    let pixels = run.fragments();
    let blend = |(at, fragments): (usize, Vec<Fragment>)| {
        let pixel =
            Pixel { transparent, lighting, center: transparent.center(at), opaque_depth: transparent.opaque_depth[at] };
        pixel.blend(fragments)
    };
    pixels.into_par_iter().enumerate().map(blend).collect()
}

/// Pixel whose transparent fragments are grouped into surfaces and blended.
struct Pixel<'a> {
    transparent: &'a TransparentSplats<'a>,
    lighting: &'a Lighting<'a>,
    center: V2<f64>,
    opaque_depth: f64,
}

impl Pixel<'_> {
    fn blend(&self, mut fragments: Vec<Fragment>) -> LayerCompositor {
        fragments.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.splat.cmp(&b.splat)));
        let mut layers = LayerCompositor::default();
        let mut surfaces: Vec<Shaded> = Vec::new();
        let mut sums = Sums::default();
        // The smallest z + ε so far of the current surface's fragments inside unfiltered footprints, as in the
        // visibility pass.
        let mut threshold = f64::INFINITY;
        for f in &fragments {
            layers.marginal |= f.inside && margin::on_depth(f.z, self.opaque_depth);
            if f.z > self.opaque_depth {
                continue;
            }
            let splat = &self.transparent.splats[f.splat as usize];
            layers.marginal |= f.marginal || (f.inside && margin::on_depth(f.z, threshold));
            layers.marginal |= f.on_visible_rim && f.z + splat.epsilon <= threshold;
            if !f.inside && !f.visible {
                continue;
            }
            if f.z > threshold {
                layers.count += u32::from(self.close(&mut surfaces, &sums));
                layers.fragments += sums.fragments;
                (sums, threshold) = (Sums::default(), f64::INFINITY);
            }
            if f.visible {
                threshold = threshold.min(f.z + splat.epsilon);
            }
            if f.inside {
                sums.add(splat, f.weight, f.z, self.lighting.plan.attributes);
            }
        }
        layers.count += u32::from(self.close(&mut surfaces, &sums));
        layers.fragments += sums.fragments;
        for shaded in &surfaces {
            layers.add_premultiplied(&shaded.surface, shaded.color, shaded.alpha);
        }
        layers
    }

    /// Shades the surface with these sums, which is complete, and appends it unless it is empty. If there are more
    /// surfaces than the plan allows, the two adjacent ones closest in depth are merged (Z01 eq. 12). Nothing is merged
    /// in frames with balls. Returns true if the surface wasn't empty.
    fn close(&self, surfaces: &mut Vec<Shaded>, sums: &Sums) -> bool {
        let Some(surface) = self.lighting.shade(sums, self.center) else { return false };
        let alpha = surface.alpha * (sums.coverage / FULL_COVERAGE).min(1.0);
        surfaces.push(Shaded { surface, color: surface.color * alpha, alpha });
        // Surfaces aren't merged if a ball may lie between two of them; merging only bounds memory.
        let plan = self.lighting.plan;
        if surfaces.len() <= plan.abuffer_surfaces as usize || plan.has(Pass::Balls) {
            return true;
        }
        let gap = |i: &usize| surfaces[i + 1].surface.depth - surfaces[*i].surface.depth;
        let Some(front) = (0..surfaces.len() - 1).min_by(|a, b| gap(a).total_cmp(&gap(b))) else { return true };
        let back = surfaces.remove(front + 1);
        let merged = &mut surfaces[front];
        merged.color += back.color * (1.0 - merged.alpha);
        merged.surface.marginal |= back.surface.marginal;
        merged.alpha += back.alpha * (1.0 - merged.alpha);
        true
    }
}
