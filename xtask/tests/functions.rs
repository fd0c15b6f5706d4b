//! Tests that no function outside of tests is longer than 100 lines, except listed ones.
//!
//! Sources are read as text. A function ends at the first line that closes a brace at the function's indentation, as
//! `cargo fmt` formats it.

use std::path::{Path, PathBuf};

/// Maximum number of lines of a function, from its name to its closing brace.
const MAX_LINES: usize = 100;

/// Longer functions that are allowed, by name, with the reason. A name alone applies to any file, a name after a path
/// only to that file.
const LONGER: [(&str, &str); 0] = [];

/// Function that was found in a source file: its name and its lines.
#[derive(Debug, PartialEq, Eq)]
struct Function {
    name: String,
    /// Number of the first line.
    line: usize,
    /// Number of lines.
    length: usize,
}

/// Returns the functions before the first test module of a source. Functions without a body, and those whose body is on
/// the first line, aren't listed.
fn functions(source: &str) -> Vec<Function> {
    let lines: Vec<&str> = source.lines().collect();
    let is_test_module = |pair: &[&str]| pair[0].trim() == "#[cfg(test)]" && pair[1].trim_start().starts_with("mod ");
    let end = lines.windows(2).position(is_test_module).unwrap_or(lines.len());
    let mut found = Vec::new();
    for (at, line) in lines[..end].iter().enumerate() {
        let Some(name) = name_of(line) else { continue };
        // The search is for the line that opens the body. A declaration in a trait has no body, and a body on one line
        // is short.
        let opens = |line: &&str| line.ends_with(['{', ';', '}']);
        let Some(head) = lines[at..].iter().position(opens) else { continue };
        if !lines[at + head].ends_with('{') {
            continue;
        }
        let close = format!("{}}}", &line[..line.len() - line.trim_start().len()]);
        let Some(length) = lines[at + head..].iter().position(|line| line.starts_with(&close)) else { continue };
        found.push(Function { name: name.to_owned(), line: at + 1, length: head + length + 1 });
    }
    found
}

/// Returns the name of the function that a line begins.
fn name_of(line: &str) -> Option<&str> {
    let mut rest = line.trim_start();
    if let Some(after) = rest.strip_prefix("pub") {
        rest = after.trim_start();
        if rest.starts_with('(') {
            rest = rest.split_once(')')?.1.trim_start();
        }
    }
    for word in ["const ", "async ", "unsafe "] {
        rest = rest.strip_prefix(word).unwrap_or(rest);
    }
    rest = rest.strip_prefix("extern \"C\" ").unwrap_or(rest).strip_prefix("fn ")?;
    Some(&rest[..rest.find(|c: char| !c.is_alphanumeric() && c != '_')?])
}

/// Finds Rust files in folders named `src`, with their paths from the root.
fn sources(folder: &Path, root: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && !["target", "tests", "benches", "examples"].contains(&name.as_str()) {
            sources(&path, root, found);
        } else if name.ends_with(".rs") && path.components().any(|c| c.as_os_str() == "src") {
            found.push(path.strip_prefix(root).unwrap().to_path_buf());
        }
    }
}

#[test]
fn no_function_is_longer_than_a_hundred_lines() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut files = Vec::new();
    ["crates", "shaders", "xtask"].iter().for_each(|folder| sources(&root.join(folder), root, &mut files));
    assert!(files.len() > 300, "{} files", files.len());
    let (mut problems, mut used) = (Vec::new(), Vec::new());
    for file in files {
        let source = std::fs::read_to_string(root.join(&file)).unwrap();
        let file = file.to_string_lossy().replace('\\', "/");
        for Function { name, line, length } in functions(&source) {
            if length <= MAX_LINES {
                continue;
            }
            let here = format!("{file} {name}");
            match LONGER.iter().find(|(listed, _)| *listed == name || *listed == here) {
                Some((listed, _)) => used.push(*listed),
                None => problems.push(format!("{file}:{line}: {name} has {length} lines")),
            }
        }
    }
    let unused = LONGER.iter().filter(|(listed, _)| !used.contains(listed));
    problems.extend(unused.map(|(listed, _)| format!("{listed} is short now: remove it from LONGER")));
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn functions_are_found_with_their_lengths() {
    let source = concat!(
        "pub(crate) const fn a(b: u32) -> u32 {\n    b\n}\n\n",
        "impl B {\n    fn c(\n        &self,\n    ) {\n        if d {\n        }\n    }\n\n    fn e() {}\n}\n\n",
        "trait F {\n    fn g();\n}\n\n#[cfg(test)]\nmod tests {\n    fn h() {\n    }\n}\n",
    );
    let found: Vec<(String, usize, usize)> =
        functions(source).into_iter().map(|f| (f.name, f.line, f.length)).collect();
    assert_eq!(found, [("a".to_owned(), 1, 3), ("c".to_owned(), 6, 6)]);
}
