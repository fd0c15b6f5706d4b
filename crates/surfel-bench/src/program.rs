//! Command line of the program, and timing of frames on any backend.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};

use crate::measure::Plan;
use crate::report::Report;
use crate::{alternate, compare, growth, kit, measure, prepare, scale, scenes, start, table, tradeoff};

/// Error of the program; its text is a one-line message.
pub(crate) type Failure = Box<dyn std::error::Error>;

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

/// Times frames of the benchmark scenes and prints a table.
///
/// Frames are drawn in turn, one of each scene and thread count, so that disturbances of the machine affect all
/// equally. The table has medians and minima. Loading, uploading and writing files are not timed.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask bench", bin_name = "cargo xtask bench", args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Rendering backend.
    #[arg(long, value_enum, default_value = "cpu")]
    pub(crate) backend: Backend,
    /// Part of the GPU adapter's name.
    #[arg(long)]
    pub(crate) adapter: Option<String>,
    /// Draw small scenes in few runs, in at most a minute.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Thread count of the CPU backends; may be repeated.
    #[arg(long, value_name = "N", default_values_t = [1, 2])]
    pub(crate) threads: Vec<usize>,
    /// Draw only the scenes whose names contain NAME or, with =NAME, the scene of exactly this name; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Vec<String>,
    /// Number of frames of each scene and thread count.
    #[arg(long, value_name = "N")]
    pub(crate) runs: Option<usize>,
    /// SIMD instructions of the CPU backend.
    #[arg(long, value_enum, default_value = "best")]
    pub(crate) simd: Simd,
    /// Bits per stored number of a splat.
    #[arg(long, default_value = "32", value_parser = ["32", "16"])]
    pub(crate) storage: String,
    /// Folder of the models igea.ply and lion_takanawa.ply; scenes of missing models are skipped.
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    pub(crate) models: PathBuf,
    /// Write the figures to a JSON file, replacing it.
    #[arg(short, long, value_name = "FILE.json")]
    pub(crate) output: Option<PathBuf>,
    /// Write the table to a Markdown file, replacing it; docs/data/bench.md is made so.
    #[arg(long, value_name = "FILE.md")]
    pub(crate) markdown: Option<PathBuf>,
    /// Write an image of every scene to this folder.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) images: Option<PathBuf>,
    /// Print the names of the scenes and exit.
    #[arg(long)]
    pub(crate) list: bool,
    /// Compare two files written by `-o`, or two builds of this program, which run in turn three times each.
    #[arg(long, num_args = 2, value_names = ["A", "B"])]
    pub(crate) compare: Option<Vec<PathBuf>>,
}

/// Measurements other than that of frames.
#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Measure what every setting costs in time and error; the same as `cargo xtask tradeoff`.
    Tradeoff(tradeoff::Arguments),
    /// Simulate how long jobs of many tasks take on many workers.
    Scale(scale::Arguments),
    /// Measure what it costs to make splats from points.
    Prepare(prepare::Arguments),
    /// Measure the time from a command to its image: the whole program, for inputs of several sizes.
    Start(start::Arguments),
    /// Draw a chart of the cost of levels of detail by number of points.
    Growth(growth::Arguments),
    /// Measure this machine's GPU, step by step, as the script of `cargo xtask gpu-kit` does.
    Kit(kit::Arguments),
}

/// Runs the program with these arguments, the first of which is its name.
pub(crate) fn main(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    match run(&Arguments::parse_from(words)) {
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
        Some(Command::Start(arguments)) => return start::run(arguments),
        Some(Command::Growth(arguments)) => return growth::run(arguments),
        Some(Command::Kit(arguments)) => return kit::run(arguments),
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
        surfel_io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
        println!("\nwritten to {}", path.display());
    }
    if let Some(path) = &arguments.markdown {
        let text = table::markdown(&report);
        surfel_io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
        println!("\nwritten to {}", path.display());
    }
    Ok(())
}

pub(crate) fn read(path: &Path) -> Result<Report, Failure> {
    let text = std::fs::read(path).map_err(|e| format!("could not read {}: {e}", path.display()))?;
    Report::parse(&text).map_err(|e| format!("{}: {e}", path.display()).into())
}
