//! Tests of the page of `surfel view` in headless Chromium.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::python::{self, Tested};

/// Folder of the tests' sources, relative to the workspace.
const TESTS: &str = "crates/surfel-view/tests/page";
/// Scripts of the page, whose syntax is checked if node is installed.
const SCRIPTS: [&str; 6] = [
    "crates/surfel-view/page/view.js",
    "crates/surfel-view/page/export.js",
    "crates/surfel-view/page/module.js",
    "crates/surfel-view/page/worker.js",
    "crates/surfel-view/page/frame.js",
    "crates/surfel-web/tests/module.mjs",
];
/// Names of the tests' files.
const FILES: [&str; 8] =
    ["package.json", "browser.mjs", "hill.mjs", "png.mjs", "test.mjs", "measure.mjs", "export.mjs", "lab.mjs"];
const CHROMIUM: &str = "/usr/bin/chromium";

/// Returns the folder in which the tests run. It contains npm's packages.
pub(crate) fn folder(root: &Path) -> PathBuf {
    python::target(root).join("page-tests")
}

/// Tests the page with the program that earlier tests have built. With `full`, installs Chromium and npm's packages if
/// they are missing.
pub(crate) fn test(root: &Path, full: bool) -> Tested {
    println!("\n== page of surfel view");
    let runs = |command: &mut Command| command.status().is_ok_and(|status| status.success());
    if !runs(Command::new("node").arg("--version").stdout(Stdio::null()).stderr(Stdio::null())) {
        return Tested::Skipped("no node".to_owned());
    }
    if !SCRIPTS.iter().all(|script| runs(Command::new("node").arg("--check").arg(root.join(script)))) {
        return Tested::Failed;
    }
    if full && !Path::new(CHROMIUM).exists() {
        let install = ["install", "-q", "-y", "--no-install-recommends", "chromium"];
        runs(Command::new("apt-get").args(install).env("DEBIAN_FRONTEND", "noninteractive"));
    }
    if !Path::new(CHROMIUM).exists() {
        return Tested::Skipped(format!("no {CHROMIUM}: apt-get install chromium"));
    }
    let folder = folder(root);
    let copy = |name: &&str| std::fs::copy(root.join(TESTS).join(name), folder.join(name)).map(drop);
    if let Err(why) = std::fs::create_dir_all(&folder).and_then(|()| FILES.iter().try_for_each(copy)) {
        eprintln!("error: {} can't be written: {why}", folder.display());
        return Tested::Failed;
    }
    if full && !runs(Command::new("npm").args(["install", "--silent", "--no-audit", "--no-fund"]).current_dir(&folder))
    {
        return Tested::Skipped("npm could not install playwright-core and axe-core".to_owned());
    }
    if !folder.join("node_modules").is_dir() {
        return Tested::Skipped(format!("no packages: npm install in {}", folder.display()));
    }
    let program = python::target(root).join("debug").join("surfel");
    let mut command = Command::new("node");
    command.arg(folder.join("test.mjs")).arg(program).arg(folder.join("screenshots"));
    if runs(&mut command) { Tested::Passed } else { Tested::Failed }
}
