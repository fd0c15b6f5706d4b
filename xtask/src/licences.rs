//! `cargo xtask licences`: writes the licences of all dependencies to one file, and the software bill of materials
//! (SBOM) in the format CycloneDX. Both files are committed and shipped with every artefact. They depend only on
//! Cargo.lock.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Value, json};

use crate::graph::{self, Package};

/// Output file with the licence texts of all dependencies, relative to the workspace.
pub(crate) const LICENCES: &str = "THIRD-PARTY.txt";
/// Output file with the software bill of materials, relative to the workspace.
pub(crate) const SBOM: &str = "packaging/surfel.cdx.json";

/// Packages that are shipped: the program, and the extension module of the Python package.
const ROOTS: [&str; 2] = ["surfel-cli", "surfel-python"];

/// Prefixes of the names of licence files, in lower case.
const TEXTS: [&str; 5] = ["license", "licence", "copying", "notice", "unlicense"];

/// Writes both files. Returns true on success.
pub(crate) fn run(root: &Path) -> bool {
    let written = generated(root).and_then(|files| {
        for (name, text) in &files {
            std::fs::write(root.join(name), text).map_err(|error| format!("{name}: {error}"))?;
            println!("{name}: {} KB", text.len() / 1000);
        }
        Ok(())
    });
    if let Err(problem) = &written {
        eprintln!("error: {problem}");
    }
    written.is_ok()
}

/// Returns the names of the committed files that differ from those that [`run`] would write.
pub(crate) fn outdated(root: &Path) -> Result<Vec<&'static str>, String> {
    let files = generated(root)?;
    let differs = |name: &str, text: &String| std::fs::read_to_string(root.join(name)).ok().as_ref() != Some(text);
    Ok(files.into_iter().filter(|(name, text)| differs(name, text)).map(|(name, _)| name).collect())
}

fn generated(root: &Path) -> Result<[(&'static str, String); 2], String> {
    let packages = graph::shipped(root, &ROOTS)?;
    let version = crate::release::version(root)?;
    let sbom = serde_json::to_string_pretty(&sbom(&packages, &version)).map_err(|error| error.to_string())?;
    Ok([(LICENCES, licences(&packages)?), (SBOM, sbom + "\n")])
}

/// Returns the text of the licence file: the list of packages, then every licence text once.
fn licences(packages: &[Package]) -> Result<String, String> {
    let foreign: Vec<&Package> = packages.iter().filter(|package| !package.is_ours).collect();
    let mut page = format!(
        "Licences of the packages in Surfel\n\nThe program and the Python package contain {} packages of other \
         authors. Each is listed with\nits licence, and each licence text follows with the packages that ship it.\n\
         This file is generated: cargo xtask licences\n\n",
        foreign.len()
    );
    // Texts that differ only in white space count as one text.
    let mut texts: BTreeMap<String, (String, Vec<String>)> = BTreeMap::new();
    for package in &foreign {
        let name = format!("{} {}", package.name, package.version);
        let repository = package.repository.as_deref().unwrap_or("no repository stated");
        let _ = writeln!(page, "{name}: {}\n    {repository}", package.licence);
        for text in texts_of(&package.folder)? {
            let key = text.split_whitespace().collect::<Vec<_>>().join(" ");
            texts.entry(key).or_insert_with(|| (text, Vec::new())).1.push(name.clone());
        }
    }
    let mut texts: Vec<(String, Vec<String>)> = texts.into_values().collect();
    texts.sort_by(|a, b| (&a.1, &a.0).cmp(&(&b.1, &b.0)));
    for (text, mut names) in texts {
        names.dedup();
        let _ = write!(page, "\n{}\n{}\n\n{}\n", "=".repeat(80), names.join(", "), text.trim_end());
    }
    Ok(page)
}

/// Returns the licence texts in a package's folder, sorted by file name.
fn texts_of(folder: &Path) -> Result<Vec<String>, String> {
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name().to_string_lossy().to_lowercase();
        if TEXTS.iter().any(|start| name.starts_with(start)) && entry.path().is_file() {
            names.push(entry.path());
        }
    }
    names.sort();
    let read = |name: &std::path::PathBuf| {
        let bytes = std::fs::read(name).map_err(|error| format!("{}: {error}", name.display()))?;
        let text = String::from_utf8_lossy(&bytes).replace("\r\n", "\n");
        Ok(text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n"))
    };
    names.iter().map(read).collect()
}

/// Returns the bill of materials in CycloneDX 1.5. It contains no time and no random number, so that the same lock file
/// gives the same bytes.
fn sbom(packages: &[Package], version: &str) -> Value {
    let own = format!("pkg:generic/surfel@{version}");
    let roots = packages.iter().filter(|package| ROOTS.contains(&package.name.as_str()));
    let mut dependencies = vec![json!({"ref": own, "dependsOn": roots.map(Package::url).collect::<Vec<_>>()})];
    dependencies.extend(packages.iter().map(|package| json!({"ref": package.url(), "dependsOn": package.needs})));
    json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": {
            "type": "application", "bom-ref": own, "name": "surfel", "version": version, "purl": own,
            "licenses": [{"expression": "MIT OR Apache-2.0"}],
        }},
        "components": packages.iter().map(component).collect::<Vec<_>>(),
        "dependencies": dependencies,
    })
}

fn component(package: &Package) -> Value {
    let mut component = json!({
        "type": "library", "bom-ref": package.url(), "name": package.name, "version": package.version,
        "purl": package.url(), "licenses": [{"expression": package.licence}],
    });
    if let Some(checksum) = &package.checksum {
        component["hashes"] = json!([{"alg": "SHA-256", "content": checksum}]);
    }
    if let Some(repository) = package.repository.as_ref().filter(|_| !package.is_ours) {
        component["externalReferences"] = json!([{"type": "vcs", "url": repository}]);
    }
    component
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn committed_files_are_current() {
        let outdated = outdated(&crate::workspace_root()).unwrap();
        assert!(outdated.is_empty(), "{outdated:?}: run cargo xtask licences");
    }

    #[test]
    fn sbom_lists_components_and_dependencies() {
        let package = |name: &str, needs: &[&str]| Package {
            name: name.to_owned(),
            version: "1.0.0".to_owned(),
            licence: "MIT".to_owned(),
            needs: needs.iter().map(ToString::to_string).collect(),
            ..Package::default()
        };
        let packages = [package("b", &[]), package(ROOTS[0], &["pkg:cargo/b@1.0.0"])];
        let sbom = sbom(&packages, "1.0.0");
        assert_eq!(sbom["components"][0]["purl"], "pkg:cargo/b@1.0.0");
        assert_eq!(sbom["dependencies"][0]["dependsOn"], json!([format!("pkg:cargo/{}@1.0.0", ROOTS[0])]));
        assert_eq!(sbom["dependencies"][2]["dependsOn"], json!(["pkg:cargo/b@1.0.0"]));
        assert_eq!(sbom["metadata"]["component"]["version"], "1.0.0");
    }

    #[test]
    fn equal_texts_are_printed_once() {
        let folder = |name: &str, text: &str| {
            let folder = std::env::temp_dir().join(format!("surfel-licences-{}-{name}", std::process::id()));
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("LICENSE-MIT"), text).unwrap();
            Package { name: name.to_owned(), folder, licence: "MIT".to_owned(), ..Package::default() }
        };
        let packages = [folder("a", "Free for\r\nall.\n"), folder("b", "Free  for all."), folder("c", "Not free.")];
        let page = licences(&packages).unwrap();
        for package in &packages {
            std::fs::remove_dir_all(&package.folder).unwrap();
        }
        assert!(page.contains("a : MIT") && page.contains("a , b \n\nFree for\nall.\n") && page.contains("Not free."));
        assert_eq!(page.matches("Free").count(), 1, "{page}");
    }
}
