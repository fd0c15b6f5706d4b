//! Scenes of the shaders without lights: `matcap` and `edl`.

use super::{Case, half_mesh_wall, mesh_through_sphere, three_materials};
use crate::build::{camera, cloud, object, scene, sheet, sphere};
use crate::polygons::{mesh_object, quad};
use crate::random::Random;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_model::{EdgeAa, Matcap, Shader, Texture, Transparency};

pub(super) fn style_cases() -> Vec<Case> {
    let (aside, hidden) = (ball_aside(), hidden_steps());
    let peel = Transparency::Peel { layers: 2, drop_last: false };
    let crossing = mesh_through_sphere().with_ball();
    let edl = |s: &mut surfel_model::Settings| s.shader = Shader::Edl;
    vec![
        three_materials().with("matcap", |s| s.shader = Shader::Matcap),
        aside.with("orthographic", |_| ()).in_orthographic(2.6, 8.0),
        aside.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        aside,
        crossing.with("peel-2", |s| s.transparency = peel),
        crossing,
        three_materials().with("edl", edl),
        half_mesh_wall().with("edl", edl),
        mesh_through_sphere().with("edl", edl).with("peel-2", |s| s.transparency = peel),
        hidden.with("orthographic", |_| ()).in_orthographic(2.6, 8.0),
        hidden.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        hidden,
        splats_faded_over_mesh(),
        splats_faded_over_mesh().with("orthographic", |_| ()).in_orthographic(2.0, 8.0),
    ]
}

impl Case {
    /// Returns the case with the shader `matcap`, and a matcap of few random colours that is twice as wide as high.
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

/// Returns a ball far from the middle of a wide image, with a matcap. Catches normals that are looked up in world axes,
/// in the axes of the view instead of the view ray, upside down, or mirrored.
pub fn ball_aside() -> Case {
    let mut scene = scene(&sphere(900, 1.2, 223));
    scene.objects[0].world_from_object = DAffine3::from_translation(DVec3::new(-0.9, 0.5, 0.2));
    scene.objects[0].material.interior_weight = Some(2.4);
    let mut camera = camera(2.6, 75.0, [72, 60]);
    camera.eye = [0.4, 0.9, 2.4];
    Case::new("ball-aside", scene, camera).with_ball()
}

/// Returns a ball in front of two slanted walls, one behind the other. Catches errors at depth steps to another surface
/// and to the background.
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

/// Returns a sheet of splats at an angle to a polygon, within the tolerance, with too little coverage to hide it.
/// Catches wrong depths in pixels where splats are blended over the polygon.
pub fn splats_faded_over_mesh() -> Case {
    let leaning = [DVec3::new(0.7, 0.0, 0.16), DVec3::new(0.05, 0.6, -0.1)];
    let sheet = sheet(DVec3::new(0.1, 0.0, 0.0), leaning, [12, 10], 0.2, |c, r| {
        [0.9 - 0.04 * c as f32, 0.3 + 0.06 * r as f32, 0.2]
    });
    let mut scene = scene(&sheet);
    // This weight is far above the true one, so that the splats cover at most a third of every pixel.
    scene.objects[0].material.interior_weight = Some(20.0);
    scene.objects.push(mesh_object(quad(DVec3::ZERO, [DVec3::new(1.0, 0.1, -0.1), DVec3::new(0.0, 0.8, 0.1)], 1.0)));
    Case::new("splats-faded-over-mesh", scene, camera(2.6, 45.0, [64, 56])).with("edl", |s| s.shader = Shader::Edl)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the colour of the built-in matcap at (x, y), both from −1 to 1, by the formula of the rendering model
    /// (§5). The scene `three-materials/matcap` is drawn with this matcap.
    fn clay([x, y]: [f64; 2]) -> [f64; 3] {
        let outside = x.hypot(y).max(1.0);
        let n = DVec3::new(x / outside, y / outside, (1.0 - (x * x + y * y) / (outside * outside)).max(0.0).sqrt());
        let key = ((n.dot(DVec3::new(-0.48, -0.6, 0.64)) + 0.25) / 1.25).max(0.0);
        let fill = n.dot(DVec3::new(0.64, 0.6, 0.48)).max(0.0);
        let gleam = n.dot(DVec3::new(-0.265, -0.331, 0.906)).max(0.0).powi(48);
        let shares = [[0.05, 0.74, 0.1], [0.05, 0.69, 0.13], [0.06, 0.61, 0.19]];
        shares.map(|[base, warm, cool]| base + warm * key + cool * fill + 0.16 * gleam)
    }

    #[test]
    fn matcap_built_in_follows_its_formula() {
        let matcap = Matcap::builtin();
        assert_eq!(matcap.size(), [256, 256]);
        for (i, texel) in matcap.texels().iter().enumerate() {
            let at = |k: usize| 2.0 * k as f64 / 255.0 - 1.0;
            let formula = clay([at(i % 256), at(i / 256)]);
            for (got, want) in texel.iter().zip(formula) {
                assert!((f64::from(*got) - want).abs() < 1e-7, "texel {i}: {texel:?}, not {formula:?}");
            }
        }
    }
}
