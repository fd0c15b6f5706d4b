//! `cargo xtask conformance` and `stability`: the backends against the truth, by programs of the package
//! `surfel-conformance`.

use std::path::Path;
use std::process::ExitCode;

use crate::{cargo, vulkan};

/// Runs one of its programs.
pub(crate) fn run(root: &Path, program: &str, options: &[&str]) -> ExitCode {
    // What is missing is said again, backend by backend, by the program.
    if let Err(problem) = vulkan::prepare(root) {
        eprintln!("error: {problem}");
        return ExitCode::FAILURE;
    }
    let mut command = cargo(root);
    // Files are named from where the user is, not from the workspace.
    if let Ok(here) = std::env::current_dir() {
        command.current_dir(here).arg("run").arg("--manifest-path").arg(root.join("Cargo.toml"));
    }
    command.args(["--quiet", "--locked", "--package", "surfel-conformance", "--example", program, "--"]);
    match command.args(options).status() {
        Ok(status) => match status.code().map(u8::try_from) {
            Some(Ok(code)) => ExitCode::from(code),
            _ => {
                eprintln!("error: the run ended early ({status}): a driver crashed, or someone stopped it");
                ExitCode::FAILURE
            }
        },
        Err(error) => {
            eprintln!("error: could not run {}: {error}", command.get_program().display());
            ExitCode::FAILURE
        }
    }
}
