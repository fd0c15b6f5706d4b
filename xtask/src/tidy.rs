//! `cargo xtask tidy`: what a compiler doesn't look at. The same checks run as tests.

use std::path::{Path, PathBuf};
use std::process::Command;

const MAX_FILE_BYTES: u64 = 2 << 20;
const MAX_RUST_LINES: usize = 500;

/// Written in two parts, so that this file passes its own check.
const LEFTOVERS: [&str; 3] = [concat!("to", "do!("), concat!("un", "implemented!("), concat!("db", "g!(")];

/// Folders that exist on one machine only.
const MACHINE_FOLDERS: [&str; 6] = [
    concat!("/ho", "me/"),
    concat!("/ro", "ot/"),
    concat!("/wo", "rk/"),
    concat!("/tm", "p/"),
    concat!("/Us", "ers/"),
    concat!(":\\Us", "ers\\"),
];

/// Data beside the checkout, which only tests, benchmarks and examples may look for (and do without).
const BESIDE_THE_CHECKOUT: &str = concat!("../sha", "red");

/// Packages with lints of their own: the only one with unsafe code can't inherit the ban on it.
const OWN_LINTS: [&str; 1] = ["surfel-ash"];

pub(crate) fn run(root: &Path) -> bool {
    let problems = problems(root);
    for problem in &problems {
        println!("{problem}");
    }
    println!("tidy: {} problems", problems.len());
    problems.is_empty()
}

/// Everything that is wrong with the tree, one line each.
fn problems(root: &Path) -> Vec<String> {
    let files = files(root);
    let mut problems = Vec::new();
    if files.is_empty() {
        problems.push(format!("{}: no files found, so nothing was checked", root.display()));
    }
    for file in &files {
        let name = file.to_string_lossy().replace('\\', "/");
        let full = root.join(file);
        let size = std::fs::metadata(&full).map_or(0, |metadata| metadata.len());
        if size > MAX_FILE_BYTES {
            problems.push(format!("{name}: {size} bytes, expected at most {MAX_FILE_BYTES}: generate or shrink it"));
            continue;
        }
        let Ok(text) = std::fs::read_to_string(&full) else { continue };
        let mut text_problems = if name.ends_with(".lock") { Vec::new() } else { check_text(&name, &text) };
        problems.append(&mut text_problems);
    }
    problems.extend(check_packages(root, &files));
    problems
}

/// Problems of one file's text; `name` is relative to the root, with slashes.
fn check_text(name: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    let rust = name.ends_with(".rs");
    let lines = text.lines().count();
    if rust && lines > MAX_RUST_LINES {
        problems.push(format!("{name}: {lines} lines, expected at most {MAX_RUST_LINES}: split it by idea"));
    }
    let mut folders = name.split('/').rev().skip(1);
    let may_look_beside = folders.any(|folder| ["tests", "benches", "examples"].contains(&folder));
    for (i, line) in text.lines().enumerate() {
        let place = format!("{name}:{}", i + 1);
        if rust && !line.trim_start().starts_with("//") {
            for leftover in LEFTOVERS.iter().filter(|leftover| contains_word(line, leftover)) {
                problems.push(format!("{place}: {leftover}), finish it"));
            }
        }
        for folder in MACHINE_FOLDERS.iter().filter(|folder| contains_path(line, folder)) {
            problems.push(format!("{place}: {folder} exists on one machine only, expected a relative path"));
        }
        if !may_look_beside && line.contains(BESIDE_THE_CHECKOUT) {
            problems.push(format!("{place}: {BESIDE_THE_CHECKOUT} is for tests, benchmarks and examples only"));
        }
    }
    problems
}

/// Whether `word` occurs where no longer word goes on before it.
fn contains_word(line: &str, word: &str) -> bool {
    before_each(line, word).any(|before| !before.is_some_and(|c| c.is_alphanumeric() || c == '_'))
}

/// Whether `folder` occurs as the start of a path rather than inside one.
fn contains_path(line: &str, folder: &str) -> bool {
    let inside = |c: char| c.is_alphanumeric() || "_-.~)}]>*$\\".contains(c);
    let drive = folder.starts_with(':');
    before_each(line, folder).any(|before| drive || !before.is_some_and(inside))
}

/// The character before each occurrence of `needle`.
fn before_each<'a>(line: &'a str, needle: &'a str) -> impl Iterator<Item = Option<char>> + 'a {
    line.match_indices(needle).map(|(at, _)| line[..at].chars().next_back())
}

/// Problems of the packages' manifests and of their mention in the architecture page.
fn check_packages(root: &Path, files: &[PathBuf]) -> Vec<String> {
    let mut problems = Vec::new();
    let page = "docs/architecture.md";
    let architecture = std::fs::read_to_string(root.join(page)).unwrap_or_default();
    for manifest in files.iter().filter(|file| file.ends_with("Cargo.toml")) {
        let name = manifest.display();
        let Ok(text) = std::fs::read_to_string(root.join(manifest)) else { continue };
        // A folder with a workspace of its own (fuzzing) goes by its own rules.
        let own_workspace = text.lines().any(|line| line.trim() == "[workspace]");
        let Some(package) = package_name(&root.join(manifest)).filter(|_| !own_workspace) else { continue };
        if !OWN_LINTS.contains(&package.as_str()) && !inherits_lints(&text) {
            problems.push(format!("{name}: no '[lints]' with 'workspace = true', expected in every package"));
        }
        if !names(&architecture, &package) {
            problems.push(format!("{page}: doesn't name {package}, expected a paragraph on every package"));
        }
    }
    problems
}

/// Whether `page` names `package` itself, not just a longer name that begins or ends with it.
fn names(page: &str, package: &str) -> bool {
    let part = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    page.match_indices(package).any(|(at, _)| {
        let after = page[at + package.len()..].chars().next();
        !page[..at].chars().next_back().is_some_and(part) && !after.is_some_and(part)
    })
}

fn inherits_lints(manifest: &str) -> bool {
    let mut lines = manifest.lines().map(str::trim).skip_while(|line| *line != "[lints]").skip(1);
    lines.by_ref().take_while(|line| !line.starts_with('[')).any(|line| line.replace(' ', "") == "workspace=true")
}

/// The name in the `[package]` table of a manifest, if there is one.
pub(crate) fn package_name(manifest: &Path) -> Option<String> {
    let text = std::fs::read_to_string(manifest).ok()?;
    let mut table = text.lines().map(str::trim).skip_while(|line| *line != "[package]").skip(1);
    table.by_ref().take_while(|line| !line.starts_with('[')).find_map(|line| {
        let value = line.strip_prefix("name")?.trim_start().strip_prefix('=')?;
        Some(value.trim().trim_matches('"').to_string())
    })
}

/// The tree's files, relative to its root, in order: what git has or would add, or, without git, all but
/// build results and hidden folders.
fn files(root: &Path) -> Vec<PathBuf> {
    let git = Command::new("git")
        .current_dir(root)
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .output();
    let mut files: Vec<PathBuf> = match git {
        Ok(output) if output.status.success() => {
            let listed = output.stdout.split(|&b| b == 0).filter(|name| !name.is_empty());
            // Listed, but perhaps deleted since.
            listed.map(|n| PathBuf::from(&*String::from_utf8_lossy(n))).filter(|n| root.join(n).is_file()).collect()
        }
        _ => {
            let mut found = Vec::new();
            walk(root, Path::new(""), &mut found);
            found
        }
    };
    files.sort();
    files.dedup();
    files
}

fn walk(root: &Path, folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(root.join(folder)).into_iter().flatten().flatten() {
        let path = folder.join(entry.file_name());
        // Not followed where it is a link, so that a loop of them ends.
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_file() {
            found.push(path);
        } else if kind.is_dir()
            && entry.file_name() != "target"
            && !entry.file_name().to_string_lossy().starts_with('.')
        {
            walk(root, &path, found);
        }
    }
}

#[cfg(test)]
#[path = "tidy_tests.rs"]
mod tests;
