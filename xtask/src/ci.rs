//! `cargo xtask ci`: runs every check, even after failures.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::release::{self, Verdict};
use crate::{FEATURES, cargo, required, suites, tidy};

enum Outcome {
    Passed,
    Failed,
    Skipped(String),
}

pub(crate) fn run(root: &Path) -> bool {
    let step = |name: &'static str, work: &dyn Fn() -> Outcome| {
        println!("== {name}");
        (name, work())
    };
    let steps = [
        step("fmt", &|| command(cargo(root).args(["fmt", "--all", "--check"]))),
        step("clippy", &|| {
            let arguments = ["clippy", "--workspace", "--all-targets", "--features", FEATURES, "--locked"];
            command(cargo(root).args(arguments).args(["--", "-D", "warnings"]))
        }),
        // The program with default features, which don't include GPU backends.
        step("default program", &|| command(cargo(root).args(["check", "--package", "surfel-cli", "--locked"]))),
        // The library as dependents use it, with default features and with as few features as possible.
        step("default library", &|| command(cargo(root).args(["check", "--package", "surfel", "--locked"]))),
        step("smallest library", &|| {
            let arguments = ["check", "--package", "surfel", "--no-default-features", "--features", "cpu", "--locked"];
            command(cargo(root).args(arguments))
        }),
        step("doc", &|| {
            let arguments = ["doc", "--workspace", "--no-deps", "--locked"];
            command(cargo(root).args(arguments).env("RUSTDOCFLAGS", "-D warnings"))
        }),
        step("test", &|| outcome(suites::run(root, suites::Gpu::Required, false))),
        step("tidy", &|| outcome(tidy::run(root))),
        step("deny", &|| deny(root)),
        step("semver", &|| match release::semver(root) {
            Verdict::Passed(_) => Outcome::Passed,
            Verdict::Failed(_) => Outcome::Failed,
            Verdict::Skipped(why) => Outcome::Skipped(why),
        }),
    ];
    println!("== summary");
    let mut passed = true;
    for (name, outcome) in steps {
        match outcome {
            Outcome::Passed => println!("{name}: passed"),
            Outcome::Failed => println!("{name}: FAILED"),
            Outcome::Skipped(ref why) => println!("{name}: skipped, {why}"),
        }
        passed &= !matches!(outcome, Outcome::Failed);
    }
    passed
}

fn deny(root: &Path) -> Outcome {
    let installed = cargo(root)
        .args(["deny", "--version"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    match (installed, required("cargo-deny")) {
        (true, _) => command(cargo(root).args(["deny", "check"])),
        (false, true) => {
            eprintln!("error: SURFEL_REQUIRE asks for cargo-deny, which is not installed: cargo install cargo-deny");
            Outcome::Failed
        }
        (false, false) => Outcome::Skipped("cargo-deny is not installed".to_owned()),
    }
}

fn outcome(passed: bool) -> Outcome {
    if passed { Outcome::Passed } else { Outcome::Failed }
}

fn command(command: &mut Command) -> Outcome {
    match command.status() {
        Ok(status) => outcome(status.success()),
        Err(error) => {
            eprintln!("error: could not run {}: {error}", command.get_program().display());
            Outcome::Failed
        }
    }
}
