//! Holds backends against the reference; run as `cargo xtask conformance`.

use std::path::PathBuf;
use std::process::ExitCode;
use surfel_conformance::backends::{Backend, is_required, run};
use surfel_conformance::expectations::Extent;
use surfel_conformance::harness::Truth;
use surfel_conformance::report::{Entry, page, table};

const HELP: &str = "\
Holds backends against the reference, scene by scene.

Usage: cargo xtask conformance [OPTIONS]

Options:
  --backend NAME   cpu, wgpu or ash; several with commas or by repeating it; all by default
  --adapter TEXT   wgpu and ash draw on the first adapter whose name contains it, in any case
  --scene TEXT     Scenes whose name contains it
  --report FILE    Write a page with pictures, FILE.html
  -h, --help       Print this

A backend that doesn't start is skipped, unless SURFEL_REQUIRE=wgpu,ash (either or both) names it.

Exit codes: 0 nothing failed, 1 something did, 2 usage";

#[derive(Default)]
struct Arguments {
    backends: Vec<Backend>,
    adapter: Option<String>,
    scene: String,
    report: Option<PathBuf>,
}

/// What the words ask for; nothing where it is help.
fn arguments(mut words: impl Iterator<Item = String>) -> Result<Option<Arguments>, String> {
    let mut found = Arguments::default();
    while let Some(word) = words.next() {
        if matches!(word.as_str(), "-h" | "--help") {
            return Ok(None);
        }
        let (flag, value) = match word.split_once('=') {
            Some((flag, value)) => (flag.to_owned(), Some(value.to_owned())),
            None => (word, None),
        };
        if !matches!(flag.as_str(), "--backend" | "--adapter" | "--scene" | "--report") {
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
            _ => found.report = Some(value.into()),
        }
    }
    if found.backends.is_empty() {
        found.backends = Backend::ALL.to_vec();
    }
    Ok(Some(found))
}

fn main() -> ExitCode {
    let arguments = match arguments(std::env::args().skip(1)) {
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
    match conformance(&arguments) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn conformance(arguments: &Arguments) -> Result<bool, Box<dyn std::error::Error>> {
    let truths = Truth::all(|name| name.contains(&arguments.scene))?;
    if truths.is_empty() {
        return Err(format!("--scene '{}': no scene's name contains it", arguments.scene).into());
    }
    let extent = if arguments.scene.is_empty() { Extent::EveryScene } else { Extent::SomeScenes };
    let mut entries = Vec::new();
    for &backend in &arguments.backends {
        eprintln!("{}: {} scenes", backend.name(), truths.len());
        let entry = match run(backend, arguments.adapter.as_deref(), &truths, extent) {
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
