//! The A-buffer (§8, after Z01 §6): a pixel's transparent fragments gathered into surfaces.
//!
//! Note: deviation from the paper: fragments are taken in the order of depth, not of drawing, so that a surface is whole
//! before the next one begins. Then merging loses nothing, and the picture doesn't depend on any order.

use crate::layers::Through;
use crate::margin;
use crate::raster::{Fragment, Run, Sums};
use crate::shade::{Lighting, Surface};
use crate::veil::Veil;
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::V2;
use surfel_math::kernel::FULL_COVERAGE;

/// A shaded surface of a pixel, or several merged.
#[derive(Clone, Copy)]
struct Shaded {
    /// The nearest one.
    surface: Surface,
    /// Their colour, premultiplied, and opacity.
    color: DVec3,
    alpha: f64,
}

/// Gathers and blends the transparent fragments of every pixel.
pub(crate) fn gather(through: &Through, lighting: &Lighting) -> Vec<Veil> {
    let run = Run::new(through.splats, through.bands, lighting.view, lighting.plan);
    let pixels = run.fragments();
    let blend = |(at, fragments): (usize, Vec<Fragment>)| {
        let pixel = Pixel { through, lighting, center: through.center(at), opaque_depth: through.opaque_depth[at] };
        pixel.blend(fragments)
    };
    pixels.into_par_iter().enumerate().map(blend).collect()
}

/// What is the same for all surfaces of a pixel.
struct Pixel<'a> {
    through: &'a Through<'a>,
    lighting: &'a Lighting<'a>,
    center: V2<f64>,
    opaque_depth: f64,
}

impl Pixel<'_> {
    fn blend(&self, mut fragments: Vec<Fragment>) -> Veil {
        fragments.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.splat.cmp(&b.splat)));
        let mut veil = Veil::default();
        let mut surfaces: Vec<Shaded> = Vec::new();
        let mut sums = Sums::default();
        // The nearest z + ε of the surface's unfiltered splats, as visibility keeps it.
        let mut kept = f64::INFINITY;
        for f in &fragments {
            veil.marginal |= f.inside && margin::on_depth(f.z, self.opaque_depth);
            if f.z > self.opaque_depth {
                continue;
            }
            let splat = &self.through.splats[f.splat as usize];
            veil.marginal |= f.marginal || (f.inside && margin::on_depth(f.z, kept));
            veil.marginal |= f.on_visible_rim && f.z + splat.epsilon <= kept;
            if !f.inside && !f.visible {
                continue;
            }
            if f.z > kept {
                self.close(&mut surfaces, &sums);
                veil.fragments += sums.fragments;
                (sums, kept) = (Sums::default(), f64::INFINITY);
            }
            if f.visible {
                kept = kept.min(f.z + splat.epsilon);
            }
            if f.inside {
                sums.add(splat, f.weight, f.z, self.lighting.plan.attributes);
            }
        }
        self.close(&mut surfaces, &sums);
        veil.fragments += sums.fragments;
        for shaded in &surfaces {
            veil.add_premultiplied(&shaded.surface, shaded.color, shaded.alpha);
        }
        veil
    }

    /// Shades a whole surface and inserts it; over the limit, merges the two that are nearest in z (Z01 eq. 12).
    fn close(&self, surfaces: &mut Vec<Shaded>, sums: &Sums) {
        let Some(surface) = self.lighting.shade(sums, self.center) else { return };
        let alpha = surface.alpha * (sums.coverage / FULL_COVERAGE).min(1.0);
        surfaces.push(Shaded { surface, color: surface.color * alpha, alpha });
        if surfaces.len() <= self.lighting.plan.abuffer_surfaces as usize {
            return;
        }
        let gap = |i: &usize| surfaces[i + 1].surface.depth - surfaces[*i].surface.depth;
        let Some(front) = (0..surfaces.len() - 1).min_by(|a, b| gap(a).total_cmp(&gap(b))) else { return };
        let back = surfaces.remove(front + 1);
        let merged = &mut surfaces[front];
        merged.color += back.color * (1.0 - merged.alpha);
        merged.surface.marginal |= back.surface.marginal;
        merged.alpha += back.alpha * (1.0 - merged.alpha);
    }
}
