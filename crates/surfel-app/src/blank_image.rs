//! Detection of blank images and their likely causes.

use glam::DVec3;
use surfel_math::srgb::{encode_rgba8, limit_color};
use surfel_model::{Geometry, Scene};
use surfel_render::Frame;

/// Smallest extent of an object and largest coordinate, in object units, whose squares f32 can represent. The image of
/// an object beyond these limits may be blank.
const SQUARED_IN_F32: [f64; 2] = [1e-18, 1e18];

/// Largest difference from the background, in 8-bit sRGB levels, at which a pixel still counts as background. Single
/// stray points in an otherwise white image differ by less.
const BACKGROUND_TOLERANCE: u8 = 8;

/// Alpha below which a splat doesn't change any pixel of an 8-bit image.
const MIN_ALPHA: f32 = 0.5 / 255.0;

/// True if no pixel of `frame` differs from the background colour (linear RGB and straight alpha) by more than 8 levels
/// of 255. The frame has linear colours, 8-bit colours or both. False if the frame has no colours.
pub fn is_blank(frame: &Frame, [r, g, b, a]: [f64; 4]) -> bool {
    let background = [r * a, g * a, b * a, a].map(|c| limit_color(c) as f32);
    let encoded = encode_rgba8(background);
    let some = !frame.color().is_empty() || !frame.rgba8().is_empty();
    let alike = |color: [u8; 4]| color.iter().zip(encoded).all(|(c, b)| c.abs_diff(b) <= BACKGROUND_TOLERANCE);
    let same = |color: &[f32; 4]| *color == background || alike(encode_rgba8(*color));
    some && frame.color().iter().all(same) && frame.rgba8().iter().all(|color| alike(*color))
}

/// Returns the likely reason why images of the scene are blank, and a remedy, as text without a full stop.
pub fn why_blank(scene: &Scene) -> &'static str {
    let are_clear = |alphas: &[f32]| alphas.iter().all(|a| *a < MIN_ALPHA);
    let invisible = |geometry: &Geometry| match geometry {
        Geometry::Splats(cloud) => cloud.data().alphas.as_ref().is_some_and(|all| are_clear(all)),
        Geometry::Gaussians(cloud) => are_clear(&cloud.data().opacities),
        Geometry::Mesh(_) | Geometry::Octree(_) => false,
    };
    if !scene.objects.is_empty() && scene.objects.iter().all(|object| invisible(&object.geometry)) {
        return "all splats have an alpha of almost 0 (--transparency off draws them opaque)";
    }
    let bounds = |geometry: &Geometry| match geometry {
        Geometry::Splats(cloud) => cloud.bounds(),
        _ => None,
    };
    let [least, most] = SQUARED_IN_F32;
    let overflows =
        |(lo, hi): (DVec3, DVec3)| (hi - lo).max_element() < least || lo.abs().max(hi.abs()).max_element() > most;
    if scene.objects.iter().any(|object| bounds(&object.geometry).is_some_and(overflows)) {
        return "the coordinates' squares are beyond single precision: scale them to between 1e-18 and 1e18";
    }
    "look from elsewhere (--view, --camera) or before another --background; if one point lies far from all others, \
     --outliers drop leaves it out"
}
