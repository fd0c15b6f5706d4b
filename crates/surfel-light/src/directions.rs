//! Directions from which a sky and its bright areas shine.

use glam::{DVec3, Vec3};
use std::f64::consts::TAU;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::Sky;

/// Fraction of a turn (2π) between successive directions of a spiral: the inverse of the golden ratio, which spreads
/// them evenly.
const GOLDEN_TURN: f64 = 0.618_033_988_749_894_9;
/// Ratio of the number of directions in the sky to the number in each of its bright areas.
const AREA_SHARE: u32 = 4;
/// Smallest number of directions in a bright area of the sky.
const MIN_AREA: u32 = 16;
/// Ratio of the number of directions in the upper half of the sky to that in the lower half, if the lower half shines.
const LOWER_SHARE: u32 = 3;

/// Direction from which a part of a sky's light comes, with the strength of this light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    /// Unit vector from the scene toward the light.
    pub toward: Vec3,
    /// Brightness of a white surface that faces the direction and gets only its light.
    pub weight: f32,
    /// True if the light belongs to the sky, false if it belongs to one of the sky's bright areas.
    pub is_sky: bool,
}

/// Returns the directions that represent a sky and its bright areas (rendering model §12). Directions without light are
/// left out.
pub(crate) fn rays(sky: &Sky) -> Vec<Ray> {
    let up = unit(sky.up.into());
    let is_lower = sky.below > 0.0;
    let upper = if is_lower { (sky.directions * LOWER_SHARE).div_ceil(LOWER_SHARE + 1) } else { sky.directions };
    let lower = if is_lower { (sky.directions - upper).max(1) } else { 0 };
    let half = |up: DVec3, count: u32, strength: f64| {
        // Each direction stands for a solid angle of 2π/count with the radiance strength/π.
        let weight = (2.0 * strength / f64::from(count.max(1))) as f32;
        cap(up, 0.0, count).map(move |toward| Ray { toward: toward.as_vec3(), weight, is_sky: true })
    };
    let mut rays: Vec<Ray> = half(up, upper, sky.above).chain(half(-up, lower, sky.below)).collect();
    for area in &sky.areas {
        let count = (sky.directions / AREA_SHARE).max(MIN_AREA);
        let middle = unit(area.toward.into());
        let least = area.half_angle_deg.to_radians().cos();
        let all: Vec<DVec3> = cap(middle, least, count).collect();
        let sum: f64 = all.iter().map(|toward| toward.dot(middle)).sum();
        let weight = (area.strength / sum) as f32;
        rays.extend(all.into_iter().map(|toward| Ray { toward: toward.as_vec3(), weight, is_sky: false }));
    }
    rays.retain(|ray| ray.weight > 0.0);
    rays
}

/// Returns `count` directions along a spiral in a cap of the unit sphere, each for an equal part of the cap's area.
/// `middle` is the cap's centre, and `least` the cosine of the angle from the centre to the rim.
fn cap(middle: DVec3, least: f64, count: u32) -> impl Iterator<Item = DVec3> {
    let (right, up) = orthonormal(middle);
    (0..count).map(move |i| {
        let cosine = 1.0 - (1.0 - least) * (f64::from(i) + 0.5) / f64::from(count);
        let (sine, turn) = ((1.0 - cosine * cosine).max(0.0).sqrt(), TAU * GOLDEN_TURN * f64::from(i));
        middle * cosine + (right * turn.cos() + up * turn.sin()) * sine
    })
}

/// Returns the light on an unoccluded surface with this unit normal: from the sky, and from its bright areas.
pub(crate) fn open(rays: &[Ray], normal: Vec3) -> [f32; 2] {
    let mut sums = [0.0; 2];
    for ray in rays {
        sums[usize::from(!ray.is_sky)] += ray.weight * ray.toward.dot(normal).max(0.0);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::SkyArea;

    #[test]
    fn irradiance_of_a_sky_is_that_of_its_closed_form() {
        let sky = Sky { below: 0.25, directions: 512, ..Sky::new([0.0, 0.0, 2.0]) };
        let rays = rays(&sky);
        assert_eq!(rays.len(), 512);
        for degrees in [0.0f32, 30.0, 60.0, 90.0, 135.0, 180.0] {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let [found, area] = open(&rays, Vec3::new(sine, 0.0, cosine));
            // A half of the sky with strength L adds L·(1 ± cosine)/2.
            let expected = 0.5 * (1.0 + cosine) + 0.25 * 0.5 * (1.0 - cosine);
            assert!((found - expected).abs() < 0.006 && area == 0.0, "{degrees}: {found}, expected {expected}");
        }
    }

    #[test]
    fn areas_shine_with_their_strength_and_dark_halves_have_no_directions() {
        let area = SkyArea { toward: [1.0, 1.0, 0.0], half_angle_deg: 20.0, strength: 0.7 };
        let sky = Sky { areas: vec![area], above: 0.0, ..Sky::new([0.0, 0.0, 1.0]) };
        let rays = rays(&sky);
        assert_eq!(rays.len(), 32);
        let toward = Vec3::new(1.0, 1.0, 0.0).normalize();
        let [dark, found] = open(&rays, toward);
        assert!(dark == 0.0 && (found - 0.7).abs() < 1e-5, "{found}");
        let widest = rays.iter().map(|ray| ray.toward.dot(toward)).fold(1.0, f32::min);
        assert!(widest > 20f32.to_radians().cos() && widest < 19f32.to_radians().cos(), "{widest}");
    }
}
