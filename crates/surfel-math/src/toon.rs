//! The shader `toon` (rendering model §5, after the drawing styles of B05 §6): light in steps, and lines where the
//! surface turns away.
//!
//! Steps are short ramps rather than jumps, so that a rounding error can't change a pixel's step.

use crate::projection::{Projection, ProjectionKind};
use crate::{Real, V2};

/// Diffuse light, 0 to 1, at the middle of each of the three steps of the shader `toon`. All steps are equally high.
const STEPS: [f64; 3] = [0.05, 0.35, 0.7];
/// Half-width of the ramp that smooths each step of diffuse light and the edge of a highlight, in units of the light's
/// strength, 0 to 1.
const HALF_WIDTH: f64 = 0.02;
/// Strength of a highlight, 0 to 1, at the edge of the spot that `toon` draws; weaker highlights aren't drawn.
const HIGHLIGHT: f64 = 0.5;
/// Limits of |n·v|, the cosine of the angle between normal and view ray, for the dark line at grazing angles. The line
/// has full strength up to the first limit, and fades out up to the second.
const LINE: [f64; 2] = [0.12, 0.22];

/// Smallest depth step to a neighbouring pixel at which `toon` draws a line, as a fraction of the depth (orthographic:
/// of the view's height). The surface's own slope adds to it.
const DEPTH_STEP: f64 = 0.02;
/// Number of pixels over which the surface's own slope is added to [`DEPTH_STEP`], so that a slanted surface gets no
/// lines.
const SLOPE_PX: f64 = 2.0;

/// Returns the planar depth in world units beyond which a pixel's neighbour is another surface, so that this pixel is
/// part of a line. `gradient` is the depth gradient of the pixel's own plane ([`crate::depth::plane_gradient`]).
#[inline(always)]
pub fn step_back_limit<R: Real>(z: R, gradient: V2<R>, projection: &Projection) -> R {
    let scale = match projection.kind {
        ProjectionKind::Perspective => z,
        ProjectionKind::Orthographic { height, .. } => z.constant(height),
    };
    let slope = z.constant(SLOPE_PX) * gradient.length();
    z + (z.constant(DEPTH_STEP) * scale + slope)
}

/// Returns 0 up to `low`, 1 from `high` on, and between them 3t² − 2t³, where t is the position of `x` from `low` to
/// `high`.
#[inline(always)]
pub fn smoothstep<R: Real>(x: R, low: f64, high: f64) -> R {
    let share = (x - x.constant(low)) / x.constant(high - low);
    let t = share.max(x.zero()).min(x.one());
    t * t * (x.constant(3.0) - x.constant(2.0) * t)
}

/// Returns diffuse light, 0 to 1, in the steps of the shader `toon`: 0, ⅓, ⅔ and 1, with short ramps between them.
#[inline(always)]
pub fn ramp<R: Real>(light: R) -> R {
    let step = |at: f64| smoothstep(light, at - HALF_WIDTH, at + HALF_WIDTH);
    (step(STEPS[0]) + step(STEPS[1]) + step(STEPS[2])) * light.constant(1.0 / 3.0)
}

/// Returns a highlight of the shader `toon`, 0 to 1: a spot with a sharp edge. `strength` is max(0, r·v)^shininess
/// times the fraction of the light that reaches the point. r is the mirror image of the unit direction to the light,
/// and v the unit direction to the eye.
#[inline(always)]
pub fn highlight<R: Real>(strength: R) -> R {
    smoothstep(strength, HIGHLIGHT - HALF_WIDTH, HIGHLIGHT + HALF_WIDTH)
}

/// Returns the factor by which `toon` multiplies a colour at `cosine` = |n·v|: 0 in the line at grazing angles, 1
/// outside of it, with a smooth transition at its edge.
#[inline(always)]
pub fn line<R: Real>(cosine: R) -> R {
    smoothstep(cosine, LINE[0], LINE[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn toon_ramp_has_four_levels_and_rises_without_jumps() {
        for (light, want) in
            [(0.0, 0.0), (0.03, 0.0), (0.1, 1.0 / 3.0), (0.33, 1.0 / 3.0), (0.5, 2.0 / 3.0), (1.0, 1.0)]
        {
            assert!((ramp(light) - want).abs() < 1e-15, "{light}: {}", ramp(light));
        }
        let values: Vec<f64> = (0..=1000).map(|i| ramp(f64::from(i) / 1000.0)).collect();
        // The steepest slope of a smoothstep is 1.5 over its width of 0.04, a third high.
        assert!(values.windows(2).all(|v| (0.0..=0.0126).contains(&(v[1] - v[0]))));
        assert_eq!((highlight(0.4), highlight(0.5), highlight(0.6)), (0.0, 0.5, 1.0));
        assert_eq!((line(0.1f32), line(0.3f32)), (0.0, 1.0));
    }
}
