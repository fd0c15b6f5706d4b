//! Decision margins: tests for fragments, edges and highlights whose results rounding could change.
//!
//! Comparisons between backends ignore differences in the pixels marked by these tests, and in no others.

use crate::clip::SplatClip;
use crate::splat::ScreenSplat;
use crate::threshold::{PossibleThresholds, SideThresholds, Threshold};
use surfel_math::V2;
use surfel_math::clip::Turn;
use surfel_math::mapping::Footprint;
use surfel_render::View;

/// Largest distance of a pixel from a footprint's rim, in pixels of the image, at which rounding could change whether
/// the pixel is inside.
pub(crate) const RIM_PX: f64 = 1e-3;
/// Largest difference between a ball's coverage of a pixel and the limit for solid fragments at which rounding could
/// change the comparison.
pub(crate) const BALL_COVERAGE: f64 = 2e-3;
/// Largest relative difference of two compared values, such as depths, at which rounding could change the result of the
/// comparison. Rims, a ball's coverage, and the depths of two balls have limits of their own.
pub(crate) const RELATIVE: f64 = 1e-4;

/// True if the offset `d` from the footprint's anchor is at most `rim_px` pixels of the view from the footprint's rim.
/// Also true if ρ² is 1 within the relative margin.
pub(crate) fn on_rim(footprint: &Footprint<f64>, d: V2<f64>, rim_px: f64) -> bool {
    let (u, v, w) = footprint.at(d);
    let value = u * u + v * v - w * w;
    let gradient = |fu: f64, fv: f64, fw: f64| 2.0 * (u * fu + v * fv - w * fw);
    let slope = gradient(footprint.u.x, footprint.v.x, footprint.w.x).hypot(gradient(
        footprint.u.y,
        footprint.v.y,
        footprint.w.y,
    ));
    value.abs() <= rim_px * slope || value.abs() <= RELATIVE * w * w
}

/// True if rounding could change whether offset `d` is inside a footprint and not clipped. The first argument has two
/// flags for the footprint without its clip: true if `d` is on the rim, and true if `d` is inside.
fn on_border(
    [rim, inside]: [bool; 2],
    clip: Option<&SplatClip>,
    footprint: &Footprint<f64>,
    turn: impl Fn(&SplatClip) -> &Turn<f64>,
    d: V2<f64>,
    rim_px: f64,
) -> bool {
    let Some(clip) = clip else { return rim };
    let turn = turn(clip);
    let clipped = || clip.is_marginal_at(footprint, turn, d, [rim_px, 0.5 * RELATIVE]);
    (rim && clip.keeps_at(footprint, turn, d)) || ((rim || inside) && clipped())
}

/// True if rounding could change whether a pixel is inside the unfiltered, clipped footprint.
pub(crate) fn is_visibility_marginal(splat: &ScreenSplat, pixel: V2<f64>) -> bool {
    let d = pixel - splat.anchor;
    let whole = [on_rim(&splat.visible, d, splat.rim_px), splat.visible.contains(d)];
    on_border(whole, splat.clip.as_ref(), &splat.visible, |c| &c.visible_turn, d, splat.rim_px)
}

/// True if rounding could change whether a pixel is inside the filtered, clipped footprint.
fn on_filtered_border(splat: &ScreenSplat, pixel: V2<f64>) -> bool {
    let d = pixel - splat.anchor;
    let rim = on_rim(&splat.filtered, d, splat.rim_px)
        || splat.clamp_radius.is_some_and(|h| (d.length() - h).abs() <= splat.rim_px.max(RELATIVE * h));
    let whole = [rim, splat.unclipped_rho_squared_at(d).is_some()];
    let includes_visible = splat.clip.as_ref().is_some_and(|c| c.includes_visible);
    on_border(whole, splat.clip.as_ref(), &splat.filtered, |c| &c.filtered_turn, d, splat.rim_px)
        || (includes_visible && whole.contains(&true) && is_visibility_marginal(splat, pixel))
}

/// True if rounding could change whether a neighbour's surface is beyond a pixel's own (rendering model §5, edge
/// antialiasing). The pixel's own surface ends at depth `near`, and the neighbour's begins at `far`.
pub(crate) fn on_step(near: f64, far: f64) -> bool {
    // Infinities decide clearly, and an infinity minus itself is NaN.
    (far - near).abs() <= RELATIVE * near.abs().max(far.abs()) && near.is_finite() && far.is_finite()
}

/// Returns the thresholds that a pixel could have if front and back sides of oriented surfaces are separated; their
/// `tie` isn't set. The second value is true if rounding could change the side that the pixel shows. `nearest` is the
/// visibility result if all uncertain fragments exist, and `farthest` if none of them does.
pub(crate) fn possible_of_sides(nearest: &SideThresholds, farthest: &SideThresholds) -> (PossibleThresholds, bool) {
    let surely_before = |side: usize, other: usize| {
        let (far, near) = (farthest.nearness()[side], nearest.nearness()[other]);
        far < near && !on_depth(far, near)
    };
    let without_any = nearest.nearness() == [f64::INFINITY; 2];
    let of = |side: usize| PossibleThresholds {
        nearest: nearest.limited(side),
        farthest: farthest.limited(side),
        tie: Threshold::NONE,
    };
    match (surely_before(0, 1) || without_any, surely_before(1, 0)) {
        (true, _) => (of(0), false),
        (_, true) => (of(1), false),
        _ => {
            let [mut one, other] = [of(0), of(1)];
            one.nearest.lower(other.nearest);
            if other.farthest.depth > one.farthest.depth {
                one.farthest = other.farthest;
            }
            (one, true)
        }
    }
}

/// True if rounding could change which of two depths is larger; infinite depths are certain.
pub(crate) fn on_depth(z: f64, limit: f64) -> bool {
    (z - limit).abs() <= RELATIVE * z.abs() && z.is_finite()
}

/// True if rounding could change which of two balls' fragments is nearer. Their depths are exact to a few roundings of
/// f32.
pub(crate) fn on_ball_depth(z: f64, other: f64) -> bool {
    (z - other).abs() <= 0.1 * RELATIVE * z.abs()
}

/// True if rounding could add or remove the highlight of a light at cosine n·l (rendering model §5, `phong`).
pub(crate) fn on_terminator(cosine: f64) -> bool {
    cosine.abs() <= RELATIVE
}

/// True if rounding could change whether the attribute pass sums a fragment at depth `z`. Fragments certainly behind
/// the threshold don't matter.
pub(crate) fn is_marginal(splat: &ScreenSplat, pixel: V2<f64>, z: f64, threshold: &Threshold, view: &View) -> bool {
    let near = (z - view.projection.near).abs() <= RELATIVE * view.projection.near;
    let depth = on_depth(z, threshold.depth);
    if z > threshold.depth && !depth {
        return false;
    }
    let border = on_filtered_border(splat, pixel);
    let inside = splat.rho_squared_at(pixel).is_some();
    border || (inside && (depth || near || splat.facing_margin <= RELATIVE))
}
