//! Scenes of transparent splats: layers behind, in front of and through opaque surfaces.

use super::Case;
use crate::build::{Splat, camera, cloud, object, scene, sheet, sphere, with_alpha};
use crate::random::Random;
use glam::DVec3;
use surfel_model::{EdgeAa, Filter, Light, Object, Shader, Transparency};

pub(super) fn transparency_cases() -> Vec<Case> {
    let peel = |layers, drop_last| Transparency::Peel { layers, drop_last };
    let (panes, spheres) = (panes(), glass_spheres());
    vec![
        panes.with("peel-1", |s| s.transparency = peel(1, false)),
        panes.with("peel-3", |s| s.transparency = peel(3, false)),
        panes.with("peel-3-drop", |s| s.transparency = peel(3, true)),
        panes.with("peel-9", |s| s.transparency = peel(9, false)),
        panes.with("abuffer-4", |s| s.transparency = Transparency::ABuffer { layers: 4 }),
        panes.with("peel-4-edge-aa", |s| (s.transparency, s.edge_aa) = (peel(4, false), EdgeAa::Coverage)),
        spheres.with("peel-3", |s| s.transparency = peel(3, false)),
        spheres.with("abuffer-6", |s| s.transparency = Transparency::ABuffer { layers: 6 }),
        pane_through_sphere().with("peel-2", |s| s.transparency = peel(2, false)),
        pane_through_sphere().with("normal", |s| (s.transparency, s.shader) = (peel(2, false), Shader::Normal)),
        fading_pane(),
        glass_beyond_its_filter(),
        faint_dust(),
        faint_dust().with("clamp", |s| s.filter = Filter::Clamp),
        faint_dust().with("adjust", |s| s.filter = Filter::Adjust),
    ]
}

fn two_lights() -> Option<Vec<Light>> {
    Some(vec![
        Light::Directional { direction: [1.0, -0.5, -1.0], color: [0.7, 0.6, 0.5], shadow: false },
        Light::Point { position: [2.0, 2.0, 1.0], color: [0.2, 0.3, 0.6] },
    ])
}

/// Creates an object whose splats all have the same alpha.
fn glass(splats: &[Splat], alpha: f32) -> Object {
    let mut object = object(with_alpha(cloud(splats), |_| alpha));
    object.material.interior_weight = Some(3.0);
    object
}

/// Returns five tilted panes of different alpha, in front of, through and behind an opaque sphere. Catches layers that
/// are counted or limited wrongly, a last layer that is blended like the others, and hidden layers that are visible.
pub fn panes() -> Case {
    let mut random = Random::new(73);
    let mut scene = scene(&sphere(500, 1.2, 79));
    scene.objects[0].material.interior_weight = Some(3.0);
    for (i, alpha) in [0.3, 0.6, 0.45, 0.2, 0.8].into_iter().enumerate() {
        let k = i as f64;
        let axes = [DVec3::new(1.1, 0.0, 0.25 - 0.1 * k), DVec3::new(0.0, 1.0, 0.1 * k - 0.2)];
        let center = DVec3::new(0.15 * k - 0.3, 0.1 * k - 0.2, 1.5 - 0.8 * k);
        let color = random.color();
        scene.objects.push(glass(&sheet(center, axes, [14, 14], 0.13, |_, _| color), alpha));
    }
    scene.lights = two_lights();
    Case::new("panes", scene, camera(4.5, 40.0, [64, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns 27 transparent spheres (G06's figure 6), whose many curved layers cross in the image.
pub fn glass_spheres() -> Case {
    let mut random = Random::new(83);
    let mut scene = scene(&[]);
    scene.objects.clear();
    for i in 0..27 {
        let place = DVec3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)) - 1.0;
        let color = random.color();
        let splats: Vec<Splat> = sphere(160, 1.25, 0)
            .iter()
            .map(|s| Splat { p: s.p * 0.4 + place, s: s.s * 0.4, t: s.t * 0.4, color })
            .collect();
        scene.objects.push(glass(&splats, 0.35));
    }
    scene.lights = two_lights();
    let mut camera = camera(5.0, 40.0, [72, 72]);
    camera.eye = [2.0, 1.4, 4.5];
    Case::new("glass-spheres", scene, camera).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a pane that intersects an opaque sphere. Catches errors where occlusion changes within a splat.
pub fn pane_through_sphere() -> Case {
    let mut scene = scene(&sphere(900, 1.2, 89));
    let axes = [DVec3::new(1.3, 0.0, 0.9), DVec3::new(0.0, 1.2, 0.2)];
    scene.objects.push(glass(&sheet(DVec3::ZERO, axes, [20, 20], 0.14, |_, _| [0.2, 0.9, 0.4]), 0.5));
    Case::new("pane-through-sphere", scene, camera(4.0, 40.0, [56, 56]))
}

/// Returns a pane whose alpha runs from 0 to 1; splats with alpha 1 are opaque. Catches averaged alpha, and errors with
/// transparent and opaque splats in one cloud.
pub fn fading_pane() -> Case {
    let axes = [DVec3::X * 1.2, DVec3::Y];
    let wall = sheet(DVec3::new(0.0, 0.0, -0.5), axes, [16, 16], 0.15, |c, _| [0.9, 0.1 + 0.05 * c as f32, 0.2]);
    let pane = sheet(DVec3::ZERO, axes, [17, 16], 0.14, |_, r| [0.1, 0.3, 0.2 + 0.04 * r as f32]);
    let mut scene = scene(&wall);
    scene.objects.push(object(with_alpha(cloud(&pane), |i| (i % 17) as f32 / 16.0)));
    Case::new("fading-pane", scene, camera(3.0, 45.0, [56, 48])).with("peel-3", |s| {
        s.transparency = Transparency::Peel { layers: 3, drop_last: false };
    })
}

/// Returns large tilted disks of glass. On the screen, they are wider than their affine filter. Pixels that are only in
/// the unfiltered footprint begin surfaces of the A-buffer and set their thresholds, but add nothing to them.
pub fn glass_beyond_its_filter() -> Case {
    let mut random = Random::new(113);
    let disks: Vec<Splat> = (0..48)
        .map(|_| {
            let p = DVec3::new(random.range(-1.0, 1.0), random.range(-0.8, 0.8), random.range(-0.6, 0.8));
            let (sin, cos) = random.range(0.0, std::f64::consts::TAU).sin_cos();
            let n = DVec3::new(cos, sin, random.range(0.25, 0.6));
            Splat::disk(p, n, random.range(0.5, 0.9), random.color())
        })
        .collect();
    let mut scene = scene(&[]);
    scene.objects = vec![object(with_alpha(cloud(&disks), |i| 0.25 + 0.1 * (i % 6) as f32))];
    scene.objects[0].material.interior_weight = Some(1.5);
    Case::new("glass-beyond-its-filter", scene, camera(2.6, 60.0, [56, 48])).with("ewa/abuffer", |s| {
        (s.filter, s.transparency) = (Filter::Ewa, Transparency::ABuffer { layers: 8 });
    })
}

/// Returns sheets of splats with little alpha, smaller than pixels, one behind the other. Their A-buffer has little
/// alpha and coverage. Catches loss of low bits.
pub fn faint_dust() -> Case {
    let mut random = Random::new(97);
    let mut scene = scene(&[]);
    scene.objects.clear();
    for i in 0..12 {
        // The centre is off the axis, so that no outline passes through the centres of a whole row of pixels.
        let center = DVec3::new(0.013, 0.007, 1.5 - 0.25 * f64::from(i));
        let color = random.color();
        let axes = [DVec3::X * 0.5, DVec3::Y * 0.5];
        let mut dust = glass(&sheet(center, axes, [24, 24], 0.012, |_, _| color), 2e-3 + 1e-3 * (i % 4) as f32);
        dust.material.interior_weight = Some(0.8);
        scene.objects.push(dust);
    }
    scene.background = [0.0; 4];
    Case::new("faint-dust", scene, camera(5.0, 24.0, [24, 24]))
        .with("abuffer", |s| s.transparency = Transparency::ABuffer { layers: 64 })
}
