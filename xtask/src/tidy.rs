//! `cargo xtask tidy`: what a compiler doesn't look at. The same checks run as tests.

mod packages;
mod pages;
mod text;

use std::path::{Path, PathBuf};
use std::process::Command;

pub(crate) use packages::package_name;

const MAX_FILE_BYTES: u64 = 2 << 20;

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
        if !name.ends_with(".lock") {
            problems.extend(text::check(&name, &text));
        }
        if name.ends_with(".md") {
            problems.extend(pages::check(root, &name, &text));
        }
    }
    problems.extend(packages::check(root, &files));
    problems
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
mod tests;
