//! Front- and back-facing splats of one oriented surface (rendering model §5): the choice of the visible side of a
//! pixel, and normals of splats that reach past the contour.

use crate::{Real, V3};

/// Fraction of its depth tolerance ε by which a back-facing fragment must be nearer than all front-facing ones for a
/// pixel to show the back.
pub const BACK_FACING_LAG: f64 = 0.125;

/// Sine of the largest angle between a back-facing splat's plane and the view ray at which the splat is lit as if it
/// were front-facing: 10°. Such splats mostly reach past the contour of the visible front.
pub const RIM_SINE: f64 = 0.173_648_177_666_930_35;

/// Returns the depth of a visibility fragment for choosing whether a pixel shows the front or the back of a surface.
/// Back-facing fragments are moved back by [`BACK_FACING_LAG`] of ε.
#[inline(always)]
pub fn nearness<R: Real>(z: R, epsilon: R, back_facing: bool) -> R {
    if back_facing { z.constant(BACK_FACING_LAG).mul_add(epsilon, z) } else { z }
}

/// Returns the depth behind which no fragment blends with the side that a pixel shows. It is midway between the nearest
/// depths of the front and the back. A surface's underside thereby separates its top from what is below (rendering
/// model §5, sheets).
#[inline(always)]
pub fn sheet_limit<R: Real>(shown: R, other: R) -> R {
    (shown + other) * shown.constant(0.5)
}

/// Returns the shading normal of a back-facing splat of an oriented two-sided surface. `cosine` is the cosine of the
/// angle between the geometric normal and the unit direction `to_eye`. The shading normal is usually reversed. Near the
/// contour, where a splat of the front side extends past the edge, a shading normal that points away from the eye is
/// mirrored in the plane perpendicular to the ray instead. Both results have the same angle to the ray, but the
/// mirrored normal continues the normals of the front side. A shading normal that points to the eye is unchanged there.
#[inline(always)]
pub fn back_normal<R: Real>(shading: V3<R>, cosine: R, to_eye: V3<R>) -> V3<R> {
    let along = shading.dot(to_eye);
    let mirrored = shading - to_eye * (along.min(along.zero()) * along.constant(2.0));
    V3::select(cosine.abs().le(cosine.constant(RIM_SINE)), mirrored, -shading)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn back_normals_go_on_across_the_contour_and_are_turned_about_beyond_the_rim() {
        let to_eye = V3::new(0.0, 0.0, -1.0);
        let at = |degrees: f64| V3::new(degrees.to_radians().cos(), 0.0, degrees.to_radians().sin());
        // n·v = −sin: the normal is tilted away from the eye by so many degrees.
        let shown = |degrees: f64| back_normal(at(degrees), -degrees.to_radians().sin(), to_eye);
        let close = |a: V3<f64>, b: V3<f64>| (a - b).length() < 1e-12;
        assert!(close(shown(0.0), at(0.0)));
        assert!(close(shown(9.0), at(-9.0)), "{:?}", shown(9.0));
        assert!(close(shown(11.0), -at(11.0)));
        // A normal tilted towards the eye is unchanged, whatever the splat's plane.
        assert!(close(back_normal(at(-5.0), -0.1, to_eye), at(-5.0)));
    }

    #[test]
    fn a_sheet_ends_midway_between_its_sides() {
        assert_eq!(sheet_limit(2.0, 2.5), 2.25);
        assert_eq!(sheet_limit(2.0, f64::INFINITY), f64::INFINITY);
    }

    #[test]
    fn back_faces_lag_behind_front_faces() {
        assert_eq!(nearness(2.0, 0.8, false), 2.0);
        assert!((nearness(2.0, 0.8, true) - 2.1).abs() < 1e-15);
    }
}
