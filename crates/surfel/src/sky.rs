//! Skies of named lights, and the ground below a scene.

use crate::Error;
use crate::framing::ViewAxes;
use crate::render_options::RenderOptions;
use crate::strays::Sphere;
use crate::values::LIGHTS;
use glam::DVec3;
use surfel_model::{Camera, Geometry, Ground, GroundStyle, Object, Scene, SceneFile, Shader, Sky, SkyArea};
use surfel_render::ball_scale;

/// A named light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NamedLight {
    /// Lights that follow the camera, without shadows.
    Headlight,
    /// A sky, and a large soft light from the upper left in front.
    Studio,
    /// An evenly bright sky.
    Sky,
    /// A sky, and a small strong light from the upper left.
    Sun,
}

/// Strengths of a named light's sky, and its area.
struct Parts {
    above: f64,
    below: f64,
    /// Direction along the camera's right, the horizontal direction toward the camera, and up; half-angle in degrees;
    /// strength.
    area: Option<(DVec3, f64, f64)>,
}

impl NamedLight {
    /// Returns the name in the flag `--light`.
    fn name(self) -> &'static str {
        LIGHTS.iter().find(|(_, light)| *light == self).map_or("", |(name, _)| name)
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

    /// Returns the sky of the light for a scene with this up axis, seen first from `camera`; `None` for lights that
    /// follow the camera. The light stands still when the camera moves.
    pub(crate) fn sky(self, up: DVec3, camera: &Camera) -> Option<Sky> {
        let Parts { above, below, area } = self.parts()?;
        let ViewAxes { right, .. } = ViewAxes::of(camera);
        // A view along the up axis has a right axis that is horizontal, too.
        let level = (right - up * up.dot(right)).normalize_or(up.any_orthonormal_vector());
        let toward_camera = level.cross(up);
        let areas = area.map(|(from, half_angle_deg, strength)| SkyArea {
            toward: (level * from.x + toward_camera * from.y + up * from.z).normalize().into(),
            half_angle_deg,
            strength,
        });
        Some(Sky { above, below, areas: areas.into_iter().collect(), ..Sky::new(up.into()) })
    }
}

/// Sky and ground of a scene, as options ask for them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SkyAndGround {
    pub(crate) sky: Option<Sky>,
    pub(crate) ground: Option<Ground>,
}

impl SkyAndGround {
    /// Applies the options to the sky and ground of a scene file, which are left out under a shader that stored light
    /// has no effect on. `scene` has the framed objects, and `kept` is the sphere of what isn't stray.
    ///
    /// # Errors
    /// [`Error::Usage`] if the options ask for a sky and an object can't store its light, or for details of a sky and
    /// there is none.
    pub(crate) fn of(
        mut file: Self,
        shader: Shader,
        options: &RenderOptions,
        (scene, kept): (&Scene, Option<Sphere>),
        (up, camera): (DVec3, &Camera),
    ) -> Result<Self, Error> {
        let unable = scene.objects.iter().find_map(|object| match object.geometry {
            Geometry::Octree(_) => Some("an octree"),
            Geometry::Gaussians(_) => Some("trained Gaussians"),
            Geometry::Splats(_) | Geometry::Mesh(_) => None,
        });
        if !matches!(shader, Shader::Phong | Shader::Unlit) {
            file = Self::default();
        }
        let (light, bounce, style) = options.light(unable.is_none());
        let mut sky = match light {
            Some(light) => light.sky(up, camera),
            None => file.sky,
        };
        if let (Some(_), Some(light), Some(unable)) = (&sky, light, unable) {
            return Err(Error::Usage(format!(
                "--light {}: the input is {unable}, and only splats, points and meshes can store light: leave out \
                 --light and --ground",
                light.name()
            )));
        }
        let of_sky =
            [(options.bounce == Some(true), "bounce"), (options.light_directions.is_some(), "light-directions")];
        if let Some((_, flag)) = of_sky.into_iter().find(|(is_given, _)| *is_given && sky.is_none()) {
            return Err(Error::Usage(format!(
                "--{flag} is for the light of a sky: give --light studio, sky or sun, too"
            )));
        }
        if let Some(sky) = &mut sky {
            sky.bounce = if light.is_some() { bounce } else { options.bounce.unwrap_or(sky.bounce) };
            sky.directions = options.light_directions.unwrap_or(sky.directions);
        }
        let made = style.and_then(|style| ground(style, scene, kept, up));
        let ground = if light.is_some() || options.ground.is_some() { made } else { file.ground };
        Ok(Self { ground: ground.filter(|_| sky.is_some()), sky })
    }

    /// Stores sky and ground in a scene file. A sky replaces all lights.
    pub(crate) fn put(self, file: &mut SceneFile) {
        if self.sky.is_some() {
            (file.lights, file.settings.shader) = (None, Shader::Unlit);
        }
        (file.sky, file.ground) = (self.sky, self.ground);
    }
}

/// Returns the ground below a scene: at the lowest point within the sphere that is framed. `None` for an empty scene.
pub(crate) fn ground(style: GroundStyle, scene: &Scene, kept: Option<Sphere>, up: DVec3) -> Option<Ground> {
    let heights = scene.objects.iter().filter_map(|object| lowest(object, kept, up));
    let height = heights.fold(f64::INFINITY, f64::min);
    let ground = Ground { style, point: (up * height).into(), normal: up.into() };
    height.is_finite().then_some(ground)
}

/// Returns the least height of an object's points: of balls with their radii, of other splats at their centres.
fn lowest(object: &Object, kept: Option<Sphere>, up: DVec3) -> Option<f64> {
    let m = &object.world_from_object;
    let is_kept = |p: &DVec3| kept.is_none_or(|kept| kept.contains(*p));
    let least = |points: &mut dyn Iterator<Item = (DVec3, f64)>| {
        points.filter(|(p, _)| is_kept(p)).map(|(p, below)| up.dot(p) - below).reduce(f64::min)
    };
    match &object.geometry {
        Geometry::Splats(cloud) => {
            let scale = if cloud.is_balls() { ball_scale(m) } else { 0.0 };
            let point = |i: usize| (m.transform_point3(cloud.center(i)), scale * cloud.radius_max(i));
            least(&mut (0..cloud.len()).map(point))
        }
        Geometry::Mesh(mesh) => {
            let point = |i: usize| (m.transform_point3(mesh.origin + mesh.positions.get(i)), 0.0);
            least(&mut (0..mesh.positions.len()).map(point))
        }
        Geometry::Octree(_) | Geometry::Gaussians(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::SplatCloud;

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

    #[test]
    fn ground_lies_below_what_is_framed() {
        let cloud = SplatCloud::balls(&[[0.0, 0.0, 1.0], [0.0, 0.0, 0.5], [0.0, 0.0, -50.0]], &[0.25; 3]).unwrap();
        let scene = Scene::from(cloud);
        let height = |kept| ground(GroundStyle::Shadow, &scene, kept, DVec3::Z).map(|ground| ground.point[2]);
        assert_eq!(height(None), Some(-50.25));
        assert_eq!(height(Some(Sphere { middle: DVec3::Z, radius: 5.0 })), Some(0.25));
        assert_eq!(ground(GroundStyle::Shadow, &Scene::default(), None, DVec3::Z), None);
    }
}
