//! `cargo xtask tidy`: checks the tree for problems that the compiler doesn't find. Tests run the same checks.

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

/// Returns the problems of the tree, one line each.
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
    problems.extend(gpu_claims(root));
    problems
}

/// Text that the pages in [`GPU_CLAIMS`] must contain until a GPU is measured, and only until then.
const NO_GPU: &str = "No GPU has been measured";

/// Pages that state whether a GPU was measured.
const GPU_CLAIMS: [&str; 2] = ["README.md", "docs/performance.md"];
/// Page of GPU measurements, relative to the root.
const GPU_PAGE: &str = "docs/data/gpu.md";

/// Returns the problems of the pages in [`GPU_CLAIMS`]: each must link the page of GPU measurements, and agree with it
/// on whether a GPU was measured. None if that page doesn't exist.
fn gpu_claims(root: &Path) -> Vec<String> {
    let Ok(page) = std::fs::read_to_string(root.join(GPU_PAGE)) else { return Vec::new() };
    let is_measured = !page.contains(crate::gpu_kit::NOT_MEASURED);
    let problem = |name: &&str| {
        let text = std::fs::read_to_string(root.join(name)).unwrap_or_default();
        // The words may be separated by a line break.
        let says_not = text.split_whitespace().collect::<Vec<_>>().join(" ").contains(NO_GPU);
        let link = GPU_PAGE.strip_prefix("docs/").filter(|_| name.starts_with("docs/")).unwrap_or(GPU_PAGE);
        if !text.contains(&format!("({link})")) {
            Some(format!("{name}: doesn't link {link}, which says whether a GPU was measured"))
        } else if says_not == is_measured {
            let expected = if is_measured { "not to say" } else { "to say" };
            Some(format!("{name}: {GPU_PAGE} has it otherwise, expected {expected} '{NO_GPU}'"))
        } else {
            None
        }
    };
    GPU_CLAIMS.iter().filter_map(problem).collect()
}

/// Returns the files of the tree in order, relative to its root. They are the files that git tracks or would add.
/// Without git, they are all files except build results and hidden folders.
pub(crate) fn files(root: &Path) -> Vec<PathBuf> {
    let git = Command::new("git")
        .current_dir(root)
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .output();
    let mut files: Vec<PathBuf> = match git {
        Ok(output) if output.status.success() => {
            let listed = output.stdout.split(|&b| b == 0).filter(|name| !name.is_empty());
            // A listed file may have been deleted.
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
        // Links aren't followed, so that a loop of links can't run forever.
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
