//! Scenes of shadows and of the shader `toon`.

use super::Case;
use crate::build::{Splat, camera, cloud, object, scene, sheet, sphere, with_alpha};
use crate::polygons::{mesh_object, mesh_sphere, quad};
use glam::{DAffine3, DVec3};
use surfel_model::{EdgeAa, Light, Object, Scene, Shader, Transparency};

/// Radius of the ball of [`ball_over_floor`].
pub const BALL_RADIUS: f64 = 0.7;
/// Centre of the ball of [`ball_over_floor`].
pub const BALL_CENTER: DVec3 = DVec3::new(0.1, 0.35, 0.0);
/// Height of the floor of [`ball_over_floor`].
pub const FLOOR_HEIGHT: f64 = -0.5;
/// Direction of the sun of [`ball_over_floor`].
pub const SUN: [f64; 3] = [-0.5, -1.0, -0.35];

pub(super) fn shadow_cases() -> Vec<Case> {
    let splats = ball_over_floor(Parts::Splats, sun());
    let peel = Transparency::Peel { layers: 3, drop_last: false };
    vec![
        splats.with("toon", |s| s.shader = Shader::Toon),
        splats,
        ball_over_floor(Parts::Meshes, sun()).with("meshes", |_| ()),
        ball_over_floor(Parts::MeshOverSplats, spot(40.0)).with("spot", |_| ()),
        ball_over_floor(Parts::SplatsOverMesh, spot(85.0)).with("wide-spot", |_| ()),
        glass_ball_over_floor().with("peel-3", |s| s.transparency = peel),
        glass_ball_over_floor().with("off", |_| ()),
        shadow_edge(Parts::Meshes, sun()).with("sun", |_| ()),
        shadow_edge(Parts::SplatsOverMesh, spot(40.0)).with("spot", |_| ()),
        shadow_edge(Parts::MeshOverSplats, spot(85.0)).with("wide-spot", |_| ()),
        super::three_materials().with("toon", |s| s.shader = Shader::Toon),
        super::mesh_through_sphere().with("toon", |s| (s.shader, s.edge_aa) = (Shader::Toon, EdgeAa::Coverage)),
    ]
}

/// Representation of the ball and the floor of [`ball_over_floor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// Splats for both.
    Splats,
    /// Polygons for both.
    Meshes,
    /// A ball of polygons, a floor of splats.
    MeshOverSplats,
    /// A ball of splats, a floor of polygons.
    SplatsOverMesh,
}

/// Returns a directional light along [`SUN`] that casts shadows.
pub fn sun() -> Light {
    Light::Directional { direction: SUN, color: [1.0; 3], shadow: true }
}

/// Returns a spot light from above that casts shadows. Its outer half-angle is in degrees.
pub fn spot(outer_deg: f64) -> Light {
    Light::Spot {
        position: [1.0, 2.6, 0.7],
        direction: [-0.3, -1.0, -0.2],
        color: [1.0, 0.9, 0.8],
        inner_deg: 0.7 * outer_deg,
        outer_deg,
        shadow: true,
    }
}

fn ball_of_splats() -> Object {
    let scaled = |s: Splat| Splat {
        p: s.p * BALL_RADIUS + BALL_CENTER,
        s: s.s * BALL_RADIUS,
        t: s.t * BALL_RADIUS,
        color: [0.9, 0.5, 0.3],
    };
    object(cloud(&sphere(1500, 1.1, 0).into_iter().map(scaled).collect::<Vec<_>>()))
}

/// Returns a ball above a floor under one light. Catches a missing shadow caster, the wrong side of a map, and errors
/// in bias, filtering and a light's own coordinates.
pub fn ball_over_floor(parts: Parts, light: Light) -> Case {
    let across = [DVec3::Z * 1.6, DVec3::X * 1.6];
    let floor_center = DVec3::Y * FLOOR_HEIGHT;
    let floor = match parts {
        Parts::Splats | Parts::MeshOverSplats => {
            object(cloud(&sheet(floor_center, across, [50, 50], 0.075, |_, _| [0.6, 0.7, 0.9])))
        }
        Parts::Meshes | Parts::SplatsOverMesh => mesh_object(quad(floor_center, across, 1.0)),
    };
    let ball = match parts {
        Parts::Splats | Parts::SplatsOverMesh => ball_of_splats(),
        Parts::Meshes | Parts::MeshOverSplats => {
            let mut ball = mesh_object(mesh_sphere(5));
            ball.world_from_object =
                DAffine3::from_translation(BALL_CENTER) * DAffine3::from_scale(DVec3::splat(BALL_RADIUS));
            ball
        }
    };
    let mut scene = Scene { objects: vec![ball, floor], lights: Some(vec![light]), ..scene(&[]) };
    scene.ambient = [0.05, 0.05, 0.1];
    for object in &mut scene.objects {
        object.material.specular = 0.0;
        object.material.interior_weight = Some(1.6);
    }
    let mut camera = camera(4.0, 40.0, [64, 64]);
    camera.eye = [0.6, 1.8, 3.6];
    Case::new("ball-over-floor", scene, camera).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a close-up of the floor at the end of the ball's shadow, an area of a few texels. Catches errors in the
/// number of texels, and in the roll and the eye of the map's view.
pub fn shadow_edge(parts: Parts, light: Light) -> Case {
    let edge = end_of_shadow(&light);
    let mut case = ball_over_floor(parts, light);
    case.camera = camera(1.0, 14.0, [48, 48]);
    (case.camera.eye, case.camera.target) = ((edge + DVec3::new(-0.1, 0.35, 0.15)).to_array(), edge.to_array());
    case.name = "shadow-edge/lit".into();
    case
}

/// Returns the end of the ball's shadow: the point of the floor hit by a ray from the light that touches the ball at
/// its side.
///
/// # Panics
/// For a light that has neither a direction nor a position.
fn end_of_shadow(light: &Light) -> DVec3 {
    let (from, along) = match light {
        Light::Directional { direction, .. } => {
            let direction = DVec3::from(*direction).normalize();
            (BALL_CENTER + direction.cross(DVec3::Y).normalize() * -BALL_RADIUS, direction)
        }
        Light::Spot { position, .. } | Light::Point { position, .. } => {
            let to_center = BALL_CENTER - DVec3::from(*position);
            let sine = BALL_RADIUS / to_center.length();
            let (axis, side) = (to_center.normalize(), to_center.cross(DVec3::Y).normalize());
            (DVec3::from(*position), axis * (1.0 - sine * sine).sqrt() - side * sine)
        }
        _ => panic!("the light has no place and no direction"),
    };
    from + along * ((FLOOR_HEIGHT - from.y) / along.y)
}

/// Returns a glass ball, part of it opaque, over a floor. Glass casts no shadow unless all splats are drawn opaque.
/// Surfaces behind the glass are in the shadow of the opaque part.
pub fn glass_ball_over_floor() -> Case {
    let mut case = ball_over_floor(Parts::Splats, sun());
    let surfel_model::Geometry::Splats(ball) = &case.scene.objects[0].geometry else { return case };
    let glass = with_alpha((**ball).clone(), |i| if i % 1500 < 1200 { 0.5 } else { 1.0 });
    case.scene.objects[0].geometry = surfel_model::Geometry::Splats(glass.into());
    case.name = "glass-ball-over-floor/lit".into();
    case
}
