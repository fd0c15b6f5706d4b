//! Scenes that test lights and materials.

use super::Case;
use crate::build::{Splat, camera, cloud, object, scene, sheet, sphere};
use glam::{DAffine3, DVec3};
use surfel_model::{EdgeAa, Light, Material, Scene, Shader};

pub(super) fn shading_cases() -> Vec<Case> {
    let lit = three_materials();
    vec![
        facing_plane(),
        lit.with("normal", |s| s.shader = Shader::Normal),
        lit.with("depth", |s| s.shader = Shader::Depth),
        lit.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        lit,
        spot_light(),
        point_light(),
        inside_sphere(),
    ]
}

/// Returns the splats of a plane of one colour that faces the eye.
fn white_plane() -> Vec<Splat> {
    sheet(DVec3::ZERO, [DVec3::X * 1.6, DVec3::Y * 1.6], [32, 32], 0.12, |_, _| [0.5, 0.25, 1.0])
}

/// Returns a plane that faces the eye under one oblique light. Catches errors in Phong's terms, each of which has its
/// own coefficient.
pub fn facing_plane() -> Case {
    let mut scene = scene(&white_plane());
    scene.ambient = [0.1, 0.2, 0.3];
    scene.lights =
        Some(vec![Light::Directional { direction: [-0.3, -0.2, -1.0], color: [0.9, 0.8, 0.7], shadow: false }]);
    scene.objects[0].material =
        Material { ambient: 0.7, diffuse: 0.6, specular: 0.5, shininess: 6.0, ..Material::default() };
    Case::new("facing-plane", scene, camera(3.0, 45.0, [48, 48])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns three touching spheres of different materials. Catches factors of the first object only, and wrong averages
/// across a seam.
pub fn three_materials() -> Case {
    let materials = [[1.0, 0.2, 0.9, 64.0], [0.2, 1.0, 0.0, 1.0], [0.5, 0.5, 0.4, 4.0]];
    let objects = materials.iter().zip([-0.8, 0.0, 0.8]).enumerate().map(|(i, (&[a, d, s, n], x))| {
        let mut object = object(cloud(&sphere(500, 1.2, 67 + i as u64)));
        object.world_from_object = DAffine3::from_translation(DVec3::X * x) * DAffine3::from_scale(DVec3::splat(0.6));
        object.material = Material {
            ambient: a,
            diffuse: d,
            specular: s,
            shininess: n,
            interior_weight: Some(2.0),
            ..Material::default()
        };
        object
    });
    let scene = Scene {
        lights: Some(vec![
            Light::Directional { direction: [1.0, -0.5, -1.0], color: [0.7, 0.6, 0.5], shadow: false },
            Light::Point { position: [2.0, 2.0, 1.0], color: [0.2, 0.3, 0.6] },
        ]),
        objects: objects.collect(),
        ..scene(&[])
    };
    Case::new("three-materials", scene, camera(3.5, 40.0, [80, 48])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a spot light on a plane. Catches errors in the falloff between the half-angles, degrees used as radians, and
/// light in the backward direction.
pub fn spot_light() -> Case {
    let mut scene = scene(&white_plane());
    scene.ambient = [0.0; 3];
    scene.lights = Some(vec![Light::Spot {
        position: [0.2, 0.1, 2.0],
        direction: [0.0, 0.0, -1.0],
        color: [1.0, 0.9, 0.8],
        inner_deg: 12.0,
        outer_deg: 26.0,
        shadow: false,
    }]);
    scene.objects[0].material.specular = 0.0;
    Case::new("spot-light", scene, camera(3.0, 45.0, [48, 48])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a point light close to a plane, far from the origin. Catches positions that are reconstructed in world
/// coordinates.
pub fn point_light() -> Case {
    let mut scene = scene(&white_plane());
    let far = DVec3::new(4e5, -3e5, 2e5);
    scene.lights = Some(vec![Light::Point { position: (far + DVec3::new(0.5, 0.4, 0.6)).to_array(), color: [1.0; 3] }]);
    scene.objects[0].world_from_object = DAffine3::from_translation(far);
    let mut camera = camera(3.0, 45.0, [48, 48]);
    camera.eye = (DVec3::from(camera.eye) + far).to_array();
    camera.target = far.to_array();
    Case::new("point-light", scene, camera).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns the inside of a two-sided sphere under the headlight. Catches normals that aren't turned to the eye.
pub fn inside_sphere() -> Case {
    let mut camera = camera(0.4, 80.0, [48, 48]);
    camera.target = [0.3, 0.2, -0.5];
    Case::new("inside-sphere", scene(&sphere(900, 1.3, 71)), camera).with("lit", |s| s.shader = Shader::Phong)
}
