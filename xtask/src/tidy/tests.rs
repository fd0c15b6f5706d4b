use super::text::{BESIDE_THE_CHECKOUT, LEFTOVERS, MACHINE_FOLDERS, MAX_COLUMNS, check};
use super::*;

/// Folder that is removed when the value is dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-xtask-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const MANIFEST: &str = "[package]\nname = \"surfel-a\"\n\n[lints]\nworkspace = true\n";

#[test]
fn tree_is_tidy() {
    let problems = problems(&crate::workspace_root());
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
}

#[test]
fn tree_without_problems_has_none() {
    let tree = Folder::new("clean");
    tree.write("crates/surfel-a/Cargo.toml", MANIFEST);
    tree.write("crates/surfel-a/src/lib.rs", "//! Nothing.\n");
    tree.write("docs/architecture.md", "`surfel-a` does it.\n");
    tree.write("fuzz/Cargo.toml", "[package]\nname = \"fuzz\"\n[workspace]\n");
    assert_eq!(problems(&tree.0), [""; 0]);
}

#[test]
fn tree_finds_manifests_and_packages_that_break_rules() {
    let tree = Folder::new("packages");
    tree.write("crates/surfel-a/Cargo.toml", "[package]\nname = \"surfel-a\"\n[lints.rust]\nworkspace = true\n");
    tree.write("crates/surfel-ash/Cargo.toml", "[package]\nname = \"surfel-ash\"\n");
    tree.write("docs/architecture.md", "surfel-ash and surfel-ab\n");
    let problems = problems(&tree.0);
    assert_eq!(problems.len(), 2, "{problems:?}");
    assert!(problems[0].contains("crates/surfel-a/Cargo.toml: no '[lints]'"), "{problems:?}");
    assert!(problems[1].contains("doesn't name surfel-a,"), "{problems:?}");
}

#[test]
fn tree_finds_tests_that_would_never_run() {
    let tree = Folder::new("tests");
    tree.write("crates/surfel-a/Cargo.toml", MANIFEST);
    tree.write("docs/architecture.md", "surfel-a\n");
    tree.write("crates/surfel-a/tests/one.rs", "//! One.\n");
    assert_eq!(problems(&tree.0), [""; 0]);
    tree.write("crates/surfel-a/tests/main.rs", "//! Both.\n\nmod one;\n");
    tree.write("crates/surfel-a/tests/two.rs", "//! Two.\n");
    let problems = problems(&tree.0);
    assert_eq!(problems.len(), 2, "{problems:?}");
    assert!(problems[0].contains("tests/two.rs: no module of crates/surfel-a/tests/main.rs"), "{problems:?}");
    assert!(problems[1].contains("crates/surfel-a/Cargo.toml: no 'autotests = false'"), "{problems:?}");
}

#[test]
fn tree_finds_files_that_are_too_large_and_a_tree_that_is_not_there() {
    let tree = Folder::new("large");
    tree.write("data/a.bin", vec![0; MAX_FILE_BYTES as usize]);
    assert_eq!(problems(&tree.0), [""; 0]);
    tree.write("data/b.bin", vec![0; MAX_FILE_BYTES as usize + 1]);
    assert!(problems(&tree.0)[0].contains("data/b.bin: 2097153 bytes"));
    assert!(problems(&tree.0.join("absent"))[0].contains("nothing was checked"));
}

#[test]
fn text_ends_by_a_column_but_for_tables_and_code_of_pages() {
    let (fits, long) = ("x".repeat(MAX_COLUMNS), "ä".repeat(MAX_COLUMNS + 1));
    for name in ["a.rs", "a.md", "shaders/a.wgsl"] {
        assert!(check(name, &fits).is_empty(), "{name}");
        assert_eq!(check(name, &format!("\n{long}")), [format!("{name}:2: 121 columns, expected 120")]);
    }
    assert!(check("a.json", &long).is_empty() && check("docs/data/a.md", &long).is_empty());
    let table = format!("| {long} |\n```\n{long}\n```\n");
    assert!(check("a.md", &table).is_empty());
    assert_eq!(check("a.md", &format!("{table}{long}")).len(), 1);
    assert_eq!(check("a.rs", &table).len(), 2);
}

#[test]
fn text_leftovers() {
    for leftover in LEFTOVERS {
        assert_eq!(check("a.rs", &format!("fn f() {{ {leftover}) }}")).len(), 1, "{leftover}");
        assert!(check("a.rs", &format!("// never write {leftover})")).is_empty());
        assert!(check("a.rs", &format!("my_{leftover})")).is_empty());
        assert!(check("a.md", leftover).is_empty());
    }
}

#[test]
fn text_machine_paths() {
    for folder in MACHINE_FOLDERS {
        assert_eq!(check("a.md", &format!("see {folder}me/x")).len(), 1, "{folder}");
        assert_eq!(check("a.toml", &format!("x = \"{folder}me\"")).len(), 1, "{folder}");
    }
    let inside = MACHINE_FOLDERS[2];
    for path in [format!("https://example.org{inside}x"), format!("..{inside}x"), format!("{{dir}}{inside}x")] {
        assert!(check("a.rs", &path).is_empty(), "{path}");
    }
}

#[test]
fn text_data_beside_the_checkout() {
    let line = format!("open(\"{BESIDE_THE_CHECKOUT}/models\")");
    assert_eq!(check("crates/a/tests/models.rs", &line).len(), 1);
    assert_eq!(check("README.md", &line).len(), 1);
    assert!(check("tests/src/test_data.rs", &line).is_empty());
}

#[test]
fn tree_finds_pages_that_disagree_on_whether_a_gpu_was_measured() {
    let tree = Folder::new("gpu");
    let problems = |page: &str, readme: &str, performance: &str| {
        tree.write("docs/data/gpu.md", page);
        tree.write("README.md", readme);
        tree.write("docs/performance.md", performance);
        problems(&tree.0)
    };
    let (not_measured, measured) = ("**Not measured.** No GPU has run this kit.\n", "Measured on **Card**.\n");
    let (says_not, links) = ("No GPU has been\nmeasured ([figures](docs/data/gpu.md)).\n", "[a](docs/data/gpu.md)\n");
    let (performance_says_not, performance_links) =
        ("No GPU has been measured: [figures](data/gpu.md).\n", "[figures](data/gpu.md)\n");
    assert_eq!(problems(not_measured, says_not, performance_says_not), [""; 0]);
    assert_eq!(problems(measured, links, performance_links), [""; 0]);
    let claims = problems(not_measured, links, performance_says_not);
    assert!(claims.len() == 1 && claims[0].starts_with("README.md: docs/data/gpu.md has it otherwise"), "{claims:?}");
    let stale = problems(measured, links, performance_says_not);
    assert!(stale.len() == 1 && stale[0].starts_with("docs/performance.md"), "{stale:?}");
    let unlinked = problems(not_measured, "No GPU has been measured.\n", performance_says_not);
    assert!(unlinked.len() == 1 && unlinked[0].contains("doesn't link"), "{unlinked:?}");
}
