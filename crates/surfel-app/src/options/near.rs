//! Suggestions for options that don't exist.

use super::{Commands, Row, Table};

/// Suggestion for a name that isn't an option of the command.
#[derive(Clone, Copy, Debug)]
pub enum Near<'a> {
    /// Another option of the same command, with a similar meaning or spelling.
    Here(&'a Row),
    /// An option with this name or letter that the command doesn't have, but others do.
    Elsewhere(&'a Row),
}

impl Table {
    /// Returns the option that is nearest to `name`, for which the command has no option. `name` is a long name or a
    /// letter, without dashes. The search looks for a synonym, then for an option of another command, then for a
    /// similar spelling. `None` if nothing is found.
    pub fn near(&self, command: Commands, name: &str) -> Option<Near<'_>> {
        if let Some(row) = self.of(command).find(|row| row.is_built && row.synonyms.contains(&name)) {
            return Some(Near::Here(row));
        }
        let is_letter = |row: &&Row| row.short.is_some_and(|short| name.chars().eq([short]));
        if let Some(row) = self.rows().find(|row| row.name == name || is_letter(row)) {
            return Some(Near::Elsewhere(row));
        }
        nearest(self.of(command), name).map(Near::Here)
    }

    /// Returns the keyword of the given Python functions that is nearest to `name` by synonym or spelling; `None` if
    /// none is similar.
    pub fn near_keyword(&self, functions: Commands, name: &str) -> Option<String> {
        let row = nearest(self.keywords(functions), &name.replace('_', "-"))?;
        Some(row.name.replace('-', "_"))
    }
}

/// Returns the row that has `name` among its synonyms, or else the row of the most similar spelling; `None` if none is
/// similar.
fn nearest<'a>(rows: impl Iterator<Item = &'a Row>, name: &str) -> Option<&'a Row> {
    let name = name.to_ascii_lowercase();
    let rows: Vec<&Row> = rows.filter(|row| row.is_built).collect();
    if let Some(row) = rows.iter().find(|row| row.synonyms.contains(&name.as_str())) {
        return Some(row);
    }
    // The allowed number of changes grows with the length: two changes in a word of four letters make another word.
    let most = (name.len() / 3).clamp(1, 3);
    let spelled = rows.iter().map(|row| (changes(&name, row.name), *row)).filter(|(changes, _)| *changes <= most);
    spelled.min_by_key(|(changes, _)| *changes).map(|(_, row)| row)
}

/// Returns the number of insertions, deletions and replacements that turn `a` into `b` (Levenshtein's distance).
fn changes(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut costs: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut costs[0], i + 1);
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = costs[j + 1];
            costs[j + 1] = replaced.min(costs[j] + 1).min(diagonal + 1);
        }
    }
    costs[b.len()]
}

#[cfg(test)]
mod tests {
    use super::super::table;
    use super::*;

    #[test]
    fn options_near_in_meaning_come_before_those_near_in_letters() {
        let near = |command, name| match table().near(command, name) {
            Some(Near::Here(row)) => row.name.to_owned(),
            Some(Near::Elsewhere(row)) => format!("elsewhere {}", row.name),
            None => String::new(),
        };
        for (command, name, want) in [
            (Commands::RENDER, "width", "size"),
            (Commands::RENDER, "cmap", "colormap"),
            (Commands::RENDER, "sise", "size"),
            (Commands::RENDER, "colour-map", "colormap"),
            (Commands::RENDER, "bg", "background"),
            (Commands::RENDER, "gsd", "elsewhere gsd"),
            (Commands::RENDER, "nonsense", ""),
            (Commands::ORTHO, "resolution", "gsd"),
            (Commands::ORTHO, "cull", "elsewhere cull"),
            (Commands::SERVE, "o", "elsewhere output"),
            (Commands::CONVERT, "overwrite", "force"),
        ] {
            assert_eq!(near(command, name), want, "{name}");
        }
        assert_eq!(table().near_keyword(Commands::RENDER, "colour_by").as_deref(), Some("color_by"));
        assert_eq!(table().near_keyword(Commands::RENDER, "stat"), None);
    }
}
