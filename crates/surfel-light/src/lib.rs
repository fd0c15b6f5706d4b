//! Computes the light of a sky and its bright areas, with soft shadows, and stores it in a scene's splats. Also draws
//! the ground with its shadows (rendering model §12).
//!
//! A [`Sky`](surfel_model::Sky) shines from many directions. [`light_scene`] draws a depth map of the scene for each
//! direction, sums the light that reaches each splat, and multiplies the splats' colours by the sum. All backends then
//! draw these colours without further lights, so that images from other cameras cost nothing more.
//!
//! ```
//! use surfel_light::{LightOptions, light_scene};
//! use surfel_model::{Object, Scene, Sky, SplatCloud};
//! # fn main() -> Result<(), surfel_light::LightError> {
//! // A disk that faces up below a sky, and one below it in its shadow.
//! let (centers, normals) = ([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]; 2]);
//! let cloud = SplatCloud::disks(&centers, &normals, &[1.0, 1.0])?;
//! let scene = Scene { sky: Some(Sky::new([0.0, 0.0, 1.0])), ..Scene::from(cloud) };
//!
//! let lit = light_scene(&scene, &LightOptions::default())?;
//! let surfel_model::Geometry::Splats(cloud) = &lit.scene.objects[0].geometry else { unreachable!() };
//! let [upper, lower] = [0, 1].map(|i| cloud.color(i)[0]);
//! assert!((upper - 1.0).abs() < 0.01); // nothing hides the sky
//! assert!((lower - 0.5).abs() < 0.05); // the upper disk hides half of its light
//! # Ok(())
//! # }
//! ```
//!
//! # Reading order
//! Start with [`light_scene`]. `directions.rs` divides a sky into rays. `casters.rs` and `depth_map.rs` find the
//! surfaces that block the rays. `receivers.rs` sums the light that reaches each point. `stored.rs` stores the sums in
//! the scene, and `buried.rs` finds dark splats that get the light of their neighbours. [`LitGround`] draws the ground.
//!
//! # Layer
//! The crate builds on `surfel-model` and `surfel-render`. `surfel-backend` calls it when a scene is uploaded.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod buried;
mod casters;
mod depth_map;
mod directions;
mod ground;
mod receivers;
mod stored;

pub use ground::LitGround;

use casters::{Casters, Sphere};
use ground::Plane;
use surfel_model::{Geometry, ModelError, Scene};

/// Reason why a scene's light can't be stored.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LightError {
    /// An object of the scene is of a kind that has no colours in which light can be stored.
    #[error(
        "objects[{object}] is {what}, which can't store the light of a sky, expected splats, points or a mesh: leave \
         out the sky, or give the object's source"
    )]
    Unsuitable {
        /// Index of the unsuitable object in the scene.
        object: usize,
        /// Kind of the unsuitable object, such as "an octree".
        what: &'static str,
    },
    /// A value of the scene, such as a sky's strength, is invalid.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Options that trade speed for accuracy of the stored light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct LightOptions {
    /// Width and height of the depth map that is drawn for each direction, in texels; at least 16, default 384.
    pub map_side: u32,
}

impl Default for LightOptions {
    fn default() -> Self {
        Self { map_side: 384 }
    }
}

impl LightOptions {
    surfel_model::setters! {
        with_map_side map_side: u32,
    }
}

/// Scene whose objects store the light of its sky.
#[derive(Clone, Debug)]
pub struct LitScene {
    /// Scene without its sky and ground. Draw its colours with [`Shader::Unlit`](surfel_model::Shader).
    pub scene: Scene,
    /// Ground, to be drawn behind the scene by [`LitGround::draw_behind`]; the scene's background is then transparent.
    /// `None` if the scene has no ground, no sky, or no splats and vertices.
    pub ground: Option<LitGround>,
}

/// Computes and stores the light of a scene's sky. A scene without a sky is returned unchanged.
///
/// The result is the same for any number of threads. Time is proportional to the number of directions times the number
/// of splats. Memory is 48 bytes per splat (680 per ball) and 10 MB for a ground, besides the copy of the scene.
///
/// # Errors
/// [`LightError::Unsuitable`] for octrees and trained Gaussians; [`LightError::Model`] for invalid values.
pub fn light_scene(scene: &Scene, options: &LightOptions) -> Result<LitScene, LightError> {
    let Some(sky) = &scene.sky else { return Ok(LitScene { scene: scene.clone(), ground: None }) };
    scene.validate()?;
    for (object, what) in scene.objects.iter().enumerate() {
        let what = match what.geometry {
            Geometry::Octree(_) => "an octree",
            Geometry::Gaussians(_) => "trained Gaussians",
            Geometry::Splats(_) | Geometry::Mesh(_) => continue,
        };
        return Err(LightError::Unsuitable { object, what });
    }
    let mut lit = Scene { sky: None, ground: None, ..scene.clone() };
    let Some(sphere) = Sphere::of(scene) else { return Ok(LitScene { scene: lit, ground: None }) };
    let side = options.map_side.max(16) as usize;
    let (rays, casters) = (directions::rays(sky), Casters::of(scene, &sphere));
    let receivers = stored::receivers(scene, &sphere);
    let plane = scene.ground.as_ref().map(|ground| Plane::of(ground, &sphere));
    let of_ground = plane.as_ref().map(Plane::receivers).unwrap_or_default();
    let [light, light_of_ground] = receivers::gather(&casters, &rays, [&receivers, &of_ground], side);
    drop((casters, receivers, of_ground));
    lit.objects = stored::store(scene, sky, &rays, &light)?;
    let ground = plane.map(|plane| LitGround::of(plane, &rays, &light_of_ground));
    if ground.is_some() {
        lit.background = [0.0; 4];
    }
    Ok(LitScene { scene: lit, ground })
}
