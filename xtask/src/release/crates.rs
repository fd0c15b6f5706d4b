//! Steps for the packages of crates.io.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Place, Verdict, bytes_of, files_in, fresh, is_here, name_of, output, ran, version};
use crate::cargo;

/// Library that reads every file format.
const READER: &str = "surfel-io";

/// Common pairs of features, with their package.
const PAIRS: [(&str, &str); 10] = [
    ("surfel", "cpu,ortho"),
    ("surfel", "cpu,sharp"),
    ("surfel", "cpu,wgpu"),
    ("surfel", "cpu,ash"),
    ("surfel", "cpu,reference"),
    ("surfel", "wgpu,ash"),
    (READER, "las,laz"),
    (READER, "gltf,draco"),
    (READER, "points,npy"),
    (READER, "laz,geotiff"),
];

/// Package that may be published, with its features.
struct Published {
    name: String,
    features: Vec<String>,
}

/// Returns all packages of the workspace that may be published.
fn published(root: &Path) -> Result<Vec<Published>, String> {
    let stdout = output(cargo(root).args(["metadata", "--format-version", "1", "--no-deps", "--locked"]))?;
    let metadata: serde_json::Value = serde_json::from_slice(&stdout).map_err(|error| error.to_string())?;
    let packages = metadata["packages"].as_array().map(Vec::as_slice).unwrap_or_default();
    let public = packages.iter().filter(|package| !package["publish"].as_array().is_some_and(Vec::is_empty));
    let keys =
        |table: &serde_json::Value| table.as_object().map(|table| table.keys().cloned().collect()).unwrap_or_default();
    let named =
        public.filter_map(|p| Some(Published { name: p["name"].as_str()?.to_owned(), features: keys(&p["features"]) }));
    Ok(named.collect())
}

/// Returns the paths of the packages' archives of this version.
fn archives(place: &Place) -> Result<Vec<PathBuf>, String> {
    let end = format!("-{}.crate", version(&place.root)?);
    Ok(files_in(&crate::python::target(&place.root).join("package"), &[&end]))
}

/// Writes the archive of each package, and prints its size.
pub(super) fn package(place: &Place) -> Verdict {
    let made = || {
        let packages = published(&place.root)?;
        for old in archives(place)? {
            std::fs::remove_file(&old).map_err(|error| format!("{}: {error}", old.display()))?;
        }
        let mut command = cargo(&place.root);
        // The packages aren't built here one after another; the step `stranger` builds them all at once.
        command.args(["package", "--no-verify", "--allow-dirty", "--quiet"]);
        command.args(packages.iter().flat_map(|package| ["--package", &package.name]));
        ran(&mut command)?;
        let archives = archives(place)?;
        for archive in &archives {
            println!("{:>8} KB  {}", bytes_of(archive) / 1000, name_of(archive));
        }
        let bytes: u64 = archives.iter().map(|archive| bytes_of(archive)).sum();
        if archives.len() == packages.len() {
            Ok(format!("{} packages, {} KB", archives.len(), bytes / 1000))
        } else {
            Err(format!("{} packages were made, expected {}", archives.len(), packages.len()))
        }
    };
    made().into()
}

/// Builds a new project outside of the checkout that depends on the packaged archives, and draws an image. Then builds
/// every package from its archive with all features.
pub(super) fn stranger(place: &Place) -> Verdict {
    let drawn = || {
        // The sources are outside of the checkout. Cargo's build results are inside.
        let folder = std::env::temp_dir().join(format!("surfel-stranger-{}", std::process::id()));
        let target = place.out.join("stranger-target");
        fresh(&folder.join("packages"))?;
        let archives = archives(place)?;
        if archives.is_empty() {
            return Err("no archives of packages: run cargo xtask release --dry-run crates first".to_owned());
        }
        let mut patches = String::new();
        for archive in &archives {
            ran(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(folder.join("packages")))?;
            let unpacked = archive.with_extension("");
            let name = name_of(&unpacked);
            let package = name.rsplit_once('-').map_or(name.as_str(), |(package, _)| package);
            let path = folder.join("packages").join(&name);
            patches += &format!("{package} = {{ path = {:?} }}\n", path.display().to_string());
        }
        write_project(place, &folder, &patches)?;
        let mut draw = cargo(&folder);
        ran(draw.arg("run").env("CARGO_TARGET_DIR", &target))?;
        let image = place.out.join("stranger.png");
        let drawn = std::fs::copy(folder.join("out.png"), &image);
        if drawn.map_err(|error| format!("the project drew no out.png: {error}"))? == 0 {
            return Err("the project's out.png is empty".to_owned());
        }
        let mut all = cargo(&folder);
        let names = published(&place.root)?;
        all.args(["check", "--all-features"]).args(names.iter().flat_map(|package| ["--package", &package.name]));
        ran(all.env("CARGO_TARGET_DIR", &target))?;
        std::fs::remove_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        Ok(format!("{} packages build from their archives; {} was drawn", archives.len(), name_of(&image)))
    };
    drawn().into()
}

/// Writes a project with the program of README.md. It depends on the packaged archives instead of crates.io.
fn write_project(place: &Place, folder: &Path, patches: &str) -> Result<(), String> {
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    let readme = std::fs::read_to_string(place.root.join("README.md")).map_err(failed)?;
    let program = crate::front_page::program_of(&readme).ok_or("README.md has no program")?;
    let version = version(&place.root)?;
    let depends = published(&place.root)?.into_iter().map(|package| format!("{} = \"={version}\"\n", package.name));
    // The package of the program has no library to depend on.
    let depends: String = depends.filter(|line| !line.contains("-cli ")).collect();
    let manifest = format!(
        "[package]\nname = \"stranger\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
         [workspace]\nmembers = [\"packages/*\"]\n\n[dependencies]\n{depends}\n[patch.crates-io]\n{patches}"
    );
    std::fs::create_dir_all(folder.join("src")).map_err(failed)?;
    std::fs::write(folder.join("Cargo.toml"), manifest).map_err(failed)?;
    std::fs::write(folder.join("src").join("main.rs"), program).map_err(failed)
}

/// Packages that need a backend, with a feature that enables one.
const DRAWING: [(&str, &str); 6] = [
    ("surfel-backend", "cpu"),
    ("surfel-ortho", "cpu"),
    ("surfel-app", "cpu"),
    ("surfel", "cpu"),
    ("surfel-view", "surfel-app/cpu"),
    ("surfel-cli", "surfel-app/cpu"),
];

/// Checks each package with every single feature, no features, all features, and common pairs of features.
pub(super) fn features(place: &Place) -> Verdict {
    let checked = || {
        let mut count = 0;
        let mut check = |package: &str, arguments: &[&str]| {
            count += 1;
            let mut command = cargo(&place.root);
            command.args(["check", "--quiet", "--locked", "--package", package]);
            ran(command.args(arguments))
        };
        for Published { name, features } in published(&place.root)? {
            // A package that draws doesn't compile without a backend.
            let backend = DRAWING.iter().find(|(package, _)| *package == name).map_or("", |(_, backend)| *backend);
            check(&name, &["--no-default-features", "--features", backend])?;
            check(&name, &["--all-features", "--features", backend])?;
            for feature in features.iter().filter(|feature| *feature != "default") {
                check(&name, &["--no-default-features", "--features", &format!("{backend},{feature}")])?;
            }
        }
        for (package, pair) in PAIRS {
            check(package, &["--no-default-features", "--features", pair])?;
        }
        Ok(format!("{count} combinations of features build"))
    };
    checked().into()
}

/// Compares the public interfaces of the libraries with those of the last release, which is given by its git tag.
pub(super) fn semver(place: &Place) -> Verdict {
    let current = match version(&place.root) {
        Ok(current) => current,
        Err(why) => return Verdict::Failed(why),
    };
    // Tags are sorted by version, the newest first.
    let listed = ["tag", "--list", "v*", "--sort=-version:refname"];
    let tags = output(Command::new("git").current_dir(&place.root).args(listed)).unwrap_or_default();
    let tags = String::from_utf8_lossy(&tags);
    let Some(tag) = baseline(&tags, &current) else {
        return Verdict::Skipped(format!("git has no tag of a release before {current}, which would be the baseline"));
    };
    if !is_here("cargo-semver-checks", "--help") {
        return Verdict::Skipped("no cargo-semver-checks: cargo install cargo-semver-checks".to_owned());
    }
    let mut command = cargo(&place.root);
    command.args(["semver-checks", "--workspace", "--baseline-rev", tag]);
    ran(&mut command).map(|()| format!("interfaces compared with {tag}")).into()
}

/// Returns the newest tag whose version isn't `current`. `tags` lists tags, the newest first.
fn baseline<'a>(tags: &'a str, current: &str) -> Option<&'a str> {
    tags.lines().find(|tag| tag.strip_prefix('v').is_some_and(|version| version != current))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn baseline_is_the_last_release() {
        assert_eq!(baseline("v0.3.0\nv0.2.1\nv0.2.0\n", "0.3.0"), Some("v0.2.1"));
        assert_eq!(baseline("v0.2.0\n", "0.3.0"), Some("v0.2.0"));
        assert_eq!(baseline("v0.2.0\n", "0.2.0"), None);
        assert_eq!(baseline("", "0.2.0"), None);
    }
}
