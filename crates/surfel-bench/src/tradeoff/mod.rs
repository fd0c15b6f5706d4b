//! `cargo xtask tradeoff`: measures the cost of every setting (*knob*) in time and in error.

mod costs;
mod detail;
mod features;
mod figures;
mod formulas;
mod gaussians;
mod light;
mod measure;
mod normals;
mod page;
mod planes;
mod scans;
mod sheets;
mod subjects;
mod textures;
mod truth;
mod variants;
mod verdict;

use std::path::PathBuf;

use crate::page::Table;
use clap::ValueEnum;
use surfel_backend::Backend;
use surfel_render::Renderer;

use crate::machine::Machine;
use crate::report::BackendFacts;
use crate::{Failure, tradeoff::figures::Figures};

/// Measures what every setting costs: time, and error against the truth that it approximates.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Rendering backends, separated by commas. The first one draws all subjects, the others the smaller ones at 128²
    /// pixels. `all` is cpu,wgpu,ash, without those that don't start.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "cpu")]
    backend: Vec<Which>,
    /// Part of the GPU adapter's name.
    #[arg(long)]
    adapter: Option<String>,
    /// 256² pixels and few runs: two minutes at most on two threads.
    #[arg(long)]
    quick: bool,
    /// Pixels on a side of all images; 512, or 256 with --quick.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(32..=4096))]
    size: Option<u32>,
    /// Only subjects whose name contains NAME; may be repeated.
    #[arg(long, value_name = "NAME")]
    subject: Vec<String>,
    /// Folder of the models igea.ply, lion_takanawa.ply and fandisk.obj; subjects of missing models are skipped.
    #[arg(long, value_name = "FOLDER", default_value = "models")]
    models: PathBuf,
    /// Output file of the figures.
    #[arg(short, long, value_name = "FILE.json", default_value = "target/tradeoff.json")]
    output: PathBuf,
    /// Output file of the page.
    #[arg(long, value_name = "FILE.html", default_value = "target/tradeoff.html")]
    report: PathBuf,
    /// Write the tables to a Markdown file, replacing it; docs/data/tradeoff.md is made so.
    #[arg(long, value_name = "FILE.md")]
    markdown: Option<PathBuf>,
}

/// Backends that can be requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Which {
    Cpu,
    Wgpu,
    Ash,
    Reference,
    All,
}

impl Which {
    /// Returns the names of the requested backends, in order, each once.
    fn names(asked: &[Self]) -> Vec<&'static str> {
        let mut names = Vec::new();
        for which in asked {
            let of_this: &[&str] = match which {
                Self::Cpu => &["cpu"],
                Self::Wgpu => &["wgpu"],
                Self::Ash => &["ash"],
                Self::Reference => &["reference"],
                Self::All => &["cpu", "wgpu", "ash"],
            };
            names.extend(of_this.iter().filter(|name| !names.contains(*name)).copied().collect::<Vec<_>>());
        }
        names
    }
}

/// Number of frames per variant with the first backend.
const RUNS: usize = 15;
/// Number of frames per variant with the first backend and `--quick`.
const QUICK_RUNS: usize = 5;
/// Number of frames per variant with the backends after the first one, which are measured mainly for their fidelity.
const OTHERS_RUNS: usize = 3;
/// Width and height, in pixels, of the images that the backends after the first one draw.
const OTHERS_SIZE: u32 = 128;

/// Results of all measurements, for printing and for the page.
pub(crate) struct Findings {
    pub figures: Figures,
    pub values: Vec<verdict::Value>,
    pub features: Table,
    pub planes: Table,
    pub formulas: Table,
    pub textures: Table,
    pub scans: Table,
    pub normals: Table,
    pub light: Table,
    /// Results of other backends, with tables of their fidelity by setting.
    pub others: Vec<(BackendFacts, Table)>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let names = Which::names(&arguments.backend);
    let Some((first, others)) = names.split_first() else {
        return Err("--backend names none, expected at least one".into());
    };
    let size = arguments.size.unwrap_or(if arguments.quick { 256 } else { 512 });
    let runs = if arguments.quick { QUICK_RUNS } else { RUNS };
    let pace = measure::Pace { runs, quick: arguments.quick };
    let start = std::time::Instant::now();
    let subjects::Subjects { wanted: subjects, left_out } = wanted(arguments, size, arguments.quick)?;
    let mut backends = measure::Backends::start(first, arguments.adapter.clone())?;
    let mut figures = Figures::new(Machine::this(), facts(&backends.wide), [size; 2], runs);
    for (name, why) in left_out {
        println!("left out: {name}: {why}");
        figures.left_out.push(format!("{name}: {why}"));
    }
    for subject in &subjects {
        eprintln!("{}: {}", subject.name, subject.about);
        measure::subject(subject, &mut backends, pace, &mut figures)?;
    }
    if arguments.wants("octree") {
        eprintln!("octree: by level of detail");
        detail::all(size, arguments.quick, &mut backends, runs, &mut figures)?;
    }
    if arguments.wants("points by levels") {
        eprintln!("points by levels: by level of detail");
        detail::points(size, arguments.quick, &mut backends, runs, &mut figures)?;
    }
    if arguments.wants("Gaussians") {
        eprintln!("Gaussians: by order and filter");
        gaussians::all(size, arguments.quick, &mut backends, runs, &mut figures)?;
    }
    if arguments.wants("sheets") {
        eprintln!("sheets: both sides of thin and of thick bodies");
        sheets::all(size, arguments.quick, &mut backends, runs, &mut figures)?;
    }
    eprintln!("features, planes and formulas");
    let features = costs::table(&mut backends, runs, size)?;
    let planes = planes::table(&mut backends, runs, size)?;
    let (formulas, normals) = (formulas::table()?, normals::table());
    let light = light::table()?;
    let textures = textures::table(&mut backends, size)?;
    let scans = scans::table(&mut backends, runs, size)?;
    drop(backends);
    for name in others {
        match measure::Backends::start(name, arguments.adapter.clone()) {
            Ok(mut backends) => figures.others.push(other(arguments, &mut backends)?),
            Err(failure) if arguments.backend.contains(&Which::All) => println!("skipped: {name}: {failure}"),
            Err(failure) => return Err(failure),
        }
    }
    let values = verdict::values(&figures);
    let others = figures.others.iter().map(|other| (other.backend.clone(), verdict::fidelity(other))).collect();
    figures.seconds = Some(start.elapsed().as_secs_f64());
    let findings = Findings { values, features, planes, formulas, textures, scans, normals, light, others, figures };
    for (title, table) in tables(&findings) {
        println!("{title}\n\n{}", table.text());
    }
    for path in [&arguments.output, &arguments.report].into_iter().chain(&arguments.markdown) {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
    }
    let json = serde_json::to_string_pretty(&findings.figures)? + "\n";
    surfel_io::atomic::write(&arguments.output, true, |out| out.write_all(json.as_bytes()))?;
    let page = page::page(&findings);
    surfel_io::atomic::write(&arguments.report, true, |out| out.write_all(page.as_bytes()))?;
    if let Some(path) = &arguments.markdown {
        let text = markdown(&findings);
        surfel_io::atomic::write(path, true, |out| out.write_all(text.as_bytes()))?;
        println!("{}", path.display());
    }
    println!("{}\n{}", arguments.output.display(), arguments.report.display());
    println!("took {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

impl Arguments {
    /// True if the subject with this name is requested.
    fn wants(&self, name: &str) -> bool {
        self.subject.is_empty() || self.subject.iter().any(|word| name.contains(word.as_str()))
    }
}

fn wanted(arguments: &Arguments, size: u32, quick: bool) -> Result<subjects::Subjects, Failure> {
    let mut subjects = subjects::all(size, quick, &arguments.models)?;
    subjects.wanted.retain(|s| arguments.wants(s.name));
    subjects.left_out.retain(|(name, _)| arguments.wants(name));
    if subjects.wanted.is_empty()
        && !["octree", "points by levels", "Gaussians", "sheets"].iter().any(|name| arguments.wants(name))
    {
        let why =
            subjects.left_out.iter().map(|(name, why)| format!("; {name} is left out: {why}")).collect::<String>();
        return Err(format!("no subject is called {}{why}", arguments.subject.join(" or ")).into());
    }
    Ok(subjects)
}

/// Measures a backend other than the first one, with small images of generated subjects.
fn other(arguments: &Arguments, backends: &mut measure::Backends) -> Result<Figures, Failure> {
    let facts = facts(&backends.wide);
    eprintln!("{} ({})", facts.name, facts.adapter);
    let pace = measure::Pace { runs: OTHERS_RUNS, quick: arguments.quick };
    let mut figures = Figures::new(Machine::this(), facts, [OTHERS_SIZE; 2], OTHERS_RUNS);
    for subject in wanted(arguments, OTHERS_SIZE, true)?.wanted.iter().filter(|s| s.is_generated) {
        eprintln!("  {}", subject.name);
        measure::subject(subject, backends, pace, &mut figures)?;
    }
    Ok(figures)
}

/// Returns all tables with their titles.
fn tables(findings: &Findings) -> Vec<(String, Table)> {
    let figures = &findings.figures;
    let mut tables = vec![
        ("Presets".to_owned(), verdict::presets(figures)),
        ("Settings".to_owned(), verdict::settings(&findings.values)),
        ("Level of detail".to_owned(), verdict::levels_of_detail(&findings.values)),
        ("Claims".to_owned(), verdict::claims(figures)),
        ("Model errors, RMSE".to_owned(), verdict::errors(figures, |r| r.model)),
        ("Model errors without rims, RMSE".to_owned(), verdict::errors(figures, |r| r.model_inside)),
        ("Features".to_owned(), findings.features.clone()),
        ("Planes".to_owned(), findings.planes.clone()),
        ("Formulas".to_owned(), findings.formulas.clone()),
        ("Textures".to_owned(), findings.textures.clone()),
        ("Splats of points".to_owned(), findings.scans.clone()),
        ("Normals".to_owned(), findings.normals.clone()),
        ("Light of a sky".to_owned(), findings.light.clone()),
    ];
    for (backend, table) in &findings.others {
        let kind = if backend.is_software { ", software Vulkan" } else { "" };
        tables.push((format!("Fidelity of {} ({}{kind})", backend.name, backend.adapter), table.clone()));
    }
    tables
}

/// Returns the tables as a Markdown file.
fn markdown(findings: &Findings) -> String {
    let figures = &findings.figures;
    let names: Vec<&str> = figures.subjects.iter().map(|subject| subject.name.as_str()).collect();
    let mut text = format!(
        "<!-- Written by `cargo xtask tradeoff --markdown FILE`. -->\n\n# Speed against accuracy: figures\n\n\
         {} ({}), one thread of {}, {}×{} pixels, medians of {} frames, commit {}.\n\
         Ratios are over the default's, geometric means over {} subjects: {}.\n",
        figures.backend.name,
        figures.backend.adapter,
        figures.machine.cpu,
        figures.size[0],
        figures.size[1],
        figures.runs,
        figures.machine.commit,
        names.len(),
        names.join(", ")
    );
    for (title, table) in tables(findings).iter().filter(|(_, table)| !table.rows.is_empty()) {
        text += &format!("\n## {title}\n\n{}", table.markdown());
    }
    text
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backends_are_named_once_and_in_order() {
        assert_eq!(Which::names(&[Which::Ash, Which::All]), ["ash", "cpu", "wgpu"]);
        assert_eq!(Which::names(&[Which::Reference]), ["reference"]);
    }
}
