//! Tests of the contents of published packages: complete metadata, no test data, no file outside of the package's
//! folder, and a README whose example is that of the documentation.

use std::path::{Component, Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Packages that are never published: tests, benches, chores, and the extension module of the Python package, which
/// is published as wheels.
const PRIVATE: [&str; 6] =
    ["surfel-bench", "surfel-benches", "surfel-conformance", "surfel-python", "surfel-web", "xtask"];

/// Number of published libraries, as stated in docs/packages.md.
const LIBRARIES: usize = 25;

/// Package that may be published.
struct Package {
    name: String,
    folder: PathBuf,
    is_library: bool,
    metadata: Value,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

fn cargo(arguments: &[&str]) -> String {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    let output = command.current_dir(root()).args(arguments).output().unwrap();
    assert!(output.status.success(), "cargo {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Returns all packages of the workspace.
fn members() -> Vec<Value> {
    let metadata: Value =
        serde_json::from_str(&cargo(&["metadata", "--format-version", "1", "--no-deps", "--offline"])).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

fn is_private(member: &Value) -> bool {
    member["publish"].as_array().is_some_and(Vec::is_empty)
}

/// Returns the packages that may be published.
fn published() -> Vec<Package> {
    let public = members().into_iter().filter(|member| !is_private(member));
    let package = |metadata: Value| {
        let is_library = |target: &Value| target["kind"].as_array().unwrap().iter().any(|kind| kind == "lib");
        Package {
            name: metadata["name"].as_str().unwrap().to_owned(),
            folder: Path::new(metadata["manifest_path"].as_str().unwrap()).parent().unwrap().to_path_buf(),
            is_library: metadata["targets"].as_array().unwrap().iter().any(is_library),
            metadata,
        }
    };
    public.map(package).collect()
}

#[test]
fn packages_that_are_never_published_are_known() {
    let members = members();
    let mut private: Vec<&str> =
        members.iter().filter(|m| is_private(m)).map(|m| m["name"].as_str().unwrap()).collect();
    private.sort_unstable();
    assert_eq!(private, PRIVATE, "publish = false is for tests, benches and chores alone");
}

/// Returns the missing metadata that users of crates.io would need.
fn metadata_problems(package: &Package) -> Vec<String> {
    let Package { name, metadata, .. } = package;
    let text = |key: &str| metadata[key].as_str().unwrap_or_default();
    let list = |key: &str| metadata[key].as_array().map(Vec::as_slice).unwrap_or_default();
    let mut problems = Vec::new();
    let mut expect = |holds: bool, what: &str| {
        if !holds {
            problems.push(format!("{name}: expected {what}"));
        }
    };
    expect(text("description").len() >= 40, "a description of at least 40 letters");
    expect(!text("description").starts_with("Surfel"), "a description that doesn't begin with the project's name");
    expect((3..=5).contains(&list("keywords").len()), "3 to 5 keywords");
    let is_short = |keyword: &Value| keyword.as_str().is_some_and(|keyword| keyword.len() <= 20);
    expect(list("keywords").iter().all(is_short), "keywords of at most 20 letters");
    expect((1..=5).contains(&list("categories").len()), "1 to 5 categories");
    expect(text("license") == "MIT OR Apache-2.0", "the licences");
    expect(!text("repository").is_empty() && !text("homepage").is_empty(), "a repository and a homepage");
    expect(text("readme") == "README.md", "a README.md of its own");
    let page = format!("https://docs.rs/{name}");
    expect(!package.is_library || text("documentation") == page, &format!("documentation = \"{page}\""));
    problems
}

#[test]
fn packages_have_metadata() {
    let packages = published();
    assert!(packages.len() >= 16 && packages.iter().any(|package| package.name == "surfel-io"));
    let problems: Vec<String> = packages.iter().flat_map(metadata_problems).collect();
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
    let mut without = published().pop().unwrap();
    without.metadata["keywords"] = Value::Array(Vec::new());
    assert_eq!(metadata_problems(&without).len(), 1, "the check finds what is missing");
}

#[test]
fn libraries_are_as_many_as_the_page_on_packages_states() {
    let packages = published();
    let (libraries, programs): (Vec<&Package>, Vec<&Package>) = packages.iter().partition(|package| package.is_library);
    assert_eq!(libraries.len(), LIBRARIES, "correct the table of docs/packages.md, too");
    assert_eq!(programs.iter().map(|package| package.name.as_str()).collect::<Vec<_>>(), ["surfel-cli"]);
}

/// True if a published package may contain the file: sources, shaders, the viewer's page and its WebAssembly module, a
/// font, an example, the licences, and cargo's own files.
fn may_contain(file: &str) -> bool {
    let folders = ["src/", "build/", "passes/", "wgsl/", "examples/", "page/", "fonts/", "module/"];
    let is_source = folders.iter().any(|folder| file.starts_with(folder));
    let ends = [".rs", ".wgsl", ".txt", ".html", ".css", ".js", ".svg", ".ttf", ".wasm", "subset.py"];
    let is_text = ends.iter().any(|end| file.ends_with(end));
    let others = ["Cargo.toml", "Cargo.toml.orig", "Cargo.lock", ".cargo_vcs_info.json", "README.md", "build.rs"];
    (is_source && is_text) || others.contains(&file) || file == "LICENSE-MIT" || file == "LICENSE-APACHE"
}

#[test]
fn packages_contain_no_test_data() {
    assert!(may_contain("src/lib.rs") && !may_contain("tests/data/square.drc") && !may_contain("src/a.drc"));
    let packages = published();
    let mut arguments = vec!["package", "--list", "--allow-dirty", "--offline"];
    arguments.extend(packages.iter().flat_map(|package| ["--package", &package.name]));
    let listed = cargo(&arguments);
    for every in ["README.md", "LICENSE-MIT", "LICENSE-APACHE", "Cargo.toml"] {
        assert_eq!(listed.lines().filter(|line| *line == every).count(), packages.len(), "{every}");
    }
    let excess: Vec<&str> = listed.lines().filter(|file| !may_contain(file)).collect();
    assert!(excess.is_empty(), "packages contain {excess:?}: see `include` in their manifests");
}

/// Returns the files that a source includes by a literal path, relative to the source's folder.
fn included(source: &str) -> impl Iterator<Item = &str> {
    ["include_str!(\"", "include_bytes!(\"", "include!(\"", "#[path = \""]
        .into_iter()
        .flat_map(move |start| source.split(start).skip(1))
        .filter_map(|rest| rest.split_once('"').map(|(path, _)| path))
}

/// Resolves `..` without the file system.
fn resolved(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut folder, component| {
        if component == Component::ParentDir {
            folder.pop();
        } else {
            folder.push(component);
        }
        folder
    })
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn packages_include_no_file_from_elsewhere() {
    assert_eq!(included("include_str!(\"../../a.md\") #[path = \"b.rs\"]").collect::<Vec<_>>(), ["../../a.md", "b.rs"]);
    assert_eq!(resolved(Path::new("/a/src/b/../../../c.md")), Path::new("/c.md"));
    for package in published() {
        let mut files = Vec::new();
        for folder in ["src", "build"] {
            sources(&package.folder.join(folder), &mut files);
        }
        assert!(!files.is_empty(), "{} has no sources", package.name);
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            for path in included(&text) {
                let target = resolved(&file.parent().unwrap().join(path));
                let inside = target
                    .strip_prefix(&package.folder)
                    .is_ok_and(|inside| may_contain(&inside.to_string_lossy().replace('\\', "/")) && target.is_file());
                assert!(inside, "{}: includes {path}, which the package of {} lacks", file.display(), package.name);
            }
        }
    }
}

/// Returns the code lines of the first example in a text whose lines begin with `prefix`. Indentation, rustdoc's
/// markers of hidden lines and empty lines are removed.
fn example(text: &str, prefix: &str) -> Vec<String> {
    let lines = text.lines().map_while(|line| line.strip_prefix(prefix));
    let block = lines.map(str::trim).skip_while(|line| !line.starts_with("```")).skip(1);
    let code = block.take_while(|line| !line.starts_with("```"));
    let shown = code.map(|line| line.strip_prefix("# ").or_else(|| (line == "#").then_some("")).unwrap_or(line));
    shown.filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

#[test]
fn readmes_have_the_example_of_the_documentation() {
    assert_eq!(example("//! a\n//! ```\n//! # use b;\n//!     c();\n//! ```\nd", "//!"), ["use b;", "c();"]);
    for package in published().iter().filter(|package| package.is_library) {
        let read = |name: &str| std::fs::read_to_string(package.folder.join(name)).unwrap();
        let documented = example(&read("src/lib.rs"), "//!");
        assert!(!documented.is_empty(), "{}: no example on the first page", package.name);
        assert_eq!(example(&read("README.md"), ""), documented, "{}: README.md and src/lib.rs differ", package.name);
        assert!(read("README.md").contains("docs/SUMMARY.md"), "{}: README.md doesn't link the book", package.name);
    }
}
