//! Checks of pages: they describe the present, and the files that they name exist.

use std::path::Path;

/// Words about the past, which pages must not contain because it belongs in the CHANGELOG. Decision records and
/// generated tables may contain them.
const OF_THE_PAST: [&str; 18] = [
    "now",
    "measured today",
    "today's code",
    "in turn with",
    "have changed",
    "has changed",
    "any more",
    "no longer",
    "used to",
    "nowadays",
    "recently",
    "the old code",
    "old and new",
    "as of this",
    "this session",
    "of the session",
    "since then",
    "before the work",
];

/// Prefixes by which paths of the tree are recognised on pages.
const ROOTS: [&str; 7] = ["crates/", "shaders/", "tests/", "xtask/", "docs/", "assets/", "fuzz/"];

/// Texts that mark a path as a placeholder or as a generated file, which isn't checked.
const NO_PATHS: [&str; 6] = ["*", "NAME", "FORMAT", "NNN", "…", "assets/generated"];

/// Returns the problems of a page. `name` is its path relative to the root, with slashes. Only `README.md` and pages in
/// `docs/` are checked.
pub(super) fn check(root: &Path, name: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    if name != "README.md" && !name.starts_with("docs/") {
        return problems;
    }
    if !name.starts_with("docs/decisions/") && !name.starts_with("docs/data/") {
        for (i, line) in text.lines().enumerate() {
            let lower = line.to_lowercase();
            for phrase in OF_THE_PAST.iter().filter(|phrase| super::text::contains_phrase(&lower, phrase)) {
                problems.push(format!("{name}:{}: '{phrase}' tells of the past, expected the present", i + 1));
            }
        }
    }
    for path in paths(text) {
        let place =
            if path.is_link { root.join(name).parent().map_or(root.into(), Path::to_path_buf) } else { root.into() };
        if !place.join(path.name).exists() {
            problems.push(format!("{name}: names {}, which isn't there", path.name));
        }
    }
    problems
}

/// Path that a page contains.
struct Named<'a> {
    name: &'a str,
    /// True if the path is relative to the page; false if it is relative to the root.
    is_link: bool,
}

/// Returns the paths on a page: links to files, and paths of the tree between backticks.
fn paths(text: &str) -> Vec<Named<'_>> {
    let links = text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target);
    let links = links.filter(|target| !target.contains("://") && !target.starts_with('#'));
    let links = links.map(|target| Named { name: target.split('#').next().unwrap_or(target), is_link: true });
    // Every second piece is between backticks. Fences split into empty pieces and don't change the parity.
    let quoted = text.split('`').skip(1).step_by(2).filter(|word| !word.contains(char::is_whitespace));
    let quoted = quoted.filter(|word| ROOTS.iter().any(|root| word.starts_with(root)));
    let quoted = quoted.map(|word| Named { name: word.split([':', '#']).next().unwrap_or(word), is_link: false });
    links.chain(quoted).filter(|path| !NO_PATHS.iter().any(|part| path.name.contains(part))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(name: &str, text: &str) -> Vec<String> {
        check(&crate::workspace_root(), name, text)
    }

    #[test]
    fn pages_tell_of_the_present() {
        assert_eq!(problems("docs/sharp.md", "It is fast.\nNow it is faster.").len(), 1);
        assert!(problems("docs/sharp.md", "It is known. Snow is white.").is_empty());
        assert!(problems("docs/decisions/001-any.md", "It is no longer so.").is_empty());
        assert!(problems("CHANGELOG.md", "It is no longer so.").is_empty());
    }

    #[test]
    fn pages_name_files_that_are_there() {
        assert!(
            problems("docs/sharp.md", "[a](testing.md#b), `xtask/src/main.rs`, [c](https://x.invalid/y)").is_empty()
        );
        assert!(problems("docs/sharp.md", "`crates/*/NAME.rs`, [a](#below), `assets/generated/part.obj`").is_empty());
        assert_eq!(problems("docs/sharp.md", "[a](absent.md) and `xtask/src/absent.rs`").len(), 2);
        assert_eq!(problems("README.md", "[a](testing.md)").len(), 1, "links are relative to their page");
        assert!(problems("README.md", "```\ncargo xtask test\n```\n`xtask/src/main.rs`").is_empty());
    }
}
