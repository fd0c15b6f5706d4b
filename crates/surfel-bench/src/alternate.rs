//! Measurement of two builds of this program in alternation, so that disturbances of the machine affect both equally.

use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::report::Report;
use crate::{Arguments, Failure, read};

/// Number of runs of each build.
const ROUNDS: usize = 3;

/// Runs both builds with the same arguments, in alternation, [`ROUNDS`] times each. Each report has the frames of all
/// rounds.
pub(crate) fn measured(programs: [&Path; 2], arguments: &Arguments) -> Result<[Report; 2], Failure> {
    let mut reports: [Option<Report>; 2] = [None, None];
    for round in 1..=ROUNDS {
        for (program, report) in programs.into_iter().zip(&mut reports) {
            if std::io::stderr().is_terminal() {
                eprintln!("round {round} of {ROUNDS}: {}", program.display());
            }
            let next = run(program, arguments)?;
            match report {
                Some(report) => report.extend(next),
                None => *report = Some(next),
            }
        }
    }
    match reports {
        [Some(a), Some(b)] => Ok([a, b]),
        _ => Err("nothing was run".into()),
    }
}

fn run(program: &Path, arguments: &Arguments) -> Result<Report, Failure> {
    let file = Temporary(std::env::temp_dir().join(format!("surfel-bench-{}.json", std::process::id())));
    let mut command = Command::new(program);
    command.args(words(arguments)).arg("--output").arg(&file.0).stdout(Stdio::null());
    let status = command.status().map_err(|e| format!("could not run {}: {e}", program.display()))?;
    if !status.success() {
        return Err(format!("{} failed: {status}", program.display()).into());
    }
    read(&file.0)
}

/// Temporary file, which is removed when the value is dropped.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        // The file may be missing: a failed run writes nothing.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Returns the command-line arguments with which a build of this program measures what `a` requests.
fn words(a: &Arguments) -> Vec<OsString> {
    let mut words: Vec<OsString> =
        vec!["--backend".into(), a.backend.name().into(), "--simd".into(), a.simd.name().into()];
    words.extend(["--models".into(), a.models.clone().into()]);
    // Older builds don't have this option.
    words.extend((a.storage != "32").then(|| ["--storage".into(), a.storage.clone().into()]).into_iter().flatten());
    words.extend(a.threads.iter().flat_map(|n| ["--threads".into(), n.to_string().into()]));
    words.extend(a.scene.iter().flat_map(|name| ["--scene".into(), name.into()]));
    words.extend(a.adapter.iter().flat_map(|name| ["--adapter".into(), name.into()]));
    words.extend(a.runs.iter().flat_map(|n| ["--runs".into(), n.to_string().into()]));
    words.extend(a.quick.then(|| "--quick".into()));
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[test]
    fn builds_are_run_with_the_same_arguments() {
        for line in [
            "bench",
            "bench --backend ash --adapter x --quick --threads 3 --scene igea --scene far --runs 4 --simd avx2",
            "bench --models a/b --storage 16",
        ] {
            let asked = Arguments::parse_from(line.split(' '));
            let passed_on = Arguments::parse_from(std::iter::once("bench".into()).chain(words(&asked)));
            assert_eq!(format!("{asked:?}"), format!("{passed_on:?}"));
        }
    }

    #[test]
    fn program_that_fails_or_is_not_there_is_named() {
        let arguments = Arguments::parse_from(["bench"]);
        let error = measured([Path::new("no/such/program"); 2], &arguments).unwrap_err().to_string();
        assert!(error.contains("no/such/program"), "{error}");
    }
}
