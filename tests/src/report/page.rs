//! Report as an HTML page in one file, with embedded images.

use super::{Entry, Sum, word};
use crate::harness::{ABSOLUTE, Checked, MAX_FORGIVEN_FRACTION, RELATIVE, Report, Truth, Verdict, pixel_errors};
use std::io;
use surfel_bench::page::{Page, Table};
use surfel_io::{PlanesView, PngOptions, write_png};
use surfel_metrics::{CompareOptions, Image, compare};
use surfel_render::Frame;

/// Returns a self-contained HTML page with the results of all backends (`entries`) for each scene of `truths`. Scenes
/// that failed come first, then expected failures, then the others, each in the order of `truths`.
///
/// # Errors
/// [`io::Error`] if an image can't be encoded.
pub fn page(entries: &[Entry], truths: &[Truth]) -> io::Result<String> {
    let ok = entries.iter().all(Entry::is_ok);
    let mut page = Page::new(&format!("Conformance: {}", if ok { "passed" } else { "FAILED" }));
    page.table(&summary(entries));
    page.paragraph(&format!(
        "Tolerance: {ABSOLUTE} + {RELATIVE}·|reference| in linear values, of Z times the median |Z|. An outlier is a \
         pixel beyond it; it is forgiven where a decision of the model is within its margin (white in the margin's \
         image), for at most {} % of an image. A difference shows the share of the tolerance in the plane that is \
         farthest off: black 0, white all of it, red more, blue more but within the margin. A backend's colours are \
         shown over grey.",
        100.0 * MAX_FORGIVEN_FRACTION
    ));
    for entry in entries {
        let Entry::Ran(run) = entry else { continue };
        // Results without a scene are unused expectations and messages of validation layers.
        for checked in run.checked.iter().skip(truths.len()) {
            page.failed_section(run.info.backend);
            page.preformatted(&checked.report.to_string());
        }
    }
    let rank = |index: &usize| results(entries, *index).map(|(_, c)| severity(&c.report)).min();
    let mut order: Vec<usize> = (0..truths.len()).collect();
    order.sort_by_key(rank);
    for index in order {
        scene(&mut page, &truths[index], &results(entries, index).collect::<Vec<_>>())?;
    }
    Ok(page.html())
}

/// Returns the results of all backends for the truth with index `truth`, with the backends' names.
fn results(entries: &[Entry], truth: usize) -> impl Iterator<Item = (&'static str, &Checked)> {
    entries.iter().filter_map(move |entry| match entry {
        Entry::Ran(run) => Some((run.info.backend, run.checked.get(truth)?)),
        Entry::Absent(..) | Entry::Missing(..) => None,
    })
}

/// Returns the key by which the page sorts scenes; failures have the smallest, so that they come first.
fn severity(report: &Report) -> u8 {
    match report.verdict {
        Verdict::Failed(_) => 0,
        Verdict::Expected(_) => 1,
        Verdict::Passed | Verdict::Skipped(_) => 2,
    }
}

fn summary(entries: &[Entry]) -> Table {
    let head = ["backend", "adapter", "scenes", "worst plane", "of tolerance", "outliers outside", "inside", "result"];
    let mut table = Table::new(&head);
    for entry in entries {
        let mut row = vec![entry.backend().to_owned()];
        match entry {
            Entry::Ran(run) => {
                let sum = Sum::of(run);
                let worst = sum.worst.and_then(|report| Some((report, report.worst_plane()?)));
                let note = run.note.as_deref().unwrap_or_default();
                row.push(format!("{} ({}) {note}", run.info.adapter, run.info.driver).trim_end().to_owned());
                row.push(sum.scenes());
                row.push(worst.map_or(String::new(), |(r, plane)| format!("{} of {}", plane.plane.name(), r.name)));
                row.push(worst.map_or(String::new(), |(_, plane)| format!("{:.3}", plane.worst)));
                row.extend([sum.outliers.to_string(), sum.forgiven.to_string()]);
                row.push(if run.is_ok() { "passed" } else { "FAILED" }.to_owned());
            }
            Entry::Absent(_, why) => row.extend([why.clone(), "skipped".to_owned()]),
            Entry::Missing(_, why) => {
                row.extend([format!("SURFEL_REQUIRE asks for it, but: {why}"), "FAILED".to_owned()]);
            }
        }
        if !entry.is_ok() {
            table.marked.push((table.rows.len(), false));
        }
        table.rows.push(row);
    }
    table
}

fn scene(page: &mut Page, truth: &Truth, results: &[(&'static str, &Checked)]) -> io::Result<()> {
    if results.iter().all(|(_, c)| c.report.is_ok()) {
        page.section(&truth.case.name);
    } else {
        page.failed_section(&truth.case.name);
    }
    if let Ok(want) = &truth.want {
        image(page, "reference", want, want.color())?;
        let margin: Vec<[f32; 4]> = want.margin().iter().map(|&m| [m, m, m, 1.0]).collect();
        let share = results.first().map_or(0.0, |(_, c)| c.report.margin_share);
        image(page, &format!("margin, {:.2} %", 100.0 * share), want, &margin)?;
        for (backend, checked) in results {
            let is_comparable = |got: &&Frame| (got.width(), got.height()) == (want.width(), want.height());
            let Some(got) = checked.got.as_ref().filter(is_comparable) else { continue };
            image(page, backend, got, got.color())?;
            image(page, &format!("{backend}, difference"), want, &difference(got, want))?;
        }
    }
    let head = ["backend", "result", "plane", "of tolerance", "at", "got", "want", "outliers outside", "inside"];
    let mut table = Table::new(&[&head[..], &["PSNR, FLIP"]].concat());
    for (backend, checked) in results {
        let report = &checked.report;
        let verdict = match &report.verdict {
            Verdict::Passed => word(&report.verdict).to_owned(),
            Verdict::Expected(why) | Verdict::Skipped(why) | Verdict::Failed(why) => {
                format!("{}: {why}", word(&report.verdict))
            }
        };
        let metrics = metrics(checked.got.as_ref(), truth.want.as_ref().ok());
        if !report.is_ok() {
            table.marked.extend((table.rows.len()..table.rows.len() + report.planes.len().max(1)).map(|i| (i, false)));
        }
        if report.planes.is_empty() {
            table.rows.push(vec![(*backend).to_owned(), verdict.clone()]);
        }
        for p in &report.planes {
            let mut row = vec![(*backend).to_owned(), verdict.clone(), p.plane.name().to_owned()];
            row.extend([format!("{:.4}", p.worst), format!("{}, {}", p.at[0], p.at[1])]);
            row.extend([p.values[0], p.values[1]].map(|value| value.to_string()));
            row.extend([p.outliers.to_string(), report.forgiven.to_string(), metrics.clone()]);
            table.rows.push(row);
        }
    }
    page.table(&table);
    Ok(())
}

/// Returns the PSNR and FLIP of the colours as text. They are for information and don't affect the verdict.
fn metrics(got: Option<&Frame>, want: Option<&Frame>) -> String {
    fn image(frame: &Frame) -> Option<Image<'_>> {
        Image::new(frame.width(), frame.height(), frame.color().as_flattened()).ok()
    }
    let compared = || compare(&image(got?)?, &image(want?)?, &CompareOptions::default()).ok();
    compared().map_or_else(String::new, |c| format!("{:.1} dB, {:.5}", c.psnr, c.flip_mean.unwrap_or(f64::NAN)))
}

/// Returns an image of the errors: grey up to the tolerance (white), red beyond it, and blue beyond it within a
/// decision margin.
fn difference(got: &Frame, want: &Frame) -> Vec<[f32; 4]> {
    let color = |(&error, &margin): (&f64, &f32)| match (error > 1.0, margin != 0.0) {
        (false, _) => [error as f32, error as f32, error as f32, 1.0],
        (true, false) => [1.0, 0.0, 0.0, 1.0],
        (true, true) => [0.1, 0.2, 1.0, 1.0],
    };
    pixel_errors(got, want).iter().zip(want.margin()).map(color).collect()
}

fn image(page: &mut Page, caption: &str, frame: &Frame, color: &[[f32; 4]]) -> io::Result<()> {
    let planes =
        PlanesView { width: frame.width(), height: frame.height(), color: Some(color), ..PlanesView::default() };
    let mut png = Vec::new();
    write_png(&mut png, &planes, &PngOptions::default())?;
    page.image(caption, &png);
    Ok(())
}
