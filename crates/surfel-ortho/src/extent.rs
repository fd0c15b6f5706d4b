//! Checks of the extent of the input: refuses coordinates in degrees, and strays that would make an image excessively
//! large.

use super::OrthoOptions;
use super::grid::Grid;
use super::source::{Source, SourceContent};
use glam::DVec3;
use std::path::PathBuf;
use surfel_io::Crs;
use surfel_load::Error;
use surfel_load::paths::display;
use surfel_model::Outliers;

/// Smallest [`score`] at which coordinates without a stated reference system count as degrees.
const DEGREES_SCORE: u32 = 3;
/// Extent of a file's coordinates, in their own units, at or above which they are taken not to be degrees. Few files
/// span so many degrees, and local coordinates usually have larger extents.
const WIDEST_DEG: f64 = 5.0;
/// Largest decimal step of x and y that suggests degrees: 1e-5° is about a metre on the ground. Coordinates in metres
/// usually have coarser steps.
const FINE: f64 = 1e-5;
/// Largest number of pixels of an image that isn't checked for strays.
const ABSURD_PX: f64 = 4e6;
/// Largest factor by which strays may enlarge an image's area; more is an error.
const MAX_STRAY_FACTOR: f64 = 100.0;
/// Inverse of the largest fraction of points that count as strays. If more points are far away, none is a stray.
const STRAY_OF: usize = 1000;
/// Number of far points that may always count as strays, also in files so small that 1/[`STRAY_OF`] of the points is
/// fewer.
const FEW: usize = 3;
/// Maximum number of points of all files from which their core, the range of the middle 96 %, is estimated.
const SAMPLE: usize = 1 << 16;

/// Returns an error for files whose x and y are degrees, according to their reference system, column names or numbers.
/// `is_stated` is true if the user stated a reference system; column names and numbers then don't count.
pub(crate) fn check_not_degrees(source: &Source, is_stated: bool) -> Result<(), Error> {
    let (lo, hi) = source.bounds;
    let is_on_earth = lo.x >= -180.0 && hi.x <= 360.0 && lo.y >= -90.0 && hi.y <= 90.0;
    let is_in_turn = lo.abs().max(hi.abs()).truncate().max_element() <= 360.0;
    let crs = source.crs.as_ref().filter(|crs| crs.is_geographic());
    let why = match crs {
        Some(crs) if is_in_turn => crs.words(),
        _ if is_stated || !is_on_earth => return Ok(()),
        _ if source.is_named_degrees => "by the names or the steps of its columns".to_owned(),
        _ if score(source) >= DEGREES_SCORE => {
            "by its numbers: they are as fine and as narrow as degrees are".to_owned()
        }
        _ => return Ok(()),
    };
    let middle = 0.5 * (lo + hi);
    // The option doesn't overrule a system that the file states.
    let (from, otherwise) = match crs {
        Some(_) => ("", ""),
        None => (" --filters.reprojection.in_srs=EPSG:4326", "; or give `crs` if it is projected"),
    };
    let out = Crs::utm_at(middle.x, middle.y);
    let problem = format!(
        "its x and y are degrees ({why}), expected lengths: project it first, as by pdal translate IN OUT \
         reprojection{from} --filters.reprojection.out_srs=EPSG:{out}{otherwise}"
    );
    Err(Error::Unsuitable { path: source.path.clone(), problem })
}

/// Returns a score, 0 to 5, for the evidence that coordinates without a reference system are degrees; [`DEGREES_SCORE`]
/// decides.
fn score(source: &Source) -> u32 {
    let SourceContent::Points(points) = &source.holds else { return 0 };
    let (lo, hi) = source.bounds;
    let (extent, middle) = (hi - lo, 0.5 * (lo + hi));
    let widest = extent.x.max(extent.y);
    if widest >= WIDEST_DEG || widest <= 0.0 {
        return 0;
    }
    // Coordinates in metres have equal decimal steps on all axes. Steps of coordinates in degrees are a hundred
    // thousand times finer than the steps of their heights in metres.
    let [x, y, z] = points.canonical.steps();
    let is_fine = |step: Option<f64>| step.is_none_or(|step| step <= FINE);
    let is_coarse = |step: Option<f64>| step.is_some_and(|z| z >= 100.0 * FINE && z >= 100.0 * x.unwrap_or(FINE));
    if !(is_fine(x) && is_fine(y)) {
        return 0;
    }
    let steps = if is_coarse(z) { 2 } else { 0 };
    // With x and y in degrees, heights in metres look steep: a metre of height for 0.001 degrees of width.
    let steep = u32::from(extent.z >= 10.0 * widest) + u32::from(extent.z >= 1000.0 * widest);
    // Local coordinates usually begin near 0; degrees don't.
    let far = u32::from(middle.abs().truncate().min_element() >= 20.0 * widest);
    steps + steep + far
}

/// Stray points far from all others, which would make an image too large, for an error message.
struct Strays {
    count: usize,
    farthest: DVec3,
    /// Distance of the farthest stray from the bounds of the points that aren't strays, in x and y.
    distance: f64,
    path: PathBuf,
    /// Bounds of the points that aren't strays: minimum x, minimum y, maximum x, maximum y.
    others: [f64; 4],
}

/// Returns the grid of an image of all points, with these bounds. Returns an error if the image is too large for a
/// file, or if a few strays make it excessively large.
pub(crate) fn grid_of_points(options: &OrthoOptions, bounds: [f64; 4], sources: &[Source]) -> Result<Grid, Error> {
    let (gsd, origin, outliers) = (options.gsd, options.origin, options.load.convert.outliers);
    let side = |low: f64, high: f64| ((high - low) / gsd).ceil().max(1.0);
    let pixels = |b: [f64; 4]| [side(b[0], b[2]), side(b[1], b[3])];
    let area = |b: [f64; 4]| pixels(b).iter().product::<f64>();
    let found = if area(bounds) > ABSURD_PX { strays(sources) } else { None };
    if let Some(strays) = found.filter(|strays| area(bounds) > MAX_STRAY_FACTOR * area(strays.others)) {
        let Strays { count, farthest: p, distance, path, others } = strays;
        let ([width, height], drop) = (pixels(bounds), outliers != Some(Outliers::Drop));
        let what = if count == 1 { "a stray point lies" } else { "stray points lie" };
        let number = if count == 1 { String::new() } else { format!("{count} ") };
        let others = others.map(|v| (v * 1e3).round() / 1e3);
        let remedy = if drop { "`outliers=drop` leaves strays out, and " } else { "" };
        let problem = format!(
            "{number}{what} {distance:.0} units from all other points, at {},{},{}{}: the image would have {width} x \
             {height} pixels; {remedy}`bounds={},{},{},{}` draws the others",
            p.x,
            p.y,
            p.z,
            if count > 1 { " the farthest" } else { "" },
            others[0],
            others[1],
            others[2],
            others[3]
        );
        return Err(Error::Unsuitable { path, problem });
    }
    Grid::of_bounds(gsd, origin, bounds).map_err(|fault| fault.of_points(bounds))
}

/// Finds stray points: a few points that are farther from the core of the points, in x and y, than the core is wide.
/// `None` if there are none, or too many ([`STRAY_OF`], [`FEW`]).
fn strays(sources: &[Source]) -> Option<Strays> {
    let clouds = || sources.iter().filter_map(|source| Some((source, source.positions()?)));
    let total: usize = clouds().map(|(_, (count, _))| count).sum();
    let step = total.div_ceil(SAMPLE).max(1);
    let mut sample: [Vec<f64>; 2] = Default::default();
    for (_, (count, at)) in clouds() {
        for p in (0..count).step_by(step).map(at) {
            sample[0].push(p.x);
            sample[1].push(p.y);
        }
    }
    // The core is the range of the middle 96 % of the points.
    let core = sample.map(|mut values| {
        values.sort_unstable_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        Some((values[last / 50], values[last - last / 50]))
    });
    let [x, y] = [core[0]?, core[1]?];
    let reach = (x.1 - x.0).max(y.1 - y.0);
    let is_core = |p: DVec3| p.x >= x.0 - reach && p.x <= x.1 + reach && p.y >= y.0 - reach && p.y <= y.1 + reach;
    let none = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let (mut others, mut out) = (none, Vec::new());
    for (source, (count, at)) in clouds() {
        for p in (0..count).map(at) {
            if is_core(p) {
                others = [others[0].min(p.x), others[1].min(p.y), others[2].max(p.x), others[3].max(p.y)];
            } else {
                out.push((p, source));
            }
            // Many points outside of the core aren't strays.
            if out.len() > (total / STRAY_OF).max(FEW) {
                return None;
            }
        }
    }
    let distance = |p: DVec3| {
        let beyond = |v: f64, low: f64, high: f64| (low - v).max(v - high).max(0.0);
        beyond(p.x, others[0], others[2]).hypot(beyond(p.y, others[1], others[3]))
    };
    let farthest = out.iter().max_by(|a, b| distance(a.0).total_cmp(&distance(b.0)))?;
    Some(Strays {
        count: out.len(),
        farthest: farthest.0,
        distance: distance(farthest.0),
        path: PathBuf::from(display(&farthest.1.path).to_string()),
        others,
    })
}
