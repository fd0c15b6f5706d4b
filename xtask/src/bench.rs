//! `cargo xtask bench`: builds the package surfel-bench for release and runs it.

use std::path::Path;
use std::process::Command;

use crate::cargo;

/// Backends that are Cargo features of surfel-bench. They are compiled only on request, since they take a minute.
const GPU_BACKENDS: [&str; 2] = ["wgpu", "ash"];

/// Runs the benchmark program with these arguments, and returns true if it succeeds. For the command `start`, builds
/// the program `surfel` first, unless `--program` names a build.
pub(crate) fn run(root: &Path, arguments: &[&str]) -> bool {
    if times_own_program(arguments) {
        let mut command = cargo(root);
        command.args(["build", "--release", "--locked", "--package", "surfel-cli", "--bin", "surfel"]);
        if !succeeds(&mut command, "cargo build") {
            return false;
        }
    }
    let mut command = cargo(root);
    command.args(["run", "--release", "--locked", "--package", "surfel-bench"]);
    let features = features(arguments);
    if !features.is_empty() {
        command.args(["--features", &features.join(",")]);
    }
    succeeds(command.arg("--").args(arguments), "cargo run")
}

/// True for the command `start`, unless the arguments name a build of the program.
fn times_own_program(arguments: &[&str]) -> bool {
    arguments.first() == Some(&"start") && !arguments.iter().any(|word| word.starts_with("--program"))
}

fn succeeds(command: &mut Command, name: &str) -> bool {
    match command.status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("error: could not run {name}: {error}");
            false
        }
    }
}

/// Returns the Cargo features that the requested backends need.
fn features(arguments: &[&str]) -> Vec<&'static str> {
    let after = arguments.iter().position(|word| *word == "--backend").and_then(|i| arguments.get(i + 1).copied());
    let joined = arguments.iter().find_map(|word| word.strip_prefix("--backend="));
    let wanted: Vec<&str> = after.or(joined).unwrap_or_default().split(',').map(str::trim).collect();
    GPU_BACKENDS.into_iter().filter(|name| wanted.contains(name) || wanted.contains(&"all")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_is_built_where_no_other_is_given() {
        assert!(times_own_program(&["start"]) && times_own_program(&["start", "--runs", "3"]));
        assert!(!times_own_program(&["start", "--program", "old"]) && !times_own_program(&["start", "--program=old"]));
        assert!(!times_own_program(&["prepare"]) && !times_own_program(&[]));
    }

    #[test]
    fn bench_builds_only_the_backends_that_are_asked_for() {
        assert_eq!(features(&["--quick", "--backend", "ash"]), ["ash"]);
        assert_eq!(features(&["--backend=wgpu"]), ["wgpu"]);
        assert_eq!(features(&["--backend", "cpu,ash"]), ["ash"]);
        assert_eq!(features(&["tradeoff", "--backend", "all"]), ["wgpu", "ash"]);
        assert!(features(&["--backend", "cpu"]).is_empty());
        assert!(features(&["--scene", "ash"]).is_empty());
    }
}
