//! `surfel info`: describes a file's content without converting all of it.

use crate::console::Console;
use crate::failure::Failure;
use crate::stdin::{self, Stdin, is_stdin};
use crate::stdout;
use serde_json::Value;
use std::path::{Path, PathBuf};
use surfel_app::options::Options;
use surfel_app::wording::notes_as_flags;
use surfel_load::words::{self, counted, shortest};

pub(crate) fn run(args: &Options, console: &Console) -> Result<(), Failure> {
    let path = args.inputs.first().map_or(Path::new(""), PathBuf::as_path);
    let convert = &args.render.splats.convert;
    let options = surfel_io::LoadOptions {
        gaussians: false,
        repair: convert.repair,
        texture: None,
        allow_outside: convert.allow_outside,
        max_texture: convert.max_texture,
        columns: convert.columns.clone(),
        ..surfel_io::LoadOptions::default()
    };
    let from_stdin = if is_stdin(path) { Some(Stdin::default().bytes()?) } else { None };
    let mut facts = surfel_load::info::info(path, &options, from_stdin.as_deref())?;
    notes_as_flags(&mut facts);
    if args.json {
        return stdout::json_result(&facts);
    }
    for note in facts["notes"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        console.note(&format!("{}: {note}", stdin::display(path)));
    }
    stdout::result(text(&facts).as_bytes())
}

fn text(facts: &Value) -> String {
    let string = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let coordinate = |value: &Value| value.as_f64().map_or_else(|| string(value), shortest);
    let point = |value: &Value| value.as_array().into_iter().flatten().map(coordinate).collect::<Vec<_>>().join(", ");
    let counts = ["splats", "points", "vertices", "triangles", "nodes", "transitions"];
    let counts = counts.into_iter().filter_map(|name| Some(counted(facts[name].as_u64()?, name)));
    let holds = match facts["harmonics_degree"].as_u64() {
        Some(degree) => format!("{} Gaussians of degree {degree}", facts["splats"]),
        None => counts.collect::<Vec<_>>().join(", "),
    };
    let mut lines = vec![
        ("file", format!("{} ({}, {} bytes)", string(&facts["file"]), string(&facts["format"]), facts["file_bytes"])),
        ("holds", holds),
        ("up", format!("{} ({})", string(&facts["up"]), string(&facts["up_reason"]))),
        ("attributes", attributes(facts).map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")),
    ];
    if let Some([lo, hi]) = facts["bounds"].as_array().map(Vec::as_slice) {
        lines.push(("bounds", format!("({}) to ({})", point(lo), point(hi))));
    }
    if let Some(r) = facts["radii"].as_object() {
        let number = |key: &str| r[key].as_f64().map_or_else(|| string(&r[key]), words::number);
        let (median, min, max) = (number("median"), number("min"), number("max"));
        lines.push(("radii", format!("median {median}, {min} to {max}, {}", string(&r["how"]))));
    }
    lines.extend(attribute_lines(facts));
    lines.push(("memory", format!("{} bytes", facts["memory_bytes"])));
    if let Some(weight) = facts["interior_weight"].as_f64() {
        lines.push(("interior weight", format!("{weight}")));
    }
    if let Some(errors) = facts["sharp_errors"].as_str() {
        lines.push(("sharp errors", errors.to_owned()));
    }
    lines.into_iter().map(|(name, value)| format!("{name:<16} {value}\n")).collect()
}

fn attributes(facts: &Value) -> impl Iterator<Item = (&String, &Value)> {
    facts["attributes"].as_object().into_iter().flatten()
}

/// Returns the lines about columns, classes and the coordinate reference system, as pairs of label and text.
fn attribute_lines(facts: &Value) -> Vec<(&'static str, String)> {
    let list = |key: &str| facts[key].as_array().into_iter().flatten();
    let string = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let mut lines = Vec::new();
    for (name, column) in attributes(facts) {
        if let Some(kind) = column["type"].as_str() {
            let of = column["of"].as_str().map_or_else(String::new, |of| format!(", of {of}"));
            lines.push(("column", format!("{name}: {kind}, {} to {}{of}", column["min"], column["max"])));
        }
    }
    for c in list("classes") {
        lines.push(("class", format!("{} ({}): {}", c["class"], string(&c["name"]), c["count"])));
    }
    match (facts["crs"]["code"].as_str(), facts["crs"]["name"].as_str()) {
        (Some(code), Some(name)) => lines.push(("crs", format!("{code} ({})", name.escape_debug()))),
        (Some(one), None) | (None, Some(one)) => lines.push(("crs", one.escape_debug().to_string())),
        (None, None) => {}
    }
    lines
}
