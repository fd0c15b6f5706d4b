//! Generator of the page `docs/options.md`.

use super::{Audience, Commands, EXPERT, Group, Row, Table};
use std::fmt::Write as _;
use surfel_load::effects::Inputs;

const INTRODUCTION: &str = "\
# Options

This page lists the options of `surfel render`, `figure`, `convert`, `ortho`, `serve`, `view`, `again` and `info`, by
task. It is generated from the options table (`crates/surfel-app/src/options`). `surfel COMMAND -h` lists the options
that are used every day, in **bold** here, and `surfel COMMAND --help` lists all of them.

- A flag on the command line takes precedence over a key of the scene file, this over `--preset`, and this over the
  default.
- Python's keywords have the flags' names, with `_` for `-`: `surfel.open(\"scan.laz\", color_by=\"height\")`.
- A file for `--config` has the flags' names as keys: `color-by = \"height\"`.
- *Files* are the kinds of files that an option has an effect on. If no input is of such a kind, the program stops and
  says so.
- *Scene key* is the option's key in a [scene file](scenes.md); keys that begin with `convert` and `material` belong to
  an object.
";

impl Table {
    /// Returns the Markdown text of the page `docs/options.md`.
    pub fn page(&self) -> String {
        let mut text = INTRODUCTION.to_owned();
        for group in Group::ALL {
            let rows = self.rows().filter(|row| row.group == group && row.audience != Audience::Expert);
            put_section(&mut text, group.heading(), rows);
        }
        put_section(&mut text, EXPERT, self.rows().filter(|row| row.audience == Audience::Expert));
        text.push_str(
            "\n## Names in other programs\n\nThe program suggests these options for names that it doesn't have.\n\n\
             | name | option |\n| --- | --- |\n",
        );
        let mut synonyms: Vec<(&str, &str)> =
            self.rows().flat_map(|row| row.synonyms.iter().map(|name| (*name, row.name))).collect();
        synonyms.sort_unstable();
        synonyms.dedup();
        for (name, option) in synonyms {
            let _ = writeln!(text, "| {name} | `--{option}` |");
        }
        text
    }
}

fn put_section<'a>(text: &mut String, heading: &str, rows: impl Iterator<Item = &'a Row>) {
    let mut rows = rows.peekable();
    if rows.peek().is_none() {
        return;
    }
    let _ = write!(
        text,
        "\n## {heading}\n\n| option | purpose | default | commands | files | scene key |\n\
         | --- | --- | --- | --- | --- | --- |\n"
    );
    for row in rows {
        let short = row.short.map(|letter| format!("-{letter}, ")).unwrap_or_default();
        let flag = format!("`{short}{}`", cell(&row.usage()));
        let flag = if row.audience == Audience::Everyday { format!("**{flag}**") } else { flag };
        let names = row.names.map(|names| names().join(", ")).unwrap_or_default();
        let names = if names.is_empty() { names } else { format!(" Values: {names}.") };
        let commands = if row.commands == Commands::ALL {
            "all".to_owned()
        } else {
            row.commands.names().collect::<Vec<_>>().join(", ")
        };
        let files = if row.inputs() == Inputs::ALL { String::new() } else { row.inputs().words() };
        let key = row.scene.map(|key| format!("`{key}`")).unwrap_or_default();
        let _ = writeln!(
            text,
            "| {flag} | {}{names} | {} | {commands} | {files} | {key} |",
            cell(&row.full_help()),
            row.default.unwrap_or_default()
        );
    }
}

/// Escapes text for a cell of a Markdown table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}
