//! The shader `edl`, eye-dome lighting (rendering model §5), which shows shape from depth alone, for scans without
//! colours or good normals.
//!
//! Source: Boucheny 2009, "Interactive scientific visualization of large datasets", as in CloudCompare and Potree.
//! Deviations: neighbours are weighted by angle instead of depth, so that neither the image's size nor the surface's
//! distance matters. A plane looks about as if it were lit from the eye.

use crate::projection::{Projection, ProjectionKind};
use crate::{Real, V2};

/// Distance in pixels from a pixel to each of the eight neighbours that eye-dome lighting compares it with, along x, y
/// or both.
pub const REACH_PX: i32 = 2;

/// Offsets, in pixels, from a pixel to the eight neighbours that eye-dome lighting compares it with, row by row.
pub const NEIGHBOURS: [[i32; 2]; 8] = [
    [-REACH_PX, -REACH_PX],
    [0, -REACH_PX],
    [REACH_PX, -REACH_PX],
    [-REACH_PX, 0],
    [REACH_PX, 0],
    [-REACH_PX, REACH_PX],
    [0, REACH_PX],
    [REACH_PX, REACH_PX],
];

/// Factor of the mean rise toward the neighbours, by which eye-dome lighting darkens. With it, the brightness of a
/// plane turned by an angle is the angle's cosine, since the mean rise is the angle's tangent over π.
const STRENGTH: f64 = std::f64::consts::PI;

/// Returns the weight of the neighbour at `offset` (pixels) in the mean rise: the rise per world unit by which the
/// neighbour is nearer. The weight is one over the distance between the two pixels at depth 1 (orthographic: at any
/// depth), divided by eight.
#[inline(always)]
pub fn rise_weight<R: Real>(offset: V2<R>, projection: &Projection) -> R {
    let [fx, fy] = projection.focal_px;
    let apart = V2::new(offset.x / offset.x.constant(fx), offset.y / offset.x.constant(fy)).length();
    offset.x.constant(0.125) / apart
}

/// Returns the brightness of a pixel in (0, 1], from its planar depth `z` in world units. `rise` is the sum over the
/// neighbours of weight·max(0, z − z of the neighbour), with [`rise_weight`]. The brightness is 1 if no neighbour is
/// nearer, and approaches 0 as the rise grows.
#[inline(always)]
pub fn brightness<R: Real>(z: R, rise: R, projection: &Projection) -> R {
    let slope = match projection.kind {
        ProjectionKind::Perspective => rise / z,
        ProjectionKind::Orthographic { .. } => rise,
    };
    let k = z.constant(STRENGTH) * slope;
    z.one() / k.mul_add(k, z.one()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projection(kind: ProjectionKind) -> Projection {
        Projection { kind, focal_px: [400.0; 2], principal_px: [50.0; 2], near: 0.1 }
    }

    /// Returns the brightness of a plane through (0, 0, 3) whose depth increases by `slope` along `direction`.
    fn plane(projection: &Projection, slope: f64, direction: f64) -> f64 {
        let (sin, cos) = direction.sin_cos();
        let (z, [fx, fy]) = (3.0, projection.focal_px);
        let rise: f64 = NEIGHBOURS
            .iter()
            .map(|&[dx, dy]| {
                let offset = V2::new(f64::from(dx), f64::from(dy));
                // Slope along the plane, on the ray through the neighbour.
                let run = slope * (cos * offset.x / fx + sin * offset.y / fy);
                let neighbour = if projection.is_perspective() { z / (1.0 - run) } else { z + run };
                rise_weight(offset, projection) * (z - neighbour).max(0.0)
            })
            .sum();
        brightness(z, rise, projection)
    }

    #[test]
    fn eye_dome_shows_a_plane_as_if_lit_from_the_eye() {
        for kind in [ProjectionKind::Perspective, ProjectionKind::Orthographic { height: 2.0, far: 9.0 }] {
            let projection = projection(kind);
            assert_eq!(plane(&projection, 0.0, 0.0), 1.0);
            for slope in [0.2, 1.0, 3.0] {
                let cosine = 1.0 / f64::hypot(1.0, slope);
                for i in 0..16 {
                    // Eight directions approximate all: their mean of max(0, cos) is 0.3018 to 0.3266, 1/π within 5.2
                    // %. In perspective, a step of 2.83 px is up to 2.2 % longer if the plane recedes by 3.
                    let got = plane(&projection, slope, f64::from(i) * 0.4);
                    assert!((got / cosine - 1.0).abs() < 0.075, "{kind:?} {slope} {i}: {got} {cosine}");
                }
            }
        }
    }

    #[test]
    fn eye_dome_is_dark_behind_a_step_and_bright_before_it() {
        let projection = projection(ProjectionKind::Perspective);
        let weight = rise_weight(V2::new(2.0, 0.0), &projection);
        assert!(brightness(3.0, weight * 1.0, &projection) < 0.06);
        assert_eq!(brightness(3.0, 0.0, &projection), 1.0);
    }
}
