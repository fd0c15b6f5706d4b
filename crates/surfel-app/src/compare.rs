//! Comparison of two images.

use serde_json::{Map, json};
use std::path::Path;
use surfel_io::ShowPath as _;
use surfel_io::atomic::target;
use surfel_io::{IoError, Planes, PlanesView, PngOptions};
use surfel_load::Error;
use surfel_load::info::json_number;
use surfel_metrics::{CompareOptions, Comparison, Image, MetricsError, PlaneComparison, PlaneOptions};

/// Differences between two images.
#[derive(Clone, Debug)]
pub struct ImageComparison {
    /// Differences of the colours.
    pub colors: Comparison,
    /// Differences of the other planes that both images have, each with its channel name.
    pub planes: Vec<(String, PlaneComparison)>,
}

/// Compares image `b` with the reference image `a`. `names` are the paths of `a` and `b`, for messages.
///
/// # Errors
/// [`Error::Input`] if the sizes differ, or if one image has no colours.
pub fn compare(a: &Planes, b: &Planes, names: [&Path; 2]) -> Result<ImageComparison, Error> {
    let wrong = |what: String| Error::Input(format!("{} and {}: {what}", names[0].shown(), names[1].shown()));
    if (a.width, a.height) != (b.width, b.height) {
        let sizes = format!("{}x{} and {}x{} pixels", a.width, a.height, b.width, b.height);
        return Err(wrong(format!("are {sizes}, expected equal sizes: render or crop both alike")));
    }
    let (Some(first), Some(second)) = (&a.color, &b.color) else {
        return Err(wrong("have no colour planes in common, expected R, G and B in both".into()));
    };
    let colors = colors(a, first.as_flattened(), second.as_flattened()).map_err(|e| wrong(e.to_string()))?;
    let planes = planes(a, b).map_err(|e| wrong(e.to_string()))?;
    Ok(ImageComparison { colors, planes })
}

/// Checks that FLIP's error map of two images can be written to the path `diff`.
///
/// # Errors
/// [`Error::Usage`] for an extension other than PNG, and if `diff` is one of the images. [`Error::Io`] for an existing
/// file, unless `force` is true.
pub fn check_diff(diff: &Path, images: [&Path; 2], force: bool) -> Result<(), Error> {
    if !diff.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Err(Error::Usage(format!("--diff {}: expected a name that ends in .png", diff.shown())));
    }
    if images.map(target).contains(&target(diff)) {
        return Err(Error::Usage(format!("--diff {}: is an input, too, expected another name", diff.shown())));
    }
    if diff.is_file() && !force {
        return Err(IoError::Exists { path: diff.to_path_buf() }.into());
    }
    Ok(())
}

/// Writes FLIP's error map as a PNG in the colours of magma. Does nothing if FLIP wasn't computed.
///
/// # Errors
/// [`Error::Io`] if the file can't be written, or if it exists and `force` is false.
pub fn save_diff(path: &Path, force: bool, comparison: &ImageComparison) -> Result<(), Error> {
    let Some(map) = &comparison.colors.flip else { return Ok(()) };
    let linear = |c: u8| surfel_math::srgb::decode(f64::from(c) / 255.0) as f32;
    let image: Vec<[f32; 4]> =
        map.to_magma().into_iter().map(|[r, g, b]| [linear(r), linear(g), linear(b), 1.0]).collect();
    let view = PlanesView { width: map.width, height: map.height, color: Some(&image), ..PlanesView::default() };
    Ok(surfel_io::save_png(path, force, &view, &PngOptions::default())?)
}

fn colors(size: &Planes, a: &[f32], b: &[f32]) -> Result<Comparison, MetricsError> {
    let a = Image::new(size.width, size.height, a)?;
    let b = Image::new(size.width, size.height, b)?;
    surfel_metrics::compare(&a, &b, &CompareOptions::default())
}

/// Compares the planes, other than colour, that both images have.
fn planes(a: &Planes, b: &Planes) -> Result<Vec<(String, PlaneComparison)>, MetricsError> {
    let mut found = Vec::new();
    let mut add = |name: &str, a: Option<&[f32]>, b: Option<&[f32]>| {
        if let (Some(a), Some(b)) = (a, b) {
            found.push((name.to_owned(), surfel_metrics::compare_plane(a, b, &PlaneOptions::default())?));
        }
        Ok(())
    };
    let flat = |p: &Planes| p.normal.as_ref().map(|n| n.as_flattened().to_vec());
    add("Z", a.depth.as_deref(), b.depth.as_deref())?;
    add("normal", flat(a).as_deref(), flat(b).as_deref())?;
    add("weight", a.weight.as_deref(), b.weight.as_deref())?;
    for (name, values) in &a.whole {
        // Integers are subtracted in f64, since f32 can't represent all of them. It can represent their small
        // differences.
        let other = b.whole.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_slice());
        let off = other.map(|other| {
            values.iter().zip(other).map(|(a, b)| (f64::from(*a) - f64::from(*b)) as f32).collect::<Vec<f32>>()
        });
        add(name, Some(&vec![0.0; values.len()]), off.as_deref())?;
    }
    for (name, values) in &a.other {
        let other = b.other.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_slice());
        add(name, Some(values), other)?;
    }
    Ok(found)
}

fn value(colors: &Comparison, metric: &str) -> f64 {
    match metric {
        "max_abs" => colors.max_abs,
        "rmse" => colors.rmse,
        "psnr" => colors.psnr,
        _ => colors.flip_mean.unwrap_or(f64::INFINITY),
    }
}

impl ImageComparison {
    /// Returns a metric of the colours by its name: `max_abs` or `rmse` (linear), or `psnr` (dB). For any other name,
    /// returns the mean FLIP error in [0, 1]; it is +∞ if FLIP wasn't computed.
    pub fn metric(&self, name: &str) -> f64 {
        value(&self.colors, name)
    }

    /// Returns the JSON object that `surfel compare --json` prints, without the names of the images.
    pub fn to_json(&self) -> serde_json::Value {
        let colors = &self.colors;
        let plane = |p: &PlaneComparison| {
            json!({ "max_abs": json_number(p.max_abs), "rmse": json_number(p.rmse), "differing": p.differing,
                    "non_finite": p.non_finite })
        };
        let planes: Map<_, _> = self.planes.iter().map(|(name, p)| (name.clone(), plane(p))).collect();
        json!({
            "width": colors.width,
            "height": colors.height,
            "max_abs": json_number(colors.max_abs),
            "max_abs_at": colors.max_abs_at.map(|(x, y)| [x, y]),
            "rmse": json_number(colors.rmse),
            "psnr": json_number(colors.psnr),
            "flip": json_number(self.metric("flip")),
            "differing": colors.differing,
            "non_finite": colors.non_finite,
            "planes": planes,
        })
    }
}
