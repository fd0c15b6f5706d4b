//! Drawing modules of exported pages: the CPU backend compiled to WebAssembly.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::python::{self, Tested};
use crate::{FEATURES, page};

const TARGET: &str = "wasm32-unknown-unknown";
/// Folder from which `surfel-web-module` embeds the modules.
pub(crate) const MODULES: &str = "crates/surfel-web-module/module";
/// Test script of a module, which runs in node.
const TEST: &str = "crates/surfel-web/tests/module.mjs";
/// Names of the modules, and the target features with which they are compiled.
const BUILDS: [(&str, &str); 2] = [("fused", "+simd128,+relaxed-simd"), ("emulated", "+simd128")];

/// Builds the modules into [`MODULES`]. Installs the WebAssembly target with rustup if it is missing.
pub(crate) fn build(root: &Path) -> bool {
    if !has_library(root) {
        println!("rustup target add {TARGET}");
        runs(Command::new("rustup").current_dir(root).args(["target", "add", TARGET]));
    }
    if !has_library(root) {
        eprintln!(
            "error: the standard library of {TARGET} is missing: rustup target add {TARGET}, or your distribution's \
             package of it"
        );
        return false;
    }
    let folder = root.join(MODULES);
    if let Err(why) = std::fs::create_dir_all(&folder) {
        eprintln!("error: {}: {why}", folder.display());
        return false;
    }
    BUILDS.iter().all(|(name, features)| {
        let Some(module) = build_one(root, features) else { return false };
        let to = folder.join(format!("{name}.wasm"));
        match std::fs::copy(&module, &to) {
            Ok(bytes) => println!("{}: {bytes} bytes", to.display()),
            Err(why) => {
                eprintln!("error: {}: {why}", to.display());
                return false;
            }
        }
        true
    })
}

/// Builds a module, and returns its path. The next build overwrites the file.
fn build_one(root: &Path, features: &str) -> Option<PathBuf> {
    let target = python::target(root).join("web");
    let mut cargo = crate::cargo(root);
    cargo.args(["rustc", "--profile", "web", "--target", TARGET, "--locked", "-p", "surfel-web", "--target-dir"]);
    // Only the linked module is stripped. Another Cargo profile would compile all dependencies again.
    cargo.arg(&target).args(["--", "-C", "strip=symbols"]);
    cargo.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", format!("-C target-feature={features}"));
    runs(cargo.env("CARGO_INCREMENTAL", "0")).then(|| target.join(TARGET).join("web").join("surfel_web.wasm"))
}

/// True if rustc finds the standard library of the WebAssembly target.
fn has_library(root: &Path) -> bool {
    let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    let found = rustc.current_dir(root).args(["--print", "target-libdir", "--target", TARGET]).output();
    let folder = found.map(|found| PathBuf::from(String::from_utf8_lossy(&found.stdout).trim().to_owned()));
    let has_core = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().starts_with("libcore");
    folder
        .ok()
        .and_then(|folder| std::fs::read_dir(folder).ok())
        .is_some_and(|mut entries| entries.any(|entry| entry.as_ref().is_ok_and(has_core)))
}

/// Tests the modules in node against the program that earlier tests have built. With `full`, builds the modules first,
/// which takes minutes, and also tests exported pages in Chromium; otherwise tests the modules that exist.
pub(crate) fn test(root: &Path, full: bool) -> Tested {
    println!("\n== drawing module of exported pages");
    if !runs(Command::new("node").arg("--version").stdout(Stdio::null()).stderr(Stdio::null())) {
        return Tested::Skipped("no node".to_owned());
    }
    if full && !build(root) {
        return Tested::Failed;
    }
    let modules: Vec<PathBuf> =
        BUILDS.iter().map(|(name, _)| root.join(MODULES).join(format!("{name}.wasm"))).collect();
    if let Some(missing) = modules.iter().find(|path| !path.exists()) {
        return Tested::Skipped(format!("no {}: cargo xtask web", missing.display()));
    }
    let program = python::target(root).join("debug").join("surfel");
    // In Node 20, a flag enables relaxed SIMD. Later versions don't know this flag.
    let has_flag = Command::new("node").args(["--experimental-wasm-relaxed-simd", "--version"]).output();
    let flag = has_flag.is_ok_and(|output| output.status.success()).then_some("--experimental-wasm-relaxed-simd");
    let mut command = Command::new("node");
    command.args(flag).arg(root.join(TEST)).arg(program).args(&modules);
    if runs(&mut command) && (!full || test_exported(root)) { Tested::Passed } else { Tested::Failed }
}

/// Tests exported pages in Chromium, with the packages that the page's own tests have installed.
fn test_exported(root: &Path) -> bool {
    let mut cargo = crate::cargo_for_tests(root);
    cargo.args(["build", "--locked", "-p", "surfel-cli", "--features", &format!("{FEATURES},surfel-cli/export")]);
    let mut unit = crate::cargo_for_tests(root);
    unit.args(["test", "--locked", "-p", "surfel-view", "--features", "export", "export::"]);
    if !runs(&mut cargo) || !runs(&mut unit) {
        return false;
    }
    let folder = page::folder(root);
    if !folder.join("node_modules").is_dir() {
        println!("skipped: exported pages: no packages in {}", folder.display());
        return true;
    }
    let program = python::target(root).join("debug").join("surfel");
    runs(Command::new("node").arg(folder.join("export.mjs")).arg(program).arg(folder.join("screenshots")))
}

fn runs(command: &mut Command) -> bool {
    command.status().is_ok_and(|status| status.success())
}
