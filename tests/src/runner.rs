//! Command line of the program that compares backends with the reference.

use crate::backends::{Backend, Repeated, Session, Start, is_required, run_reporting};
use crate::expectations::Extent;
use crate::harness::{Report, Truth, Verdict};
use crate::random_scenes::against::ReferenceComparison;
use crate::random_scenes::{case, store};
use crate::report::{Entry, page, table, word};
use crate::truths;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};
use surfel_ash::GpuPath;
use surfel_bench::kit::{Conformance, Lines};

const HELP: &str = "\
Holds backends against the reference, scene by scene.

Usage: cargo xtask conformance [OPTIONS]

Options:
  --backend NAME   cpu, wgpu or ash; several with commas or by repeating it; all by default
  --adapter TEXT   wgpu and ash draw on the first adapter whose name contains it, in any case
  --scene TEXT     Scenes whose name contains it
  --report FILE    Write a page with images, FILE.html
  --random N       N random scenes instead, as --seed and those after it say
  --seed S         Number of the first random scene; 0 by default
  --keep FOLDER    Where scene files of random scenes that fail are written; target/random by default
  --store FOLDER   Only write the random scenes there, as scene files
  --write-truths FILE  Only write the reference's images to FILE
  --truths FILE    Read the reference's images from FILE instead of drawing them
  --out FOLDER     Append a line of JSON for each scene to FOLDER/results.jsonl, as soon as it is drawn, with hashes of
                   repeated frames of it
  --path PATH      compute or raster: the path that wgpu and ash draw by; auto by default
  --wgsl           wgpu translates shaders from WGSL on Vulkan, too, instead of passing SPIR-V to the driver
  --no-validation  Draw without validation layers
  -h, --help       Print this

A backend that doesn't start is skipped, unless SURFEL_REQUIRE=wgpu,ash (either or both) names it.

Exit codes: 0 nothing failed, 1 something did, 2 usage";

#[derive(Default)]
struct Arguments {
    backends: Vec<Backend>,
    adapter: Option<String>,
    scene: String,
    report: Option<PathBuf>,
    random: Option<u64>,
    seed: u64,
    keep: Option<PathBuf>,
    store: Option<PathBuf>,
    write_truths: Option<PathBuf>,
    truths: Option<PathBuf>,
    out: Option<PathBuf>,
    no_validation: bool,
    path: GpuPath,
    wgsl: bool,
}

const FLAGS: [&str; 12] = [
    "--backend",
    "--adapter",
    "--scene",
    "--report",
    "--random",
    "--seed",
    "--keep",
    "--store",
    "--write-truths",
    "--truths",
    "--out",
    "--path",
];

fn whole(flag: &str, value: &str) -> Result<u64, String> {
    value.parse().map_err(|_| format!("{flag} '{value}': expected a whole number"))
}

/// Parses the command line; `None` if it requests help.
fn arguments(mut words: impl Iterator<Item = String>) -> Result<Option<Arguments>, String> {
    let mut found = Arguments::default();
    while let Some(word) = words.next() {
        if matches!(word.as_str(), "-h" | "--help") {
            return Ok(None);
        }
        match word.as_str() {
            "--no-validation" => {
                found.no_validation = true;
                continue;
            }
            "--wgsl" => {
                found.wgsl = true;
                continue;
            }
            _ => {}
        }
        let (flag, value) = match word.split_once('=') {
            Some((flag, value)) => (flag.to_owned(), Some(value.to_owned())),
            None => (word, None),
        };
        if !FLAGS.contains(&flag.as_str()) {
            return Err(format!("unknown argument '{flag}'"));
        }
        let value = value.or_else(|| words.next()).ok_or_else(|| format!("{flag} needs a value"))?;
        match flag.as_str() {
            "--backend" => {
                for name in value.split(',') {
                    let backend = Backend::ALL.into_iter().find(|b| b.name() == name.trim());
                    let backend = backend.ok_or_else(|| format!("--backend '{name}': expected cpu, wgpu or ash"))?;
                    if !found.backends.contains(&backend) {
                        found.backends.push(backend);
                    }
                }
            }
            "--adapter" => found.adapter = Some(value),
            "--scene" => found.scene = value,
            "--random" => found.random = Some(whole(&flag, &value)?),
            "--seed" => found.seed = whole(&flag, &value)?,
            "--keep" => found.keep = Some(value.into()),
            "--store" => found.store = Some(value.into()),
            "--write-truths" => found.write_truths = Some(value.into()),
            "--truths" => found.truths = Some(value.into()),
            "--out" => found.out = Some(value.into()),
            "--path" => {
                found.path = match value.as_str() {
                    "auto" => GpuPath::Auto,
                    "compute" => GpuPath::Compute,
                    "raster" => GpuPath::Raster,
                    _ => return Err(format!("--path '{value}': expected auto, compute or raster")),
                }
            }
            _ => found.report = Some(value.into()),
        }
    }
    if found.backends.is_empty() {
        found.backends = Backend::ALL.to_vec();
    }
    if found.random.is_some() && (found.report.is_some() || !found.scene.is_empty()) {
        return Err("--random goes with neither --report nor --scene: a scene that fails is written to --keep".into());
    }
    Ok(Some(found))
}

/// Runs the program with these arguments, which don't include the program's name.
pub fn main(words: impl Iterator<Item = String>) -> ExitCode {
    let arguments = match arguments(words) {
        Ok(Some(arguments)) => arguments,
        Ok(None) => {
            println!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(problem) => {
            eprintln!("error: {problem}\n\n{HELP}");
            return ExitCode::from(2);
        }
    };
    let result = match arguments.random {
        Some(count) => random(&arguments, count),
        None => conformance(&arguments),
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn conformance(arguments: &Arguments) -> Result<bool, Box<dyn std::error::Error>> {
    let is_wanted = |name: &str| name.contains(&arguments.scene);
    let truths = match &arguments.truths {
        Some(path) => truths::read(path, is_wanted)?,
        None => Truth::all(is_wanted)?,
    };
    if truths.is_empty() {
        return Err(format!("--scene '{}': no scene's name contains it", arguments.scene).into());
    }
    if let Some(path) = &arguments.write_truths {
        truths::write(path, &truths)?;
        println!("{} scenes: {}", truths.len(), path.display());
        return Ok(true);
    }
    let extent = if arguments.scene.is_empty() { Extent::EveryScene } else { Extent::SomeScenes };
    let mut lines = arguments.out.as_deref().map(Lines::open).transpose()?;
    let start = Start {
        adapter: arguments.adapter.as_deref(),
        validation: !arguments.no_validation,
        path: arguments.path,
        wgsl: arguments.wgsl,
    };
    let mut entries = Vec::new();
    for &backend in &arguments.backends {
        eprintln!("{}: {} scenes", backend.name(), truths.len());
        let mut broken = None;
        let ran = run_reporting(backend, start, &truths, extent, |session, truth, report, time| {
            if let Some(lines) = &mut lines {
                broken = lines.append(&line(session, truth, report, time)).err().or(broken.take());
            }
        });
        if let Some(error) = broken {
            return Err(format!("could not write lines: {error}").into());
        }
        let entry = match ran {
            Ok(run) => Entry::Ran(run),
            Err(error) if is_required(backend.name()) => Entry::Missing(backend, error.to_string()),
            Err(error) => Entry::Absent(backend, error.to_string()),
        };
        entries.push(entry);
    }
    print!("{}", table(&entries));
    if let Some(path) = &arguments.report {
        let page = page(&entries, &truths)?;
        surfel_io::atomic::write(path, true, |out| out.write_all(page.as_bytes()))?;
        println!("{}", path.display());
    }
    Ok(entries.iter().all(Entry::is_ok))
}

/// Number of frames of a scene whose planes are hashed, to find out whether repeated frames are identical.
const HASHED: usize = 5;
/// Number of frames of a scene whose planes are hashed on devices that compute on the CPU, which are slow.
const HASHED_BY_SOFTWARE: usize = 2;

/// Returns the record of a scene that was compared, with hashes of further frames.
fn line(session: &mut Session, truth: &Truth, report: &Report, time: Duration) -> Conformance {
    let start = Instant::now();
    let drawn = !matches!(report.verdict, Verdict::Skipped(_));
    let times = if session.is_software() { HASHED_BY_SOFTWARE } else { HASHED };
    let repeated = if drawn { session.repeat(&truth.case, times) } else { Ok(Repeated::default()) };
    let ms = (time + start.elapsed()).as_secs_f64() * 1e3;
    let (repeated, fault) = match repeated {
        Ok(repeated) => (repeated, None),
        Err(error) => (Repeated::default(), Some(error.to_string())),
    };
    let worst = report.worst_plane();
    let why = match &report.verdict {
        Verdict::Passed => String::new(),
        Verdict::Expected(why) | Verdict::Skipped(why) | Verdict::Failed(why) => why.clone(),
    };
    let region = truth.case.view().region;
    Conformance {
        backend: session.info().backend.to_owned(),
        adapter: session.info().adapter.clone(),
        is_software: session.is_software(),
        scene: report.name.clone(),
        size: [region.width, region.height],
        verdict: word(&report.verdict).to_owned(),
        why: [why, fault.unwrap_or_default()].into_iter().filter(|w| !w.is_empty()).collect::<Vec<_>>().join("; "),
        plane: worst.map(|plane| plane.plane.name().to_owned()),
        worst: worst.map(|plane| plane.worst),
        outliers: report.outliers() as u64,
        forgiven: report.forgiven as u64,
        passes: repeated.passes,
        hashes: repeated.hashes,
        ms,
    }
}

/// Compares backends with the reference in `count` random scenes, or only writes the scenes to a folder if
/// `arguments.store` is set. Returns false if a comparison fails or a required backend is missing.
fn random(arguments: &Arguments, count: u64) -> Result<bool, Box<dyn std::error::Error>> {
    let seeds = (arguments.seed..).take(usize::try_from(count)?);
    if let Some(folder) = &arguments.store {
        let folder = store::folder(folder)?;
        for seed in seeds {
            println!("{}", store::store(&case(seed), folder)?.display());
        }
        return Ok(true);
    }
    let keep = arguments.keep.clone().unwrap_or_else(|| PathBuf::from("target/random"));
    let mut against = ReferenceComparison::new(Some(&keep))?;
    let mut is_missing = false;
    for &backend in &arguments.backends {
        if let Err(error) = against.start(backend, arguments.adapter.as_deref()) {
            let required = is_required(backend.name());
            is_missing |= required;
            let word = if required { "FAILED" } else { "skipped" };
            println!("{word}: {}: {error}", backend.name());
        }
    }
    for seed in seeds {
        for failure in against.draw(seed)? {
            println!("{failure}\n");
        }
        if (seed - arguments.seed) % 100 == 99 {
            eprintln!("{} of {count} scenes", seed - arguments.seed + 1);
        }
    }
    against.tallies().for_each(|tally| println!("{tally}"));
    Ok(!is_missing && against.tallies().all(|tally| tally.failures.is_empty()))
}
