//! Named lights, and the skies by which they are realised.

use glam::DVec3;
use surfel_framing::ViewAxes;
use surfel_model::{Camera, Sky, SkyArea};

/// Light that is selected by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NamedLight {
    /// Lights that follow the camera, without shadows.
    Headlight,
    /// A sky, and a large soft light from the upper left in front.
    Studio,
    /// A sky without an area light: soft light from all around, mostly from above.
    Sky,
    /// A sky, and a small strong light from the upper left.
    Sun,
}

/// Fraction of a named light that is constant everywhere, and doesn't come from its sky ([`Sky::even`]). It lightens
/// surfaces that no light of the sky reaches: splats inside of a body that are visible through gaps, and the inside of
/// foliage.
const EVEN: f64 = 0.08;

/// Strengths of a named light's sky, and its area light: a round bright area in the sky.
struct Parts {
    above: f64,
    below: f64,
    /// Area light, or `None`: its direction, its half-angle in degrees, and its strength. The direction's coordinates
    /// are along the camera's right, the horizontal direction toward the camera, and the up axis.
    area: Option<(DVec3, f64, f64)>,
}

impl NamedLight {
    /// Returns the light's name as a value of the option `light`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Headlight => "headlight",
            Self::Studio => "studio",
            Self::Sky => "sky",
            Self::Sun => "sun",
        }
    }

    fn parts(self) -> Option<Parts> {
        match self {
            Self::Headlight => None,
            Self::Studio => {
                Some(Parts { above: 0.55, below: 0.2, area: Some((DVec3::new(-0.55, 0.6, 0.9), 15.0, 0.6)) })
            }
            Self::Sky => Some(Parts { above: 1.0, below: 0.3, area: None }),
            Self::Sun => Some(Parts { above: 0.4, below: 0.15, area: Some((DVec3::new(-0.7, 0.45, 0.8), 3.0, 0.85)) }),
        }
    }

    /// Returns the light's sky for a scene with the up axis `up`. Its bright area is placed relative to `camera`, the
    /// first one of a scene, and stays fixed when the camera moves. Returns `None` for lights that follow the camera.
    pub fn sky(self, up: DVec3, camera: &Camera) -> Option<Sky> {
        let Parts { above, below, area } = self.parts()?;
        let ViewAxes { right, .. } = ViewAxes::of(camera);
        // The right axis is nearly horizontal in all views, including those along the up axis.
        let level = (right - up * up.dot(right)).normalize_or(up.any_orthonormal_vector());
        let toward_camera = level.cross(up);
        let areas = area.map(|(from, half_angle_deg, strength)| SkyArea {
            toward: (level * from.x + toward_camera * from.y + up * from.z).normalize().into(),
            half_angle_deg,
            strength,
        });
        Some(Sky { above, below, even: EVEN, areas: areas.into_iter().collect(), ..Sky::new(up.into()) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_stand_upper_left_of_the_first_camera_whatever_is_up() {
        for (up, eye) in [
            (DVec3::Z, [0.0, -5.0, 1.0]),
            (DVec3::Y, [0.0, 1.0, 5.0]),
            (DVec3::Z, [0.0, -1e-9, 5.0]),
            (DVec3::NEG_Y, [4.0, 0.0, 1.0]),
        ] {
            let camera = Camera { up: up.into(), ..Camera::perspective(eye, [0.0; 3], 45.0, [10, 10]) };
            let sky = NamedLight::Studio.sky(up, &camera).unwrap();
            sky.validate().unwrap();
            let toward = DVec3::from(sky.areas[0].toward);
            let axes = ViewAxes::of(&camera);
            assert!(toward.dot(axes.right) < -0.3 && toward.dot(up) > 0.6, "{up}: {toward}");
            let back = axes.right.cross(up);
            assert!(toward.dot(back) > 0.3, "{up}: {toward}");
        }
        let camera = Camera::perspective([0.0, 0.0, 5.0], [0.0; 3], 45.0, [10, 10]);
        assert!(NamedLight::Headlight.sky(DVec3::Y, &camera).is_none());
        assert!(NamedLight::Sky.sky(DVec3::Y, &camera).unwrap().areas.is_empty());
    }
}
