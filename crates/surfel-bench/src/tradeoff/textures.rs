//! Cost and benefit of fitting splats to a texture (`--texture`).

use std::sync::Arc;
use std::time::Instant;

use crate::page::Table;
use glam::Vec3;
use surfel_metrics::{CompareOptions, Image, compare};
use surfel_model::Camera;
use surfel_model::{Geometry, Mesh, Shader, TextureSampling};
use surfel_sample::NoProgress;
use surfel_sample::{MeshMethod, MeshOptions, fit_to_mesh, splats_from_mesh};

use super::measure::{Backends, draw_single};
use super::subjects;
use crate::{Failure, clouds};

/// Number of splats of the ball.
const SPLATS: usize = 40_000;
/// Factor by which the image of polygons is larger than the ideal image along each side, before its pixels are
/// averaged.
const SAMPLES: u32 = 4;

/// Colour as a function of the position on the ball.
type Paint = fn(Vec3) -> [f32; 3];

/// Names and functions of the painted textures.
const PAINTS: [(&str, Paint); 3] = [("smooth", smooth), ("as in a photo", fractal), ("black and white", squares)];

fn smooth(p: Vec3) -> [f32; 3] {
    (Vec3::splat(0.5) + 0.3 * (60.0 * p).map(f32::sin)).to_array()
}

/// Returns a sum of waves whose heights decrease with their frequencies, as in photographs.
fn fractal(p: Vec3) -> [f32; 3] {
    let wave = |octave: i32| {
        let frequency = 4.0 * 1.7f32.powi(octave);
        let turned = Vec3::new(p.x + 0.7 * p.y, p.y - 0.6 * p.z, p.z + 0.8 * p.x);
        (frequency * turned + Vec3::splat(octave as f32)).map(f32::sin) / 1.7f32.powi(octave)
    };
    let sum: Vec3 = (0..8).map(wave).sum();
    (Vec3::splat(0.5) + 0.15 * sum).clamp(Vec3::ZERO, Vec3::ONE).to_array()
}

fn squares(p: Vec3) -> [f32; 3] {
    let index = (p * 14.0).floor();
    [((index.x + index.y + index.z) as i32).rem_euclid(2) as f32; 3]
}

/// Measures every way to sample a texture's colours, on each kind of texture.
pub(crate) fn table(backends: &mut Backends, size: u32) -> Result<Table, Failure> {
    let head = ["texture", "splats take it by", "ms", "of them to fit", "RMSE close", "FLIP close", "RMSE whole"];
    let mut table = Table::new(&head);
    let close = subjects::camera([0.2, 0.4, 1.9], [0.1, 0.1, 0.0], 12.0, size);
    let whole = subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size);
    for (name, paint) in PAINTS {
        let mut mesh = clouds::bumpy_mesh(360);
        let positions = (0..mesh.positions.len()).map(|i| mesh.positions.get(i).as_vec3());
        mesh.colors = Some(positions.map(paint).collect());
        let truths = [&close, &whole].map(|camera| truth(backends, &mesh, camera));
        let [close_truth, whole_truth] = truths;
        let (close_truth, whole_truth) = (close_truth?, whole_truth?);
        for sampling in TextureSampling::ALL {
            let start = Instant::now();
            let options = MeshOptions::new(MeshMethod::Count(SPLATS));
            let (cloud, _) = splats_from_mesh(&mesh, &options, &NoProgress)?;
            let made = start.elapsed();
            let (cloud, _) = fit_to_mesh(cloud, &mesh, sampling, &NoProgress)?;
            let all = start.elapsed();
            let geometry = Geometry::from(cloud);
            let [rmse, flip] =
                errors(&draw_single(backends, &geometry, &close, Shader::Unlit, 0)?.0, &close_truth, size)?;
            let [far, _] = errors(&draw_single(backends, &geometry, &whole, Shader::Unlit, 0)?.0, &whole_truth, size)?;
            table.rows.push(vec![
                name.to_owned(),
                sampling.name().to_owned(),
                format!("{:.0}", all.as_secs_f64() * 1e3),
                format!("{:.0}", (all - made).as_secs_f64() * 1e3),
                format!("{rmse:.4}"),
                format!("{flip:.4}"),
                format!("{far:.4}"),
            ]);
        }
    }
    Ok(table)
}

/// Draws the polygons, averaged over each pixel, as the ideal image.
fn truth(backends: &mut Backends, mesh: &Mesh, camera: &Camera) -> Result<Vec<[f32; 4]>, Failure> {
    let [width, height] = camera.size;
    let fine = Camera { size: [width * SAMPLES, height * SAMPLES], ..camera.clone() };
    let fine = draw_single(backends, &Geometry::Mesh(Arc::new(mesh.clone())), &fine, Shader::Unlit, 0)?.0;
    let pixel = |i: u32| {
        let mut sum = [0.0; 4];
        for k in 0..SAMPLES * SAMPLES {
            let (x, y) = (i % width * SAMPLES + k % SAMPLES, i / width * SAMPLES + k / SAMPLES);
            let sample = fine[(y * width * SAMPLES + x) as usize];
            sum.iter_mut().zip(sample).for_each(|(s, c)| *s += c / (SAMPLES * SAMPLES) as f32);
        }
        sum
    };
    Ok((0..width * height).map(pixel).collect())
}

/// Returns the RMSE and the mean FLIP of an image against the ideal image.
pub(super) fn errors(image: &[[f32; 4]], truth: &[[f32; 4]], size: u32) -> Result<[f64; 2], Failure> {
    let of = |pixels| Image::new(size, size, pixels);
    let found = compare(&of(truth.as_flattened())?, &of(image.as_flattened())?, &CompareOptions::default())?;
    Ok([found.rmse, found.flip_mean.unwrap_or(f64::NAN)])
}
