//! `surfel compare`: how far two images are apart.

use crate::args::CompareArgs;
use crate::failure::Failure;
use crate::stdout;
use crate::values::{Threshold, json_number};
use serde_json::{Map, json};
use std::fmt::Write;
use surfel::io::{IoError, Planes, PlanesView, PngOptions};
use surfel_metrics::{CompareOptions, Comparison, Image, MetricsError, PlaneComparison, PlaneOptions};

pub(crate) fn run(args: &CompareArgs) -> Result<(), Failure> {
    if let Some(diff) = &args.diff {
        if !diff.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
            return Err(Failure::usage(format!("--diff {}: expected a name that ends in .png", diff.display())));
        }
        if diff.is_file() && !args.force {
            return Err(IoError::Exists { path: diff.clone() }.into());
        }
    }
    let a = surfel::io::read_image(&args.a)?;
    let b = surfel::io::read_image(&args.b)?;
    let wrong = |what: String| Failure::input(format!("{} and {}: {what}", args.a.display(), args.b.display()));
    if (a.width, a.height) != (b.width, b.height) {
        let sizes = format!("{}x{} and {}x{} pixels", a.width, a.height, b.width, b.height);
        return Err(wrong(format!("are {sizes}, expected equal sizes: render or crop both alike")));
    }
    let (Some(first), Some(second)) = (&a.color, &b.color) else {
        return Err(wrong("have no colour planes in common, expected R, G and B in both".into()));
    };
    let colors = colors(&a, first.as_flattened(), second.as_flattened()).map_err(|e| wrong(e.to_string()))?;
    let planes = planes(&a, &b).map_err(|e| wrong(e.to_string()))?;
    if let (Some(path), Some(map)) = (&args.diff, &colors.flip) {
        let linear = |c: u8| surfel::math::srgb::decode(f64::from(c) / 255.0) as f32;
        let image: Vec<[f32; 4]> =
            map.to_magma().into_iter().map(|[r, g, b]| [linear(r), linear(g), linear(b), 1.0]).collect();
        let view = PlanesView { width: map.width, height: map.height, color: Some(&image), ..PlanesView::default() };
        surfel::io::save_png(path, args.force, &view, &PngOptions::default())?;
    }
    if args.json {
        stdout::json_result(&as_json(args, &colors, &planes))?;
    } else {
        stdout::result(as_text(&colors, &planes).as_bytes())?;
    }
    judge(args, &colors)
}

fn colors(size: &Planes, a: &[f32], b: &[f32]) -> Result<Comparison, MetricsError> {
    let a = Image::new(size.width, size.height, a)?;
    let b = Image::new(size.width, size.height, b)?;
    surfel_metrics::compare(&a, &b, &CompareOptions::default())
}

/// The planes besides colour that both images have.
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
        // Whole numbers differ by what f32 can say, though it can't say them.
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

fn as_json(args: &CompareArgs, colors: &Comparison, planes: &[(String, PlaneComparison)]) -> serde_json::Value {
    let plane = |p: &PlaneComparison| {
        json!({ "max_abs": json_number(p.max_abs), "rmse": json_number(p.rmse), "differing": p.differing,
                "non_finite": p.non_finite })
    };
    let planes: Map<_, _> = planes.iter().map(|(name, p)| (name.clone(), plane(p))).collect();
    json!({
        "a": args.a.to_string_lossy(),
        "b": args.b.to_string_lossy(),
        "width": colors.width,
        "height": colors.height,
        "max_abs": json_number(colors.max_abs),
        "max_abs_at": colors.max_abs_at.map(|(x, y)| [x, y]),
        "rmse": json_number(colors.rmse),
        "psnr": json_number(colors.psnr),
        "flip": json_number(value(colors, "flip")),
        "differing": colors.differing,
        "non_finite": colors.non_finite,
        "planes": planes,
    })
}

fn as_text(colors: &Comparison, planes: &[(String, PlaneComparison)]) -> String {
    let mut text = String::new();
    let at = colors.max_abs_at.map(|(x, y)| format!("  at {x},{y}")).unwrap_or_default();
    // Writing to a string can't fail.
    let _ = writeln!(text, "max_abs  {:.6}{at}", colors.max_abs);
    let _ = writeln!(text, "rmse     {:.6}", colors.rmse);
    let _ = writeln!(text, "psnr     {:.2} dB", colors.psnr);
    let _ = writeln!(text, "flip     {:.6}", value(colors, "flip"));
    for (name, p) in planes {
        let _ = writeln!(text, "{name}: max_abs {:.6}, rmse {:.6}", p.max_abs, p.rmse);
    }
    text
}

fn judge(args: &CompareArgs, colors: &Comparison) -> Result<(), Failure> {
    // A value that is no number passes nothing.
    let judged = |t: &Threshold| Some(value(colors, t.metric)).filter(|v| !v.is_nan());
    let above = |t: &&Threshold| judged(t).is_none_or(|v| v > t.value);
    let below = |t: &&Threshold| judged(t).is_none_or(|v| v < t.value);
    let say = |t: &Threshold, side: &str| format!("{} is {:.6}, {side} {}", t.metric, value(colors, t.metric), t.value);
    let mut broken: Vec<String> = args.fail_above.iter().filter(above).map(|t| say(t, "above")).collect();
    broken.extend(args.fail_below.iter().filter(below).map(|t| say(t, "below")));
    if let Some(preset) = args.verify_preset {
        let promised = Threshold { metric: "psnr", value: preset.promise().model_db };
        let of = format!(" (the promise of preset {})", preset.name());
        broken.extend(Some(&promised).filter(below).map(|t| say(t, "below") + &of));
    }
    if broken.is_empty() { Ok(()) } else { Err(Failure::threshold(broken.join("; "))) }
}
