//! Evaluation of the results: cost of each setting's values, dominated values, and claims of papers.

use std::collections::BTreeMap;

use crate::page::Table;
use surfel_render::Preset;

use super::figures::{Error, Figures, Row};
use super::variants::{DEFAULT, default_value};

/// Cost and error of a setting's value. Fields without units are ratios to the default value, as geometric means over
/// subjects.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Value {
    pub knob: String,
    pub value: String,
    pub cost: Option<f64>,
    pub error: Option<f64>,
    /// Ratio of the model error inside silhouettes to that of the default.
    pub inside: Option<f64>,
    /// Ratio of the number of fragments to that of the default.
    pub fragments: Option<f64>,
    /// Ratio of the bytes per splat to those of the default.
    pub bytes: Option<f64>,
    /// Smallest PSNR of all subjects against the reference's image with the same settings, in dB; `None` if all
    /// compared images are equal, or if none was compared.
    pub fidelity_db: Option<f64>,
    /// Largest ratio of a subject's model error to that of the default, with the name of the subject.
    pub worst: Option<(f64, String)>,
    /// Value of the same setting that dominates this one: at least equal in everything, and clearly better in
    /// something.
    pub dominated_by: Option<String>,
}

/// Relative difference up to which two times count as equal: the noise of medians of alternating runs on a shared
/// machine. A larger difference of times or errors counts as clear.
const NOISE: f64 = 0.03;

/// Returns all values of all settings except presets, grouped by setting, the default first. For the setting
/// `transparency`, the default isn't listed.
pub(crate) fn values(figures: &Figures) -> Vec<Value> {
    let mut knobs: Vec<&str> = Vec::new();
    for row in figures.rows.iter().filter(|r| r.knob != DEFAULT && r.knob != "preset") {
        if !knobs.contains(&row.knob.as_str()) {
            knobs.push(&row.knob);
        }
    }
    let mut all = Vec::new();
    for knob in knobs {
        let mut values = Vec::new();
        if knob != "transparency" {
            values.push(value(figures, knob, None));
        }
        let mut names: Vec<&str> = Vec::new();
        for row in figures.rows.iter().filter(|r| r.knob == knob) {
            if !names.contains(&row.value.as_str()) {
                names.push(&row.value);
            }
        }
        values.extend(names.iter().map(|name| value(figures, knob, Some(name))));
        let compared = values.clone();
        for one in &mut values {
            one.dominated_by = compared.iter().find(|other| dominates(other, one)).map(|other| other.value.clone());
        }
        all.extend(values);
    }
    all
}

fn dominates(a: &Value, b: &Value) -> bool {
    let (Some(cost_a), Some(cost_b), Some(error_a), Some(error_b)) = (a.cost, b.cost, a.error, b.error) else {
        return false;
    };
    // Memory counts as a cost, too.
    let bytes = |v: &Value| v.bytes.unwrap_or(1.0);
    let (inside_a, inside_b) = (a.inside.unwrap_or(1.0), b.inside.unwrap_or(1.0));
    // Errors have no noise, but tiny differences count as equal.
    let no_worse = cost_a <= cost_b * (1.0 + NOISE)
        && error_a <= error_b * 1.005
        && inside_a <= inside_b * 1.005
        && bytes(a) <= bytes(b) * 1.001;
    let clearly = |a: f64, b: f64| a < b * (1.0 - NOISE);
    let better = clearly(cost_a, cost_b) || clearly(error_a, error_b) || clearly(inside_a, inside_b);
    a.value != b.value && no_worse && better
}

fn value(figures: &Figures, knob: &str, name: Option<&str>) -> Value {
    let of = |row: &Row| row.knob == knob && Some(row.value.as_str()) == name;
    let subjects: Vec<&str> = figures.rows.iter().filter(|r| r.knob == knob).map(|r| r.subject.as_str()).collect();
    let rows: Vec<&Row> = match name {
        Some(_) => figures.rows.iter().filter(|r| of(r)).collect(),
        None => figures.rows.iter().filter(|r| r.knob == DEFAULT && subjects.contains(&r.subject.as_str())).collect(),
    };
    let base = |row: &Row| figures.row(&row.subject, DEFAULT, DEFAULT);
    let mean = |f: &dyn Fn(&Row) -> Option<f64>| {
        let ratios = rows.iter().filter_map(|row| Some(f(row)? / f(base(row)?)?)).filter(|r| r.is_finite() && *r > 0.0);
        let (sum, count) = ratios.fold((0.0, 0u32), |(sum, count), ratio| (sum + ratio.ln(), count + 1));
        (count > 0).then(|| (sum / f64::from(count)).exp())
    };
    let model = |row: &Row| row.model.map(|e| e.rmse);
    let ratio = |row: &&&Row| Some((model(row)? / model(base(row)?)?, row.subject.clone()));
    let worst = rows.iter().filter_map(|row| ratio(&row)).max_by(|a, b| a.0.total_cmp(&b.0));
    let fidelity = rows.iter().filter_map(|row| row.fidelity?.psnr_db).fold(f64::INFINITY, f64::min);
    Value {
        knob: knob.to_owned(),
        value: name.map_or_else(|| default_value(knob).to_owned(), str::to_owned),
        cost: mean(&|row| row.ms),
        error: mean(&model),
        inside: mean(&|row| row.model_inside.map(|e| e.rmse)),
        fragments: mean(&|row| row.fragments.map(|n| n as f64)),
        bytes: mean(&|row| row.bytes_per_splat),
        fidelity_db: fidelity.is_finite().then_some(fidelity),
        worst,
        dominated_by: None,
    }
}

/// Formats a ratio as `1.23×`; a missing ratio as a dash.
fn times(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}×"))
}

fn decibels(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.0} dB"))
}

/// Level-of-detail settings, with their subjects, which no other setting uses.
const LEVELS_OF_DETAIL: [(&str, &str); 2] = [("level of detail", "octree"), ("levels of points", "points by levels")];

/// Returns the table of level-of-detail settings, whose values are sizes of splats in pixels.
pub(crate) fn levels_of_detail(values: &[Value]) -> Table {
    let mut table = Table::new(&["of", "splats of at most", "time", "model error", "without rims"]);
    for (knob, of) in LEVELS_OF_DETAIL {
        for v in values.iter().filter(|v| v.knob == knob) {
            table.rows.push(vec![of.to_owned(), v.value.clone(), times(v.cost), times(v.error), times(v.inside)]);
        }
    }
    table
}

/// Returns the table of all settings except those of level of detail.
pub(crate) fn settings(values: &[Value]) -> Table {
    let mut table = Table::new(&[
        "knob",
        "value",
        "time",
        "model error",
        "worst error on",
        "without rims",
        "fragments",
        "bytes",
        "fidelity ≥",
        "dominated by",
    ]);
    for v in values.iter().filter(|v| LEVELS_OF_DETAIL.iter().all(|(knob, _)| v.knob != *knob)) {
        let worst = v.worst.as_ref().map_or_else(|| "-".to_owned(), |(ratio, name)| format!("{ratio:.2}× {name}"));
        if v.dominated_by.is_some() {
            table.marked.push((table.rows.len(), false));
        }
        table.rows.push(vec![
            v.knob.clone(),
            v.value.clone(),
            times(v.cost),
            times(v.error),
            worst,
            times(v.inside),
            times(v.fragments),
            times(v.bytes),
            decibels(v.fidelity_db),
            v.dominated_by.clone().unwrap_or_default(),
        ]);
    }
    table
}

/// Returns the table of the fidelity of each setting's values: worst PSNR with its subject, worst pixel, and model
/// error and time relative to the default.
pub(crate) fn fidelity(figures: &Figures) -> Table {
    let mut table =
        Table::new(&["knob", "value", "fidelity ≥", "on", "largest error", "model error", "time", "drawn on"]);
    let mut names: Vec<(&str, &str)> = Vec::new();
    for row in &figures.rows {
        if !names.contains(&(row.knob.as_str(), row.value.as_str())) {
            names.push((&row.knob, &row.value));
        }
    }
    for (knob, name) in names {
        let summary = value(figures, knob, Some(name));
        let rows = || figures.rows.iter().filter(|r| r.knob == knob && r.value == name);
        let errors = rows().filter_map(|r| Some((r.fidelity?, r.subject.as_str())));
        // Equal images have no PSNR.
        let least = errors.clone().filter_map(|(e, on)| Some((e.psnr_db?, on))).min_by(|a, b| a.0.total_cmp(&b.0));
        let largest = errors.map(|(e, _)| e.max_abs).reduce(f64::max);
        table.rows.push(vec![
            knob.to_owned(),
            name.to_owned(),
            decibels(least.map(|l| l.0)),
            least.map_or("-", |l| l.1).to_owned(),
            largest.map_or_else(|| "-".to_owned(), |e| format!("{e:.1e}")),
            times(summary.error),
            times(summary.cost),
            format!("{} of {}", rows().filter(|r| r.not_drawn.is_none()).count(), rows().count()),
        ]);
    }
    table
}

/// Returns the table of presets: time relative to the default, and the worst result of all subjects for each of a
/// preset's two promises. Rows with a broken promise are highlighted.
pub(crate) fn presets(figures: &Figures) -> Table {
    let mut table = Table::new(&[
        "preset",
        "time",
        "model error",
        "fidelity ≥",
        "promised",
        "from preset reference ≥",
        "promised",
        "on",
        "drawn on",
    ]);
    let mut names: Vec<&str> = Vec::new();
    for row in figures.rows.iter().filter(|r| r.knob == "preset") {
        if !names.contains(&row.value.as_str()) {
            names.push(&row.value);
        }
    }
    for name in names {
        let summary = value(figures, "preset", Some(name));
        let rows = || figures.rows.iter().filter(|r| r.knob == "preset" && r.value == name);
        let least = rows().filter_map(|r| Some((r.from_reference_preset_db?, r.subject.as_str())));
        let least = least.min_by(|a, b| a.0.total_cmp(&b.0));
        let drawn = rows().filter(|r| r.not_drawn.is_none()).count();
        let promise = Preset::ALL.into_iter().find(|preset| preset.name() == name).map(Preset::promise);
        let is_short = |found: Option<f64>, promised: Option<f64>| found.zip(promised).is_some_and(|(a, b)| a < b);
        let (fidelity_db, model_db) = (promise.map(|p| p.fidelity_db), promise.map(|p| p.model_db));
        if is_short(summary.fidelity_db, fidelity_db) || is_short(least.map(|l| l.0), model_db) {
            table.marked.push((table.rows.len(), false));
        }
        let same = || "the same image".to_owned();
        table.rows.push(vec![
            name.to_owned(),
            times(summary.cost),
            times(summary.error),
            decibels(summary.fidelity_db),
            decibels(fidelity_db),
            least.map_or_else(same, |l| decibels(Some(l.0))),
            model_db.map_or_else(|| "-".to_owned(), |db| if db.is_finite() { decibels(Some(db)) } else { same() }),
            least.map_or("-", |l| l.1).to_owned(),
            format!("{drawn} of {}", rows().count()),
        ]);
    }
    table
}

/// Returns the table of the model error (RMSE) by subject and value. The function `error` selects a row's error: of the
/// whole image, or without silhouettes. Shaders aren't listed.
pub(crate) fn errors(figures: &Figures, error: impl Fn(&Row) -> Option<Error>) -> Table {
    let subjects: Vec<&str> = figures.subjects.iter().map(|s| s.name.as_str()).collect();
    let mut head = vec!["knob", "value"];
    head.extend(&subjects);
    let mut table = Table::new(&head);
    let mut lines: BTreeMap<usize, (String, String)> = BTreeMap::new();
    for (index, row) in figures.rows.iter().enumerate().filter(|(_, r)| r.knob != "shader") {
        if !lines.values().any(|(knob, value)| *knob == row.knob && *value == row.value) {
            lines.insert(index, (row.knob.clone(), row.value.clone()));
        }
    }
    for (knob, value) in lines.into_values() {
        let cell = |subject: &&str| {
            let rmse = figures.row(subject, &knob, &value).and_then(&error);
            rmse.map_or_else(|| "-".to_owned(), |e| format!("{:.4}", e.rmse))
        };
        let cells: Vec<String> = subjects.iter().map(cell).collect();
        table.rows.push([vec![knob, value], cells].concat());
    }
    table
}

/// Returns the table of claims of papers with the corresponding measurements.
pub(crate) fn claims(figures: &Figures) -> Table {
    let mut table = Table::new(&["claim", "measured"]);
    let mut add = |claim: &str, measured: Option<String>| {
        table.rows.push(vec![claim.to_owned(), measured.unwrap_or_else(|| "not measured on this backend".to_owned())]);
    };
    let ratio = |subjects: &[&str], a: (&str, &str), b: (&str, &str), f: &dyn Fn(&Row) -> Option<f64>| {
        let parts = subjects.iter().filter_map(|subject| {
            let value = |(knob, value): (&str, &str)| f(figures.row(subject, knob, value)?);
            Some(format!("{:.2}× {subject}", value(a)? / value(b)?))
        });
        let parts: Vec<String> = parts.collect();
        (!parts.is_empty()).then(|| parts.join(", "))
    };
    let (ms, fragments) = (|r: &Row| r.ms, |r: &Row| r.fragments.map(|n| n as f64));
    let rmse = |r: &Row| r.model.map(|e| e.rmse);
    let scans = ["bumpy", "igea", "lion"];
    let mixed = ["horizon", "zone plate"];
    add(
        "G06: adjusting splats costs nothing at the fragments (time, adjust over none)",
        ratio(&scans, ("filter", "adjust"), ("filter", "none"), &ms),
    );
    add("the same, fragments", ratio(&scans, ("filter", "adjust"), ("filter", "none"), &fragments));
    add(
        "G06: adjust is closer to the truth than clamp where magnified and minified meet (error, adjust over clamp)",
        ratio(&mixed, ("filter", "adjust"), ("filter", "clamp"), &rmse),
    );
    add("the same against ewa (error, adjust over ewa)", ratio(&mixed, ("filter", "adjust"), ("filter", "ewa"), &rmse));
    add(
        "B05: clamping triples fragments (clamp, c 1, h 1.41 px over none, c 2)",
        ratio(&scans, ("papers", "clamp, c 1, h 1.41 px (B05)"), ("filter", "none"), &fragments),
    );
    add(
        "the same with our h and c (clamp over none)",
        ratio(&scans, ("filter", "clamp"), ("filter", "none"), &fragments),
    );
    add(
        "B05: deferred shading is nearly free (time, phong over normals alone)",
        ratio(&scans, (DEFAULT, DEFAULT), ("shader", "normal"), &ms),
    );
    add(
        "B05: 16-bit storage is invisible (error, 16 over 32 bits)",
        ratio(&["ball", "bumpy", "igea", "lion"], ("storage", "16 bits"), (DEFAULT, DEFAULT), &rmse),
    );
    add(
        "Z01: cutoff 1 suffices (error, 1 over 2)",
        ratio(&["horizon", "zone plate", "ball"], ("cutoff", "1"), (DEFAULT, DEFAULT), &rmse),
    );
    add(
        "C12: clipping keeps the frame rate (time, clipped over off)",
        ratio(&["cylinder", "fandisk"], (DEFAULT, DEFAULT), ("clip", "off"), &ms),
    );
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(cost: f64, error: f64, name: &str) -> Value {
        Value {
            knob: "k".into(),
            value: name.into(),
            cost: Some(cost),
            error: Some(error),
            inside: None,
            fragments: None,
            bytes: None,
            fidelity_db: None,
            worst: None,
            dominated_by: None,
        }
    }

    #[test]
    fn a_value_is_dominated_by_one_that_is_no_worse_and_clearly_better_in_something() {
        let base = value(1.0, 1.0, "base");
        assert!(dominates(&base, &value(1.3, 1.0, "slower")));
        assert!(dominates(&base, &value(1.0, 1.5, "worse")));
        assert!(!dominates(&base, &value(1.01, 1.0, "noise")));
        assert!(!dominates(&base, &value(0.8, 1.5, "a trade")));
        let sharp = Value { inside: Some(0.8), ..value(1.1, 1.1, "better inside") };
        assert!(!dominates(&Value { inside: Some(1.0), ..base.clone() }, &sharp));
        assert!(!dominates(&value(0.5, 0.5, "base"), &base), "itself");
    }
}
