//! Measurement of the time of whole commands, from their start to their result.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use crate::machine::Machine;
use crate::page::Table;
use crate::{Failure, clouds};

/// Times the program `surfel` as a whole, from its start to its end, and prints a table.
///
/// The time includes reading, preparing, drawing and writing. Runs alternate between the inputs, so that disturbances
/// of the machine affect all equally.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Build of the program; default: the one of this workspace.
    #[arg(long, value_name = "FILE", default_value = "target/release/surfel")]
    program: PathBuf,
    /// Folder of the model igea.ply; without the file its row is skipped.
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    models: PathBuf,
    /// Number of runs; the fastest one counts.
    #[arg(long, value_name = "N", default_value_t = 5)]
    runs: usize,
    /// Write the table to a Markdown file, replacing it; docs/data/start.md is made so.
    #[arg(long, value_name = "FILE.md")]
    markdown: Option<PathBuf>,
}

/// Command that is timed.
struct Row {
    name: String,
    words: Vec<PathBuf>,
    /// Shortest wall-clock time of all runs, in seconds.
    best: f64,
    /// Sum of the CPU times of all runs, in seconds; `None` if the system doesn't report them.
    busy: Option<f64>,
}

impl Row {
    fn new(name: &str, words: &[&Path]) -> Self {
        let words = words.iter().map(|word| word.to_path_buf()).collect();
        Self { name: name.to_owned(), words, best: f64::INFINITY, busy: Some(0.0) }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("surfel-start-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let machine = Machine::this();
    let result = time_all(arguments, &folder);
    std::fs::remove_dir_all(&folder)?;
    let rows = result?;
    print!("{}", table(&rows, arguments.runs).text());
    if let Some(path) = &arguments.markdown {
        let text = markdown(&machine, &rows, arguments.runs);
        surfel_io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
        println!("\nwritten to {}", path.display());
    }
    Ok(())
}

fn time_all(arguments: &Arguments, folder: &Path) -> Result<Vec<Row>, Failure> {
    let image = folder.join("image.png");
    let rest = [Path::new("-q"), Path::new("--force"), Path::new("-o"), &image];
    let draw = |name: &str, input: &Path| Row::new(name, &[&[input], &rest[..]].concat());
    let mut rows = vec![Row::new("`surfel --version`", &[Path::new("--version")])];
    let points = |count: usize| -> Result<PathBuf, Failure> {
        let path = folder.join(format!("{count}.ply"));
        std::fs::write(&path, bare_points(count)?)?;
        Ok(path)
    };
    rows.push(draw("10,000 points", &points(10_000)?));
    rows.push(draw("Spot, a textured mesh", Path::new("assets/spot/spot.obj")));
    let igea = arguments.models.join("igea.ply");
    if igea.exists() {
        rows.push(draw("igea, a mesh", &igea));
    }
    rows.push(draw("1,000,000 points", &points(1_000_000)?));
    for _ in 0..arguments.runs.max(1) {
        for row in &mut rows {
            let (start, busy) = (Instant::now(), children_seconds());
            time_once(&arguments.program, row)?;
            row.best = row.best.min(start.elapsed().as_secs_f64());
            let busy = children_seconds().zip(busy).map(|(end, start)| end - start);
            row.busy = row.busy.zip(busy).map(|(sum, more)| sum + more);
        }
    }
    Ok(rows)
}

fn time_once(program: &Path, row: &Row) -> Result<(), Failure> {
    let shown = program.display();
    let mut command = Command::new(program);
    command.args(&row.words).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let output = command.output().map_err(|error| format!("could not run {shown}: {error}"))?;
    if !output.status.success() {
        return Err(format!("{shown} failed on {}: {}", row.name, String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(())
}

/// Returns a binary PLY file that contains only positions of points on a bumpy ball.
fn bare_points(count: usize) -> Result<Vec<u8>, Failure> {
    let cloud = clouds::ball(count)?;
    let mut bytes = Vec::with_capacity(128 + 12 * count);
    write!(bytes, "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n")?;
    write!(bytes, "property float x\nproperty float y\nproperty float z\nend_header\n")?;
    for p in cloud.data().centers.high() {
        p.to_array().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    }
    Ok(bytes)
}

/// Returns the CPU time of this process's children that have ended, in seconds, with a resolution of 0.01 s; `None` if
/// the system doesn't report it.
fn children_seconds() -> Option<f64> {
    of_children(&std::fs::read_to_string("/proc/self/stat").ok()?)
}

/// Parses the sum of fields 16 and 17 of Linux's `stat` file, in seconds. The fields are in hundredths of a second. The
/// program's name, in parentheses, may contain any characters.
fn of_children(stat: &str) -> Option<f64> {
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let [user, system] = [13, 14].map(|i| fields.get(i)?.parse::<f64>().ok());
    Some((user? + system?) / 100.0)
}

fn table(rows: &[Row], runs: usize) -> Table {
    let mut table = Table::new(&["input", "s", "CPU s"]);
    for row in rows {
        let busy = row.busy.map_or("–".to_owned(), |busy| format!("{:.2}", busy / runs.max(1) as f64));
        table.rows.push(vec![row.name.clone(), format!("{:.3}", row.best), busy]);
    }
    table
}

/// Returns the table as a Markdown file, with the machine and its load at the start of the measurement.
fn markdown(machine: &Machine, rows: &[Row], runs: usize) -> String {
    let load = machine.load.map_or("unknown".to_owned(), |load| format!("{load:.1}"));
    format!(
        "<!-- Written by `cargo xtask bench start --markdown FILE`. -->\n\n# Start to image\n\n\
         The whole program, from command to PNG: {}, {} threads, load of the last minute before {load}, commit {}.\n\
         Seconds of the fastest of {runs} runs, and CPU seconds, the mean of all runs.\n\n{}",
        machine.cpu,
        machine.threads,
        machine.commit,
        table(rows, runs).markdown()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_of_children_is_read_behind_any_name() {
        let stat = "42 (a ) b) S 1 42 42 0 -1 4194304 100 200 0 0 7 8 250 30 20 0 1 0 100 0 0";
        assert_eq!(of_children(stat), Some(2.8));
        assert_eq!(of_children("42 (surfel) S 1"), None);
    }

    #[test]
    fn bare_points_have_positions_alone() {
        let bytes = bare_points(100).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        let header = &text[..text.find("end_header\n").unwrap() + 11];
        assert_eq!(bytes.len() - header.len(), 1200);
        assert!(header.matches("property").count() == 3 && header.contains("element vertex 100\n"));
    }

    #[test]
    fn rows_show_the_fastest_run_and_the_mean_processor_time() {
        let row = |best, busy| Row { best, busy, ..Row::new("Spot", &[]) };
        let rows = [row(0.5, Some(3.0)), row(0.25, None)];
        let text = markdown(&Machine { load: Some(1.25), ..Machine::this() }, &rows, 4);
        assert!(text.ends_with("| Spot | 0.500 | 0.75 |\n| Spot | 0.250 | – |\n"), "{text}");
        assert!(text.contains("fastest of 4 runs") && text.contains("before 1.2, commit"), "{text}");
    }
}
