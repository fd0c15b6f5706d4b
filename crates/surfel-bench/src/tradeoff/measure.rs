//! Measurement of variants: draws every variant of every subject, times it, and measures its fidelity and its model
//! error.

use std::time::Instant;

use glam::{DAffine3, Vec3};
use surfel_backend::{Backend, BackendOptions, BackendScene};
use surfel_metrics::{CompareOptions, Image, MetricsError, compare};
use surfel_model::{Camera, Material, Scene, Settings};
use surfel_model::{Cull, Geometry, Object, Shader};
use surfel_render::{Frame, Planes, Preset, Renderer, Stats, View};

use super::figures::{Error, Figures, Row, SubjectFacts};
use super::subjects::{IdealImage, Subject};
use super::truth::Truth;
use super::variants::{self, Only, Variant};
use crate::Failure;
use crate::machine::busy_ms;

/// Backends of a measurement: the tested one, a second instance that stores splats in 16 bits, and the reference.
pub(crate) struct Backends {
    pub wide: Backend,
    pub narrow: Backend,
    pub reference: Backend,
    /// True if times are CPU times.
    pub on_cpu: bool,
}

impl Backends {
    pub(crate) fn start(name: &str, adapter: Option<String>) -> Result<Self, Failure> {
        let one_thread = BackendOptions::default().with_threads(1).with_adapter(adapter);
        let options = |quantised| one_thread.clone().with_quantised(quantised);
        let free = BackendOptions::default();
        Ok(Self {
            wide: Backend::by_name(name, &options(false))?,
            narrow: Backend::by_name(name, &options(true))?,
            reference: Backend::by_name("reference", &free)?,
            on_cpu: name == "cpu" || name == "reference",
        })
    }
}

/// Variant that is being measured.
struct Ready {
    variant: Variant,
    settings: Settings,
    /// Index of the variant's scene among the uploaded scenes.
    scene: usize,
    frame: Frame,
    stats: Stats,
    /// Reason why the backend can't draw the variant; `None` if it draws it.
    not_drawn: Option<String>,
    /// Time of each frame, in milliseconds.
    ms: Vec<f64>,
}

/// Draws a single geometry with back-face culling and without light. Returns the image, and the median time of `runs`
/// further frames in milliseconds, which is NaN if `runs` is 0.
pub(super) fn draw_single(
    backends: &mut Backends,
    geometry: &Geometry,
    camera: &Camera,
    shader: Shader,
    runs: usize,
) -> Result<(Vec<[f32; 4]>, f64), Failure> {
    let material = Material { cull: Cull::Back, ..Material::default() };
    let object = Object { geometry: geometry.clone(), world_from_object: DAffine3::IDENTITY, material };
    let scene = Scene { objects: vec![object], ..Scene::default() };
    let resident = backends.wide.upload(&scene)?;
    let settings = Settings::default().with_shader(shader);
    let image = backends.wide.render(&resident, camera, &settings)?.color().to_vec();
    let mut ms = Vec::new();
    for _ in 0..runs {
        let start = Instant::now();
        backends.wide.render(&resident, camera, &settings)?;
        ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok((image, crate::report::median(&ms)))
}

/// Numbers of frames and of variants that a measurement draws.
#[derive(Clone, Copy)]
pub(crate) struct Pace {
    /// Number of frames per variant; a time is the median of these.
    pub runs: usize,
    /// True to measure only some of the variants.
    pub quick: bool,
}

/// Draws a subject (a scene with its view) with each variant of the settings that applies to it. Appends one row of
/// times and errors per variant to `figures`, and the description of the subject.
pub(crate) fn subject(
    subject: &Subject,
    backends: &mut Backends,
    Pace { runs, quick }: Pace,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let view = View::new(&subject.camera)?;
    let on_cpu = backends.on_cpu;
    let applies = |variant: &Variant| match variant.only {
        Only::Everything => true,
        Only::Clips => subject.clips,
        Only::Transparent => subject.transparent,
        Only::Graphics => !on_cpu,
        Only::Lit => subject.settings.shader == Shader::Phong,
    };
    let exact = backends.reference.upload(&subject.scene)?;
    let scenes = [backends.wide.upload(&subject.scene)?, backends.narrow.upload(&subject.scene)?];
    let mut ready = Vec::new();
    for variant in variants::all(quick).into_iter().filter(applies) {
        let scene = usize::from(variant.quantised);
        ready.push(first_image(backends, (&scenes, scene), &view, variant, &subject.settings));
    }
    time(backends, &scenes, &view, &mut ready, runs)?;
    let reference = &mut backends.reference;
    let truth = truth(subject, reference, &exact, &view)?;
    let best = image(reference, &exact, &view, &Preset::Reference.apply(subject.settings))?;
    // Variants with equal settings (other storage, some presets) share one image of the reference.
    let mut drawn: Vec<(Settings, Option<Frame>)> = Vec::new();
    for one in ready {
        let known = drawn.iter().position(|(settings, _)| *settings == one.settings);
        let at = known.unwrap_or(drawn.len());
        if known.is_none() {
            drawn.push((one.settings, image(reference, &exact, &view, &one.settings).ok()));
        }
        figures.rows.push(row(subject, &one, drawn[at].1.as_ref(), &truth, Some(&best), on_cpu)?);
    }
    figures.subjects.push(facts(subject, subject.truth.words()));
    Ok(())
}

/// Measures scenes that show one object at different levels of detail, and appends their rows. The first scene is the
/// default. The ideal image is that of `subject`, whose own scene isn't drawn.
pub(crate) fn details(
    subject: &Subject,
    levels: &[(Variant, Subject)],
    backends: &mut Backends,
    runs: usize,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let view = View::new(&subject.camera)?;
    let finest = backends.reference.upload(&subject.scene)?;
    let truth = truth(subject, &mut backends.reference, &finest, &view)?;
    let scenes = levels.iter().map(|(_, level)| backends.wide.upload(&level.scene)).collect::<Result<Vec<_>, _>>()?;
    let mut ready = Vec::new();
    for (at, (variant, level)) in levels.iter().enumerate() {
        ready.push(first_image(backends, (&scenes, at), &view, variant.clone(), &level.settings));
    }
    time(backends, &scenes, &view, &mut ready, runs)?;
    for ((_, level), one) in levels.iter().zip(&ready) {
        let exact = backends.reference.upload(&level.scene)?;
        let at_same = image(&mut backends.reference, &exact, &view, &one.settings)?;
        figures.rows.push(row(level, one, Some(&at_same), &truth, None, backends.on_cpu)?);
    }
    figures.subjects.push(facts(subject, subject.truth.words()));
    Ok(())
}

/// Draws the first image of a variant, with all planes. If the backend can't draw it, the result has the reason and no
/// frame.
fn first_image(
    backends: &mut Backends,
    (scenes, scene): (&[BackendScene], usize),
    view: &View,
    variant: Variant,
    settings: &Settings,
) -> Ready {
    let settings = variant.settings(settings);
    let frame = Frame::default();
    let mut one = Ready { variant, settings, scene, frame, stats: Stats::default(), not_drawn: None, ms: Vec::new() };
    match draw(backends, scenes, view, &mut one, Planes::ALL.with_fragments(true)) {
        Ok(stats) => one.stats = stats,
        Err(error) => one.not_drawn = Some(error.to_string()),
    }
    one
}

fn facts(subject: &Subject, truth: String) -> SubjectFacts {
    let (name, about) = (subject.name.to_owned(), subject.about.to_owned());
    SubjectFacts { name, about, truth, splats: splats(subject) }
}

fn splats(subject: &Subject) -> u64 {
    surfel_render::SceneSummary::of(&subject.scene).splats
}

fn draw(
    backends: &mut Backends,
    scenes: &[BackendScene],
    view: &View,
    one: &mut Ready,
    planes: Planes,
) -> Result<Stats, surfel_render::RenderError> {
    let backend = if one.variant.quantised { &mut backends.narrow } else { &mut backends.wide };
    backend.render_into(&scenes[one.scene], view, &one.settings, planes, &mut one.frame)
}

/// Times all variants in alternation, several times, so that disturbances of the machine affect all equally. Only
/// colours are drawn. Each variant is drawn twice and timed once, so that the cache contents of the previous variant
/// have no effect.
fn time(
    backends: &mut Backends,
    scenes: &[BackendScene],
    view: &View,
    ready: &mut [Ready],
    runs: usize,
) -> Result<(), Failure> {
    for _ in 0..runs {
        for one in ready.iter_mut().filter(|one| one.not_drawn.is_none()) {
            let kept = std::mem::take(&mut one.frame);
            draw(backends, scenes, view, one, Planes::COLOR)?;
            let (clock, busy) = (Instant::now(), busy_ms());
            draw(backends, scenes, view, one, Planes::COLOR)?;
            let elapsed = clock.elapsed().as_secs_f64() * 1e3;
            let busy = busy_ms().zip(busy).map(|(end, start)| end - start).filter(|_| backends.on_cpu);
            one.ms.push(busy.unwrap_or(elapsed));
            one.frame = kept;
        }
    }
    Ok(())
}

fn image(
    reference: &mut Backend,
    scene: &BackendScene,
    view: &View,
    settings: &Settings,
) -> Result<Frame, surfel_render::RenderError> {
    let mut frame = Frame::default();
    reference.render_into(scene, view, settings, Planes::ALL.with_margin(true), &mut frame)?;
    Ok(frame)
}

fn truth(subject: &Subject, reference: &mut Backend, exact: &BackendScene, view: &View) -> Result<Truth, Failure> {
    let mut frame = Frame::default();
    match &subject.truth {
        IdealImage::Surface(truth) => {
            return Ok(Truth {
                color: truth.color.clone(),
                depth: truth.depth.clone(),
                normal: truth.normal.clone(),
                mask: truth.mask.clone(),
            });
        }
        IdealImage::Samples(n) => {
            reference.render_sampled(exact, view, &subject.settings, Planes::ALL, Some(*n), &mut frame)?;
        }
        IdealImage::Drawn(settings) => {
            reference.render_into(exact, view, settings, Planes::ALL, &mut frame)?;
        }
    }
    let mask = vec![true; frame.color().len()];
    Ok(Truth { color: frame.color().to_vec(), depth: frame.depth().to_vec(), normal: frame.normal().to_vec(), mask })
}

fn row(
    subject: &Subject,
    one: &Ready,
    at_same: Option<&Frame>,
    truth: &Truth,
    best: Option<&Frame>,
    on_cpu: bool,
) -> Result<Row, Failure> {
    let drawn = one.not_drawn.is_none();
    let size = subject.camera.size;
    let shown = if drawn { Some(&one.frame) } else { at_same };
    let fidelity = at_same.filter(|_| drawn).map(|want| {
        let mask: Vec<bool> = want.margin().iter().map(|&m| m == 0.0).collect();
        error(one.frame.color(), want.color(), &mask)
    });
    // Images of different shaders can't be compared.
    let comparable = one.settings.shader == subject.settings.shader;
    let (mut model, mut model_flip, mut depth, mut normal) = (None, None, None, None);
    let mut model_inside = None;
    // Both images are drawn by the reference, so that fidelity has no effect.
    let best = best.zip(at_same).filter(|_| one.variant.preset().is_some());
    let from_best = best.map(|(best, same)| error(same.color(), best.color(), &vec![true; best.color().len()]));
    if let Some(frame) = shown.filter(|_| comparable) {
        model = Some(error(frame.color(), &truth.color, &truth.mask));
        let inside = truth.inside(size);
        // An opaque background covers every pixel, so there are no silhouettes.
        let has_rim = subject.scene.background[3] == 0.0 && inside.contains(&true);
        model_inside = has_rim.then(|| error(frame.color(), &truth.color, &inside));
        model_flip = Some(flip(size, frame.color(), truth)?);
        depth = relative_depth(frame.depth(), truth);
        normal = angle_deg(frame.normal(), truth);
    }
    let ms = median(&one.ms);
    let splats = splats(subject);
    Ok(Row {
        subject: subject.name.to_owned(),
        knob: one.variant.knob.to_owned(),
        value: one.variant.value.clone(),
        not_drawn: one.not_drawn.clone(),
        ms,
        splats_per_s: ms.map(|ms| splats as f64 / (ms * 1e-3)),
        bytes_per_splat: drawn.then_some(one.stats.bytes_per_splat),
        fragments: Some(one.stats.fragments).filter(|&n| n > 0 || (drawn && on_cpu)),
        fidelity,
        model,
        model_inside,
        model_flip,
        model_depth: depth,
        model_normal_deg: normal,
        from_reference_preset_db: from_best.and_then(|e| e.psnr_db),
    })
}

/// Returns the median; `None` without values. For an even number of values, it is the larger of the two middle ones.
pub(super) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}

/// Returns the difference between the colours of two images, in the pixels of the mask.
fn error(got: &[[f32; 4]], want: &[[f32; 4]], mask: &[bool]) -> Error {
    let (mut squares, mut worst) = (0.0, Vec::new());
    for ((got, want), _) in got.iter().zip(want).zip(mask).filter(|(_, counts)| **counts) {
        let mut most = 0.0f64;
        for (&a, &b) in got.iter().zip(want) {
            let difference = surfel_metrics::abs_difference(a, b);
            squares += difference * difference;
            most = most.max(difference);
        }
        worst.push(most);
    }
    worst.sort_by(f64::total_cmp);
    let last = worst.len().saturating_sub(1);
    let at = |share: f64| worst.get((share * last as f64).round() as usize).copied().unwrap_or(0.0);
    let rmse = (squares / (4.0 * worst.len().max(1) as f64)).sqrt();
    let psnr_db = (rmse > 0.0).then(|| -20.0 * rmse.log10());
    Error { max_abs: at(1.0), p999: at(0.999), rmse, psnr_db }
}

fn flip([width, height]: [u32; 2], got: &[[f32; 4]], truth: &Truth) -> Result<f64, MetricsError> {
    let a = Image::new(width, height, truth.color.as_flattened())?;
    let b = Image::new(width, height, got.as_flattened())?;
    let options = CompareOptions { mask: Some(&truth.mask), ..CompareOptions::default() };
    Ok(compare(&a, &b, &options)?.flip_mean.unwrap_or(f64::NAN))
}

pub(super) fn relative_depth(got: &[f32], truth: &Truth) -> Option<f64> {
    let both =
        got.iter().zip(&truth.depth).zip(&truth.mask).filter(|((a, b), m)| **m && a.is_finite() && b.is_finite());
    let squares = both.map(|((a, b), _)| f64::from((a - b) / b).powi(2));
    root_mean(squares)
}

pub(super) fn angle_deg(got: &[[f32; 3]], truth: &Truth) -> Option<f64> {
    let vectors = got.iter().zip(&truth.normal).zip(&truth.mask).filter(|(_, m)| **m);
    let angle = |(a, b): (&[f32; 3], &[f32; 3])| {
        let (a, b) = (Vec3::from(*a).as_dvec3(), Vec3::from(*b).as_dvec3());
        (a.length() > 0.5 && b.length() > 0.5).then(|| a.cross(b).length().atan2(a.dot(b)).to_degrees().powi(2))
    };
    root_mean(vectors.filter_map(|(pair, _)| angle(pair)))
}

fn root_mean(squares: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = squares.fold((0.0, 0u32), |(sum, count), square| (sum + square, count + 1));
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_counts_only_what_the_mask_lets_through() {
        let want = vec![[0.0f32; 4]; 1000];
        let mut got = want.clone();
        got[3][0] = 0.5;
        let all = error(&got, &want, &vec![true; 1000]);
        assert_eq!((all.max_abs, all.p999), (0.5, 0.0));
        assert!((all.rmse - (0.25f64 / 4000.0).sqrt()).abs() < 1e-12);
        let mut mask = vec![true; 1000];
        mask[3] = false;
        assert_eq!(error(&got, &want, &mask), Error { max_abs: 0.0, p999: 0.0, rmse: 0.0, psnr_db: None });
    }

    #[test]
    fn normals_are_compared_by_their_angle() {
        let truth = Truth {
            color: vec![],
            depth: vec![2.0, f32::INFINITY],
            normal: vec![[1.0, 0.0, 0.0], [0.0; 3]],
            mask: vec![true; 2],
        };
        let half = std::f32::consts::FRAC_1_SQRT_2;
        assert!((angle_deg(&[[half, half, 0.0], [1.0, 0.0, 0.0]], &truth).unwrap() - 45.0).abs() < 1e-4);
        assert_eq!(relative_depth(&[2.5, 1.0], &truth), Some(0.25));
    }
}
