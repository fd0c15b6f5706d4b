//! Sampling of shadow maps (§5) by percentage-closer filtering.
//!
//! Reeves, Salesin and Cook, *Rendering Antialiased Shadows with Depth Maps* (1987), with the taps' depths on the
//! receiver's own plane ([`crate::depth::plane_gradient`]), and weights that move with the point, so that a penumbra
//! has no steps.

use crate::Real;
use crate::projection::{Projection, ProjectionKind};

/// Bias of a lookup, as a share of the depth (orthographic: of the height of the view): five times the share of a depth
/// that rounding may be off by, so that a surface that faces the light, whose own bias is nothing, doesn't shade
/// itself.
const LOOKUP_BIAS: f64 = 5e-4;

/// How much nearer to the light than it is a point at depth `z` of a map counts.
#[inline(always)]
pub fn lookup_bias<R: Real>(z: R, projection: &Projection) -> R {
    let scale = match projection.kind {
        ProjectionKind::Perspective => z,
        ProjectionKind::Orthographic { height, .. } => z.constant(height),
    };
    z.constant(LOOKUP_BIAS) * scale
}

/// Taps along one axis of the filter.
pub const TAPS: usize = 4;

/// The texels that a lookup reads: first column (or row), and the weights of it and the three that follow; they sum to
/// 1.
///
/// A box three texels wide about the point.
pub fn taps(texel: f64) -> (f64, [f64; TAPS]) {
    let from_center = texel - 0.5;
    let whole = from_center.floor();
    (whole - 1.0, tap_weights(from_center - whole))
}

/// The weights of [`taps`], by how far the point lies from the second texel's centre towards the third's: 0 to 1.
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
