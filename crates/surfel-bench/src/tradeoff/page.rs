//! Page of the trade-off measurements: recommendations, costs, and errors of images.

use crate::chart::{Axis, Chart, Series, Style};
use crate::page::Page;

use super::Findings;
use super::figures::Figures;
use super::variants::DEFAULT;
use super::verdict;

/// Returns the page as a self-contained HTML file.
pub(crate) fn page(findings: &Findings) -> String {
    let mut page = Page::new("Speed against accuracy");
    introduction(&mut page, &findings.figures);
    settings(&mut page, findings);
    options(&mut page, findings);
    light(&mut page, findings);
    other_backends(&mut page, findings);
    subjects(&mut page, &findings.figures);
    errors(&mut page, &findings.figures);
    page.html()
}

/// Writes the introduction: what is compared, and on which machine.
fn introduction(page: &mut Page, figures: &Figures) {
    page.paragraph(
        "Surfel draws surfaces as overlapping disks (splats). Its settings trade speed for accuracy. Each image below \
         was drawn with one setting changed and all others as they are by default, timed, and compared twice.",
    );
    page.paragraph(
        "Fidelity is the backend against the f64 reference at the same settings: what single precision and fast code \
         cost. Model error is the image against what it approximates: the surface itself where it has a closed form, \
         else the exact, unfiltered splats with many samples a pixel. The two are never mixed.",
    );
    let machine = &figures.machine;
    let load = machine.load.map_or_else(|| "unknown".to_owned(), |load| format!("{load:.1}"));
    page.paragraph(&format!(
        "{} ({}), one thread of {}, {}x{} pixels, commit {}, load {load}. Times are medians of {} frames drawn in turn \
         with all others, on the CPU's own clock; differences of 3 % are noise.",
        figures.backend.name,
        figures.backend.adapter,
        machine.cpu,
        figures.size[0],
        figures.size[1],
        machine.commit,
        figures.runs
    ));
    if !figures.left_out.is_empty() {
        page.paragraph(&format!("Left out: {}.", figures.left_out.join("; ")));
    }
}

/// Writes the sections on presets, settings, and claims of papers.
fn settings(page: &mut Page, findings: &Findings) {
    let Findings { figures, values, .. } = findings;
    page.section("Which preset?");
    page.paragraph(
        "A preset is a named choice of settings. Times and errors are over the defaults', geometric means over the \
         subjects. The PSNR of the subject that has least, and what the preset promises; a red row breaks its promise. \
         'From preset reference' compares two images by the reference: fidelity has no part in it.",
    );
    page.table(&verdict::presets(figures));
    page.section("Which setting?");
    page.paragraph(
        "Over the default's: time, model error (RMSE) of whole images and without rims, fragments and memory, \
         geometric means over the subjects. A red row is dominated: the named value of the same knob is at least as \
         fast and as accurate, and clearly better in something.",
    );
    page.table(&verdict::settings(values));
    page.heading("Level of detail");
    page.table(&verdict::levels_of_detail(values));
    page.section("What the papers claim");
    page.table(&verdict::claims(figures));
}

/// Writes the sections on the costs of features, planes and options, and of formulas that no option selects.
fn options(page: &mut Page, findings: &Findings) {
    let Findings { features, planes, formulas, textures, scans, normals, .. } = findings;
    page.section("What a scene's features cost");
    page.paragraph(&format!(
        "Each feature alone, added to {} white, unlit, opaque disks. Passes, sums (what is added up for a pixel, four \
         bytes each), and what a GPU has for it (textures drawn into, their bytes a pixel, shaders that run) are the \
         frame plan's; bytes a splat and milliseconds are measured. A green row has a feature that is absent: asked \
         for and not in the scene, or in the scene and left out by the settings. Its plan is the plain one, which is \
         tested, and its cost is none. GPUs have no A-buffer.",
        super::features::SPLATS
    ));
    page.table(features);
    page.section("What planes cost, and how exact they are");
    page.paragraph(
        "Each plane of an image beside color alone, of the subject 'ball' and of Gaussians: its bytes a pixel, the \
         time over that of color alone, the largest error against the f64 reference outside of pixels that hang on \
         rounding, and the RMS against the sphere in closed form.",
    );
    page.table(planes);
    page.section("What a texture's fit costs and gains");
    page.paragraph(
        "A ball of 40,000 splats takes the colours of its polygons in the three ways of --texture. Times are of the \
         conversion, on all threads; errors are of unlit images against the polygons, 4x4 samples a pixel: close, \
         where a splat is many pixels, and of the whole ball.",
    );
    page.table(textures);
    page.section("What the options of points cost and gain");
    page.paragraph(
        "200,000 points of the bumpy ball, off it by a fifth of their spacing, one in 500 of them a stray; against its \
         polygons. Holes are pixels of the ball that stay empty, of all its pixels.",
    );
    page.table(scans);
    page.section("What is no setting, and why");
    page.paragraph(
        "The kernel e^(−2ρ²), which weighs a splat at a pixel, and the reciprocal that perspective needs are computed \
         for every splat at every pixel it covers. Other ways to compute them, over 2048 numbers in cache, against \
         f64: no setting chooses between them, since the one that is used is the fastest whose error no image shows. \
         The third column is the largest error of a weight that follows; 3e-5 of white is 90 dB, which presets \
         promise.",
    );
    page.table(formulas);
    page.paragraph(
        "Normals have no setting of their own: they are kept as the splats are, in 32 or 16 bits (the setting \
         'storage'), in the least memory whose error no image shows. Largest angles over 40,000 directions; a lit \
         colour changes by no more than the angle in radians, and a step of 8-bit colour is 4e-3.",
    );
    page.table(normals);
}

/// Writes the section on the cost and error of stored light.
fn light(page: &mut Page, findings: &Findings) {
    page.section("Light of a sky");
    page.paragraph(
        "Light on a floor below a ball of 6000 disks, against the closed form of the ball's form factor. The first row \
         is the default; 'light-directions' sets the number of directions. Times are those of storing the light, once \
         for all images.",
    );
    page.table(&findings.light);
}

/// Writes the sections on the fidelity of the other backends.
fn other_backends(page: &mut Page, findings: &Findings) {
    for (backend, table) in &findings.others {
        page.section(&format!("Fidelity of {} ({})", backend.name, backend.adapter));
        let software = if backend.is_software {
            " This is software Vulkan: the CPU computes what a graphics card would, so that errors are those of \
             shaders in single precision, and times say nothing about graphics cards."
        } else {
            ""
        };
        page.paragraph(&format!(
            "The same scenes at {0}x{0} pixels on this backend, against the f64 reference at the same settings, \
             outside of pixels that hang on rounding; model error and time over this backend's default.{software}",
            super::OTHERS_SIZE
        ));
        page.table(table);
    }
}

/// Writes the section with a chart per subject.
fn subjects(page: &mut Page, figures: &Figures) {
    page.section("Subjects");
    page.paragraph(
        "A point is a setting, all others being the defaults': to the left is faster, below is closer to the truth. \
         The line is the front, which nothing beats in both. Labels that would cover something are left out; the table \
         below has every number. An error below the chart lies on its lower edge. What the backend doesn't draw has an \
         error (by the reference) and no time.",
    );
    for subject in &figures.subjects {
        page.heading(&subject.name);
        page.paragraph(&format!("{} ({} splats). Truth: {}.", subject.about, subject.splats, subject.truth));
        let chart = chart(figures, &subject.name);
        // A chart that has only the Pareto front has two series.
        if chart.series.len() > 2 {
            page.chart(&chart);
        }
    }
}

/// Writes the section on the model errors of all subjects.
fn errors(page: &mut Page, figures: &Figures) {
    page.section("Model errors (RMSE)");
    page.table(&verdict::errors(figures, |r| r.model));
    page.section("Model errors without rims (RMSE)");
    page.paragraph(
        "Of pixels that the truth covers wholly, as their eight neighbours are. A filter makes every silhouette wider \
         by up to its radius, which outweighs all else in whole images; what it is for shows here.",
    );
    page.table(&verdict::errors(figures, |r| r.model_inside));
}

/// Index of black in the palette.
const BLACK: usize = 7;

/// Largest ratio of a chart's largest error to the smallest error that its axis shows; smaller errors are drawn at the
/// end of the axis. Without this limit, a nearly perfect variant would compress the range of all others.
const MAX_RANGE: f64 = 100.0;

/// Returns a chart of time against model error, with the Pareto front. Each variant that has a time and a model error
/// is a point, except variants of the setting `shader`.
fn chart(figures: &Figures, subject: &str) -> Chart {
    let rows = figures.rows.iter().filter(|r| r.subject == subject && r.knob != "shader");
    let points = rows.filter_map(|r| Some((r.knob.as_str(), r.value.as_str(), [r.ms?, r.model?.rmse])));
    let points: Vec<(&str, &str, [f64; 2])> = points.collect();
    let mut groups: Vec<&str> = Vec::new();
    for (knob, ..) in &points {
        if !groups.contains(knob) {
            groups.push(knob);
        }
    }
    let mut front: Vec<[f64; 2]> = points.iter().map(|p| p.2).collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut least = f64::INFINITY;
    front.retain(|p| {
        let better = p[1] < least;
        least = least.min(p[1]);
        better
    });
    let mut series = vec![Series::new("front", Style::Steps, 6, front)];
    // The default comes last, so that it is drawn on top of all others.
    groups.retain(|knob| *knob != DEFAULT);
    groups.push(DEFAULT);
    for (color, knob) in groups.iter().enumerate() {
        let of_knob = || points.iter().filter(|p| p.0 == *knob);
        // The setting of a paper is labelled by the name of the paper. A value that is meaningless alone is labelled
        // with its setting.
        let label = |p: &(&str, &str, [f64; 2])| match (p.1.split_once('('), p.1) {
            (Some((_, name)), _) => name.trim_end_matches(')').to_owned(),
            (None, "on") => "edges".to_owned(),
            (None, "off" | "paper" | "line") => format!("{} {}", p.0, p.1),
            (None, value) => value.to_owned(),
        };
        let is_default = *knob == DEFAULT;
        series.push(Series {
            name: (*knob).to_owned(),
            style: Style::Points,
            // Black is used only for the default.
            color: if is_default { BLACK } else { color + usize::from(color >= BLACK) },
            points: of_knob().map(|p| p.2).collect(),
            labels: of_knob().map(label).collect(),
        });
    }
    let most = points.iter().map(|p| p.2[1]).fold(0.0, f64::max);
    let least = points.iter().map(|p| p.2[1]).fold(f64::INFINITY, f64::min);
    let error = Axis::new("model error, RMSE of linear colour (1 = white)");
    let y = if least < most / MAX_RANGE { error.over([most / MAX_RANGE, 1.1 * most]) } else { error };
    Chart {
        title: format!("{subject}: time against model error"),
        x: Axis::new("milliseconds a frame, one thread"),
        y,
        series,
        shaded: None,
    }
}
