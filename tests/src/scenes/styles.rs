//! Scenes of shaders that aren't lit: a picture of a ball, and depth alone.

use super::{Case, half_mesh_wall, mesh_through_sphere, three_materials};
use crate::build::{camera, cloud, object, scene, sheet, sphere};
use crate::random::Random;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_model::{Matcap, Shader, Texture, Transparency};

pub(super) fn style_cases() -> Vec<Case> {
    let (aside, hidden) = (ball_aside(), hidden_steps());
    let peel = Transparency::Peel { layers: 2, drop_last: false };
    let crossing = mesh_through_sphere().with_ball();
    let edl = |s: &mut surfel_model::Settings| s.shader = Shader::Edl;
    vec![
        three_materials().with("matcap", |s| s.shader = Shader::Matcap),
        aside.with("orthographic", |_| ()).in_orthographic(2.6, 8.0),
        aside.with("edge-aa", |s| s.edge_aa = true),
        aside,
        crossing.with("peel-2", |s| s.transparency = peel),
        crossing,
        three_materials().with("edl", edl),
        half_mesh_wall().with("edl", edl),
        mesh_through_sphere().with("edl", edl).with("peel-2", |s| s.transparency = peel),
        hidden.with("orthographic", |_| ()).in_orthographic(2.6, 8.0),
        hidden.with("edge-aa", |s| s.edge_aa = true),
        hidden,
    ]
}

impl Case {
    /// The same by the shader `matcap`, with a ball of few and random colours, twice as wide as high.
    #[must_use]
    pub fn with_ball(&self) -> Self {
        let mut random = Random::new(211);
        let texel = |random: &mut Random| random.color().map(|c| (255.0 * c) as u8);
        let srgba8 = (0..50).map(|_| texel(&mut random)).map(|[r, g, b]| [r, g, b, 255]).collect();
        let image = Texture { width: 10, height: 5, srgba8 };
        let mut case = self.with("matcap", |s| s.shader = Shader::Matcap);
        case.scene.matcap = Some(Arc::new(Matcap::new(&image).expect("ten by five texels")));
        case
    }
}

/// A ball far from the middle of a wide picture, under a picture of another: normals looked up in world axes, in the view's
/// instead of the sight's, upside down, or mirrored.
pub fn ball_aside() -> Case {
    let mut scene = scene(&sphere(900, 1.2, 223));
    scene.objects[0].world_from_object = DAffine3::from_translation(DVec3::new(-0.9, 0.5, 0.2));
    scene.objects[0].material.interior_weight = Some(2.4);
    let mut camera = camera(2.6, 75.0, [72, 60]);
    camera.eye = [0.4, 0.9, 2.4];
    Case::new("ball-aside", scene, camera).with_ball()
}

/// A ball close before two slanted walls, one behind the other: steps in depth, to another surface and to none.
pub fn hidden_steps() -> Case {
    let wall = |z: f64, lean: f64| {
        let axes = [DVec3::new(0.9, 0.0, lean), DVec3::new(0.1, 0.8, -0.2)];
        object(cloud(&sheet(DVec3::new(lean, 0.0, z), axes, [24, 22], 0.09, |c, r| {
            [0.3 + 0.02 * c as f32, 0.6, 0.9 - 0.03 * r as f32]
        })))
    };
    let mut scene = scene(&sphere(700, 1.2, 227));
    scene.objects[0].world_from_object =
        DAffine3::from_translation(DVec3::new(0.1, 0.1, 0.5)) * DAffine3::from_scale(DVec3::splat(0.45));
    scene.objects.extend([wall(-0.2, 0.5), wall(-0.9, -0.4)]);
    for object in &mut scene.objects {
        object.material.interior_weight = Some(2.4);
    }
    Case::new("hidden-steps", scene, camera(3.0, 45.0, [66, 58])).with("edl", |s| s.shader = Shader::Edl)
}
