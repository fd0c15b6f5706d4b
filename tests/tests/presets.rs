//! What presets promise: on every scene the processor backend's fidelity, and the model error.

use surfel_conformance::harness::{reference_frame, render};
use surfel_conformance::scenes::{self, Case};
use surfel_metrics::{CompareOptions, Image, compare};
use surfel_model::{Geometry, Scene};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Preset, Renderer, SceneSummary, inside_surfaces};

/// PSNR of linear premultiplied colour, dB; of the pixels that the mask lets through.
fn psnr(want: &Frame, got: &Frame, mask: Option<&[bool]>) -> f64 {
    let a = Image::new(want.width, want.height, want.color.as_flattened()).unwrap();
    let b = Image::new(got.width, got.height, got.color.as_flattened()).unwrap();
    compare(&a, &b, &CompareOptions { mask, flip: None, ..CompareOptions::default() }).unwrap().psnr
}

/// The scene with an interior weight for every cloud, so that edges can be antialiased.
fn weighed(mut scene: Scene) -> Scene {
    for object in &mut scene.objects {
        if let Geometry::Splats(cloud) = &object.geometry
            && object.material.interior_weight.or(cloud.data().interior_weight).is_none()
        {
            object.material.interior_weight = Some(surfel_sample::interior_weight(cloud).unwrap_or(1.0));
        }
    }
    scene
}

fn at(case: &Case, preset: Preset) -> Case {
    let mut case = case.with(preset.name(), |settings| *settings = preset.apply(*settings));
    case.scene = weighed(case.scene);
    case
}

/// Least PSNR over scenes, and where.
struct Least {
    db: f64,
    scene: String,
}

impl Least {
    fn none() -> Self {
        Self { db: f64::INFINITY, scene: "-".into() }
    }

    fn add(&mut self, db: f64, scene: &str) {
        if db < self.db {
            *self = Self { db, scene: scene.into() };
        }
    }
}

#[test]
fn preset_promises_hold_on_every_scene() {
    let mut reference = Reference::new(0).unwrap();
    let mut cpu = surfel_cpu::Renderer::new(0).unwrap();
    let capabilities = cpu.info().capabilities;
    // Presets set what the variants of a scene set: its first one stands for all of them.
    let mut seen = Vec::new();
    let mut cases = scenes::all();
    cases.retain(|case| {
        let scene = case.name.split('/').next().unwrap_or_default().to_owned();
        let first = !seen.contains(&scene);
        seen.push(scene);
        first
    });
    assert!(cases.len() > 20, "{}", cases.len());
    let mut failed = Vec::new();
    for preset in Preset::ALL {
        let (mut fidelity, mut model, mut inside) = (Least::none(), Least::none(), Least::none());
        let mut surfaces = 0;
        for case in &cases {
            let best = reference_frame(&mut reference, &at(case, Preset::Reference)).unwrap();
            let case = at(case, preset);
            let want = reference_frame(&mut reference, &case).unwrap();
            model.add(psnr(&best, &want, None), &case.name);
            if let Some(mask) = inside_surfaces(&best).filter(|_| !SceneSummary::of(&case.scene).transparent) {
                inside.add(psnr(&best, &want, Some(&mask)), &case.name);
                surfaces += 1;
            }
            if case.is_drawn_by(&capabilities) {
                let mask: Vec<bool> = want.margin.iter().map(|&m| m == 0.0).collect();
                fidelity.add(psnr(&want, &render(&mut cpu, &case, Planes::COLOR).unwrap(), Some(&mask)), &case.name);
            }
        }
        println!(
            "{}: fidelity {:.1} dB ({}), model {:.1} dB ({}), inside {:.1} dB ({})",
            preset.name(),
            fidelity.db,
            fidelity.scene,
            model.db,
            model.scene,
            inside.db,
            inside.scene
        );
        assert!(surfaces > 15, "{surfaces} scenes have surfaces");
        let promise = preset.promise();
        let kept = fidelity.db >= promise.fidelity_db && model.db >= promise.model_db && inside.db >= promise.inside_db;
        if !kept {
            failed.push(preset.name());
        }
    }
    assert!(failed.is_empty(), "promises broken: {failed:?}");
}

#[test]
fn preset_settings_are_told_from_others() {
    for preset in Preset::ALL {
        let found = Preset::of(&preset.apply(surfel_model::Settings::default())).unwrap();
        assert_eq!(found.apply(surfel_model::Settings::default()), preset.apply(surfel_model::Settings::default()));
    }
    let own = surfel_model::Settings { cutoff: 2.5, ..surfel_model::Settings::default() };
    assert_eq!(Preset::of(&own), None);
}
