//! Default lights of scenes without lights.

use glam::DVec3;
use surfel_framing::{Samples, ViewAxes};
use surfel_load::LoadedObjects;
use surfel_model::{Camera, Light, Up};

/// Key light: its direction before normalisation, and its colour in linear RGB. The direction is toward the light, in
/// coordinates along the camera's right, up and backward axes.
const KEY: (DVec3, [f64; 3]) = (DVec3::new(-0.55, 0.7, 0.9), [0.82, 0.81, 0.79]);
/// Soft fill light from the right, in the same form as [`KEY`]: direction and colour.
const FILL: (DVec3, [f64; 3]) = (DVec3::new(0.9, 0.1, 0.7), [0.15, 0.16, 0.17]);
/// Rim light from behind, in the same form as [`KEY`]: direction and colour.
const RIM: (DVec3, [f64; 3]) = (DVec3::new(0.5, 0.6, -0.8), [0.22, 0.22, 0.24]);
/// Range of the length of a surface's mean unit normal over which raking light increases from 0 to full strength. The
/// length is 1 if the whole surface faces one direction, and 0.93 for normals spread over 30°.
const FACES_ONE_WAY: (f64, f64) = (0.9, 0.96);
/// Cosine of the largest angle between a raking key light and the surface normal: 60°, which is 30° above the surface.
const RAKING: f64 = 0.5;
/// Range like [`FACES_ONE_WAY`] for scans around ground, such as aerial surveys and mobile scans. In woods and streets,
/// the mean normal points up (or down) with a length of 0.5 to 0.9. For bodies and rooms, it is shorter.
const FACES_UP: (f64, f64) = (0.4, 0.55);
/// Cosine of the angle between the mean normal and the up axis (either sign) above which point clouds count as scans
/// around ground, and use [`FACES_UP`].
const UP: f64 = 0.9;
/// Largest factor on the colour of a raking light. The factor makes up for the light's slant, which darkens level
/// areas.
const STRONGEST: f64 = 1.4;

/// Returns three lights that follow the camera:
/// - a key light from the upper left in front,
/// - a soft fill light from the right,
/// - a rim light from behind that separates the outline from the background.
pub fn studio_lights(camera: &Camera) -> Vec<Light> {
    lights(camera, |key| (key, 1.0))
}

/// Properties of objects that determine their lights for any camera.
#[derive(Clone, Copy, Debug)]
pub struct Lighting {
    /// Mean facing direction of the objects: a unit vector, or zero if the objects have colours or no mean direction.
    facing: DVec3,
    /// Strength of raking light, from 0 (key light from the front) to 1 (key light lowered to the raking angle).
    share: f64,
}

impl Lighting {
    /// Estimates the lighting properties of loaded objects. `up` is their up axis.
    pub fn of(loaded: &LoadedObjects, samples: &Samples, up: Up) -> Self {
        if loaded.facts.iter().any(|facts| facts.colored) {
            return Self { facing: DVec3::ZERO, share: 0.0 };
        }
        let facing = samples.all().map_or(DVec3::ZERO, |patches| patches.mean(|p| p.normal));
        let is_of_points = loaded.facts.iter().all(|facts| facts.points);
        let share = raking_strength(facing, if is_of_points { Some(up.vector()) } else { None });
        Self { facing: facing.normalize_or_zero(), share }
    }

    /// Returns [`studio_lights`], with the key light lowered to a raking angle for objects without colours that face
    /// one direction as a whole. Examples are ground, walls, reliefs, and scans around ground. As in hillshaded maps,
    /// raking light shows slopes, which hardly differ from level areas in frontal light. If any object has colours, the
    /// key light is the normal one: colours show the slopes, and often contain light already.
    pub fn lights(self, camera: &Camera) -> Vec<Light> {
        lights(camera, |key| raking(key, self.facing, self.share))
    }
}

/// Returns the strength of raking light, 0 to 1, for a surface with the mean unit normal `facing`. `up` is the up axis
/// if all objects are point clouds, and `None` otherwise.
fn raking_strength(facing: DVec3, up: Option<DVec3>) -> f64 {
    let ramp = |(from, to): (f64, f64)| ((facing.length() - from) / (to - from)).clamp(0.0, 1.0);
    match up {
        Some(up) if facing.dot(up).abs() > UP * facing.length() => ramp(FACES_UP),
        _ => ramp(FACES_ONE_WAY),
    }
}

/// Returns the key, fill and rim lights for a camera. `key` maps the unit vector toward the key light to the vector
/// that replaces it, and a factor on the light's colour.
fn lights(camera: &Camera, key: impl Fn(DVec3) -> (DVec3, f64)) -> Vec<Light> {
    let ViewAxes { right, up, forward } = ViewAxes::of(camera);
    let toward = |(from, _): (DVec3, [f64; 3])| (right * from.x + up * from.y - forward * from.z).normalize();
    let light =
        |toward: DVec3, color: [f64; 3]| Light::Directional { direction: (-toward).into(), color, shadow: false };
    let (key, strength) = key(toward(KEY));
    vec![light(key, KEY.1.map(|c| c * strength)), light(toward(FILL), FILL.1), light(toward(RIM), RIM.1)]
}

/// Rotates `toward`, the unit vector toward a light, away from the unit `normal` by the fraction `share` of the way to
/// the raking angle ([`RAKING`]). A light that is lower already, or along the normal, doesn't change. Also returns a
/// factor on the light's colour, which preserves most of the brightness of level areas.
fn raking(toward: DVec3, normal: DVec3, share: f64) -> (DVec3, f64) {
    // A surface may be visible from either side; the light is on the visible side.
    let normal = if normal.dot(toward) < 0.0 { -normal } else { normal };
    let from = normal.dot(toward);
    let along = (toward - normal * from).normalize_or_zero();
    if share == 0.0 || from <= RAKING || along == DVec3::ZERO {
        return (toward, 1.0);
    }
    let to = from + (RAKING - from) * share;
    (normal * to + along * (1.0 - to * to).sqrt(), (from / to).min(STRONGEST))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_light_rakes_over_what_faces_one_way_alone() {
        let key = DVec3::new(0.3, 0.1, 0.9).normalize();
        let rakes = |key: DVec3, facing: DVec3| raking(key, facing.normalize_or_zero(), raking_strength(facing, None));
        // Ground, viewed from above and from below.
        for normal in [DVec3::Z, DVec3::NEG_Z] {
            let (toward, strength) = rakes(key, normal);
            assert!((toward.z - RAKING).abs() < 1e-12 && (toward.length() - 1.0).abs() < 1e-12, "{toward}");
            // The horizontal direction doesn't change, and level ground gets as much light, up to the limit.
            assert!((toward.x / toward.y - 3.0).abs() < 1e-9 && strength == STRONGEST, "{toward} {strength}");
        }
        // Mean normal between the limits: half of the change.
        let (toward, strength) = rakes(key, DVec3::Z * 0.93);
        assert!((toward.z - 0.5 * (key.z + RAKING)).abs() < 1e-9, "{toward}");
        assert!((strength * toward.z - key.z).abs() < 1e-9, "{strength}");
        // Unchanged: bodies, surfaces lit from the side, and light straight from above.
        let grazing = DVec3::new(0.9, 0.0, 0.3).normalize();
        for (key, facing) in [(key, DVec3::Z * 0.9), (key, DVec3::ZERO), (grazing, DVec3::Z), (DVec3::Z, DVec3::Z)] {
            assert_eq!(rakes(key, facing), (key, 1.0));
        }
    }

    #[test]
    fn key_light_rakes_over_points_about_ground_along_their_up_axis() {
        let lean = |degrees: f64, length: f64| {
            DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos()) * length
        };
        // Woods, a street and level ground; bodies; a wall; ground with another up axis.
        for (facing, up, share) in [
            (lean(0.0, 0.6), DVec3::Z, 1.0),
            (lean(20.0, 0.9), DVec3::Z, 1.0),
            (lean(0.0, 0.475), DVec3::Z, 0.5),
            (lean(0.0, 0.4), DVec3::Z, 0.0),
            (lean(90.0, 0.6), DVec3::Z, 0.0),
            (lean(0.0, 0.6), DVec3::Y, 0.0),
            (lean(0.0, 0.96), DVec3::Y, 1.0),
            // Estimated normals of ground may all point down.
            (lean(180.0, 0.8), DVec3::Z, 1.0),
            (DVec3::ZERO, DVec3::Z, 0.0),
        ] {
            assert!((raking_strength(facing, Some(up)) - share).abs() < 1e-9, "{facing} {up}");
        }
        // Meshes need a longer mean normal.
        assert_eq!(raking_strength(lean(0.0, 0.6), None), 0.0);
    }
}
