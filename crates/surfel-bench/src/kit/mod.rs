//! `surfel-bench kit`: measurements of a machine's GPU, and the page that shows them.
//!
//! `cargo xtask gpu-kit` packs this program with a script that runs its steps one after the other. Each step appends
//! lines to one file of records, so that results are preserved if a step is killed.

mod devices;
mod frames;
mod page;
#[cfg(feature = "wgpu")]
mod probes;
mod record;
mod roofline;
mod work;

use std::path::PathBuf;

use clap::{Args, Subcommand};

pub use record::{Conformance, Lines, plane_hashes};

use crate::{Backend, Failure};

/// Measures this machine's GPU, step by step.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    step: Step,
}

#[derive(Debug, Subcommand)]
enum Step {
    /// List the devices that both backends see, with limits and features. Exit code 0: a GPU is present; 3: only
    /// devices that compute on the CPU; 4: none.
    Devices(On),
    /// Time frames of the kit's scenes on a backend.
    Frames {
        /// Rendering backend.
        #[arg(value_enum)]
        backend: Backend,
        #[command(flatten)]
        on: On,
    },
    /// Measure upper bounds of the device's performance: memory, arithmetic, fill rates.
    Probes(On),
    /// Write a page of the measurements.
    Report {
        /// Folder that the script wrote.
        out: PathBuf,
        /// Write the page to this file, replacing it, instead of printing it.
        #[arg(long, value_name = "FILE.md")]
        markdown: Option<PathBuf>,
    },
}

/// Backend, adapter and output folder of a step.
#[derive(Debug, Args)]
pub(crate) struct On {
    /// Folder whose `results.jsonl` is appended to.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Part of the GPU adapter's name.
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Draw small images of few splats, for devices that compute on the CPU.
    #[arg(long)]
    small: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.step {
        Step::Devices(on) => devices::run(on),
        Step::Frames { backend, on } => frames::run(*backend, on),
        #[cfg(feature = "wgpu")]
        Step::Probes(on) => probes::run(on),
        #[cfg(not(feature = "wgpu"))]
        Step::Probes(_) => Err("this program was built without wgpu: build it with --features wgpu,ash".into()),
        Step::Report { out, markdown } => page::run(out, markdown.as_deref()),
    }
}

/// True if an adapter's name contains the requested text, or if none is requested.
#[cfg(any(feature = "wgpu", feature = "ash"))]
fn fits(on: &On, name: &str) -> bool {
    on.adapter.as_ref().is_none_or(|wanted| name.to_lowercase().contains(&wanted.to_lowercase()))
}
