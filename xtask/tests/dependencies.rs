//! Tests of the dependencies between packages: invariant 1 of docs/architecture.md, checked with `cargo metadata`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Packages of the workspace with their layers, from the bottom up. A package depends only on packages with a lower
/// number; development dependencies are unrestricted.
const LAYERS: [(&str, u32); 31] = [
    ("surfel-math", 0),
    ("surfel-web-module", 0),
    ("surfel-model", 1),
    ("surfel-metrics", 1),
    ("surfel-figure", 1),
    ("surfel-files", 2),
    ("surfel-sample", 2),
    ("surfel-images", 3),
    ("surfel-io", 4),
    ("surfel-render", 4),
    ("surfel-light", 5),
    ("surfel-reference", 5),
    ("surfel-cpu", 5),
    ("surfel-shaders", 5),
    ("surfel-benches", 6),
    ("surfel-gpu", 6),
    ("surfel-wgpu", 7),
    ("surfel-ash", 7),
    ("surfel-framing", 5),
    ("surfel-load", 6),
    ("surfel-stage", 7),
    ("surfel-backend", 8),
    ("surfel-ortho", 9),
    ("surfel-app", 10),
    ("surfel", 11),
    ("surfel-view", 11),
    ("surfel-bench", 11),
    ("surfel-python", 12),
    ("surfel-cli", 12),
    ("surfel-web", 12),
    ("surfel-conformance", 13),
];

/// Packages that must not depend on a GPU crate, directly or indirectly.
const GPU_FREE: [&str; 15] = [
    "surfel-math",
    "surfel-model",
    "surfel-metrics",
    "surfel-render",
    "surfel-cpu",
    "surfel-reference",
    "surfel-figure",
    "surfel-files",
    "surfel-images",
    "surfel-io",
    "surfel-light",
    "surfel-sample",
    "surfel-framing",
    "surfel-load",
    "surfel-stage",
];
const GPU: [&str; 3] = ["wgpu", "ash", "naga"];

/// Package of the dependency graph.
#[derive(Clone, Debug, Default)]
struct Package {
    name: String,
    version: String,
    ours: bool,
    /// Ids of the packages needed for a build: normal and build dependencies on any platform.
    needs: BTreeSet<String>,
    /// Ids of development dependencies.
    tests_with: BTreeSet<String>,
}

type Graph = BTreeMap<String, Package>;

fn workspace_graph() -> Graph {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let metadata = |extra: &[&str]| {
        let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo.current_dir(root).args(["metadata", "--format-version", "1", "--locked"]).args(extra).output().unwrap()
    };
    let host = metadata_host();
    // The first attempt is offline, for all platforms. Packages for other platforms may be missing, so the next attempt
    // is online, and the last one is offline for this platform alone.
    let tries: [&[&str]; 3] = [&["--offline"], &[], &["--offline", "--filter-platform", &host]];
    let mut complaint = String::new();
    for extra in tries {
        let output = metadata(extra);
        if output.status.success() {
            return graph(&serde_json::from_slice(&output.stdout).unwrap());
        }
        complaint = String::from_utf8_lossy(&output.stderr).into_owned();
    }
    panic!("cargo metadata failed: {complaint}");
}

fn metadata_host() -> String {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).arg("-vV").output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().find_map(|line| line.strip_prefix("host: ")).unwrap().to_string()
}

fn graph(metadata: &Value) -> Graph {
    let text = |value: &Value| value.as_str().unwrap().to_string();
    let members: BTreeSet<String> = metadata["workspace_members"].as_array().unwrap().iter().map(text).collect();
    let mut graph = Graph::new();
    for package in metadata["packages"].as_array().unwrap() {
        let id = text(&package["id"]);
        let (name, version, ours) = (text(&package["name"]), text(&package["version"]), members.contains(&id));
        graph.insert(id, Package { name, version, ours, ..Package::default() });
    }
    for node in metadata["resolve"]["nodes"].as_array().unwrap() {
        let package = graph.get_mut(node["id"].as_str().unwrap()).unwrap();
        for dependency in node["deps"].as_array().unwrap() {
            for kind in dependency["dep_kinds"].as_array().unwrap() {
                let into =
                    if kind["kind"].as_str() == Some("dev") { &mut package.tests_with } else { &mut package.needs };
                into.insert(text(&dependency["pkg"]));
            }
        }
    }
    graph
}

fn ours(graph: &Graph) -> impl Iterator<Item = &Package> {
    graph.values().filter(|package| package.ours)
}

fn names<'a>(graph: &'a Graph, ids: &'a BTreeSet<String>) -> impl Iterator<Item = &'a Package> {
    ids.iter().filter_map(|id| graph.get(id))
}

/// Returns the names of all packages that building `package` needs, directly or indirectly.
fn reach(graph: &Graph, package: &Package) -> BTreeSet<String> {
    let mut open: Vec<&Package> = vec![package];
    let mut seen = BTreeSet::new();
    while let Some(package) = open.pop() {
        open.extend(names(graph, &package.needs).filter(|next| seen.insert(next.name.clone())));
    }
    seen
}

fn layer_problems(graph: &Graph) -> Vec<String> {
    let layer = |name: &str| LAYERS.iter().find(|(package, _)| *package == name).map(|(_, layer)| *layer);
    let mut problems = Vec::new();
    for package in ours(graph).filter(|package| package.name != "xtask") {
        let name = &package.name;
        let Some(own) = layer(name) else {
            problems.push(format!("{name} has no layer: add it to LAYERS and to docs/architecture.md"));
            continue;
        };
        for dependency in names(graph, &package.needs).filter(|dependency| dependency.ours) {
            let below = layer(&dependency.name).is_some_and(|layer| layer < own);
            let allowed = below && (name != "surfel-metrics" || dependency.name == "surfel-math");
            if !allowed {
                problems.push(format!("{name} depends on {}, which isn't below it", dependency.name));
            }
        }
    }
    for package in ours(graph).filter(|package| package.name == "xtask") {
        for dependency in names(graph, &package.needs).chain(names(graph, &package.tests_with)).filter(|d| d.ours) {
            problems.push(format!("xtask depends on {}, expected on none of ours", dependency.name));
        }
    }
    problems
}

fn gpu_problems(graph: &Graph) -> Vec<String> {
    let free = ours(graph).filter(|package| GPU_FREE.contains(&package.name.as_str()));
    let reached = free.flat_map(|package| {
        let reached = reach(graph, package);
        GPU.into_iter().filter(move |gpu| reached.contains(*gpu)).map(|gpu| format!("{} reaches {gpu}", package.name))
    });
    reached.collect()
}

fn math_problems(graph: &Graph) -> Vec<String> {
    let needs = ours(graph).filter(|package| package.name == "surfel-math").flat_map(|math| names(graph, &math.needs));
    needs
        .filter(|d| d.name != "glam")
        .map(|d| format!("surfel-math depends on {}, expected glam alone", d.name))
        .collect()
}

/// Returns the dependencies of which packages of the workspace use several versions.
fn version_problems(graph: &Graph) -> Vec<String> {
    let mut versions: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for package in ours(graph) {
        let direct = names(graph, &package.needs).chain(names(graph, &package.tests_with));
        for dependency in direct.filter(|dependency| !dependency.ours) {
            versions.entry(&dependency.name).or_default().insert(&dependency.version);
        }
    }
    let several = versions.into_iter().filter(|(_, versions)| versions.len() > 1);
    several.map(|(name, versions)| format!("{name} in versions {versions:?}, expected one")).collect()
}

type Check = fn(&Graph) -> Vec<String>;
const CHECKS: [Check; 4] = [layer_problems, gpu_problems, math_problems, version_problems];

#[test]
fn workspace_keeps_its_layers_and_one_version_of_each_dependency() {
    let graph = workspace_graph();
    assert!(ours(&graph).any(|package| package.name == "surfel-math"), "the graph is not of this workspace");
    let problems: Vec<String> = CHECKS.iter().flat_map(|check| check(&graph)).collect();
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
}

/// Creates a graph of packages. Each is given by `name version`, its dependencies and its development dependencies.
/// Packages of version 0.1.0 belong to the workspace.
fn made(packages: &[(&str, &[&str], &[&str])]) -> Graph {
    let owned = |ids: &[&str]| ids.iter().map(ToString::to_string).collect();
    let package = |(id, needs, tests_with): &(&str, &[&str], &[&str])| {
        let (name, version) = id.split_once(' ').unwrap();
        let (name, version, ours) = (name.to_string(), version.to_string(), version == "0.1.0");
        (id.to_string(), Package { name, version, ours, needs: owned(needs), tests_with: owned(tests_with) })
    };
    packages.iter().map(package).collect()
}

fn good() -> Vec<(&'static str, &'static [&'static str], &'static [&'static str])> {
    vec![
        ("surfel-math 0.1.0", &["glam 1.0.0"], &["rand 1.0.0"]),
        ("surfel-metrics 0.1.0", &["surfel-math 0.1.0", "rand 1.0.0"], &[]),
        ("surfel-model 0.1.0", &["surfel-math 0.1.0"], &["surfel-io 0.1.0"]),
        ("surfel-io 0.1.0", &["surfel-model 0.1.0", "png 1.0.0"], &[]),
        ("surfel-wgpu 0.1.0", &["surfel-io 0.1.0", "wgpu 1.0.0"], &[]),
        ("xtask 0.1.0", &[], &["rand 1.0.0"]),
        ("glam 1.0.0", &[], &[]),
        ("png 1.0.0", &["rand 2.0.0"], &["ash 1.0.0"]),
        ("rand 1.0.0", &[], &[]),
        ("rand 2.0.0", &[], &[]),
        ("wgpu 1.0.0", &["naga 1.0.0"], &[]),
        ("naga 1.0.0", &[], &[]),
        ("ash 1.0.0", &[], &[]),
    ]
}

#[test]
fn checks_accept_a_good_graph() {
    let graph = made(&good());
    for (i, check) in CHECKS.iter().enumerate() {
        assert_eq!(check(&graph), [""; 0], "check {i}");
    }
}

/// Test case of a rule: a package that breaks the rule by its dependencies or development dependencies, and the
/// expected message.
struct Broken {
    check: Check,
    id: &'static str,
    needs: &'static [&'static str],
    tests_with: &'static [&'static str],
    complaint: &'static str,
}

#[test]
fn checks_find_each_broken_rule() {
    let broken = |check, id, complaint| Broken { check, id, needs: &[], tests_with: &[], complaint };
    let cases = [
        Broken {
            needs: &["surfel-io 0.1.0"],
            ..broken(layer_problems, "surfel-model 0.1.0", "surfel-model depends on surfel-io")
        },
        Broken {
            needs: &["surfel-model 0.1.0"],
            ..broken(layer_problems, "surfel-metrics 0.1.0", "surfel-metrics depends on")
        },
        Broken {
            tests_with: &["surfel-math 0.1.0"],
            ..broken(layer_problems, "xtask 0.1.0", "xtask depends on surfel-math")
        },
        broken(layer_problems, "surfel-new 0.1.0", "surfel-new has no layer"),
        Broken { needs: &["wgpu 1.0.0"], ..broken(gpu_problems, "png 1.0.0", "surfel-io reaches naga") },
        Broken { needs: &["ash 1.0.0"], ..broken(gpu_problems, "surfel-math 0.1.0", "surfel-model reaches ash") },
        Broken {
            needs: &["glam 1.0.0", "rand 1.0.0"],
            ..broken(math_problems, "surfel-math 0.1.0", "surfel-math depends on rand")
        },
        Broken { needs: &["rand 2.0.0"], ..broken(version_problems, "surfel-io 0.1.0", "rand in versions") },
        Broken { tests_with: &["rand 2.0.0"], ..broken(version_problems, "surfel-io 0.1.0", "rand in versions") },
    ];
    for Broken { check, id, needs, tests_with, complaint } in cases {
        let mut packages = good();
        packages.retain(|package| package.0 != id);
        packages.push((id, needs, tests_with));
        let problems = check(&made(&packages));
        assert!(problems.iter().any(|problem| problem.contains(complaint)), "{complaint}: {problems:?}");
    }
}
