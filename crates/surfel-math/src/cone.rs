//! Cones of normals, by which back-facing splats are culled together.

use glam::DVec3;

/// Amount by which the cosine of a cone's half-angle is reduced, and (`SINE_SLACK`) by which the sine of the sum of the
/// half-angles is enlarged. Both exceed the rounding of stored normals, in f32 and in 16 bits.
const COSINE_SLACK: f64 = 1e-6;
const SINE_SLACK: f64 = 1e-4;

/// A cone of directions, narrower than a half space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalCone {
    /// Unit vector along the cone's axis.
    axis: DVec3,
    /// Sine of the cone's half-angle, the angle between axis and rim. `cosine` is its cosine.
    sine: f64,
    cosine: f64,
}

impl NormalCone {
    /// Returns a cone around the mean of these unit vectors that contains all of them. `None` if the cone isn't
    /// narrower than a half space, or if there are no vectors.
    pub fn about(normals: impl Iterator<Item = DVec3> + Clone) -> Option<Self> {
        let axis = normals.clone().sum::<DVec3>().try_normalize()?;
        let cosine = normals.map(|n| axis.dot(n)).fold(1.0, f64::min) - COSINE_SLACK;
        (cosine > 0.0).then(|| Self { axis, sine: (1.0 - cosine * cosine).sqrt(), cosine })
    }

    /// True if all splats inside a sphere are back-facing, given that the cone contains their normals. `toward` is the
    /// unit direction from the eye to the sphere's centre. `spread_sine` is the sine of the half-angle of the sphere as
    /// viewed from the eye (its radius divided by its distance), or 0 in an orthographic view.
    ///
    /// The half-angles of the cone and of the sphere are added. If their sum plus the angle between the axis and
    /// `toward` is below 90°, a normal within the cone points away from the eye on every ray through the sphere.
    ///
    /// Facing is invariant under affine maps, so cone, sphere and eye may be in object space. NaN gives false.
    pub fn is_back_facing(&self, toward: DVec3, spread_sine: f64) -> bool {
        let spread_cosine = (1.0 - spread_sine * spread_sine).max(0.0).sqrt();
        let sine = self.sine * spread_cosine + self.cosine * spread_sine;
        let cosine = self.cosine * spread_cosine - self.sine * spread_sine;
        cosine > 0.0 && toward.dot(self.axis) > sine + SINE_SLACK
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pseudo-random numbers from −1 to 1.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 1u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    #[test]
    fn cone_contains_its_normals_and_ends_at_a_half_space() {
        let cone = |normals: &[DVec3]| NormalCone::about(normals.iter().copied());
        let single = cone(&[DVec3::Z]).unwrap();
        assert!(single.axis == DVec3::Z && single.sine < 2e-3 && single.cosine < 1.0);
        assert!(cone(&[DVec3::Z, -DVec3::Z]).is_none() && cone(&[]).is_none() && cone(&[DVec3::NAN]).is_none());
        let right = cone(&[DVec3::X, DVec3::Y]).unwrap();
        assert!((right.cosine - 0.5f64.sqrt()).abs() < 1e-5, "{right:?}");
        assert!(cone(&[DVec3::X, DVec3::Y, DVec3::new(-1.0, 0.0, 0.0)]).is_none());
    }

    #[test]
    fn culled_spheres_contain_no_front_facing_splat() {
        let mut next = numbers();
        let (mut culled, mut missed) = (0, 0);
        for _ in 0..2000 {
            let mut vector = || DVec3::new(next(), next(), next());
            let (axis, center) = (vector().normalize(), 3.0 * vector());
            let (spread, radius) = (0.3 * vector().x.abs(), vector().y.abs());
            let splats: Vec<(DVec3, DVec3)> = (0..50)
                .map(|_| (center + radius * vector().clamp_length_max(1.0), (axis + spread * vector()).normalize()))
                .collect();
            let Some(cone) = NormalCone::about(splats.iter().map(|splat| splat.1)) else { continue };
            // The eye is at the origin. For an eye inside the sphere there is no half-angle, and the cone isn't tested.
            let is_culled =
                radius < center.length() && cone.is_back_facing(center.normalize(), radius / center.length());
            let all_back = splats.iter().all(|(p, n)| n.dot(*p) > 0.0);
            assert!(!is_culled || all_back, "{cone:?} {center} {radius}");
            culled += usize::from(is_culled);
            missed += usize::from(all_back && !is_culled);
            let along = DVec3::Z;
            assert!(!cone.is_back_facing(along, 0.0) || splats.iter().all(|(_, n)| n.dot(along) > 0.0));
        }
        assert!(culled > 100 && missed > 0, "{culled} {missed}");
        let cone = NormalCone::about([DVec3::Z].into_iter()).unwrap();
        assert!(cone.is_back_facing(DVec3::Z, 0.5) && !cone.is_back_facing(-DVec3::Z, 0.0));
        assert!(!cone.is_back_facing(DVec3::NAN, 0.0) && !cone.is_back_facing(DVec3::Z, f64::NAN));
    }
}
