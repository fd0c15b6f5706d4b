//! Tests of presets' promises in every scene: each backend's fidelity, and the model error.

use crate::validated_gpu;
use glam::Vec3;
use std::sync::OnceLock;
use surfel_conformance::harness::{Truth, render};
use surfel_conformance::scenes::{self, Case};
use surfel_metrics::{CompareOptions, Image, compare};
use surfel_model::{Accumulate, EdgeAa, Geometry, Scene};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Preset, Renderer, SceneSummary, inside_surfaces};

/// Returns the PSNR of linear premultiplied colour in dB, over the pixels that the mask selects.
fn psnr(want: &Frame, got: &Frame, mask: Option<&[bool]>) -> f64 {
    let a = Image::new(want.width(), want.height(), want.color().as_flattened()).unwrap();
    let b = Image::new(got.width(), got.height(), got.color().as_flattened()).unwrap();
    compare(&a, &b, &CompareOptions { mask, flip: None, ..CompareOptions::default() }).unwrap().psnr
}

/// Returns the scene with an interior weight for every cloud, so that edges can be antialiased.
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

/// The least PSNR over scenes, and its scene.
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

/// Returns every variant of every scene that a preset draws differently, after the preset's settings are applied.
fn cases(preset: Preset) -> Vec<Case> {
    let mut cases: Vec<Case> = Vec::new();
    for case in scenes::all() {
        // Variants with the same settings may be of another scene or view, and are cheap.
        let scene = |case: &Case| case.name.split('/').next().unwrap_or_default().to_owned();
        let camera = case.camera.clone();
        let case = at(&case, preset);
        let is_known = |other: &Case| {
            scene(other) == scene(&case)
                && other.settings == case.settings
                && (&other.camera, other.region) == (&camera, case.region)
        };
        if !cases.iter().any(is_known) {
            cases.push(case);
        }
    }
    cases
}

/// Returns the root mean square differences of depths (relative) and normals (degrees) of two images, over pixels that
/// the mask selects and both images cover.
fn geometry_errors(want: &Frame, got: &Frame, mask: &[bool]) -> [f64; 2] {
    let root_mean = |squares: Vec<f64>| (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    let counts = |i: &usize| mask[*i] && want.depth()[*i].is_finite() && got.depth()[*i].is_finite();
    let depth = |i: usize| (f64::from(got.depth()[i] - want.depth()[i]) / f64::from(want.depth()[i])).powi(2);
    let normal = |i: usize| {
        let [a, b] = [want.normal()[i], got.normal()[i]].map(|n| Vec3::from(n).as_dvec3());
        a.cross(b).length().atan2(a.dot(b)).to_degrees().powi(2)
    };
    let all = || (0..mask.len()).filter(counts);
    [root_mean(all().map(depth).collect()), root_mean(all().map(normal).collect())]
}

/// Step between the drawn cases in tests without `--full`.
const QUICK: usize = 3;

/// Returns the reference's images of every `step`-th case of a preset, drawn once per process. With samples, a frame
/// costs a software driver seventeen frames, and its memory grows with each: for GPUs, seven of eight cases have none.
fn truths(preset: Preset, of_gpus: bool, step: usize) -> &'static [Truth] {
    static TRUTHS: [[[OnceLock<Vec<Truth>>; QUICK]; 2]; Preset::ALL.len()] =
        [const { [const { [const { OnceLock::new() }; QUICK] }; 2] }; Preset::ALL.len()];
    let index = Preset::ALL.into_iter().position(|other| other == preset).unwrap();
    TRUTHS[index][usize::from(of_gpus)][step - 1].get_or_init(|| {
        let mut reference = Reference::new(Default::default()).unwrap();
        let mut truth = |(i, mut case): (usize, Case)| {
            if of_gpus && i % 8 > 0 {
                case.settings.edge_aa = EdgeAa::Off;
            }
            Truth::of(&mut reference, case)
        };
        cases(preset).into_iter().step_by(step).enumerate().map(&mut truth).collect()
    })
}

/// Checks a backend's fidelity in every `step`-th case, and prints the results.
fn hold_fidelity(backend: &mut impl Renderer, step: usize) {
    let capabilities = backend.info().capabilities;
    let mut failed = Vec::new();
    for preset in Preset::ALL {
        // The same settings, so the same images.
        if preset == Preset::Reference {
            continue;
        }
        let promise = preset.promise();
        let (mut least, mut depth, mut normal) = (Least::none(), Least::none(), Least::none());
        let mut drawn = 0;
        for Truth { case, want } in truths(preset, backend.info().backend != "cpu", step) {
            // Sums in half precision are only drawn on request, and by no preset.
            if !case.is_drawn_by(&capabilities) || case.settings.accumulate == Accumulate::F16 {
                continue;
            }
            let want = want.as_ref().unwrap();
            let got = render(backend, case, Planes::ALL).unwrap();
            let mask: Vec<bool> = want.margin().iter().map(|&m| m == 0.0).collect();
            let db = psnr(want, &got, Some(&mask));
            least.add(db, &case.name);
            let errors = geometry_errors(want, &got, &mask);
            // Negative logarithms, so that the least is the worst here too.
            depth.add(-errors[0].log10(), &case.name);
            normal.add(-errors[1].log10(), &case.name);
            drawn += 1;
            let is_kept = db >= promise.fidelity_db
                && errors[0] <= promise.fidelity_depth
                && errors[1] <= promise.fidelity_normal_deg;
            if !is_kept {
                let [depth, normal] = errors;
                failed.push(format!("{db:.1} dB, depth {depth:.1e}, normals {normal:.1e} degrees: {}", case.name));
            }
        }
        println!(
            "{} on {}: {drawn} images, fidelity {:.1} dB ({}), depth {:.1e} ({}), normals {:.1e} degrees ({})",
            preset.name(),
            backend.info().backend,
            least.db,
            least.scene,
            10f64.powf(-depth.db),
            depth.scene,
            10f64.powf(-normal.db),
            normal.scene
        );
        assert!(drawn * step > 60, "{drawn} images");
    }
    assert!(failed.is_empty(), "promises broken: {failed:#?}");
}

#[test]
fn preset_fidelity_holds_on_cpu() {
    hold_fidelity(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), QUICK);
}

#[test]
#[ignore = "80 s: cargo xtask test --full"]
fn preset_fidelity_holds_on_cpu_in_every_case() {
    hold_fidelity(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), 1);
}

#[test]
#[ignore = "78 s on lavapipe with two cores: cargo xtask test --full"]
fn preset_fidelity_holds_on_wgpu() {
    // `gpu_backends` compares every scene's image with that of ash.
    if let Some(mut renderer) = validated_gpu::wgpu() {
        hold_fidelity(&mut renderer, QUICK);
        validated_gpu::no_messages();
    }
}

#[test]
#[ignore = "96 s on lavapipe with two cores: cargo xtask test --full"]
fn preset_fidelity_holds_on_ash() {
    if let Some(mut renderer) = validated_gpu::ash() {
        hold_fidelity(&mut renderer, 1);
    }
}

#[test]
fn preset_model_errors_hold() {
    hold_model_errors(QUICK);
}

#[test]
#[ignore = "108 s: cargo xtask test --full"]
fn preset_model_errors_hold_in_every_case() {
    hold_model_errors(1);
}

/// Checks the presets' model errors in every `step`-th case, and prints the results.
fn hold_model_errors(step: usize) {
    let mut failed = Vec::new();
    let best = truths(Preset::Reference, false, step);
    for preset in Preset::ALL {
        let (mut model, mut inside) = (Least::none(), Least::none());
        let (mut images, mut surfaces) = (0, 0);
        let promise = preset.promise();
        let truths = truths(preset, false, step);
        // All presets set the same settings, so that the same variants remain.
        assert_eq!(truths.len(), best.len());
        for (Truth { case, want }, Truth { want: best, .. }) in truths.iter().zip(best) {
            let (best, want) = (best.as_ref().unwrap(), want.as_ref().unwrap());
            let mut hold = |least: &mut Least, what: &str, db: f64, promised: f64| {
                least.add(db, &case.name);
                if db < promised {
                    failed.push(format!("{}, {what}: {db:.1} dB, {}", preset.name(), case.name));
                }
            };
            hold(&mut model, "whole", psnr(best, want, None), promise.model_db);
            if let Some(mask) = inside_surfaces(best).filter(|_| !SceneSummary::of(&case.scene).transparent) {
                hold(&mut inside, "inside", psnr(best, want, Some(&mask)), promise.inside_db);
                surfaces += 1;
            }
            images += 1;
        }
        println!(
            "{}: {images} images, {surfaces} of surfaces; model {:.1} dB ({}), inside {:.1} dB ({})",
            preset.name(),
            model.db,
            model.scene,
            inside.db,
            inside.scene
        );
        assert!(surfaces * step > 30 && images * step > 60, "{surfaces} of {images} images have surfaces");
    }
    assert!(failed.is_empty(), "promises broken: {failed:#?}");
}

#[test]
fn preset_settings_are_told_from_others() {
    for preset in Preset::ALL {
        let found = Preset::of(&preset.apply(surfel_model::Settings::default())).unwrap();
        assert_eq!(found.apply(surfel_model::Settings::default()), preset.apply(surfel_model::Settings::default()));
    }
    let own = surfel_model::Settings::default().with_cutoff(2.5);
    assert_eq!(Preset::of(&own), None);
    // Sums in half precision break the promises.
    let half = surfel_model::Settings::default().with_accumulate(Accumulate::F16);
    assert_eq!(Preset::of(&half), None);
}
