//! Bounds of a chunk's groups of 16 splats: a bounding sphere and a cone of normals for each group. They are stored in
//! bytes.

use crate::scene::cloud::{CHUNK, Chunk};
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::Simd;
use glam::DVec3;
use surfel_math::V3;

const _: () = assert!(CHUNK == LANES * LANES, "a chunk's groups fill the lanes");

/// Largest absolute value of a coordinate that is stored in a byte, in steps. [`Groups`] defines the length of a step.
const STEPS: f64 = 127.0;

/// Largest radius of a group's bounding sphere that can be stored, in radii of the chunk's bounding sphere. The group's
/// centre is in the box of the chunk's centres, at most √3 chunk radii from any of them. Its splats are inside the
/// chunk's sphere.
const RADII: f64 = 3.0;

/// Number of steps by which a sine of 1 is stored in a byte. A larger number, a sine above 1, marks an absent cone.
const SINES: f64 = 250.0;

/// Amount added to the sine of a cone of normals; far above the rounding of stored normals.
const SLACK: f64 = 2e-3;

/// Centre, radius and normal of one splat, from which the bounds of its group are computed.
pub(crate) struct BoundedSplat {
    /// Centre relative to the chunk's origin, in object units.
    pub center: DVec3,
    pub radius: f64,
    pub normal: DVec3,
}

/// Bounds of a chunk's groups of 16 splats, one lane per group, stored in bytes.
pub(crate) struct Groups {
    /// Centres of the groups' bounding spheres, relative to the chunk's origin: columns of x, of y and of z. [`STEPS`]
    /// steps are the largest coordinate of the chunk's centres.
    center: [[i8; LANES]; 3],
    /// Radii of the groups' bounding spheres, rounded up. 255 steps are [`RADII`] radii of the chunk.
    radius: [u8; LANES],
    /// Axes of the groups' cones of normals; a length of 1 is [`STEPS`] steps. Rounded towards zero, so that none is
    /// longer than 1.
    axis: [[i8; LANES]; 3],
    /// Sines of the half-angles of the groups' cones of normals, rounded up; [`SINES`] steps are 1.
    sine: [u8; LANES],
}

impl Groups {
    pub(crate) fn of(chunk: &Chunk, splats: &[BoundedSplat]) -> Self {
        let mut all =
            Self { center: [[0; LANES]; 3], radius: [0; LANES], axis: [[0; LANES]; 3], sine: [u8::MAX; LANES] };
        let scale = f64::from(chunk.space.center) / STEPS;
        for (i, splats) in splats.chunks(LANES).enumerate().take(LANES) {
            let around = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let (min, max) = splats.iter().fold(around, |(a, b), s| (a.min(s.center), b.max(s.center)));
            let steps = if scale > 0.0 { (0.5 * (min + max) / scale).round() } else { DVec3::ZERO };
            let radius = |s: &BoundedSplat| (s.center - steps * scale).length() + s.radius;
            let radius = splats.iter().map(radius).fold(0.0, f64::max);
            all.radius[i] = (radius * f64::from(u8::MAX) / (RADII * chunk.radius)).ceil() as u8;
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
}

/// Bounds of a chunk's groups of splats, one lane per group, in object units relative to the chunk's origin.
pub(crate) struct GroupLanes<S: Simd> {
    pub center: V3<Lanes<S>>,
    pub radius: Lanes<S>,
    /// Axes of the groups' cones of normals, in object space; at most of length 1.
    pub axis: V3<Lanes<S>>,
    /// Sines of the half-angles of the groups' cones of normals; above 1 for an absent cone.
    pub sine: Lanes<S>,
}

impl Groups {
    #[inline(always)]
    pub(crate) fn decode<S: Simd>(&self, simd: S, chunk: &Chunk) -> GroupLanes<S> {
        let k = |v: f64| Lanes::splat(simd, v as f32);
        GroupLanes {
            center: coordinates(simd, &self.center) * k(f64::from(chunk.space.center) / STEPS),
            radius: Lanes::load(simd, &self.radius.map(f32::from)) * k(RADII * chunk.radius / f64::from(u8::MAX)),
            axis: coordinates(simd, &self.axis) * k(1.0 / STEPS),
            sine: Lanes::load(simd, &self.sine.map(f32::from)) * k(1.0 / SINES),
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::xorshift::Xorshift;
    use surfel_model::ChunkSpace;

    #[test]
    fn spheres_and_cones_of_groups_hold_their_splats() {
        let mut numbers = Xorshift::new();
        let mut random = move || 2.0 * numbers.share() - 1.0;
        let mut cones = 0;
        for (count, size, spread) in [(1, 0.0, 0.0), (16, 1.0, 0.3), (100, 1e-6, 0.1), (256, 1e9, 0.8), (250, 0.0, 2.0)]
        {
            let splats: Vec<BoundedSplat> = (0..count)
                .map(|i| {
                    // The groups are spread around a sphere.
                    let angle = (i / LANES) as f64;
                    let axis = DVec3::new(angle.cos(), angle.sin(), 0.3).normalize();
                    let normal = (axis + spread * DVec3::new(random(), random(), random())).normalize();
                    BoundedSplat { center: size * (axis + 0.1 * normal), radius: (0.01 + random().abs()) * 0.2, normal }
                })
                .collect();
            let largest = |of: &dyn Fn(&BoundedSplat) -> f64| splats.iter().map(of).fold(0.0, f64::max);
            let chunk = Chunk {
                space: ChunkSpace {
                    origin: DVec3::ZERO,
                    center: largest(&|s| s.center.abs().max_element()) as f32,
                    color: 1.0,
                    radius: 1.0,
                },
                radius: largest(&|s| s.center.length() + s.radius),
                half: DVec3::ONE,
                area: 1.0,
                member: 0,
                first: 0,
                count,
                cone: None,
            };
            let all = Groups::of(&chunk, &splats);
            for (i, splat) in splats.iter().enumerate().map(|(i, splat)| (i / LANES, splat)) {
                let decoded = |bytes: &[[i8; LANES]; 3]| DVec3::from_array([0, 1, 2].map(|k| f64::from(bytes[k][i])));
                let center = decoded(&all.center) * f64::from(chunk.space.center) / STEPS;
                let radius = f64::from(all.radius[i]) * RADII * chunk.radius / 255.0;
                assert!((splat.center - center).length() + splat.radius <= radius * (1.0 + 1e-12), "{center} {radius}");
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
