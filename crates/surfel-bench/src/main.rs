//! Frames of known scenes, timed on any backend. Run it as `cargo xtask bench`, which builds it for release.

mod alternate;
mod clouds;
mod compare;
mod growth;
mod machine;
mod measure;
mod prepare;
mod report;
mod scale;
mod scenes;
mod table;
mod tradeoff;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};

use crate::measure::Plan;
use crate::report::Report;

/// What goes wrong, said in one line.
type Failure = Box<dyn std::error::Error>;

/// Backends that can be timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Backend {
    Cpu,
    Wgpu,
    Ash,
    Reference,
}

impl Backend {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Wgpu => "wgpu",
            Self::Ash => "ash",
            Self::Reference => "reference",
        }
    }
}

/// SIMD instructions of the CPU backend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Simd {
    Best,
    Avx2,
}

impl Simd {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Best => "best",
            Self::Avx2 => "avx2",
        }
    }
}

/// Times frames of known scenes and prints a table.
///
/// Frames are drawn in turn, one of each scene and thread count, so that what disturbs the machine disturbs all alike;
/// medians and minima are reported. Loading, uploading and writing files are not timed.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask bench", bin_name = "cargo xtask bench", args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// What draws.
    #[arg(long, value_enum, default_value = "cpu")]
    backend: Backend,
    /// A part of the GPU adapter's name.
    #[arg(long)]
    adapter: Option<String>,
    /// Small scenes and few runs: a minute at most.
    #[arg(long)]
    quick: bool,
    /// Thread count of the CPU backends; several times for several.
    #[arg(long, value_name = "N", default_values_t = [1, 2])]
    threads: Vec<usize>,
    /// Only scenes whose name has this in it, or is what follows a =; several times for several.
    #[arg(long, value_name = "NAME")]
    scene: Vec<String>,
    /// Frames of each scene and thread count.
    #[arg(long, value_name = "N")]
    runs: Option<usize>,
    /// SIMD instructions of the CPU backend.
    #[arg(long, value_enum, default_value = "best")]
    simd: Simd,
    /// Bits in which splats are kept.
    #[arg(long, default_value = "32", value_parser = ["32", "16"])]
    storage: String,
    /// Where the models igea.ply and lion_takanawa.ply are; without them their scenes are left out.
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    models: PathBuf,
    /// Write the figures as JSON, over what is there.
    #[arg(short, long, value_name = "FILE.json")]
    output: Option<PathBuf>,
    /// Write the table as Markdown, over what is there: docs/data/bench.md is made so.
    #[arg(long, value_name = "FILE.md")]
    markdown: Option<PathBuf>,
    /// Write an image of every scene.
    #[arg(long, value_name = "FOLDER")]
    images: Option<PathBuf>,
    /// Print the names of the scenes and end.
    #[arg(long)]
    list: bool,
    /// Compare two files that were written by `-o`; or two builds of this program, run in turn three times each.
    #[arg(long, num_args = 2, value_names = ["A", "B"])]
    compare: Option<Vec<PathBuf>>,
}

/// What else this program measures.
#[derive(Debug, clap::Subcommand)]
enum Command {
    /// What every setting costs, in time and in error; as `cargo xtask tradeoff`.
    Tradeoff(tradeoff::Arguments),
    /// What jobs of many pieces take on many workers, simulated.
    Scale(scale::Arguments),
    /// What it costs to make splats of points.
    Prepare(prepare::Arguments),
    /// How levels of points grow, as a chart.
    Growth(growth::Arguments),
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.command {
        Some(Command::Tradeoff(arguments)) => return tradeoff::run(arguments),
        Some(Command::Scale(arguments)) => return scale::run(arguments),
        Some(Command::Prepare(arguments)) => return prepare::run(arguments),
        Some(Command::Growth(arguments)) => return growth::run(arguments),
        None => {}
    }
    if let Some([a, b]) = arguments.compare.as_deref() {
        let are_files = [a, b].map(|path| path.extension().is_some_and(|extension| extension == "json"));
        let [a, b] = match are_files {
            [true, true] => [read(a)?, read(b)?],
            [false, false] => alternate::measured([a, b], arguments)?,
            _ => return Err("--compare takes two .json files or two programs, not one of each".into()),
        };
        print!("{}", compare::table(&a, &b)?);
        return Ok(());
    }
    let scenes = scenes::chosen(arguments)?;
    if arguments.list {
        scenes.iter().for_each(|scene| println!("{:12} {}", scene.name, scene.about));
        return Ok(());
    }
    let report = measure::all(&Plan::new(arguments), &scenes)?;
    print!("{}", table::of(&report));
    if let Some(path) = &arguments.output {
        let text = serde_json::to_string_pretty(&report)? + "\n";
        surfel::io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
        println!("\nwritten to {}", path.display());
    }
    if let Some(path) = &arguments.markdown {
        let text = table::markdown(&report);
        surfel::io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
        println!("\nwritten to {}", path.display());
    }
    Ok(())
}

fn read(path: &Path) -> Result<Report, Failure> {
    let text = std::fs::read(path).map_err(|e| format!("could not read {}: {e}", path.display()))?;
    Report::parse(&text).map_err(|e| format!("{}: {e}", path.display()).into())
}
