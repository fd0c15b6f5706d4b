//! `surfel compare`: measures the difference between two images.

use crate::args::CompareArgs;
use crate::failure::Failure;
use crate::stdout;
use crate::values::Threshold;
use std::fmt::Write;
use surfel_app::compare::{ImageComparison, check_diff, compare, save_diff};

pub(crate) fn run(args: &CompareArgs) -> Result<(), Failure> {
    if let Some(diff) = &args.diff {
        check_diff(diff, [&args.a, &args.b], args.force)?;
    }
    let a = surfel_io::read_image(&args.a)?;
    let b = surfel_io::read_image(&args.b)?;
    let compared = compare(&a, &b, [&args.a, &args.b])?;
    if let Some(diff) = &args.diff {
        save_diff(diff, args.force, &compared)?;
    }
    if args.json {
        let mut json = compared.to_json();
        json["a"] = args.a.to_string_lossy().into();
        json["b"] = args.b.to_string_lossy().into();
        stdout::json_result(&json)?;
    } else {
        stdout::result(as_text(&compared).as_bytes())?;
    }
    judge(args, &compared)
}

fn as_text(compared: &ImageComparison) -> String {
    let colors = &compared.colors;
    let mut text = String::new();
    let at = colors.max_abs_at.map(|(x, y)| format!("  at {x},{y}")).unwrap_or_default();
    // Writing to a string can't fail.
    let _ = writeln!(text, "max_abs  {:.6}{at}", colors.max_abs);
    let _ = writeln!(text, "rmse     {:.6}", colors.rmse);
    let _ = writeln!(text, "psnr     {:.2} dB", colors.psnr);
    let _ = writeln!(text, "flip     {:.6}", compared.metric("flip"));
    for (name, p) in &compared.planes {
        let _ = writeln!(text, "{name}: max_abs {:.6}, rmse {:.6}", p.max_abs, p.rmse);
    }
    text
}

fn judge(args: &CompareArgs, compared: &ImageComparison) -> Result<(), Failure> {
    // NaN fails every threshold.
    let judged = |t: &Threshold| Some(compared.metric(t.metric)).filter(|v| !v.is_nan());
    let above = |t: &&Threshold| judged(t).is_none_or(|v| v > t.value);
    let below = |t: &&Threshold| judged(t).is_none_or(|v| v < t.value);
    let say =
        |t: &Threshold, side: &str| format!("{} is {:.6}, {side} {}", t.metric, compared.metric(t.metric), t.value);
    let mut broken: Vec<String> = args.fail_above.iter().filter(above).map(|t| say(t, "above")).collect();
    broken.extend(args.fail_below.iter().filter(below).map(|t| say(t, "below")));
    if let Some(preset) = args.verify_preset {
        let promised = Threshold { metric: "psnr", value: preset.promise().model_db };
        let of = format!(" (the promise of preset {})", preset.name());
        broken.extend(Some(&promised).filter(below).map(|t| say(t, "below") + &of));
    }
    if broken.is_empty() { Ok(()) } else { Err(Failure::threshold(broken.join("; "))) }
}
