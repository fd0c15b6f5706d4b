//! Report as a table on the terminal.

use super::{Entry, Sum};
use std::fmt::Write;

const HEAD: [&str; 7] =
    ["backend", "scenes", "worst plane", "of tolerance", "outliers outside", "inside margin", "result"];

/// Returns the descriptions of all failures, then a table with a row per backend, failed ones first.
///
/// Outliers are pixels with an error above the tolerance, in all scenes.
pub fn table(entries: &[Entry]) -> String {
    let mut text = String::new();
    for entry in entries {
        let Entry::Ran(run) = entry else { continue };
        for checked in run.checked.iter().filter(|c| !c.report.is_ok()) {
            // Writing to a string can't fail.
            let _ = writeln!(text, "{} on {}: {}\n", run.info.backend, run.info.adapter, checked.report);
        }
    }
    let mut sorted: Vec<&Entry> = entries.iter().collect();
    sorted.sort_by_key(|entry| entry.is_ok());
    let rows: Vec<[String; 7]> =
        std::iter::once(HEAD.map(str::to_owned)).chain(sorted.iter().map(|e| row(e))).collect();
    let widths: [usize; 7] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    for row in &rows {
        let cells: Vec<String> = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}")).collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    for entry in &sorted {
        let line = match entry {
            Entry::Ran(run) => {
                let note = run.note.as_ref().map(|note| format!("; {note}")).unwrap_or_default();
                format!("{}: {} ({}){note}", run.info.backend, run.info.adapter, run.info.driver)
            }
            Entry::Absent(_, why) => format!("skipped: {}: {why}", entry.backend()),
            Entry::Missing(_, why) => format!("SURFEL_REQUIRE asks for {}, but: {why}", entry.backend()),
        };
        text.push_str(&line);
        text.push('\n');
    }
    text
}

fn row(entry: &Entry) -> [String; 7] {
    let backend = entry.backend().to_owned();
    let result = |word: &str| word.to_owned();
    let none = || "-".to_owned();
    let run = match entry {
        Entry::Ran(run) => run,
        Entry::Absent(..) => return [backend, none(), none(), none(), none(), none(), result("skipped")],
        Entry::Missing(..) => return [backend, none(), none(), none(), none(), none(), result("FAILED")],
    };
    let sum = Sum::of(run);
    let worst = sum.worst.and_then(|report| Some((report, report.worst_plane()?)));
    let place = worst.map_or_else(none, |(report, plane)| format!("{} of {}", plane.plane.name(), report.name));
    let share = worst.map_or_else(none, |(_, plane)| format!("{:.3}", plane.worst));
    let word = if run.is_ok() { "passed" } else { "FAILED" };
    [backend, sum.scenes(), place, share, sum.outliers.to_string(), sum.forgiven.to_string(), result(word)]
}
