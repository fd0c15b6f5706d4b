//! Trade-offs of trained Gaussians: sort order, filter, and drawing them as surfaces instead.

use glam::{DQuat, DVec3};
use surfel_math::gaussian::SH_C0;
use surfel_math::srgb;
use surfel_model::{CloudData, Column3, Filter, GaussianCloud, GaussianData, GaussianKind, OnInvalid, Shape, Sort};
use surfel_model::{Scene, Settings, SplatCloud};

use super::figures::Figures;
use super::measure::{self, Backends};
use super::subjects::{self, IdealImage, Subject};
use super::variants::{DEFAULT, Variant};
use crate::{Failure, clouds};

/// Number of Gaussians in each of the three shells.
const SPLATS: usize = 12_000;

/// Measures every sort order and filter of Gaussians. The first variant is the default.
pub(crate) fn all(
    size: u32,
    quick: bool,
    backends: &mut Backends,
    runs: usize,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let cloud = shells()?;
    let surfaces = Scene::from(ellipses(&cloud)?);
    let scene = Scene::from(cloud);
    let samples = if quick { 4 } else { 8 };
    let settings = Settings::default();
    let (by_pixel, principal) = (settings.with_sort(Sort::Pixel), settings.with_gaussian_filter(Filter::Principal));
    let both = by_pixel.with_gaussian_filter(Filter::Principal);
    let truth = subject(&scene, both, size, samples);
    let level = |knob, value: &str, scene: &Scene, settings| {
        (Variant::of_scene(knob, value.to_owned()), subject(scene, settings, size, samples))
    };
    let levels = [
        level(DEFAULT, DEFAULT, &scene, settings),
        level("sort", "pixel", &scene, by_pixel),
        level("Gaussian filter", "principal", &scene, principal),
        level("composite", "surface", &surfaces, settings),
        level("sort and filter", "pixel, principal", &scene, both),
    ];
    measure::details(&truth, &levels, backends, runs, figures)
}

fn subject(scene: &Scene, settings: Settings, size: u32, samples: u32) -> Subject {
    Subject {
        name: "Gaussians",
        about: "three shells of flat Gaussians of 0.2 to 6 px that stand on end, a third of them nearly opaque",
        scene: scene.clone(),
        camera: subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size),
        settings,
        truth: IdealImage::Samples(samples),
        clips: false,
        transparent: false,
        is_generated: true,
    }
}

/// Returns three shells of Gaussians. Each Gaussian is tilted against its shell by up to 90°, so that Gaussians
/// intersect.
fn shells() -> Result<GaussianCloud, Failure> {
    let ball = clouds::ball(SPLATS)?;
    let mut numbers = clouds::Random(1);
    let mut random = move || numbers.next();
    let (mut centers, mut sigmas, mut rotations) = (Vec::new(), Vec::new(), Vec::new());
    let (mut opacities, mut harmonics) = (Vec::new(), Vec::new());
    for (shell, scale) in [1.0, 0.85, 0.7].into_iter().enumerate() {
        for i in 0..ball.len() {
            centers.push(ball.center(i) * scale);
            // Sizes are between 1/5 and 6 times the median, with more small than large ones.
            let sigma = 0.5 * ball.radius_max(i) * scale * 30f64.powf(random()) / 5.0;
            sigmas.push([sigma as f32, (sigma * (0.2 + 0.8 * random())) as f32, 0.0]);
            let tilt = DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5) * 2.0;
            let normal = (ball.normal(i).normalize() + tilt).normalize_or(DVec3::Z);
            rotations.push(DQuat::from_rotation_arc(DVec3::Z, normal).as_quat().to_array());
            opacities.push([0.95, 0.5, 0.2][(3.0 * random()) as usize % 3]);
            let hue = random();
            let color = [0.2 + 0.7 * hue, 0.3 + 0.3 * shell as f64, 0.9 - 0.7 * hue];
            harmonics.push(color.map(|c| ((c - 0.5) / SH_C0) as f32));
        }
    }
    let data = GaussianData {
        origin: DVec3::ZERO,
        centers: Column3::from_f64(&centers),
        kind: GaussianKind::Flat,
        sigmas,
        rotations,
        opacities,
        degree: 0,
        harmonics,
        linear_colors: false,
        up: None,
    };
    Ok(GaussianCloud::new(data, OnInvalid::Refuse)?.0)
}

/// Returns the splats of `--composite surface`: opaque ellipses with half-axes of two standard deviations. Gaussians
/// with an opacity below [`GaussianCloud::FAINT`] are left out.
fn ellipses(gaussians: &GaussianCloud) -> Result<SplatCloud, Failure> {
    let kept: Vec<usize> =
        (0..gaussians.len()).filter(|&i| gaussians.data().opacities[i] >= GaussianCloud::FAINT).collect();
    let (s, t): (Vec<_>, Vec<_>) = kept.iter().map(|&i| gaussians.ellipse(i)).unzip();
    let column = |v: &[DVec3]| Column3::from_f32(v.iter().map(|v| v.as_vec3()).collect());
    let centers: Vec<DVec3> = kept.iter().map(|&i| gaussians.center(i)).collect();
    let color = |&i: &usize| gaussians.coefficients(i)[0].map(|c| srgb::decode(0.5 + SH_C0 * f64::from(c)) as f32);
    let shape = Shape::Ellipses { s: column(&s), t: column(&t) };
    let data = CloudData {
        colors: Some(kept.iter().map(color).collect()),
        ..CloudData::new(DVec3::ZERO, Column3::from_f64(&centers), shape)
    };
    let mut cloud = SplatCloud::new(data, OnInvalid::Refuse)?.0;
    if let Some(weight) = surfel_sample::interior_weight(&cloud) {
        cloud.set_interior_weight(weight);
    }
    Ok(cloud)
}
