//! Reports as text and Markdown.

use std::fmt::Write;

use crate::page::Table;

use crate::report::{FillRate, Report, Row};

/// Returns the whole report as text.
pub(crate) fn of(report: &Report) -> String {
    let mut text = String::new();
    let (machine, backend) = (&report.machine, &report.backend);
    let load = machine.load.map_or("unknown".to_owned(), |load| format!("{load:.1}"));
    let _ = writeln!(text, "machine   {}, {} threads, {}, load {load}", machine.cpu, machine.threads, machine.system);
    let software = if backend.is_software { " — software Vulkan: the CPU computes, this is no GPU" } else { "" };
    let _ = writeln!(text, "backend   {}: {} ({}){software}", backend.name, backend.adapter, backend.driver);
    let _ = writeln!(text, "commit    {}", machine.commit);
    if !report.fill_rates.is_empty() {
        let rate = |c: &FillRate| format!("{} {:.0}", c.name, c.fragments_per_s * 1e-6);
        let rates = report.fill_rates.iter().map(rate).collect::<Vec<_>>().join(", ");
        let _ = writeln!(text, "fill rates  Mfragments/s by empty shaders: {rates}");
    }
    text.push('\n');
    let head = [
        "scene", "thr", "median", "min ms", "busy ms", "splats", "Msplat/s", "drawn/s", "Mfrag/s", "fr/splat", "fr/px",
    ];
    let more = ["% blend", "% frame", "pairs M", "ns/pair", "B/splat", "MB", "+ MB", "GB/s", "stages, ms"];
    let mut lines = vec![head.iter().chain(&more).map(ToString::to_string).collect::<Vec<_>>()];
    lines.extend(report.rows.iter().map(line));
    text += &aligned(&lines);
    for note in shader_notes(&report.rows).into_iter().chain(scaling_note(&report.rows)) {
        let _ = writeln!(text, "{note}");
    }
    text
}

/// Returns the report as a Markdown file with a row per scene. The times of all numbers of threads are side by side.
pub(crate) fn markdown(report: &Report) -> String {
    let (machine, backend) = (&report.machine, &report.backend);
    let mut threads: Vec<usize> = report.rows.iter().map(|row| row.threads).collect();
    threads.sort_unstable();
    threads.dedup();
    let times = threads.iter().map(|n| format!("{n} thread{}, ms (least)", if *n == 1 { "" } else { "s" }));
    let head = ["scene", "", "splats", "drawn", "Mfragments", "Mpairs"].map(str::to_owned);
    let mut table = Table { head: head.into_iter().chain(times).collect(), ..Table::default() };
    let millions = |count: Option<f64>| count.map_or_else(|| "-".to_owned(), |n| format!("{:.2}", n * 1e-6));
    for (i, row) in report.rows.iter().enumerate() {
        if report.rows[..i].iter().any(|earlier| earlier.scene == row.scene) {
            continue;
        }
        let mut cells = vec![row.scene.clone(), row.about.clone(), row.splats.to_string(), row.drawn.to_string()];
        cells.extend([millions(row.fragments.map(|n| n as f64)), millions(row.block_pairs)]);
        cells.extend(threads.iter().map(|n| {
            let same = report.rows.iter().find(|other| other.scene == row.scene && other.threads == *n);
            same.map_or_else(|| "-".to_owned(), |row| format!("{:.1} ({:.1})", row.median_ms, row.min_ms))
        }));
        table.rows.push(cells);
    }
    format!(
        "<!-- Written by `cargo xtask bench --markdown FILE`. -->\n\n# Frame times\n\n\
         {}: {} on {}, {} threads, commit {}.\n\
         Medians and least times of a frame. A pair is a splat and a block of 4×4 pixels.\n\n{}",
        backend.name,
        backend.adapter,
        machine.cpu,
        machine.threads,
        machine.commit,
        table.markdown()
    )
}

fn line(row: &Row) -> Vec<String> {
    let number = |value: Option<f64>, scale: f64, digits: usize| {
        value.map_or("-".to_owned(), |value| format!("{:.digits$}", value * scale))
    };
    let stages = row.stages_ms.iter().map(|(name, ms)| format!("{name} {ms:.1}"));
    vec![
        row.scene.clone(),
        row.threads.to_string(),
        format!("{:.2}", row.median_ms),
        format!("{:.2}", row.min_ms),
        number(row.busy_ms, 1.0, 2),
        row.splats.to_string(),
        number(Some(row.splats_per_s), 1e-6, 1),
        number(Some(row.drawn_per_s), 1e-6, 1),
        number(row.fragments_per_s, 1e-6, 0),
        number(row.fragments_per_splat, 1.0, 1),
        number(row.fragments_per_px, 1.0, 1),
        number(row.share_of_blend, 1e2, 1),
        number(row.frame_share_of_blend, 1e2, 1),
        number(row.block_pairs, 1e-6, 2),
        number(row.ns_per_pair, 1.0, 1),
        number(Some(row.bytes_per_splat), 1.0, 1),
        number(Some(row.resident_mb), 1.0, 1),
        number(row.batch_mb, 1.0, 1),
        number(row.gb_per_s, 1.0, 1),
        stages.collect::<Vec<_>>().join(", "),
    ]
}

/// Formats rows of cells as columns with the width of their widest cell. The first and the last column are
/// left-aligned, the others right-aligned.
pub(crate) fn aligned(lines: &[Vec<String>]) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let width = |i: usize| lines.iter().filter_map(|line| line.get(i)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|i| width(i).unwrap_or(0)).collect();
    let mut text = String::new();
    for line in lines {
        for (i, cell) in line.iter().enumerate() {
            let width = widths[i];
            let _ = match i {
                0 => write!(text, "{cell:width$}"),
                i if i + 1 == columns => write!(text, "  {cell}"),
                _ => write!(text, "  {cell:>width$}"),
            };
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

/// Returns the CPU time if it is known, else the wall-clock time, in milliseconds. Differences between shaders are
/// smaller than the noise of wall-clock times on a shared machine.
fn cost(row: &Row) -> f64 {
    row.busy_ms.unwrap_or(row.median_ms)
}

/// Returns a note per scene of the shader `phong` on its time relative to the shaders `normal` and `unlit`. The scenes
/// of those shaders have its name with `-normal` and `-unlit`; without both, there is no note.
fn shader_notes(rows: &[Row]) -> Vec<String> {
    let phong = rows.iter().filter(|row| row.shader == "phong");
    let notes = phong.filter_map(|phong| {
        let other = |shader: &str| {
            let name = format!("{}-{shader}", phong.scene);
            rows.iter().find(|row| row.scene == name && row.threads == phong.threads)
        };
        let (normal, unlit) = (other("normal")?, other("unlit")?);
        Some(format!(
            "{}, {} threads: phong over normal {:.3}, over unlit {:.3}",
            phong.scene,
            phong.threads,
            cost(phong) / cost(normal),
            cost(phong) / cost(unlit)
        ))
    });
    notes.collect()
}

/// Returns a note on the speed-up of two threads over one, in the scenes that were measured with both; `None` if there
/// are none.
fn scaling_note(rows: &[Row]) -> Option<String> {
    let gains = rows.iter().filter(|row| row.threads == 1).filter_map(|one| {
        let two = rows.iter().find(|row| row.scene == one.scene && row.threads == 2)?;
        Some(format!("{} {:.2}", one.scene, one.median_ms / two.median_ms))
    });
    let gains: Vec<String> = gains.collect();
    (!gains.is_empty()).then(|| format!("two threads over one: {}", gains.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Machine;
    use crate::report::{BackendFacts, Samples, Subject};

    #[test]
    fn markdown_has_a_row_a_scene_and_a_column_a_thread_count() {
        let row = |scene: &str, threads: usize, frames_ms: Vec<f64>| {
            let subject = Subject {
                scene: scene.into(),
                about: "what it is".into(),
                shader: "phong".into(),
                threads,
                size: [8, 8],
            };
            Row::new(subject, Samples { frames_ms, ..Samples::default() })
        };
        let rows = vec![row("a", 1, vec![2.0, 3.0, 9.0]), row("a", 2, vec![1.5]), row("b", 1, vec![4.0])];
        let facts =
            BackendFacts { name: "cpu".into(), adapter: "AVX2".into(), driver: String::new(), is_software: false };
        let text = markdown(&Report::new(Machine::this(), facts, Vec::new(), rows));
        assert!(text.contains("| Mpairs | 1 thread, ms (least) | 2 threads, ms (least) |"), "{text}");
        assert!(text.contains("| a | what it is | 0 | 0 | - | - | 3.0 (2.0) | 1.5 (1.5) |"), "{text}");
        assert!(text.contains("| b | what it is | 0 | 0 | - | - | 4.0 (4.0) | - |"), "{text}");
    }

    #[test]
    fn table_columns_line_up() {
        let line = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
        let text = aligned(&[line(["a", "time", "note"]), line(["long", "1", "x"])]);
        assert_eq!(text, "a     time  note\nlong     1  x\n");
    }
}
