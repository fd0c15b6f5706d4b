//! The page: one file, pictures inside.

use super::{Entry, Sum, word};
use crate::harness::{ABSOLUTE, Checked, FORGIVEN_SHARE, RELATIVE, Report, Truth, Verdict, pixel_errors};
use std::fmt::Write;
use std::io;
use surfel_io::{PlanesView, PngOptions, write_png};
use surfel_metrics::{CompareOptions, Image, compare};
use surfel_render::Frame;

const STYLE: &str = "\
body{font:14px/1.4 sans-serif;margin:2em;background:#fff;color:#111}\
table{border-collapse:collapse;margin:.6em 0}td,th{border:1px solid #ccc;padding:.1em .6em;text-align:left}\
td.n{text-align:right;font-variant-numeric:tabular-nums}\
section{border-top:1px solid #ccc}section.FAILED{border-left:.5em solid #c00;padding-left:1em}\
figure{display:inline-block;margin:.2em .8em .2em 0}figcaption{font-size:12px}\
img{width:192px;image-rendering:pixelated;background:#888}.FAILED b{color:#c00}";

/// A self-contained page about what backends made of scenes: failures first, then as the scenes come.
///
/// # Errors
/// [`io::Error`] if a picture can't be encoded.
pub fn page(entries: &[Entry], truths: &[Truth]) -> io::Result<String> {
    let mut page = String::from("<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Conformance</title>");
    let ok = entries.iter().all(Entry::is_ok);
    // Writing to a string can't fail, here and below.
    let _ = write!(page, "<style>{STYLE}</style><h1>Conformance: {}</h1>", if ok { "passed" } else { "FAILED" });
    summary(&mut page, entries);
    let _ = write!(
        page,
        "<p>Tolerance: {ABSOLUTE} + {RELATIVE}·|reference| in linear values, of Z times the median |Z|. An outlier is a \
         pixel beyond it; it is forgiven where a decision of the model is within its margin (white in the margin's \
         picture), for at most {} % of a picture. A difference shows the share of the tolerance in the plane that is \
         farthest off: black 0, white all of it, red more, blue more but within the margin. A backend's colours are shown \
         over grey.</p>",
        100.0 * FORGIVEN_SHARE
    );
    for entry in entries {
        let Entry::Ran(run) = entry else { continue };
        // What has no scene: expectations that nothing needed, messages of validation layers.
        for checked in run.checked.iter().skip(truths.len()) {
            let text = escape(&checked.report.to_string());
            let _ = write!(page, "<section class=\"FAILED\"><h2>{}</h2><pre>{text}</pre></section>", run.info.backend);
        }
    }
    let rank = |index: &usize| results(entries, *index).map(|(_, c)| severity(&c.report)).min();
    let mut order: Vec<usize> = (0..truths.len()).collect();
    order.sort_by_key(rank);
    for index in order {
        scene(&mut page, &truths[index], &results(entries, index).collect::<Vec<_>>())?;
    }
    page.push_str("</html>\n");
    Ok(page)
}

/// What backends made of a scene, with their names.
fn results(entries: &[Entry], truth: usize) -> impl Iterator<Item = (&'static str, &Checked)> {
    entries.iter().filter_map(move |entry| match entry {
        Entry::Ran(run) => Some((run.info.backend, run.checked.get(truth)?)),
        Entry::Absent(..) | Entry::Missing(..) => None,
    })
}

/// Its place on the page.
fn severity(report: &Report) -> u8 {
    match report.verdict {
        Verdict::Failed(_) => 0,
        Verdict::Expected(_) => 1,
        Verdict::Passed | Verdict::Skipped(_) => 2,
    }
}

fn summary(page: &mut String, entries: &[Entry]) {
    page.push_str("<table><tr><th>backend<th>adapter<th>scenes<th>worst plane<th>of tolerance<th>outliers outside");
    page.push_str("<th>inside margin<th>result</tr>");
    for entry in entries {
        let result = if entry.is_ok() { "passed" } else { "FAILED" };
        let _ = write!(page, "<tr class=\"{result}\"><td>{}", entry.backend());
        match entry {
            Entry::Ran(run) => {
                let sum = Sum::of(run);
                let adapter = escape(&format!("{} ({})", run.info.adapter, run.info.driver));
                let note = run.note.as_deref().map(escape).unwrap_or_default();
                let _ = write!(page, "<td>{adapter} {note}<td>{}", sum.scenes());
                match sum.worst.and_then(|report| Some((report, report.worst_plane()?))) {
                    Some((report, plane)) => {
                        let place = escape(&format!("{} of {}", plane.plane.name(), report.name));
                        let _ = write!(page, "<td>{place}<td class=\"n\">{:.3}", plane.worst);
                    }
                    None => page.push_str("<td><td>"),
                }
                let _ = write!(page, "<td class=\"n\">{}<td class=\"n\">{}", sum.outliers, sum.forgiven);
                let _ = write!(page, "<td><b>{result}</b></tr>");
            }
            Entry::Absent(_, why) => {
                let _ = write!(page, "<td colspan=\"6\">{}<td>skipped</tr>", escape(why));
            }
            Entry::Missing(_, why) => {
                let why = escape(why);
                let _ = write!(page, "<td colspan=\"6\">SURFEL_REQUIRE asks for it, but: {why}<td><b>FAILED</b></tr>");
            }
        }
    }
    page.push_str("</table>");
}

fn scene(page: &mut String, truth: &Truth, results: &[(&'static str, &Checked)]) -> io::Result<()> {
    let is_ok = results.iter().all(|(_, c)| c.report.is_ok());
    let class = if is_ok { "passed" } else { "FAILED" };
    let _ = write!(page, "<section class=\"{class}\"><h2>{}</h2>", escape(&truth.case.name));
    if let Ok(want) = &truth.want {
        figure(page, "reference", want, &want.color)?;
        let margin: Vec<[f32; 4]> = want.margin.iter().map(|&m| [m, m, m, 1.0]).collect();
        let share = results.first().map_or(0.0, |(_, c)| c.report.margin_share);
        figure(page, &format!("margin, {:.2} %", 100.0 * share), want, &margin)?;
        for (backend, checked) in results {
            let Some(got) = checked.got.as_ref().filter(|got| (got.width, got.height) == (want.width, want.height))
            else {
                continue;
            };
            figure(page, backend, got, &got.color)?;
            figure(page, &format!("{backend}, difference"), want, &difference(got, want))?;
        }
    }
    page.push_str("<table><tr><th>backend<th>result<th>plane<th>of tolerance<th>at<th>got<th>want");
    page.push_str("<th>outliers outside<th>inside margin<th>PSNR, FLIP</tr>");
    for (backend, checked) in results {
        let report = &checked.report;
        let why = match &report.verdict {
            Verdict::Passed => String::new(),
            Verdict::Expected(why) | Verdict::Skipped(why) | Verdict::Failed(why) => format!(": {}", escape(why)),
        };
        let rows = report.planes.len().max(1);
        let verdict = word(&report.verdict);
        let _ = write!(page, "<tr class=\"{verdict}\"><td rowspan=\"{rows}\">{backend}");
        let _ = write!(page, "<td rowspan=\"{rows}\"><b>{verdict}</b>{why}");
        if report.planes.is_empty() {
            page.push_str("<td colspan=\"8\"></tr>");
        }
        for (index, p) in report.planes.iter().enumerate() {
            page.push_str(if index == 0 { "" } else { "<tr>" });
            let _ = write!(page, "<td>{}<td class=\"n\">{:.4}<td>{}, {}", p.plane.name(), p.worst, p.at[0], p.at[1]);
            let _ = write!(page, "<td class=\"n\">{}<td class=\"n\">{}", p.values[0], p.values[1]);
            let _ = write!(page, "<td class=\"n\">{}", p.outliers);
            if index == 0 {
                let metrics = metrics(checked.got.as_ref(), truth.want.as_ref().ok());
                let _ = write!(page, "<td class=\"n\" rowspan=\"{rows}\">{}", report.forgiven);
                let _ = write!(page, "<td rowspan=\"{rows}\">{metrics}");
            }
            page.push_str("</tr>");
        }
    }
    page.push_str("</table></section>");
    Ok(())
}

/// PSNR and FLIP of the colours, for information: neither decides.
fn metrics(got: Option<&Frame>, want: Option<&Frame>) -> String {
    fn image(frame: &Frame) -> Option<Image<'_>> {
        Image::new(frame.width, frame.height, frame.color.as_flattened()).ok()
    }
    let compared = || compare(&image(got?)?, &image(want?)?, &CompareOptions::default()).ok();
    compared().map_or_else(String::new, |c| format!("{:.1} dB, {:.5}", c.psnr, c.flip_mean.unwrap_or(f64::NAN)))
}

/// The share of the tolerance, amplified to be seen.
fn difference(got: &Frame, want: &Frame) -> Vec<[f32; 4]> {
    let color = |(&error, &margin): (&f64, &f32)| match (error > 1.0, margin != 0.0) {
        (false, _) => [error as f32, error as f32, error as f32, 1.0],
        (true, false) => [1.0, 0.0, 0.0, 1.0],
        (true, true) => [0.1, 0.2, 1.0, 1.0],
    };
    pixel_errors(got, want).iter().zip(&want.margin).map(color).collect()
}

fn figure(page: &mut String, caption: &str, frame: &Frame, color: &[[f32; 4]]) -> io::Result<()> {
    let planes = PlanesView { width: frame.width, height: frame.height, color: Some(color), ..PlanesView::default() };
    let mut png = Vec::new();
    write_png(&mut png, &planes, &PngOptions::default())?;
    let caption = escape(caption);
    let data = base64(&png);
    let _ = write!(page, "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\">");
    let _ = write!(page, "<figcaption>{caption}</figcaption></figure>");
    Ok(())
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// RFC 4648, §4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |i: usize| u32::from(group.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let is_padding = digit > group.len();
            let value = (bits >> (18 - 6 * digit)) as usize & 63;
            text.push(if is_padding { '=' } else { char::from(DIGITS[value]) });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_the_rfcs_examples() {
        let pairs =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE=")];
        for (bytes, text) in pairs {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xbf]), "+/+/");
    }

    #[test]
    fn text_of_drivers_is_no_markup() {
        assert_eq!(escape("<a href=\"x\">&"), "&lt;a href=&quot;x&quot;&gt;&amp;");
    }
}
