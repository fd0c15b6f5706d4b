//! How strong a spot light is in a direction.

use crate::lanes::{LANES, Lanes};
use fearless_simd::Simd;
use glam::{DVec3, Vec3};
use surfel_math::V3;

/// Strength of a spot light: smoothstep between its half-angles. The angle needs an arctangent, so it is scalar.
#[cold]
pub(crate) fn strength<S: Simd>(simd: S, to_light: V3<Lanes<S>>, direction: Vec3, inner: f64, outer: f64) -> Lanes<S> {
    let (x, y, z) = (to_light.x.to_array(), to_light.y.to_array(), to_light.z.to_array());
    let strength: [f32; LANES] = std::array::from_fn(|i| {
        let ray = -DVec3::new(x[i].into(), y[i].into(), z[i].into());
        let axis = direction.as_dvec3();
        let angle = (2.0 * (ray - axis).length().atan2((ray + axis).length())).to_degrees();
        let t = if angle <= inner {
            1.0
        } else if angle >= outer {
            0.0
        } else {
            (outer - angle) / (outer - inner)
        };
        (t * t * (3.0 - 2.0 * t)) as f32
    });
    Lanes::load(simd, &strength)
}
