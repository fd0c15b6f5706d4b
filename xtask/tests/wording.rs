//! Tests of the messages of packages below `surfel-app`. No message contains a flag. Each option in a code span is in
//! the options table, so that `surfel_app::wording` can translate it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Packages whose messages name options neutrally, as code spans.
const NEUTRAL: [&str; 18] = [
    "ash", "backend", "cpu", "figure", "files", "framing", "gpu", "images", "io", "light", "load", "math", "metrics",
    "model", "ortho", "render", "sample", "stage",
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Returns the names of all options with underscores, from the generated page.
fn options() -> BTreeSet<String> {
    let page = std::fs::read_to_string(root().join("docs/options.md")).unwrap();
    let rows = page.lines().filter(|line| line.starts_with("| `") || line.starts_with("| **`"));
    let name = |row: &str| {
        let (_, rest) = row.split_once("--")?;
        Some(rest.split(|c: char| !(c.is_ascii_alphanumeric() || c == '-')).next()?.replace('-', "_"))
    };
    rows.filter_map(name).collect()
}

/// Returns the code lines of a source, without comments and without tests, which are at the end of a file.
fn code(source: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = source.lines().enumerate().take_while(|(_, line)| line.trim() != "mod tests {");
    lines.filter(|(_, line)| !line.trim_start().starts_with("//"))
}

/// Returns the options that a line names as flags, which begin with two dashes.
fn flags<'a>(line: &'a str, options: &'a BTreeSet<String>) -> impl Iterator<Item = &'a str> {
    line.split("--").skip(1).filter_map(|rest| {
        // Other names are flags of cargo and other programs.
        let end = rest.find(|c: char| !(c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c)));
        let name = rest[..end.unwrap_or(rest.len())].trim_end_matches('-');
        options.contains(&name.replace('-', "_")).then_some(name)
    })
}

/// Returns the code spans of a line that look like options: a name of lower-case letters, and perhaps a value.
fn spans(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2).filter_map(|span| {
        let name = span.split('=').next()?;
        let is_name =
            !name.is_empty() && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
        is_name.then_some(name)
    })
}

#[test]
fn messages_below_the_application_name_options_neutrally() {
    let options = options();
    assert!(options.contains("max_points") && options.len() > 100, "{options:?}");
    let (mut problems, mut mentions) = (Vec::new(), 0);
    for package in NEUTRAL {
        let mut files = Vec::new();
        sources(&root().join(format!("crates/surfel-{package}/src")), &mut files);
        for file in files.into_iter().filter(|file| !file.ends_with("tests.rs")) {
            let text = std::fs::read_to_string(&file).unwrap();
            let place = |number: usize| format!("{}:{}", file.strip_prefix(root()).unwrap().display(), number + 1);
            for (number, line) in code(&text) {
                problems.extend(flags(line, &options).map(|flag| format!("{}: --{flag}", place(number))));
                for name in spans(line) {
                    mentions += 1;
                    if !options.contains(name) {
                        problems.push(format!("{}: `{name}` is no option", place(number)));
                    }
                }
            }
        }
    }
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
    assert!(mentions > 50, "{mentions}");
}

#[test]
fn flags_and_spans_are_found() {
    let options = BTreeSet::from(["max_points".to_owned(), "repair".to_owned()]);
    let line = "note(\"--max-points ends it; cargo --features x; --repair\")";
    assert_eq!(flags(line, &options).collect::<Vec<_>>(), ["max-points", "repair"]);
    assert_eq!(spans("\"a `classes=all` b `surfel convert` c `repair`\"").collect::<Vec<_>>(), ["classes", "repair"]);
}
