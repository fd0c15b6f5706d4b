//! `cargo xtask tradeoff`: every knob's cost in time and in error.

mod features;
mod figures;
mod measure;
mod page;
mod subjects;
mod truth;
mod variants;
mod verdict;

use std::path::PathBuf;

use surfel::{Backend, Renderer};

use crate::machine::Machine;
use crate::report::BackendFacts;
use crate::{Failure, tradeoff::figures::Figures};

/// Measures what every setting costs: time, and error against the truth that it approximates.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// What draws.
    #[arg(long, value_enum, default_value = "cpu")]
    pub backend: crate::Backend,
    /// A part of the GPU adapter's name.
    #[arg(long)]
    adapter: Option<String>,
    /// 256² pixels and few runs: two minutes at most.
    #[arg(long)]
    quick: bool,
    /// Only subjects whose name has this in it; several times for several.
    #[arg(long, value_name = "NAME")]
    subject: Vec<String>,
    /// Where the models igea.ply, lion_takanawa.ply and fandisk.obj are; without them their subjects are left out.
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    models: PathBuf,
    /// Where the figures go.
    #[arg(short, long, value_name = "FILE.json", default_value = "target/tradeoff.json")]
    output: PathBuf,
    /// Where the page goes.
    #[arg(long, value_name = "FILE.html", default_value = "target/tradeoff.html")]
    report: PathBuf,
    /// Print tables as Markdown.
    #[arg(long)]
    markdown: bool,
}

const RUNS: usize = 15;
const QUICK_RUNS: usize = 7;

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut subjects = subjects::all(arguments.quick, &arguments.models)?;
    if !arguments.subject.is_empty() {
        subjects.retain(|s| arguments.subject.iter().any(|word| s.name.contains(word.as_str())));
    }
    let Some(first) = subjects.first() else {
        return Err(format!("no subject is called {}", arguments.subject.join(" or ")).into());
    };
    let runs = if arguments.quick { QUICK_RUNS } else { RUNS };
    let mut backends = measure::Backends::start(arguments.backend.name(), arguments.adapter.clone())?;
    let mut figures = Figures::new(Machine::this(), facts(&backends.wide), first.camera.size, runs);
    for subject in &subjects {
        eprintln!("{}: {}", subject.name, subject.about);
        measure::subject(subject, &mut backends, runs, &mut figures)?;
    }
    let features = features::table(&mut backends, runs, first.camera.size[0])?;
    let values = verdict::values(&figures);
    for (title, table) in [
        ("Presets", verdict::presets(&figures)),
        ("Knobs, over the default's", verdict::table(&values)),
        ("Claims", verdict::claims(&figures)),
        ("Model errors, RMSE", verdict::errors(&figures, |r| r.model)),
        ("Model errors without rims, RMSE", verdict::errors(&figures, |r| r.model_inside)),
        ("Features", features.clone()),
    ] {
        println!("{title}\n\n{}", if arguments.markdown { table.markdown() } else { table.text() });
    }
    for path in [&arguments.output, &arguments.report] {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
    }
    let json = serde_json::to_string_pretty(&figures)? + "\n";
    surfel::io::atomic::write(&arguments.output, true, |out| out.write_all(json.as_bytes()))?;
    let page = page::page(&figures, &values, &features);
    surfel::io::atomic::write(&arguments.report, true, |out| out.write_all(page.as_bytes()))?;
    println!("{}\n{}", arguments.output.display(), arguments.report.display());
    Ok(())
}

fn facts(backend: &Backend) -> BackendFacts {
    let info = backend.info();
    BackendFacts {
        name: info.backend.to_owned(),
        adapter: info.adapter.clone(),
        driver: info.driver.clone(),
        is_software: backend.is_software(),
    }
}
