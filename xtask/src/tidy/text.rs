//! Checks of the lines of any file: length, leftovers of debugging, and paths of a single machine.

/// Maximum length of a line of prose or code, in columns.
pub(super) const MAX_COLUMNS: usize = 120;

/// Extensions of files whose line length is checked.
const READ_IN_EDITORS: [&str; 5] = [".rs", ".wgsl", ".toml", ".md", ".sh"];

/// Folder of generated tables, whose rows may have any length.
const GENERATED: &str = "docs/data/";

/// Leftovers that the code of Rust files must not contain. Each is written in two parts, so that this file passes its
/// own check.
pub(super) const LEFTOVERS: [&str; 3] = [concat!("to", "do!("), concat!("un", "implemented!("), concat!("db", "g!(")];

/// Folders that exist on a single machine only, which files must not name.
pub(super) const MACHINE_FOLDERS: [&str; 6] = [
    concat!("/ho", "me/"),
    concat!("/ro", "ot/"),
    concat!("/wo", "rk/"),
    concat!("/tm", "p/"),
    concat!("/Us", "ers/"),
    concat!(":\\Us", "ers\\"),
];

/// Path of the data beside the checkout.
pub(super) const BESIDE_THE_CHECKOUT: &str = concat!("../sha", "red");
/// The only file that may contain [`BESIDE_THE_CHECKOUT`].
const TEST_DATA: &str = "tests/src/test_data.rs";

/// Returns the problems in a file's lines. `name` is its path relative to the root, with slashes.
pub(super) fn check(name: &str, text: &str) -> Vec<String> {
    let mut problems = Vec::new();
    let rust = name.ends_with(".rs");
    for (i, line) in text.lines().enumerate() {
        let place = format!("{name}:{}", i + 1);
        if rust && !line.trim_start().starts_with("//") {
            for leftover in LEFTOVERS.iter().filter(|leftover| contains_word(line, leftover)) {
                problems.push(format!("{place}: {leftover}), finish it"));
            }
        }
        for folder in MACHINE_FOLDERS.iter().filter(|folder| contains_path(line, folder)) {
            problems.push(format!("{place}: {folder} exists on one machine only, expected a relative path"));
        }
        if name != TEST_DATA && line.contains(BESIDE_THE_CHECKOUT) {
            problems.push(format!("{place}: {BESIDE_THE_CHECKOUT} is for {TEST_DATA} alone"));
        }
    }
    if READ_IN_EDITORS.iter().any(|end| name.ends_with(end)) && !name.starts_with(GENERATED) {
        let long = long_lines(text, name.ends_with(".md"));
        problems
            .extend(long.map(|(line, columns)| format!("{name}:{line}: {columns} columns, expected {MAX_COLUMNS}")));
    }
    problems
}

/// Returns the numbers and lengths of lines that are too long. Declarations of renamed dependencies may have any
/// length; on pages, tables, images and code blocks may, too.
fn long_lines(text: &str, is_page: bool) -> impl Iterator<Item = (usize, usize)> {
    let mut in_code = false;
    text.lines().enumerate().filter_map(move |(i, line)| {
        in_code ^= line.starts_with("```");
        // The declaration of a dependency under another name can't be wrapped.
        let is_renamed = line.contains(" = { package = \"");
        let is_free =
            is_renamed || is_page && (in_code || ["|", "<img", "!["].iter().any(|start| line.starts_with(start)));
        let columns = line.chars().count();
        (columns > MAX_COLUMNS && !is_free).then_some((i + 1, columns))
    })
}

/// True if the line contains `word` with no letter, digit or underscore before it.
fn contains_word(line: &str, word: &str) -> bool {
    before_each(line, word).any(|before| !before.is_some_and(|c| c.is_alphanumeric() || c == '_'))
}

/// True if the line contains `phrase` with no letter or digit directly before or after it.
pub(super) fn contains_phrase(line: &str, phrase: &str) -> bool {
    line.match_indices(phrase).any(|(at, _)| {
        let beside = [line[..at].chars().next_back(), line[at + phrase.len()..].chars().next()];
        !beside.into_iter().flatten().any(char::is_alphanumeric)
    })
}

/// True if the line contains `folder` at the beginning of a path, not within a path.
fn contains_path(line: &str, folder: &str) -> bool {
    let inside = |c: char| c.is_alphanumeric() || "_-.~)}]>*$\\".contains(c);
    let drive = folder.starts_with(':');
    before_each(line, folder).any(|before| drive || !before.is_some_and(inside))
}

/// Returns the character before each occurrence of `needle`.
fn before_each<'a>(line: &'a str, needle: &'a str) -> impl Iterator<Item = Option<char>> + 'a {
    line.match_indices(needle).map(|(at, _)| line[..at].chars().next_back())
}
