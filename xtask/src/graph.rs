//! Dependency graph of the shipped program and of the Python package, from `cargo metadata`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::cargo;

/// Cargo features of the shipped program and extension module.
const SHIPPED: &str = "surfel-cli/gpu,surfel-cli/mcp,surfel-cli/zstd,surfel-python/gpu,surfel-python/zstd";

/// Package of the dependency graph.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Package {
    pub(crate) name: String,
    pub(crate) version: String,
    /// Licence as an SPDX expression.
    pub(crate) licence: String,
    /// Address of the package's source repository, if its manifest states one.
    pub(crate) repository: Option<String>,
    /// Folder of the package's sources.
    pub(crate) folder: PathBuf,
    /// True if the package belongs to this workspace.
    pub(crate) is_ours: bool,
    /// SHA-256 of the package's archive, as stated by the registry.
    pub(crate) checksum: Option<String>,
    /// Package URLs of the dependencies, sorted.
    pub(crate) needs: Vec<String>,
}

impl Package {
    /// Returns the package URL, which identifies the package in an SBOM.
    pub(crate) fn url(&self) -> String {
        format!("pkg:cargo/{}@{}", self.name, self.version.replace('+', "%2B"))
    }
}

/// Returns all packages that are linked into the packages `roots` on Linux, including `roots`, sorted by name and
/// version.
pub(crate) fn shipped(root: &Path, roots: &[&str]) -> Result<Vec<Package>, String> {
    let metadata = metadata(root)?;
    let lock = std::fs::read_to_string(root.join("Cargo.lock")).map_err(|error| format!("Cargo.lock: {error}"))?;
    let packages = packages(&metadata, &checksums(&lock)).ok_or("cargo metadata printed what wasn't expected")?;
    let mut open: Vec<&Package> = packages.values().filter(|package| roots.contains(&package.name.as_str())).collect();
    if open.len() != roots.len() {
        return Err(format!("the workspace lacks one of {}", roots.join(", ")));
    }
    let by_url: BTreeMap<String, &Package> = packages.values().map(|package| (package.url(), package)).collect();
    let mut reached: BTreeSet<String> = open.iter().map(|package| package.url()).collect();
    while let Some(package) = open.pop() {
        let needed = package.needs.iter().filter_map(|url| by_url.get(url));
        open.extend(needed.filter(|next| reached.insert(next.url())));
    }
    let mut found: Vec<Package> = reached.iter().map(|url| by_url[url].clone()).collect();
    found.sort_by(|a, b| (&a.name, &a.version).cmp(&(&b.name, &b.version)));
    Ok(found)
}

/// Runs `cargo metadata` and returns its output. Packages are downloaded only if some are missing.
fn metadata(root: &Path) -> Result<Value, String> {
    let mut complaint = String::new();
    for extra in [&["--offline"][..], &[]] {
        let mut command = cargo(root);
        command.args(["metadata", "--format-version", "1", "--locked", "--features", SHIPPED]).args(extra);
        for platform in &crate::python::TARGETS {
            command.args(["--filter-platform", platform.triple]);
        }
        let output = command.output().map_err(|error| format!("cargo metadata can't be run: {error}"))?;
        if output.status.success() {
            return serde_json::from_slice(&output.stdout).map_err(|error| format!("cargo metadata: {error}"));
        }
        complaint = String::from_utf8_lossy(&output.stderr).into_owned();
    }
    Err(format!("cargo metadata failed: {complaint}"))
}

/// Returns all packages by their ids in cargo; `None` if cargo's output has another form. Only dependencies that a
/// program links are listed, not development or build dependencies.
fn packages(metadata: &Value, checksums: &BTreeMap<(String, String), String>) -> Option<BTreeMap<String, Package>> {
    let text = |value: &Value| value.as_str().map(str::to_owned);
    let members: BTreeSet<String> = metadata["workspace_members"].as_array()?.iter().filter_map(text).collect();
    let mut packages = BTreeMap::new();
    for package in metadata["packages"].as_array()? {
        let id = text(&package["id"])?;
        let (name, version) = (text(&package["name"])?, text(&package["version"])?);
        let manifest = PathBuf::from(package["manifest_path"].as_str()?);
        let package = Package {
            checksum: checksums.get(&(name.clone(), version.clone())).cloned(),
            licence: text(&package["license"]).unwrap_or_default().replace('/', " OR ").replace("  ", " "),
            repository: text(&package["repository"]),
            folder: manifest.parent()?.to_path_buf(),
            is_ours: members.contains(&id),
            needs: Vec::new(),
            name,
            version,
        };
        packages.insert(id, package);
    }
    for node in metadata["resolve"]["nodes"].as_array()? {
        let links = |dependency: &&Value| {
            dependency["dep_kinds"].as_array().is_some_and(|kinds| kinds.iter().any(|kind| kind["kind"].is_null()))
        };
        let needed = node["deps"].as_array()?.iter().filter(links).filter_map(|dependency| dependency["pkg"].as_str());
        let needs: BTreeSet<String> = needed.filter_map(|id| packages.get(id)).map(Package::url).collect();
        packages.get_mut(node["id"].as_str()?)?.needs = needs.into_iter().collect();
    }
    Some(packages)
}

/// Returns the checksums in a lock file, by name and version of the package.
fn checksums(lock: &str) -> BTreeMap<(String, String), String> {
    let value = |block: &str, key: &str| {
        let line = block.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = \""));
        line.and_then(|line| line.strip_suffix('"')).map(str::to_owned)
    };
    let blocks = lock.split("[[package]]").skip(1);
    blocks.filter_map(|b| Some(((value(b, "name")?, value(b, "version")?), value(b, "checksum")?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn graph_contains_what_a_program_links() {
        let lock =
            "version = 4\n\n[[package]]\nname = \"b\"\nversion = \"1.0.0\"\nsource = \"r\"\nchecksum = \"abc\"\n";
        let package = |name: &str| {
            json!({"id": name, "name": name, "version": "1.0.0", "license": "MIT/Apache-2.0", "repository": null,
                "manifest_path": format!("/x/{name}/Cargo.toml")})
        };
        let needs = |name: &str, kind: Value| json!({"pkg": name, "dep_kinds": [{"kind": kind}]});
        let metadata = json!({
            "workspace_members": ["a"],
            "packages": [package("a"), package("b"), package("c")],
            "resolve": {"nodes": [
                {"id": "a", "deps": [needs("b", Value::Null), needs("c", json!("dev")), needs("c", json!("build"))]},
                {"id": "b", "deps": []}, {"id": "c", "deps": []},
            ]},
        });
        let packages = packages(&metadata, &checksums(lock)).unwrap();
        assert_eq!(packages["a"].needs, ["pkg:cargo/b@1.0.0"]);
        assert_eq!(packages["b"].checksum.as_deref(), Some("abc"));
        assert!(packages["a"].is_ours && !packages["b"].is_ours && packages["a"].checksum.is_none());
        assert_eq!(packages["c"].licence, "MIT OR Apache-2.0");
    }
}
