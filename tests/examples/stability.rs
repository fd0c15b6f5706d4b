//! Runs sweeps to the extremes; run as `cargo xtask stability`.

use std::path::PathBuf;
use std::process::ExitCode;
use surfel_conformance::backends::is_required;
use surfel_conformance::stability::{Draw, Measured, Precision, breaks, drawer, naive_points, page, run, sweeps};
use surfel_reference::Renderer as Reference;

const HELP: &str = "\
Drives one number of an image after another to its extreme, and holds backends against exact arithmetic.

Usage: cargo xtask stability [OPTIONS]

Options:
  --backend NAME   reference, cpu, wgpu or ash; several with commas or by repeating it; reference
                   and cpu by default
  --adapter TEXT   wgpu and ash draw on the first adapter whose name contains it, in any case
  --sweep TEXT     Sweeps whose name contains it
  --report FILE    Where the page goes; target/stability.html by default
  --markdown FILE  Write the table as Markdown too: docs/data/stability.md is made so
  -h, --help       Print this

A backend that doesn't start is skipped, unless SURFEL_REQUIRE=wgpu,ash (either or both) names it.

Exit codes: 0 nothing broke where it has to work, 1 something did, 2 usage";

struct Arguments {
    backends: Vec<String>,
    adapter: Option<String>,
    sweep: String,
    report: PathBuf,
    markdown: Option<PathBuf>,
}

/// Parses the command line; `None` if it asks for help.
fn arguments(mut words: impl Iterator<Item = String>) -> Result<Option<Arguments>, String> {
    let mut found = Arguments {
        backends: Vec::new(),
        adapter: None,
        sweep: String::new(),
        report: PathBuf::from("target/stability.html"),
        markdown: None,
    };
    while let Some(word) = words.next() {
        if matches!(word.as_str(), "-h" | "--help") {
            return Ok(None);
        }
        let (flag, value) = match word.split_once('=') {
            Some((flag, value)) => (flag.to_owned(), Some(value.to_owned())),
            None => (word, None),
        };
        if !matches!(flag.as_str(), "--backend" | "--adapter" | "--sweep" | "--report" | "--markdown") {
            return Err(format!("unknown argument '{flag}'"));
        }
        let value = value.or_else(|| words.next()).ok_or_else(|| format!("{flag} needs a value"))?;
        match flag.as_str() {
            "--backend" => {
                for name in value.split(',').map(str::trim) {
                    if !["reference", "cpu", "wgpu", "ash"].contains(&name) {
                        return Err(format!("--backend '{name}': expected reference, cpu, wgpu or ash"));
                    }
                    if !found.backends.iter().any(|b| b == name) {
                        found.backends.push(name.to_owned());
                    }
                }
            }
            "--adapter" => found.adapter = Some(value),
            "--sweep" => found.sweep = value,
            "--markdown" => found.markdown = Some(value.into()),
            _ => found.report = value.into(),
        }
    }
    if found.backends.is_empty() {
        found.backends = vec!["reference".to_owned(), "cpu".to_owned()];
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
    match stability(&arguments) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

type Failure = Box<dyn std::error::Error>;

fn start(name: &str, adapter: Option<&str>) -> Result<(Precision, Box<Draw<'static>>), surfel_render::RenderError> {
    let adapter = adapter.map(str::to_owned);
    Ok(match name {
        "reference" => (Precision::F64, drawer(Reference::new(Default::default())?)),
        "cpu" => (Precision::F32, drawer(surfel_cpu::Renderer::new(Default::default())?)),
        "wgpu" => {
            let options = surfel_wgpu::Options::default().with_adapter(adapter);
            (Precision::GPU, drawer(surfel_wgpu::Renderer::new(options)?))
        }
        _ => {
            let options = surfel_ash::Options::default().with_adapter(adapter);
            (Precision::GPU, drawer(surfel_ash::Renderer::new(options)?))
        }
    })
}

fn stability(arguments: &Arguments) -> Result<bool, Failure> {
    let (mut names, mut backends) = (Vec::new(), Vec::new());
    for name in &arguments.backends {
        match start(name, arguments.adapter.as_deref()) {
            Ok(backend) => {
                names.push(name.clone());
                backends.push(backend);
            }
            Err(error) if is_required(name) => {
                return Err(format!("SURFEL_REQUIRE asks for {name}, but: {error}").into());
            }
            Err(error) => println!("skipped: {name}: {error}"),
        }
    }
    let mut reference = Reference::new(Default::default())?;
    let mut measured = Vec::new();
    for sweep in sweeps().into_iter().filter(|sweep| sweep.name.contains(&arguments.sweep)) {
        eprintln!("{}: {} values of {}", sweep.name, sweep.values.len(), sweep.parameter);
        let outcomes = run(&sweep, &mut reference, &mut backends)?;
        let naive = naive_points(&sweep);
        measured.push(Measured { sweep, outcomes, naive });
    }
    if measured.is_empty() {
        return Err(format!("--sweep '{}': no sweep's name contains it", arguments.sweep).into());
    }
    print!("{}", breaks(&measured, &names).text());
    let faults = |backend: usize| measured.iter().flat_map(move |m| m.faults(backend));
    let mut is_ok = true;
    for (index, name) in names.iter().enumerate() {
        for fault in faults(index) {
            println!("{name}: {fault}");
            is_ok = false;
        }
    }
    println!("{}", if is_ok { "nothing breaks where it has to work" } else { "FAILED" });
    if let Some(folder) = arguments.report.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let page = page(&measured, &names);
    surfel_io::atomic::write(&arguments.report, true, |out| out.write_all(page.as_bytes()))?;
    println!("{}", arguments.report.display());
    if let Some(path) = &arguments.markdown {
        let text = format!(
            "<!-- Written by `cargo xtask stability --markdown FILE`. -->\n\n\
             # Numerical stability: the first value at which anything breaks\n\n{}",
            breaks(&measured, &names).markdown()
        );
        surfel_io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
        println!("{}", path.display());
    }
    Ok(is_ok)
}
