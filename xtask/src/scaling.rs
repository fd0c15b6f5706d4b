//! `cargo xtask scaling`: measures how the CPU time of commands grows with the size of hostile inputs of many shapes.

mod documents;
mod meshes;
mod points;
mod scenes;

use crate::growth::measured_with_code;
use std::path::{Path, PathBuf};
use std::process::Command;

const HELP: &str = "\
Usage: cargo xtask scaling [--program FILE] [--runs N] [--markdown FILE] [NAME...]

Times surfel on inputs of sizes n, 2n, 4n and 8n, of every shape or of those whose names contain a NAME, and prints the
exponent of the CPU time over the size: of the line fitted through the four, and of the last doubling. It fails where a
fitted exponent is above 1.2. Needs GNU time as /usr/bin/time. The program is built for release unless one is named.";

/// Largest exponent p with which a shape passes, if its CPU time grows as the p-th power of its size.
const MOST: f64 = 1.2;

/// Mean CPU time that GNU time loses by rounding, in seconds. It rounds the times of the user and of the system down to
/// 0.01 s each.
const ROUNDED_S: f64 = 0.01;
/// Duration in seconds below which a run is repeated [`SHORT_RUNS`] times, and the times are averaged.
const SHORT_S: f64 = 0.1;
/// Number of repetitions of a run shorter than [`SHORT_S`].
const SHORT_RUNS: u32 = 6;

/// Exit code of the program for invalid input.
const WRONG_INPUT: i32 = 3;

/// Kind of hostile input, with the command that is run on it.
struct Shape {
    name: &'static str,
    /// Name of the parts of the input whose number is its size, such as `points`.
    counts: &'static str,
    /// Smallest of the four sizes; the others are 2, 4 and 8 times as large.
    n: usize,
    /// Function that writes an input of size `n` into a folder. It returns the arguments of the program, which runs in
    /// this folder.
    make: Make,
    /// Expected exit code of the program; [`WRONG_INPUT`] if the program must refuse the input.
    code: i32,
}

type Make = Box<dyn Fn(&Path, usize) -> std::io::Result<Vec<String>>>;

impl Shape {
    fn new(
        name: &'static str,
        (n, counts): (usize, &'static str),
        make: impl Fn(&Path, usize) -> std::io::Result<Vec<String>> + 'static,
    ) -> Self {
        Self { name, counts, n, make: Box::new(make), code: 0 }
    }

    /// Returns the shape with the expectation that the program refuses its input.
    fn refused(self) -> Self {
        Self { code: WRONG_INPUT, ..self }
    }
}

/// CPU times of a shape at its four sizes, and its peak memory. Each time is the shortest of `--runs` runs, or, if that
/// is below [`SHORT_S`], the mean of [`SHORT_RUNS`] further runs.
struct Row {
    shape: Shape,
    seconds: [f64; 4],
    peak_mb: f64,
}

struct Arguments<'a> {
    program: Option<PathBuf>,
    runs: usize,
    markdown: Option<PathBuf>,
    names: Vec<&'a str>,
}

pub(crate) fn run(root: &Path, words: &[&str]) -> bool {
    let done = parse(words).and_then(|arguments| measure(root, &arguments));
    done.map_err(|problem| eprintln!("error: {problem}")).unwrap_or(false)
}

fn parse<'a>(words: &[&'a str]) -> Result<Arguments<'a>, String> {
    let mut arguments = Arguments { program: None, runs: 2, markdown: None, names: Vec::new() };
    let mut words = words.iter();
    while let Some(word) = words.next() {
        let mut value = || words.next().copied().ok_or_else(|| format!("{word} needs a value\n\n{HELP}"));
        match *word {
            "--program" => arguments.program = Some(value()?.into()),
            "--markdown" => arguments.markdown = Some(value()?.into()),
            "--runs" => {
                arguments.runs = value()?.parse().map_err(|_| "--runs: expected a number of runs".to_owned())?;
            }
            word if word.starts_with('-') => return Err(format!("unknown option '{word}'\n\n{HELP}")),
            name => arguments.names.push(name),
        }
    }
    Ok(arguments)
}

/// Returns all kinds of hostile input: of meshes, points, documents and scenes.
fn shapes() -> Vec<Shape> {
    [meshes::shapes(), points::shapes(), documents::shapes(), scenes::shapes()].into_iter().flatten().collect()
}

fn measure(root: &Path, arguments: &Arguments) -> Result<bool, String> {
    let program = match &arguments.program {
        Some(program) => root.join(program),
        None => crate::growth::build(root, &[&["surfel-cli"]]).map(|()| root.join("target/release/surfel"))?,
    };
    let folder = std::env::temp_dir().join(format!("surfel-scaling-{}", std::process::id()));
    let is_asked =
        |shape: &Shape| arguments.names.is_empty() || arguments.names.iter().any(|name| shape.name.contains(name));
    let (mut rows, mut failures) = (Vec::new(), 0);
    for shape in shapes().into_iter().filter(is_asked) {
        match measure_shape(shape, &program, &folder, arguments.runs) {
            Ok(row) => {
                println!("{}", row.line());
                rows.push(row);
            }
            Err(problem) => {
                eprintln!("error: {problem}");
                failures += 1;
            }
        }
    }
    if let Some(path) = &arguments.markdown {
        let head = "| shape | n counts | n | n, s | 2n, s | 4n, s | 8n, s | exponent | last doubling | peak, MB |\n\
                    | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n";
        let table: String = rows.iter().map(|row| row.line() + "\n").collect();
        replace_table(path, &(head.to_owned() + &table))?;
    }
    let steep: Vec<&str> = rows.iter().filter(|row| row.exponent() > MOST).map(|row| row.shape.name).collect();
    println!(
        "{} shapes, above {MOST}: {}",
        rows.len(),
        if steep.is_empty() { "none".into() } else { steep.join(", ") }
    );
    Ok(steep.is_empty() && failures == 0)
}

/// Replaces the table on a page. Appends the table to a page without one.
fn replace_table(path: &Path, table: &str) -> Result<(), String> {
    let page = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let is_row = |line: &&str| line.starts_with('|');
    let before: Vec<&str> = page.lines().take_while(|line| !is_row(line)).collect();
    let after: Vec<&str> = page.lines().skip(before.len()).skip_while(is_row).collect();
    let text = [before.join("\n"), table.trim_end().to_owned(), after.join("\n")].join("\n");
    std::fs::write(path, text.trim_end().to_owned() + "\n").map_err(|e| format!("{}: {e}", path.display()))
}

fn measure_shape(shape: Shape, program: &Path, folder: &Path, runs: usize) -> Result<Row, String> {
    let (mut seconds, mut peak_mb) = ([f64::INFINITY; 4], 0.0_f64);
    for (doublings, best) in seconds.iter_mut().enumerate() {
        let problem = |e: std::io::Error| format!("{}: {e}", folder.display());
        std::fs::create_dir_all(folder).map_err(problem)?;
        let words = (shape.make)(folder, shape.n << doublings).map_err(problem)?;
        let mut once = || {
            let mut command = Command::new(program);
            command.args(&words).args(["--threads", "1", "-q"]).current_dir(folder);
            let cost = measured_with_code(&mut command, shape.code)
                .map_err(|e| format!("{} at {}: {e}", shape.name, shape.n << doublings))?;
            peak_mb = peak_mb.max(cost.peak_mb);
            Ok::<f64, String>(cost.cpu_s + ROUNDED_S)
        };
        for _ in 0..runs.max(1) {
            *best = best.min(once()?);
        }
        if *best < SHORT_S {
            let sum: f64 = (0..SHORT_RUNS).map(|_| once()).sum::<Result<f64, String>>()?;
            *best = sum / f64::from(SHORT_RUNS);
        }
        std::fs::remove_dir_all(folder).map_err(problem)?;
    }
    Ok(Row { shape, seconds, peak_mb })
}

impl Row {
    /// Returns the exponent of growth of this shape.
    fn exponent(&self) -> f64 {
        exponent(self.seconds)
    }

    fn line(&self) -> String {
        let [a, b, c, d] = self.seconds;
        let Shape { name, counts, n, .. } = &self.shape;
        let (fitted, last) = (self.exponent(), (d / c).log2());
        format!(
            "| {name} | {counts} | {n} | {a:.3} | {b:.3} | {c:.3} | {d:.3} | {fitted:.2} | {last:.2} | {:.0} |",
            self.peak_mb
        )
    }
}

/// Returns the exponent of growth of times at four sizes, each twice the previous one. It is the least-squares slope of
/// the logarithms.
fn exponent(seconds: [f64; 4]) -> f64 {
    let [a, b, c, d] = seconds.map(f64::log2);
    (3.0 * (d - a) + (c - b)) / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponent_is_that_of_a_power() {
        assert!((exponent([0.1, 0.2, 0.4, 0.8]) - 1.0).abs() < 1e-12);
        assert!((exponent([0.1, 0.4, 1.6, 6.4]) - 2.0).abs() < 1e-12);
        assert_eq!(exponent([0.3; 4]), 0.0);
    }

    #[test]
    fn there_are_forty_shapes_and_each_has_a_name_of_its_own() {
        let names: std::collections::BTreeSet<&str> = shapes().iter().map(|shape| shape.name).collect();
        assert!(names.len() == shapes().len() && names.len() >= 40, "{}", names.len());
    }

    #[test]
    fn inputs_are_written_and_grow() {
        let folder = std::env::temp_dir().join(format!("surfel-scaling-test-{}", std::process::id()));
        for shape in shapes() {
            let size = |n: usize| {
                std::fs::create_dir_all(&folder).unwrap();
                let words = (shape.make)(&folder, n).unwrap();
                let files = std::fs::read_dir(&folder).unwrap();
                let bytes: u64 = files.map(|file| file.unwrap().metadata().unwrap().len()).sum();
                std::fs::remove_dir_all(&folder).unwrap();
                bytes + words.iter().map(|word| word.len() as u64).sum::<u64>()
            };
            assert!(size(100) > size(10), "{}", shape.name);
        }
    }

    #[test]
    fn tables_of_a_page_are_replaced() {
        let path = std::env::temp_dir().join(format!("surfel-scaling-page-{}", std::process::id()));
        std::fs::write(&path, "# Page\n\n| a |\n| - |\n| 1 |\n\nEnd.\n").unwrap();
        replace_table(&path, "| b |\n| - |\n").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "# Page\n\n| b |\n| - |\n\nEnd.\n");
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn wrong_arguments_are_refused() {
        assert!(parse(&["--runs"]).is_err() && parse(&["--runs", "x"]).is_err() && parse(&["--what"]).is_err());
        let arguments = parse(&["fan", "--runs", "3"]).unwrap();
        assert_eq!((arguments.runs, &arguments.names[..]), (3, &["fan"][..]));
    }
}
