//! Cost of making splats from points, and their accuracy, by the options `--max-points`, `--radius-scale` and
//! `--outliers`.

use std::time::Instant;

use crate::page::Table;
use surfel_model::SplatCloud;
use surfel_model::{Column3, Geometry, PointCloud, Shader};
use surfel_sample::NoProgress;
use surfel_sample::{PointOptions, outliers, splats_from_points};

use super::measure::{Backends, draw_single};
use super::{subjects, textures};
use crate::{Failure, clouds};

/// Number of points of the ball.
const POINTS: usize = 200_000;
/// Ratio of the number of all points to the number of outliers. Outliers are anywhere in a box around the ball.
const STRAY: usize = 500;
/// Standard deviation of the noise perpendicular to the surface, relative to the spacing of points.
const NOISE: f64 = 0.2;

/// Options of making splats from points that are measured together.
struct Row {
    option: &'static str,
    /// Fraction of the points from which splats are made, as `--max-points` selects them.
    share: f64,
    /// Factor by which the estimated radii are multiplied (`--radius-scale`).
    radius_scale: f64,
    /// True if outliers are dropped (`--outliers drop`).
    drops: bool,
}

/// Measured options, the default first.
const ROWS: [Row; 8] = [
    row("none", 1.0, 1.0, false),
    row("--outliers drop", 1.0, 1.0, true),
    row("--max-points, half of them", 0.5, 1.0, false),
    row("--max-points, a tenth", 0.1, 1.0, false),
    row("--max-points, a hundredth", 0.01, 1.0, false),
    row("--radius-scale 0.6", 1.0, 0.6, false),
    row("--radius-scale 0.8", 1.0, 0.8, false),
    row("--radius-scale 1.5", 1.0, 1.5, false),
];

const fn row(option: &'static str, share: f64, radius_scale: f64, drops: bool) -> Row {
    Row { option, share, radius_scale, drops }
}

/// Measures every option, from points to the image.
pub(crate) fn table(backends: &mut Backends, runs: usize, size: u32) -> Result<Table, Failure> {
    let head = ["option", "splats", "ms to make", "ms a frame", "RMSE", "RMSE of normals", "holes"];
    let mut table = Table::new(&head);
    let camera = subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size);
    let mesh = Geometry::from(clouds::bumpy_mesh(360));
    let shaders = [Shader::Unlit, Shader::Normal];
    let mut truths = Vec::new();
    for shader in shaders {
        truths.push(draw_single(backends, &mesh, &camera, shader, 0)?.0);
    }
    let points = scan()?;
    for Row { option, share, radius_scale, drops } in ROWS {
        let start = Instant::now();
        let cloud = made(points.clone(), share, radius_scale, drops)?;
        let made_ms = start.elapsed().as_secs_f64() * 1e3;
        let (splats, geometry) = (cloud.len(), Geometry::from(cloud));
        let mut errors = Vec::new();
        let (mut frame_ms, mut holes) = (0.0, 0);
        for (shader, truth) in shaders.into_iter().zip(&truths) {
            let (image, ms) = draw_single(backends, &geometry, &camera, shader, runs)?;
            errors.push(textures::errors(&image, truth, size)?[0]);
            if shader == Shader::Unlit {
                frame_ms = ms;
                holes = image.iter().zip(truth).filter(|(found, truth)| truth[3] > 0.0 && found[3] == 0.0).count();
            }
        }
        table.rows.push(vec![
            option.to_owned(),
            splats.to_string(),
            format!("{made_ms:.0}"),
            format!("{frame_ms:.2}"),
            format!("{:.4}", errors[0]),
            format!("{:.4}", errors[1]),
            holes.to_string(),
        ]);
    }
    Ok(table)
}

/// Returns points of the ball with noise and outliers, without normals.
fn scan() -> Result<PointCloud, Failure> {
    let cloud = clouds::ball(POINTS)?;
    let spacing = (4.0 * std::f64::consts::PI / POINTS as f64).sqrt();
    let mut random = clouds::Random(7);
    let mut even = || 2.0 * random.next() - 1.0;
    let place = |i: usize| {
        let place = if i.is_multiple_of(STRAY) {
            glam::DVec3::new(even(), even(), even()) * 1.5
        } else {
            // Uniform noise that has the standard deviation of a normal distribution.
            cloud.center(i) + cloud.normal(i) * (NOISE * spacing * 3f64.sqrt() * even())
        };
        place.as_vec3()
    };
    let positions = Column3::from_f32((0..POINTS).map(place).collect());
    Ok(PointCloud { positions, colors: cloud.data().colors.clone(), ..PointCloud::default() })
}

fn made(mut points: PointCloud, share: f64, radius_scale: f64, drops: bool) -> Result<SplatCloud, Failure> {
    if drops {
        let keep: Vec<bool> = outliers(&points, &NoProgress)?.iter().map(|alone| !alone).collect();
        points.retain(&keep);
    }
    if share < 1.0 {
        points.thin((share * points.len() as f64) as usize);
    }
    let options = PointOptions { radius_scale, ..PointOptions::default() };
    Ok(splats_from_points(&points, &options, &NoProgress)?.0)
}
