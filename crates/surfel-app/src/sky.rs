//! Sky and ground of a scene.

use crate::render_options::RenderOptions;
use glam::DVec3;
use surfel_framing::strays::Sphere;
use surfel_load::Error;
use surfel_model::{Camera, Geometry, Ground, GroundStyle, Object, Scene, SceneFile, Shader, Sky};
use surfel_render::ball_scale;

/// Sky and ground of a scene, after options have been applied; `None` for each that the scene lacks.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SkyAndGround {
    pub(crate) sky: Option<Sky>,
    pub(crate) ground: Option<Ground>,
}

impl SkyAndGround {
    /// Applies the options to `file`, the sky and ground of a scene file. The file's sky and ground are ignored if
    /// `shader` can't show stored light. A ground without a sky is dropped. `scene` has the framed objects; points
    /// outside of the sphere `kept` are strays and don't affect the ground.
    ///
    /// # Errors
    /// [`Error::Usage`] if the options request a sky and an object can't store its light. Also [`Error::Usage`] if the
    /// options state details of a sky and there is none.
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

    /// Stores sky and ground in a scene file. A sky replaces all lights, and sets the shader to `unlit`.
    pub(crate) fn put(self, file: &mut SceneFile) {
        if self.sky.is_some() {
            (file.lights, file.settings.shader) = (None, Shader::Unlit);
        }
        (file.sky, file.ground) = (self.sky, self.ground);
    }
}

/// Returns the ground below a scene, at the height of its lowest point within the sphere `kept`. `None` for the sphere
/// includes all points. Returns `None` if there is no such point.
pub(crate) fn ground(style: GroundStyle, scene: &Scene, kept: Option<Sphere>, up: DVec3) -> Option<Ground> {
    let heights = scene.objects.iter().filter_map(|object| lowest(object, kept, up));
    let height = heights.fold(f64::INFINITY, f64::min);
    let ground = Ground { style, point: (up * height).into(), normal: up.into() };
    height.is_finite().then_some(ground)
}

/// Returns the smallest height of an object along `up`, within the sphere `kept`. Balls are measured at their lowest
/// points, other splats at their centres. `None` if the object has no point in the sphere, and for octrees and
/// Gaussians.
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
    fn ground_lies_below_what_is_framed() {
        let cloud = SplatCloud::balls(&[[0.0, 0.0, 1.0], [0.0, 0.0, 0.5], [0.0, 0.0, -50.0]], &[0.25; 3]).unwrap();
        let scene = Scene::from(cloud);
        let height = |kept| ground(GroundStyle::Shadow, &scene, kept, DVec3::Z).map(|ground| ground.point[2]);
        assert_eq!(height(None), Some(-50.25));
        assert_eq!(height(Some(Sphere { middle: DVec3::Z, radius: 5.0 })), Some(0.25));
        assert_eq!(ground(GroundStyle::Shadow, &Scene::default(), None, DVec3::Z), None);
    }
}
