//! `cargo xtask release --dry-run`: makes everything that a release publishes, tests it as a new user would, and prints
//! the owner's remaining tasks. Nothing is uploaded.

mod checks;
mod crates;
mod emulated;
mod programs;
mod wheels;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// Result of a step, with a line of explanation.
pub(crate) enum Verdict {
    Passed(String),
    Failed(String),
    /// The step couldn't run, because the machine lacks a program or a service.
    Skipped(String),
}

impl From<Result<String, String>> for Verdict {
    fn from(result: Result<String, String>) -> Self {
        match result {
            Ok(detail) => Self::Passed(detail),
            Err(why) => Self::Failed(why),
        }
    }
}

/// Locations of a dry run: the checkout, and the output folder for packages, programs and wheels.
pub(crate) struct Place {
    root: PathBuf,
    out: PathBuf,
}

/// Step of the release: its name, and the function that performs it.
type Step = (&'static str, fn(&Place) -> Verdict);

const STEPS: [Step; 14] = [
    ("versions", checks::versions),
    ("files", checks::generated),
    ("workflows", checks::workflows),
    ("citation", checks::citation),
    ("web", programs::web),
    ("crates", crates::package),
    ("stranger", crates::stranger),
    ("features", crates::features),
    ("semver", crates::semver),
    ("wheels", wheels::build),
    ("environments", wheels::environments),
    ("sdist", wheels::source),
    ("tarball", programs::tarball),
    ("debian", programs::debian),
];

/// Performs the named steps, or all steps if `names` is empty, in order. Prints a summary with times, and the owner's
/// tasks.
pub(crate) fn run(root: &Path, names: &[&str]) -> bool {
    if let Some(unknown) = names.iter().find(|name| STEPS.iter().all(|(step, _)| step != *name)) {
        let known: Vec<&str> = STEPS.iter().map(|(step, _)| *step).collect();
        eprintln!("error: no step is called '{unknown}', expected some of: {}", known.join(" "));
        return false;
    }
    let place = Place { root: root.to_path_buf(), out: crate::python::target(root).join("release-dry-run") };
    if let Err(error) = std::fs::create_dir_all(&place.out) {
        eprintln!("error: {}: {error}", place.out.display());
        return false;
    }
    let mut passed = true;
    let mut summary = Vec::new();
    for (name, step) in STEPS.iter().filter(|(name, _)| names.is_empty() || names.contains(name)) {
        println!("\n== {name}");
        let start = Instant::now();
        let verdict = not_skipped(step(&place), crate::required(name));
        let (word, detail) = match &verdict {
            Verdict::Passed(detail) => ("passed", detail),
            Verdict::Failed(why) => ("FAILED", why),
            Verdict::Skipped(why) => ("skipped", why),
        };
        passed &= !matches!(verdict, Verdict::Failed(_));
        summary.push(format!("{name:<12} {word:<7} {:>6.1} s  {detail}", start.elapsed().as_secs_f64()));
    }
    println!("\n== summary\n{}\n\n{}", summary.join("\n"), owner_list(root));
    passed
}

/// Returns the verdict of a step. A step that is required but was skipped has failed.
fn not_skipped(verdict: Verdict, required: bool) -> Verdict {
    match verdict {
        Verdict::Skipped(why) if required => Verdict::Failed(format!("SURFEL_REQUIRE forbids skipping it: {why}")),
        verdict => verdict,
    }
}

/// Compares the public interfaces of the libraries with those of the last release.
pub(crate) fn semver(root: &Path) -> Verdict {
    crates::semver(&Place { root: root.to_path_buf(), out: PathBuf::new() })
}

/// Returns the tasks that only the owner can do, in at most ten lines.
fn owner_list(root: &Path) -> String {
    let version = version(root).unwrap_or_else(|_| "VERSION".to_owned());
    format!(
        "The owner's steps (docs/packages.md explains each):\n\
         1. git grep -l example.invalid/surfel | xargs sed -i 's|https://example.invalid/surfel|REPOSITORY|g'\n\
         2. Where a name is taken on crates.io or PyPI: cargo xtask rename PREFIX, then cargo xtask licences\n\
         3. Date [{version}] in CHANGELOG.md and CITATION.cff; MAINTAINER in xtask/src/release/programs.rs; commit\n\
         4. cargo xtask release --dry-run passes\n\
         5. Once: on PyPI, add this repository's release.yml as a trusted publisher\n\
         6. Once: cargo login\n\
         7. git tag v{version} && git push origin v{version}: the workflow makes a draft release and uploads wheels\n\
         8. cargo publish --workspace\n\
         9. Publish the draft release on the repository's page"
    )
}

/// Returns the version that all packages share.
pub(crate) fn version(root: &Path) -> Result<String, String> {
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).map_err(|error| format!("Cargo.toml: {error}"))?;
    let table = manifest.split_once("[workspace.package]").ok_or("Cargo.toml has no [workspace.package]")?.1;
    let value = table.lines().find_map(|line| line.strip_prefix("version = \"")?.strip_suffix('"'));
    value.map(str::to_owned).ok_or_else(|| "Cargo.toml: [workspace.package] has no version".to_owned())
}

/// Runs a command, whose output is shown. If it fails, the error names the command.
fn ran(command: &mut Command) -> Result<(), String> {
    let shown = shown(command);
    println!("{shown}");
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{shown}: {status}")),
        Err(error) => Err(format!("{shown}: {error}")),
    }
}

/// Runs a command and returns its standard output.
fn output(command: &mut Command) -> Result<Vec<u8>, String> {
    let shown = shown(command);
    let output = command.stderr(Stdio::inherit()).output().map_err(|error| format!("{shown}: {error}"))?;
    if output.status.success() { Ok(output.stdout) } else { Err(format!("{shown}: {}", output.status)) }
}

fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

/// True if the program can be started with this argument and succeeds.
fn is_here(program: &str, argument: &str) -> bool {
    let mut command = Command::new(program);
    command.arg(argument).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Returns the time of the last commit, in seconds since 1970; `0` if git fails. Archives contain this time instead of
/// the time of day.
fn epoch(root: &Path) -> String {
    let stdout = output(Command::new("git").current_dir(root).args(["log", "-1", "--format=%ct"])).unwrap_or_default();
    let time = String::from_utf8_lossy(&stdout).trim().to_owned();
    if time.is_empty() { "0".to_owned() } else { time }
}

/// Creates an empty folder. Deletes an existing folder first.
fn fresh(folder: &Path) -> Result<(), String> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

/// Returns the files of a folder whose names have one of these suffixes, sorted.
fn files_in(folder: &Path, ends: &[&str]) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> =
        entries.filter(|file| ends.iter().any(|end| file.to_string_lossy().ends_with(end))).collect();
    files.sort();
    files
}

/// Returns the name of a file without its folder.
fn name_of(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns the size of a file in bytes.
fn bytes_of(file: &Path) -> u64 {
    std::fs::metadata(file).map_or(0, |metadata| metadata.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn owner_list_has_at_most_ten_lines() {
        let list = owner_list(&crate::workspace_root());
        assert!(list.lines().count() <= 10, "{list}");
        assert!(list.contains(&version(&crate::workspace_root()).unwrap()));
    }

    #[test]
    fn versions_agree_everywhere() {
        let root = crate::workspace_root();
        assert_eq!(checks::version_problems(&root), [""; 0]);
    }

    #[test]
    fn required_steps_fail_if_they_are_skipped() {
        let skipped = || Verdict::Skipped("no tool".to_owned());
        assert!(matches!(not_skipped(skipped(), true), Verdict::Failed(why) if why.ends_with("no tool")));
        assert!(matches!(not_skipped(skipped(), false), Verdict::Skipped(_)));
        assert!(matches!(not_skipped(Verdict::Passed(String::new()), true), Verdict::Passed(_)));
    }

    #[test]
    fn steps_have_names_of_their_own() {
        let names: std::collections::BTreeSet<&str> = STEPS.iter().map(|(name, _)| *name).collect();
        assert_eq!(names.len(), STEPS.len());
        assert!(!run(&crate::workspace_root(), &["no-such-step"]));
    }
}
