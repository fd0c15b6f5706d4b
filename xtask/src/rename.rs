//! `cargo xtask rename PREFIX`: renames the published packages, in case a name is taken on crates.io or PyPI. `surfel`
//! becomes PREFIX and `surfel-io` becomes PREFIX-io. The names of libraries, of the program and of the Python module
//! don't change. No source changes: a program depends on `PREFIX` and writes `use surfel::…`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::cargo;

/// Files that list packages in pairs with a layer or features. In such a pair, `surfel` means the package, not the
/// program.
const PAIRS: [&str; 2] = ["xtask/tests/dependencies.rs", "xtask/src/release/crates.rs"];

/// File to be changed, with its new text.
#[derive(Debug, PartialEq, Eq)]
struct Change {
    file: PathBuf,
    text: String,
}

/// Renames the packages. With `dry_run`, only prints the files that would change.
pub(crate) fn run(root: &Path, prefix: &str, dry_run: bool) -> bool {
    let done = changes(root, prefix).and_then(|changes| {
        for change in &changes {
            println!("{}{}", if dry_run { "would change " } else { "" }, change.file.display());
            if !dry_run {
                let failed = |error| format!("{}: {error}", change.file.display());
                std::fs::write(root.join(&change.file), &change.text).map_err(failed)?;
            }
        }
        // Cargo sorts the lock file by name.
        let mut relock = cargo(root);
        relock.args(["update", "--workspace", "--offline", "--quiet"]);
        match dry_run || relock.status().is_ok_and(|status| status.success()) {
            true => Ok(changes.len()),
            false => Err("files are renamed, but not Cargo.lock: cargo update failed, see above".to_owned()),
        }
    });
    match done {
        Ok(0) => eprintln!("error: no package is called surfel, so nothing was renamed"),
        Ok(files) => println!("{files} files; next: cargo fmt --all, cargo xtask licences, cargo xtask ci"),
        Err(ref problem) => eprintln!("error: {problem}"),
    }
    done.is_ok_and(|files| files > 0)
}

/// Returns the files that change, with their new texts.
fn changes(root: &Path, prefix: &str) -> Result<Vec<Change>, String> {
    let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if !prefix.starts_with(|c: char| c.is_ascii_lowercase()) || !prefix.chars().all(is_name) || prefix.ends_with('-') {
        return Err(format!("'{prefix}': expected a package name of lower-case letters, digits and hyphens"));
    }
    let files = crate::tidy::files(root);
    let names = published(root, &files);
    let mut changes = Vec::new();
    for file in files {
        let Ok(text) = std::fs::read_to_string(root.join(&file)) else { continue };
        let new = renamed(&file, &text, &names, prefix);
        if new != text {
            changes.push(Change { file, text: new });
        }
    }
    Ok(changes)
}

/// Returns the names of the published packages.
fn published(root: &Path, files: &[PathBuf]) -> BTreeSet<String> {
    let manifests = files.iter().filter(|file| file.ends_with("Cargo.toml")).map(|file| root.join(file));
    let public = manifests.filter(|manifest| {
        let text = std::fs::read_to_string(manifest).unwrap_or_default();
        !text.lines().any(|line| line.trim() == "publish = false" || line.trim() == "[workspace]")
    });
    let names = public.filter_map(|manifest| crate::tidy::package_name(&manifest));
    names.filter(|name| name == "surfel" || name.starts_with("surfel-")).collect()
}

/// Returns the text of a file after renaming.
fn renamed(file: &Path, text: &str, names: &BTreeSet<String>, prefix: &str) -> String {
    let new = |name: &str| name.replacen("surfel", prefix, 1);
    let name = file.to_string_lossy().replace('\\', "/");
    match name.as_str() {
        "Cargo.toml" => workspace(text, names, &new),
        "pyproject.toml" => text.replacen("\nname = \"surfel\"\n", &format!("\nname = {}\n", quoted(prefix)), 1),
        // This file contains tests with example trees.
        "CHANGELOG.md" | "THIRD-PARTY.txt" | "xtask/src/rename.rs" => text.to_owned(),
        _ if name.ends_with("Cargo.toml") => manifest(text, names, &new),
        _ if name.ends_with("Cargo.lock") => {
            names.iter().fold(text.to_owned(), |text, name| text.replace(&quoted(name), &quoted(&new(name))))
        }
        _ if [".rs", ".md", ".yml", ".sh", ".py"].iter().any(|end| name.ends_with(end)) => {
            // The chores and the page on packages use package names. Other files use library names, which don't change,
            // except in calls of cargo.
            let is_about_packages = name.starts_with("xtask/") || name == "docs/architecture.md";
            let is_comment = |line: &str| name.ends_with(".rs") && line.trim_start().starts_with("//");
            let line = |line| if is_comment(line) { line.to_owned() } else { everywhere(line, names, &new) };
            let mut text = match is_about_packages {
                true => text.split('\n').map(line).collect::<Vec<_>>().join("\n"),
                false => text.to_owned(),
            };
            if PAIRS.contains(&name.as_str()) {
                text = text.replace("(\"surfel\", ", &format!("({}, ", quoted(prefix)));
            }
            calls(&text, names, &new)
        }
        _ => text.to_owned(),
    }
}

fn quoted(name: &str) -> String {
    format!("\"{name}\"")
}

/// Renames a package in its own manifest and adds the name of the library, which doesn't change. In manifests outside
/// of the workspace, such as that of fuzzing, keys of dependencies don't change.
fn manifest(text: &str, names: &BTreeSet<String>, new: &dyn Fn(&str) -> String) -> String {
    let by_path = |name: &String| format!("\n{name} = {{ path");
    let text = names.iter().fold(text.to_owned(), |text, name| {
        text.replace(&by_path(name), &format!("\n{name} = {{ package = {}, path", quoted(&new(name))))
    });
    let Some(name) = names.iter().find(|name| text.contains(&format!("[package]\nname = \"{name}\"\n"))) else {
        return text;
    };
    let text = text.replacen(&format!("name = \"{name}\""), &format!("name = {}", quoted(&new(name))), 1);
    let page = format!("https://docs.rs/{name}\"");
    let is_library = text.contains(&page);
    let text = text.replace(&page, &format!("https://docs.rs/{}\"", new(name)));
    if !is_library || text.contains("\n[lib]\n") {
        return text;
    }
    text.replacen("\n[lints", &format!("\n[lib]\nname = \"{}\"\n\n[lints", name.replace('-', "_")), 1)
}

/// Renames packages in the workspace's manifest. Keys of dependencies don't change, so the manifests of packages
/// needn't change.
fn workspace(text: &str, names: &BTreeSet<String>, new: &dyn Fn(&str) -> String) -> String {
    let mut table = "";
    let line = |line| -> String {
        if str::starts_with(line, '[') {
            table = line;
        }
        let Some((key, value)) = line.split_once(" = {").filter(|(key, _)| names.contains(*key)) else {
            return line.to_owned();
        };
        match table {
            "[workspace.dependencies]" => format!("{key} = {{ package = {},{value}", quoted(&new(key))),
            _ => format!("{} = {{{value}", new(key)),
        }
    };
    text.split('\n').map(line).collect::<Vec<_>>().join("\n")
}

/// Renames packages wherever a text contains their names, except in paths. `surfel` alone isn't renamed if it means the
/// program.
fn everywhere(text: &str, names: &BTreeSet<String>, new: &dyn Fn(&str) -> String) -> String {
    let is_part = |c: char| c.is_alphanumeric() || "_-".contains(c);
    let mut text = text.to_owned();
    for name in names.iter().filter(|name| name.contains('-')) {
        let mut out = String::new();
        let mut rest = text.as_str();
        while let Some(at) = rest.find(name.as_str()) {
            let (before, after) = (&rest[..at], &rest[at + name.len()..]);
            let is_name = !before.ends_with(|c| is_part(c) || c == '/') && !after.starts_with(is_part);
            out += before;
            out += &if is_name { new(name) } else { name.clone() };
            rest = after;
        }
        text = out + rest;
    }
    text.replace("**surfel**", &format!("**{}**", new("surfel")))
}

/// Renames packages in calls of cargo, and in links to their documentation.
fn calls(text: &str, names: &BTreeSet<String>, new: &dyn Fn(&str) -> String) -> String {
    let starts = [
        "-p ",
        "--package ",
        "--package\", \"",
        "--exclude ",
        "--features ",
        ",",
        "cargo install ",
        "cargo binstall ",
        "pip install ",
        "--only-binary ",
        "docs.rs/",
        "[package.",
    ];
    let mut text = text.to_owned();
    for name in names {
        for start in starts {
            for end in [" ", "`", "\"", ")", "\n", "/", ",", "["] {
                // The feature of a package follows a slash, as in `surfel-cli/wgpu`.
                if (start == "--features " || start == ",") != (end == "/") {
                    continue;
                }
                text = text.replace(&format!("{start}{name}{end}"), &format!("{start}{}{end}", new(name)));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes a workspace of three packages.
    fn tree() -> PathBuf {
        let root = std::env::temp_dir().join(format!("surfel-rename-{}", std::process::id()));
        let files = [
            (
                "Cargo.toml",
                "[workspace]\nresolver = \"3\"\nmembers = [\"crates/*\"]\n\n[workspace.dependencies]\n\
                 surfel = { path = \"crates/surfel\", version = \"0.1.0\" }\n\n[profile.dev.package]\n\
                 surfel = { opt-level = 3 }\n",
            ),
            (
                "crates/surfel/Cargo.toml",
                "[package]\nname = \"surfel\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\
                 documentation = \"https://docs.rs/surfel\"\n\n[lints]\n",
            ),
            ("crates/surfel/src/lib.rs", "pub fn draw() {}\n"),
            (
                "crates/surfel-cli/Cargo.toml",
                "[package]\nname = \"surfel-cli\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[[bin]]\n\
                 name = \"surfel\"\npath = \"src/main.rs\"\n\n[lints]\n\n[dependencies]\nsurfel.workspace = true\n",
            ),
            ("crates/surfel-cli/src/main.rs", "fn main() {\n    surfel::draw();\n}\n"),
            (
                "crates/surfel-tests/Cargo.toml",
                "[package]\nname = \"surfel-tests\"\nversion = \"0.1.0\"\nedition = \"2024\"\npublish = false\n\n\
                 [dependencies]\nsurfel.workspace = true\n",
            ),
            ("crates/surfel-tests/src/lib.rs", "pub use surfel::draw;\n"),
            ("notes.md", "`cargo run -p surfel-cli`, `cargo doc -p surfel`, `crates/surfel-cli/src`, `surfel-tests`\n"),
            ("python/errors.py", "'pip install surfel[ray] --only-binary surfel)'\nimport surfel\n"),
            ("fuzz/Cargo.toml", "[workspace]\n\n[dependencies]\nsurfel = { path = \"../crates/surfel\" }\n"),
            ("xtask/src/main.rs", "const FEATURES: &str = \"surfel-cli/wgpu,surfel-cli/ash\";\n"),
        ];
        for (name, text) in files {
            let file = root.join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, text).unwrap();
        }
        root
    }

    #[test]
    fn renaming_changes_packages_and_no_code() {
        let root = tree();
        let before = changes(&root, "splatter").unwrap();
        let read = |name: &str| std::fs::read_to_string(root.join(name)).unwrap();
        assert!(run(&root, "splatter", true) && read("notes.md").contains("surfel-cli"), "a dry run changes nothing");
        assert!(run(&root, "splatter", false));
        let notes = "`cargo run -p splatter-cli`, `cargo doc -p splatter`, `crates/surfel-cli/src`, `surfel-tests`\n";
        assert_eq!(read("notes.md"), notes);
        assert!(read("crates/surfel/Cargo.toml").contains("name = \"splatter\"\n"));
        assert!(read("crates/surfel/Cargo.toml").contains("docs.rs/splatter\"\n\n[lib]\nname = \"surfel\"\n"));
        assert_eq!(read("crates/surfel-cli/src/main.rs"), "fn main() {\n    surfel::draw();\n}\n");
        assert_eq!(read("xtask/src/main.rs"), "const FEATURES: &str = \"splatter-cli/wgpu,splatter-cli/ash\";\n");
        let hint = "'pip install splatter[ray] --only-binary splatter)'\nimport surfel\n";
        assert_eq!(read("python/errors.py"), hint);
        assert!(read("fuzz/Cargo.toml").contains("surfel = { package = \"splatter\", path = \"../crates/surfel\" }"));
        assert_eq!(before.len(), 7, "{before:?}");
        // Cargo finds the packages by their new names, and the code still compiles.
        let mut check = cargo(&root);
        check.args(["check", "--workspace", "--offline", "--quiet"]).env("CARGO_TARGET_DIR", root.join("target"));
        let checked = check.output().unwrap();
        let lock = read("Cargo.lock");
        std::fs::remove_dir_all(&root).unwrap();
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
        assert!(lock.contains("\"splatter-cli\"") && lock.contains("\"surfel-tests\""), "{lock}");
    }

    #[test]
    fn renaming_refuses_what_is_no_package_name() {
        for prefix in ["", "Splat", "9a", "a_b", "a-", "a b"] {
            assert!(changes(&crate::workspace_root(), prefix).is_err(), "{prefix}");
        }
    }
}
