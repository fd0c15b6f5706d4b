//! Sampling of shadow maps (rendering model §5) by percentage-closer filtering.
//!
//! Source: Reeves, Salesin and Cook, *Rendering Antialiased Shadows with Depth Maps* (1987). Deviations: the taps'
//! depths are on the receiver's own plane ([`crate::depth::plane_gradient`]), and weights move with the point, so that
//! a penumbra has no steps.

use crate::Real;
use crate::projection::{Projection, ProjectionKind};

/// Distance by which a point is moved towards the light before a shadow map's lookup. It is a fraction of the point's
/// depth in the map (orthographic: of the view's height), far above the relative rounding error of a depth in f32.
/// Surfaces that face the light have no slope bias, and would shade themselves without this distance.
const LOOKUP_BIAS: f64 = 5e-4;

/// Returns the distance by which a point at depth `z` of a shadow map is moved towards the light before the lookup;
/// both are in world units.
#[inline(always)]
pub fn lookup_bias<R: Real>(z: R, projection: &Projection) -> R {
    let scale = match projection.kind {
        ProjectionKind::Perspective => z,
        ProjectionKind::Orthographic { height, .. } => z.constant(height),
    };
    z.constant(LOOKUP_BIAS) * scale
}

/// Number of texels that a lookup in a shadow map reads along each axis.
pub const TAPS: usize = 4;

/// Returns the first column (or row) of a shadow map's lookup, and the weights of four consecutive texels, whose sum is
/// one. The position `texel` is in texels from the map's edge.
///
/// The filter is a box three texels wide around the point.
pub fn taps(texel: f64) -> (f64, [f64; TAPS]) {
    let from_center = texel - 0.5;
    let whole = from_center.floor();
    (whole - 1.0, tap_weights(from_center - whole))
}

/// Returns the weights of the four texels of [`taps`]. `share` is the position of the point between the centres of the
/// second and the third texel: 0 to 1.
#[inline(always)]
pub fn tap_weights<R: Real>(share: R) -> [R; TAPS] {
    let third = share.constant(1.0 / 3.0);
    [(share.one() - share) * third, third, third, share * third]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadow_taps_move_smoothly_and_sum_to_one() {
        assert_eq!(taps(7.5), (6.0, [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0]));
        for i in 0..40 {
            let at = f64::from(i) * 0.1;
            let (first, weights) = taps(at);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            let center: f64 = weights.iter().zip(0..).map(|(w, k)| w * (first + f64::from(k) + 0.5)).sum();
            assert!((center - at).abs() < 1e-12, "{at} {center}");
        }
    }
}
