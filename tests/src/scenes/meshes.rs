//! Scenes of polygons among splats.

use super::Case;
use crate::build::{camera, cloud, object, scene, sheet, sphere, with_alpha};
use crate::polygons::{checkers, mesh_object, mesh_sphere, quad};
use crate::random::Random;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_model::{Cull, EdgeAa, Light, Projection, Scene, Shader, Texture, Transparency};

pub(super) fn mesh_cases() -> Vec<Case> {
    let (wall, crossing) = (half_mesh_wall(), mesh_through_sphere());
    let peel = Transparency::Peel { layers: 3, drop_last: false };
    let pane = texture_with_alpha();
    vec![
        wall.with("normal", |s| s.shader = Shader::Normal),
        wall.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        wall,
        sphere_before_mesh(),
        crossing.with("peel-3", |s| s.transparency = peel),
        crossing.with("orthographic", |_| ()).in_orthographic(2.6, 8.0),
        crossing,
        mesh_ball(),
        textured_floor(),
        pane.with("peel-2", |s| s.transparency = Transparency::Peel { layers: 2, drop_last: false }),
        pane,
    ]
}

impl Case {
    /// Returns the case with a parallel projection from the same eye. `height` is the height of the view and `far` the
    /// far plane, in world units.
    #[must_use]
    pub fn in_orthographic(mut self, height: f64, far: f64) -> Self {
        self.camera.projection = Projection::Orthographic { height };
        self.camera.far = Some(far);
        self
    }
}

fn two_lights() -> Option<Vec<Light>> {
    Some(vec![
        Light::Directional { direction: [1.0, -0.5, -1.0], color: [0.7, 0.6, 0.5], shadow: false },
        Light::Point { position: [2.0, 2.0, 1.0], color: [0.2, 0.3, 0.6] },
    ])
}

/// Returns a wall whose left half is splats and whose right half is polygons. The halves overlap by a third of a
/// splat's width. Catches errors in the transition.
pub fn half_mesh_wall() -> Case {
    let axes = [DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.0, 0.9, 0.1)];
    let splats = sheet(DVec3::new(-0.5, 0.0, 0.0), axes, [10, 18], 0.15, |c, r| {
        [0.3 + 0.05 * c as f32, 0.7, 0.2 + 0.03 * r as f32]
    });
    let mut scene = scene(&splats);
    // Σw inside this grid: π·r²/spacing² splats cover each point, and each has a mean weight of (1 − e⁻²)/2.
    scene.objects[0].material.interior_weight = Some(std::f64::consts::PI * 2.25 * 0.432);
    let mut wall = quad(DVec3::new(0.5, 0.0, 0.0), axes, 1.0);
    wall.colors = Some(vec![[0.25, 0.3, 0.9], [0.4, 0.3, 0.9], [0.4, 0.2, 0.7], [0.25, 0.2, 0.7]]);
    scene.objects.push(mesh_object(wall));
    scene.lights = two_lights();
    Case::new("half-mesh-wall", scene, camera(2.6, 45.0, [72, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a sphere of splats in front of a wall of polygons, with antialiased edges. Catches errors in drawing the
/// polygon behind an edge.
pub fn sphere_before_mesh() -> Case {
    let mut scene = scene(&sphere(900, 1.1, 101));
    scene.objects[0].material.interior_weight = Some(2.0);
    let mut wall = quad(DVec3::new(0.4, 0.0, -2.0), [DVec3::X * 1.6, DVec3::Y * 3.0], 5.0);
    wall.texture = Some(checkers(4));
    scene.objects.push(mesh_object(wall));
    Case::new("sphere-before-mesh", scene, camera(3.0, 45.0, [64, 64]))
        .with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage)
}

/// Returns polygons that intersect an opaque sphere of splats and a transparent pane. The nearer surface must be
/// visible in every pixel.
pub fn mesh_through_sphere() -> Case {
    let mut random = Random::new(103);
    let mut scene = scene(&sphere(700, 1.2, 107));
    scene.objects[0].material.interior_weight = Some(2.6);
    let mut pane = quad(DVec3::ZERO, [DVec3::new(1.2, 0.1, 0.9), DVec3::new(0.0, 1.1, 0.2)], 1.0);
    pane.colors = Some((0..4).map(|_| random.color()).collect());
    scene.objects.push(mesh_object(pane));
    let axes = [DVec3::new(1.0, 0.0, -0.8), DVec3::new(0.0, 0.7, 0.1)];
    let glass = sheet(DVec3::new(0.0, 0.0, 0.4), axes, [16, 12], 0.12, |_, _| [0.2, 0.9, 0.4]);
    let mut glass = object(with_alpha(cloud(&glass), |_| 0.5));
    glass.material.interior_weight = Some(2.6);
    scene.objects.push(glass);
    scene.lights = two_lights();
    Case::new("mesh-through-sphere", scene, camera(4.0, 40.0, [60, 60])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns two objects of polygons: a mirrored, sheared ball with vertex normals and back-face culling, and a
/// flat-shaded ball.
pub fn mesh_ball() -> Case {
    let mut smooth = mesh_object(mesh_sphere(3));
    smooth.world_from_object = DAffine3::from_translation(DVec3::X * -0.6)
        * DAffine3::from_mat3(glam::DMat3::from_cols_array(&[-0.8, 0.2, 0.0, 0.0, 0.6, 0.3, 0.1, 0.0, 0.9]));
    smooth.material.cull = Cull::Back;
    smooth.material.two_sided = false;
    let mut flat = mesh_sphere(2);
    flat.normals = None;
    flat.colors = Some((0..flat.positions.len()).map(|i| [0.2 + 0.01 * i as f32, 0.5, 0.3]).collect());
    let mut flat = mesh_object(flat);
    flat.world_from_object = DAffine3::from_translation(DVec3::new(0.7, 0.1, -0.3));
    flat.material.specular = 0.6;
    let scene = Scene { objects: vec![smooth, flat], lights: two_lights(), ..scene(&[]) };
    Case::new("mesh-balls", scene, camera(3.4, 45.0, [80, 56])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a chequered floor from behind the eye to far ahead. Catches errors at the near plane, in the perspective of
/// texture coordinates, and in mipmaps.
pub fn textured_floor() -> Case {
    let mut floor = quad(DVec3::new(0.0, -0.3, -6.0), [DVec3::X * 3.0, DVec3::NEG_Z * 12.0], 24.0);
    floor.texture = Some(checkers(2));
    let mut scene = scene(&[]);
    scene.objects = vec![mesh_object(floor)];
    let mut camera = camera(2.0, 60.0, [64, 48]);
    camera.near = 0.5;
    Case::new("textured-floor", scene, camera)
}

/// Returns a slanted quad in front of a wall of splats, with vertices and a texture of every alpha. Alpha must have no
/// effect on polygons. Catches blending or cutting by alpha, and mipmaps that weight colours by alpha.
pub fn texture_with_alpha() -> Case {
    let mut random = Random::new(137);
    let wall =
        sheet(DVec3::new(0.0, 0.0, -1.0), [DVec3::X * 1.6, DVec3::Y * 1.2], [16, 12], 0.2, |_, _| random.color());
    let mut scene = scene(&wall);
    scene.objects[0].material.interior_weight = Some(2.0);
    let srgba8 = (0..64u8).map(|i| [4 * i, 255 - 4 * i, 37 * (i % 7), if i % 3 == 0 { 0 } else { 4 * i }]).collect();
    let mut quad = quad(DVec3::new(0.0, 0.0, -0.3), [DVec3::new(0.9, 0.0, 0.5), DVec3::new(0.0, 0.7, -0.4)], 6.0);
    quad.texture = Some(Arc::new(Texture { width: 8, height: 8, srgba8 }));
    quad.alphas = Some(vec![1.0, 0.4, 0.0, 0.7]);
    scene.objects.push(mesh_object(quad));
    Case::new("texture-with-alpha", scene, camera(2.6, 45.0, [64, 48]))
}
