//! Checks of package manifests, and of the architecture page's descriptions of packages.

use std::path::{Path, PathBuf};

/// Packages that don't inherit the workspace's lints, which forbid unsafe code. The first two call unsafe functions,
/// and the last has exported functions with unsafe attributes.
const OWN_LINTS: [&str; 3] = ["surfel-ash", "surfel-wgpu", "surfel-web"];

/// Returns problems of the packages' manifests and test folders, and packages that the architecture page doesn't
/// mention. Folders with their own workspace aren't checked.
pub(super) fn check(root: &Path, files: &[PathBuf]) -> Vec<String> {
    let mut problems = Vec::new();
    let page = "docs/architecture.md";
    let architecture = std::fs::read_to_string(root.join(page)).unwrap_or_default();
    for manifest in files.iter().filter(|file| file.ends_with("Cargo.toml")) {
        let name = manifest.display();
        let Ok(text) = std::fs::read_to_string(root.join(manifest)) else { continue };
        // A folder with its own workspace, such as that of fuzzing, has its own rules.
        let own_workspace = text.lines().any(|line| line.trim() == "[workspace]");
        let Some(package) = package_name(&root.join(manifest)).filter(|_| !own_workspace) else { continue };
        if !OWN_LINTS.contains(&package.as_str()) && !inherits_lints(&text) {
            problems.push(format!("{name}: no '[lints]' with 'workspace = true', expected in every package"));
        }
        if !names(&architecture, &package) {
            problems.push(format!("{page}: doesn't name {package}, expected a paragraph on every package"));
        }
        problems.extend(check_tests(root, manifest, &text, files));
    }
    problems
}

/// Checks that the integration tests of a package are a single binary, since each binary links all dependencies of the
/// package. A file that isn't a module of this binary would never run.
fn check_tests(root: &Path, manifest: &Path, text: &str, files: &[PathBuf]) -> Vec<String> {
    let folder = manifest.with_file_name("tests");
    let in_folder = |file: &&PathBuf| file.parent() == Some(&folder) && file.extension().is_some_and(|e| e == "rs");
    let tests: Vec<_> = files.iter().filter(in_folder).collect();
    if tests.len() < 2 {
        return Vec::new();
    }
    let main = std::fs::read_to_string(root.join(folder.join("main.rs"))).unwrap_or_default();
    let module = |file: &Path| format!("mod {};", file.file_stem().unwrap_or_default().to_string_lossy());
    let forgotten = |file: &&&PathBuf| !file.ends_with("main.rs") && !main.lines().any(|line| line == module(file));
    let mut problems: Vec<_> = tests
        .iter()
        .filter(forgotten)
        .map(|file| format!("{}: no module of {}/main.rs, so it never runs", file.display(), folder.display()))
        .collect();
    if !text.lines().any(|line| line == "autotests = false") {
        let name = manifest.display();
        problems.push(format!("{name}: no 'autotests = false', expected where tests/ has several files"));
    }
    problems
}

/// True if `page` contains the name `package`, and not only a longer name that begins or ends with it.
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

/// Returns the name in the `[package]` table of a manifest, if it has one.
pub(crate) fn package_name(manifest: &Path) -> Option<String> {
    let text = std::fs::read_to_string(manifest).ok()?;
    let mut table = text.lines().map(str::trim).skip_while(|line| *line != "[package]").skip(1);
    table.by_ref().take_while(|line| !line.starts_with('[')).find_map(|line| {
        let value = line.strip_prefix("name")?.trim_start().strip_prefix('=')?;
        Some(value.trim().trim_matches('"').to_string())
    })
}
