//! Tests of imports between files: stages of `surfel-cpu` import only downward, the modules of every package have an
//! order, and no crate has a large cycle of files.
//!
//! Sources are read as text: `use crate::…` and `use super::…` outside of tests and comments.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders of `surfel-cpu` in the order of a frame. Each folder imports only from earlier ones; the files beside them
/// may import all.
const STAGES: [&str; 9] = ["simd", "scene", "tiles", "cull", "setup", "raster", "shade", "screen", "gaussians"];

/// Maximum number of files that may import each other in a cycle.
const MAX_CIRCLE: usize = 3;

/// Allowed cycles: sets of top-level modules that import each other. They are parts of the reference's model of splats,
/// balls and samples, each in its own file.
const CYCLES: [(&str, [&str; 3]); 3] = [
    ("crates/surfel-reference/src", ["ball", "shade", "shadow"]),
    ("crates/surfel-reference/src", ["frame", "nearest", "samples"]),
    ("crates/surfel-reference/src", ["margin", "splat", "threshold"]),
];

/// Files of a crate by their module paths, such as `tiles::grid`, with the paths that each imports.
type Imports = BTreeMap<String, BTreeSet<String>>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// Finds Rust files in a folder and its subfolders, with their relative paths.
fn files(folder: &Path, below: &str, found: &mut Vec<(String, String)>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            files(&path, &format!("{below}{name}/"), found);
        } else if name.ends_with(".rs") {
            found.push((format!("{below}{name}"), std::fs::read_to_string(&path).unwrap()));
        }
    }
}

/// Returns the module of a file: `tiles/grid.rs` is `tiles::grid`. Empty for `lib.rs`, `main.rs` and `mod.rs` at the
/// root.
fn module(file: &str) -> String {
    let path = file.trim_end_matches(".rs").trim_end_matches("/mod");
    if ["lib", "main", "mod"].contains(&path) { String::new() } else { path.replace('/', "::") }
}

/// Returns a source without comments and without test code, which is at the end of a file.
fn without_tests(source: &str) -> String {
    let mut lines = Vec::new();
    let mut skips_item = false;
    for line in source.lines() {
        let line = line.split("//").next().unwrap_or_default();
        if line.trim() == "#[cfg(test)]" {
            skips_item = true;
            continue;
        }
        if skips_item && line.trim_start().starts_with("mod ") && line.trim_end().ends_with('{') {
            break;
        }
        if !skips_item {
            lines.push(line);
        }
        skips_item = false;
    }
    lines.join("\n")
}

/// Returns the paths of a use tree: `a::{b, c::{d, e}}` gives `a::b`, `a::c::d` and `a::c::e`.
fn leaves(tree: &str) -> Vec<String> {
    let tree = tree.trim();
    let Some((head, rest)) = tree.split_once('{') else {
        return vec![tree.split(" as ").next().unwrap_or_default().trim().to_string()];
    };
    let inner = rest.strip_suffix('}').unwrap_or(rest);
    let (mut parts, mut depth, mut start) = (Vec::new(), 0, 0);
    for (i, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&inner[start..i]);
                start = i + 1;
            }
            _ => (),
        }
    }
    parts.push(&inner[start..]);
    let parts = parts.into_iter().filter(|part| !part.trim().is_empty());
    parts.flat_map(leaves).map(|leaf| format!("{}{leaf}", head.trim())).collect()
}

/// Returns the paths that a file imports from its own crate, relative to the crate's root.
fn imported(module: &str, source: &str) -> Vec<String> {
    let flat = without_tests(source).replace('\n', " ");
    let mut found = Vec::new();
    for part in flat.split("use ").skip(1) {
        let tree = part.split(';').next().unwrap_or_default();
        for leaf in leaves(tree) {
            if let Some(path) = leaf.strip_prefix("crate::") {
                found.push(path.to_string());
            } else if leaf.starts_with("super::") {
                let mut base: Vec<&str> = module.split("::").filter(|name| !name.is_empty()).collect();
                let mut rest = leaf.as_str();
                while let Some(next) = rest.strip_prefix("super::") {
                    base.pop();
                    rest = next;
                }
                base.push(rest);
                found.push(base.join("::"));
            }
        }
    }
    // Paths in expressions count as imports.
    for part in flat.split("crate::").skip(1) {
        let end = part.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).unwrap_or(part.len());
        found.push(part[..end].trim_end_matches(':').to_string());
    }
    found
}

/// Returns the imports between files of a crate.
fn imports(sources: &[(String, String)]) -> Imports {
    let modules: BTreeSet<String> = sources.iter().map(|(file, _)| module(file)).collect();
    let mut imports = Imports::new();
    for (file, source) in sources {
        let own = module(file);
        let of_file = imports.entry(own.clone()).or_default();
        for path in imported(&own, source) {
            // The longest prefix that is a file counts; the rest are items of this file. An item of the crate's root
            // may be a re-export, which is ignored.
            let mut path = path.trim_end_matches("::self").trim_end_matches("::*").to_string();
            while !path.is_empty() && !modules.contains(&path) {
                path = path.rsplit_once("::").map_or(String::new(), |(head, _)| head.to_string());
            }
            if !path.is_empty() && path != own {
                of_file.insert(path);
            }
        }
    }
    imports
}

/// Returns imports from a stage to a later one, or to a file outside of the stages.
fn upward(imports: &Imports) -> Vec<String> {
    let stage = |module: &str| {
        let folder = module.split("::").next().unwrap_or_default();
        STAGES.iter().position(|stage| *stage == folder).unwrap_or(STAGES.len())
    };
    let arrows = imports.iter().flat_map(|(from, to)| to.iter().map(move |to| (from, to)));
    let up = arrows.filter(|(from, to)| stage(from) < stage(to));
    up.map(|(from, to)| format!("{from} imports {to}, which comes later")).collect()
}

/// Returns the cycles, which are sets of files that all import each other, directly or indirectly.
fn circles(imports: &Imports) -> Vec<BTreeSet<String>> {
    let reach = |from: &String| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
        while let Some(file) = open.pop() {
            for next in imports.get(file).into_iter().flatten() {
                if seen.insert(next.clone()) {
                    open.push(next);
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&String, BTreeSet<String>> = imports.keys().map(|file| (file, reach(file))).collect();
    let mut found = Vec::new();
    let mut placed = BTreeSet::new();
    for (file, others) in &reached {
        if others.contains(*file) && !placed.contains(*file) {
            let back = |other: &&String| reached.get(other).is_some_and(|reached| reached.contains(*file));
            let circle: BTreeSet<String> = others.iter().filter(back).cloned().collect();
            placed.extend(circle.clone());
            found.push(circle);
        }
    }
    found
}

/// Returns the source folders of the workspace's packages, relative to its root.
fn source_folders() -> Vec<String> {
    let mut folders: Vec<String> = ["shaders", "tests", "xtask"].map(|name| format!("{name}/src")).to_vec();
    for package in std::fs::read_dir(root().join("crates")).unwrap() {
        folders.push(format!("crates/{}/src", package.unwrap().file_name().to_string_lossy()));
    }
    folders.retain(|folder| root().join(folder).is_dir());
    folders
}

fn sources(folder: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    files(&root().join(folder), "", &mut found);
    found
}

#[test]
fn stages_of_the_cpu_backend_import_down_only() {
    let imports = imports(&sources("crates/surfel-cpu/src"));
    let stages = STAGES.iter().filter(|stage| imports.keys().any(|file| file.starts_with(&format!("{stage}::"))));
    assert_eq!(stages.count(), STAGES.len(), "every stage is a folder");
    assert!(imports.values().map(BTreeSet::len).sum::<usize>() > 100, "imports are found");
    let problems = upward(&imports);
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
}

/// Returns the imports between the top-level modules of a crate, which are its folders and the files beside them.
fn imports_of_modules(imports: &Imports) -> Imports {
    let top = |path: &String| path.split("::").next().unwrap_or_default().to_owned();
    let mut modules = Imports::new();
    for (from, to) in imports.iter().filter(|(from, _)| !from.is_empty()) {
        let from = top(from);
        let found = modules.entry(from.clone()).or_default();
        found.extend(to.iter().map(top).filter(|to| *to != from));
    }
    modules
}

#[test]
fn modules_of_every_package_have_an_order() {
    let mut problems = Vec::new();
    let mut known: BTreeSet<(String, BTreeSet<String>)> =
        CYCLES.into_iter().map(|(folder, names)| (folder.to_owned(), names.map(str::to_owned).into())).collect();
    for folder in source_folders().into_iter().filter(|folder| folder.starts_with("crates/")) {
        let mut sources = sources(&folder);
        sources.retain(|(file, _)| !file.ends_with("tests.rs"));
        for circle in circles(&imports_of_modules(&imports(&sources))) {
            if !known.remove(&(folder.clone(), circle.clone())) {
                problems.push(format!("{folder}: modules import each other: {circle:?}"));
            }
        }
    }
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
    assert!(known.is_empty(), "cycles that are listed and gone: {known:?}");
    // Two folders that import each other through different files form a cycle of modules, but not of files.
    let made =
        made(&[("a/x.rs", "use crate::b::x::X;"), ("a/y.rs", ""), ("b/x.rs", ""), ("b/y.rs", "use crate::a::y::Y;")]);
    assert_eq!((circles(&made).len(), circles(&imports_of_modules(&made)).len()), (0, 1));
}

#[test]
fn no_crate_has_a_large_circle_of_files() {
    let mut problems = Vec::new();
    for folder in source_folders() {
        for circle in circles(&imports(&sources(&folder))) {
            if circle.len() > MAX_CIRCLE {
                problems.push(format!("{folder}: {} files import each other: {circle:?}", circle.len()));
            }
        }
    }
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
}

/// Returns the types named in a source that glam has only with its default features. A build of all tests enables these
/// features, because a crate for tests does; the program alone doesn't.
fn integer_vectors(source: &str) -> Vec<String> {
    let source = without_tests(source);
    let words = source.split(|c: char| !c.is_alphanumeric() && c != '_');
    let is_integer = |word: &&str| {
        let base = word.trim_end_matches(|c: char| c.is_ascii_digit());
        base.ends_with("Vec") && ["I", "U"].contains(&base.trim_end_matches("Vec").trim_end_matches(char::is_numeric))
            || base == "USizeVec"
    };
    words.filter(is_integer).map(str::to_owned).collect()
}

#[test]
fn program_uses_no_type_that_glam_lacks_without_its_default_features() {
    for folder in source_folders().iter().filter(|folder| folder.starts_with("crates/")) {
        for (file, source) in sources(folder) {
            assert_eq!(integer_vectors(&source), Vec::<String>::new(), "{folder}/{file}");
        }
    }
    let source = "use glam::{IVec3, DVec3, U64Vec2};\nlet v = Vec::new(); // UVec2\nlet w = USizeVec3::ONE;";
    assert_eq!(integer_vectors(source), ["IVec3", "U64Vec2", "USizeVec3"]);
}

fn made(files: &[(&str, &str)]) -> Imports {
    imports(&files.iter().map(|(file, source)| ((*file).to_string(), (*source).to_string())).collect::<Vec<_>>())
}

#[test]
fn checks_find_imports_that_run_up_and_circles_however_they_are_written() {
    let low = ("simd/lanes.rs", "pub struct Lanes;");
    let (high, below) = (("raster/block.rs", "use crate::simd::lanes::Lanes;"), ("simd.rs", "mod lanes;"));
    assert_eq!(upward(&made(&[low, high, below])), [""; 0]);
    for source in [
        "use crate::raster::block::draw;",
        "use crate::{raster::block, simd};",
        "use crate::raster::{\n    block::{self, draw},\n};",
        "use super::super::raster::block::draw as other;",
        "fn f() { crate::raster::block::draw() }",
    ] {
        let found = upward(&made(&[("simd/lanes.rs", source), high, below]));
        assert_eq!(found, ["simd::lanes imports raster::block, which comes later"], "{source}");
    }
    // A file outside of the stages may not be imported by them.
    let renderer = ("renderer.rs", "use crate::raster::block::draw;");
    assert_eq!(upward(&made(&[("simd/lanes.rs", "use crate::renderer::Renderer;"), high, renderer])).len(), 1);
    for source in
        ["// use crate::raster::block::draw;", "#[cfg(test)]\nmod tests {\n    use crate::raster::block::draw;\n}"]
    {
        assert_eq!(upward(&made(&[("simd/lanes.rs", source), high, below])), [""; 0], "{source}");
    }
    let circle = |names: &[&str]| {
        let uses = |i: usize| format!("use crate::{}::X;", names[(i + 1) % names.len()]);
        let files: Vec<(String, String)> =
            names.iter().enumerate().map(|(i, name)| (format!("{name}.rs"), uses(i))).collect();
        circles(&imports(&files))
    };
    assert_eq!(circle(&["a", "b", "c", "d"]).iter().map(BTreeSet::len).collect::<Vec<_>>(), [4]);
    assert!(circles(&made(&[("a.rs", "use crate::b::X;"), ("b.rs", "use crate::c::X;"), ("c.rs", "")])).is_empty());
}
