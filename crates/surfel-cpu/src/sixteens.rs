//! Which sixteens of a chunk's splats a region may see: a ball about each and a cone about its normals, in bytes, all of them
//! tested at once.

use crate::lane_math::transform;
use crate::lanes::{LANES, Lanes};
use crate::placed::{ObjectSetup, Sides};
use crate::store::{CHUNK, Chunk};
use fearless_simd::{Simd, mask32x16};
use glam::DVec3;
use surfel_math::{Real, V3};
use surfel_model::Cull;

const _: () = assert!(CHUNK == LANES * LANES, "a chunk's sixteens fill the lanes");

/// Steps of a coordinate on either side of zero.
const STEPS: f64 = 127.0;

/// Greatest ball, in the chunk's: one about a point in the box of a chunk's centres, a root of three away at most.
const BALLS: f64 = 3.0;

/// Steps of a cone's sine. More than 1 stand for no cone.
const SINES: f64 = 250.0;

/// Rounding of stored normals, and far more.
const SLACK: f64 = 2e-3;

/// A splat as its sixteen is bounded.
pub(crate) struct Bounded {
    /// Centre, from the chunk's origin.
    pub center: DVec3,
    pub radius: f64,
    pub normal: DVec3,
}

/// A chunk's sixteens.
pub(crate) struct Sixteens {
    /// Centres of balls, of the chunk's largest coordinate.
    center: [[i8; LANES]; 3],
    /// Their radii, rounded up.
    ball: [u8; LANES],
    /// Axes of cones about normals, rounded towards zero: none is longer than 1.
    axis: [[i8; LANES]; 3],
    /// Sines of the cones' angles, rounded up.
    sine: [u8; LANES],
}

impl Sixteens {
    pub(crate) fn of(chunk: &Chunk, splats: &[Bounded]) -> Self {
        let mut all = Self { center: [[0; LANES]; 3], ball: [0; LANES], axis: [[0; LANES]; 3], sine: [u8::MAX; LANES] };
        let scale = f64::from(chunk.space.center) / STEPS;
        for (i, splats) in splats.chunks(LANES).enumerate().take(LANES) {
            let around = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let (min, max) = splats.iter().fold(around, |(a, b), s| (a.min(s.center), b.max(s.center)));
            let steps = if scale > 0.0 { (0.5 * (min + max) / scale).round() } else { DVec3::ZERO };
            let radius = |s: &Bounded| (s.center - steps * scale).length() + s.radius;
            let ball = splats.iter().map(radius).fold(0.0, f64::max);
            all.ball[i] = (ball * f64::from(u8::MAX) / (BALLS * chunk.ball)).ceil() as u8;
            let axis = (splats.iter().map(|s| s.normal).sum::<DVec3>().normalize_or_zero() * STEPS).trunc();
            let cosine = splats.iter().map(|s| s.normal.dot(axis.normalize_or_zero())).fold(1.0, f64::min);
            if cosine > 0.0 {
                let sine = (1.0 - cosine * cosine).max(0.0).sqrt() + SLACK;
                all.sine[i] = (sine * SINES).ceil() as u8;
            }
            for k in 0..3 {
                (all.center[k][i], all.axis[k][i]) = (steps[k] as i8, axis[k] as i8);
            }
        }
        all
    }

    /// Those that may be seen, as bits, given the chunk's centre in view space.
    #[inline(always)]
    pub(crate) fn seen<S: Simd>(
        &self,
        simd: S,
        setup: &ObjectSetup<'_>,
        (chunk, center): (&Chunk, DVec3),
        sides: &Sides,
    ) -> u64 {
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let at = coordinates(simd, &self.center) * k(f64::from(chunk.space.center) / STEPS);
        let ball = Lanes::load(simd, &self.ball.map(f32::from)) * k(BALLS * chunk.ball / f64::from(u8::MAX));
        let p = transform(&setup.linear.as_mat3(), at) + V3::new(k(center.x), k(center.y), k(center.z));
        let mut unseen = beyond(sides, &p, ball);
        if setup.material.cull == Cull::Back {
            let axis = coordinates(simd, &self.axis) * k(1.0 / STEPS);
            let sine = Lanes::load(simd, &self.sine.map(f32::from)) * k(1.0 / SINES);
            // As `ObjectSetup::is_turned_away`, with cosines taken for 1.
            let eye = setup.eye_in_object;
            let away = if setup.view.projection.is_perspective() {
                let ray = chunk.space.origin - eye;
                let ray = at + V3::new(k(ray.x), k(ray.y), k(ray.z));
                sine.mul_add(ray.length(), ball).lt(axis.dot(ray))
            } else {
                sine.lt(axis.dot(V3::new(k(eye.x), k(eye.y), k(eye.z))))
            };
            unseen |= away;
        }
        !fearless_simd::prelude::SimdMask::to_bitmask(unseen) & (u64::MAX >> (64 - chunk.count.div_ceil(LANES)))
    }
}

#[inline(always)]
fn coordinates<S: Simd>(simd: S, [x, y, z]: &[[i8; LANES]; 3]) -> V3<Lanes<S>> {
    V3::new(
        Lanes::load(simd, &x.map(f32::from)),
        Lanes::load(simd, &y.map(f32::from)),
        Lanes::load(simd, &z.map(f32::from)),
    )
}

/// Which of sixteen balls lie beyond a region's sides, given in view space and in the object's lengths.
#[inline(always)]
pub(crate) fn beyond<S: Simd>(sides: &Sides, p: &V3<Lanes<S>>, ball: Lanes<S>) -> mask32x16<S> {
    let k = |v: f64| ball.constant(v);
    let ball = ball * k(sides.reach);
    let depth = if sides.perspective { p.z } else { ball.one() };
    let [[left, right], [top, bottom]] = sides.slopes;
    let [[left_length, right_length], [top_length, bottom_length]] = sides.lengths;
    let beyond = (ball * k(left_length)).lt(depth * k(left) - p.x)
        | (ball * k(right_length)).lt(p.x - depth * k(right))
        | (ball * k(top_length)).lt(depth * k(top) - p.y)
        | (ball * k(bottom_length)).lt(p.y - depth * k(bottom));
    if sides.perspective { beyond & (ball * k(4.0)).le(p.z) } else { beyond }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_render::ChunkSpace;

    #[test]
    fn balls_and_cones_of_sixteens_hold_their_splats() {
        let mut state = 0x9e37_79b9_7f4a_7c15u64;
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let mut cones = 0;
        for (count, size, spread) in [(1, 0.0, 0.0), (16, 1.0, 0.3), (100, 1e-6, 0.1), (256, 1e9, 0.8), (250, 0.0, 2.0)]
        {
            let splats: Vec<Bounded> = (0..count)
                .map(|i| {
                    // Around a sphere, a sixteen after another.
                    let angle = (i / LANES) as f64;
                    let axis = DVec3::new(angle.cos(), angle.sin(), 0.3).normalize();
                    let normal = (axis + spread * DVec3::new(random(), random(), random())).normalize();
                    Bounded { center: size * (axis + 0.1 * normal), radius: (0.01 + random().abs()) * 0.2, normal }
                })
                .collect();
            let largest = |of: &dyn Fn(&Bounded) -> f64| splats.iter().map(of).fold(0.0, f64::max);
            let chunk = Chunk {
                space: ChunkSpace {
                    origin: DVec3::ZERO,
                    center: largest(&|s| s.center.abs().max_element()) as f32,
                    color: 1.0,
                    radius: 1.0,
                },
                ball: largest(&|s| s.center.length() + s.radius),
                half: DVec3::ONE,
                area: 1.0,
                first: 0,
                count,
                cone: None,
            };
            let all = Sixteens::of(&chunk, &splats);
            for (i, splat) in splats.iter().enumerate().map(|(i, splat)| (i / LANES, splat)) {
                let decoded = |bytes: &[[i8; LANES]; 3]| DVec3::from_array([0, 1, 2].map(|k| f64::from(bytes[k][i])));
                let center = decoded(&all.center) * f64::from(chunk.space.center) / STEPS;
                let ball = f64::from(all.ball[i]) * BALLS * chunk.ball / 255.0;
                assert!((splat.center - center).length() + splat.radius <= ball * (1.0 + 1e-12), "{center} {ball}");
                let (axis, sine) = (decoded(&all.axis) / STEPS, f64::from(all.sine[i]) / SINES);
                assert!(axis.length() <= 1.0);
                if sine <= 1.0 {
                    let turn = axis.normalize().dot(splat.normal);
                    assert!(turn > 0.0 && (1.0 - turn * turn).max(0.0).sqrt() + SLACK <= sine + 1e-9, "{axis} {sine}");
                    cones += 1;
                }
            }
        }
        assert!(cones > 300, "{cones}");
    }
}
