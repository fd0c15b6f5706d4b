//! `cargo xtask bench`: builds the package surfel-bench for release and runs it.

use std::path::Path;

use crate::cargo;

/// Backends that are features of surfel-bench: built only where they are asked for, since they take a minute.
const GPU_BACKENDS: [&str; 2] = ["wgpu", "ash"];

/// Runs the bench with these arguments, in the workspace.
pub(crate) fn run(root: &Path, arguments: &[&str]) -> bool {
    let mut command = cargo(root);
    command.args(["run", "--release", "--locked", "--package", "surfel-bench"]);
    if let Some(feature) = feature(arguments) {
        command.args(["--features", feature]);
    }
    match command.arg("--").args(arguments).status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("error: could not run cargo run: {error}");
            false
        }
    }
}

/// The feature that the wanted backend needs.
fn feature(arguments: &[&str]) -> Option<&'static str> {
    let after = arguments.iter().position(|word| *word == "--backend").and_then(|i| arguments.get(i + 1).copied());
    let joined = arguments.iter().find_map(|word| word.strip_prefix("--backend="));
    GPU_BACKENDS.into_iter().find(|name| after.or(joined) == Some(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bench_builds_only_the_backend_that_is_asked_for() {
        assert_eq!(feature(&["--quick", "--backend", "ash"]), Some("ash"));
        assert_eq!(feature(&["--backend=wgpu"]), Some("wgpu"));
        assert_eq!(feature(&["--backend", "cpu"]), None);
        assert_eq!(feature(&["--scene", "ash"]), None);
    }
}
