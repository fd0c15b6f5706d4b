//! Generator of Python's keywords and their type stubs.

use super::{Commands, Row, Table};
use std::fmt::Write as _;

impl Row {
    /// Returns the type of the keyword in Python.
    pub fn python_type(&self) -> String {
        match (self.python, self.names) {
            ("", _) if self.is_switch() => "bool".to_owned(),
            ("", Some(names)) => {
                let names: Vec<String> = names().iter().map(|name| format!("\"{name}\"")).collect();
                format!("Literal[{}]", names.join(", "))
            }
            ("", None) => "str".to_owned(),
            (python, _) => python.to_owned(),
        }
    }
}

impl Table {
    /// Returns Python source for the stubs: one `TypedDict` of keywords for each function.
    pub fn stub(&self) -> String {
        let mut text = String::new();
        for (class, functions) in [
            ("_RenderFlags", Commands::RENDER),
            ("_Convert", Commands::CONVERT),
            ("_Ortho", Commands::ORTHO),
            ("_Figure", Commands::FIGURE),
        ] {
            let _ = writeln!(text, "class {class}(TypedDict, total=False):");
            for row in self.keywords(functions) {
                let _ = writeln!(text, "    {}: {}", row.name.replace('-', "_"), row.python_type());
            }
            text.push('\n');
        }
        text
    }
    /// Returns the source of Python's module `_table.py`: names, separators and synonyms of the keywords.
    pub fn python(&self) -> String {
        let mut text =
            "\"\"\"Keywords, generated from the options table in crates/surfel-app/src/options.\"\"\"\n\n".to_owned();
        let name = |row: &Row| row.name.replace('-', "_");
        let is_splat = |row: &&Row| row.is_image && row.keyword.has(Commands::CONVERT);
        let sets: [(&str, Vec<&Row>); 5] = [
            ("SPLATS", self.rows().filter(is_splat).collect()),
            ("RENDER", self.keywords(Commands::RENDER).collect()),
            ("CONVERT", self.keywords(Commands::CONVERT).collect()),
            ("ORTHO", self.keywords(Commands::ORTHO).collect()),
            ("FIGURE", self.keywords(Commands::FIGURE).collect()),
        ];
        for (set, rows) in sets {
            let names: String = rows.into_iter().map(|row| format!("    \"{}\",\n", name(row))).collect();
            let _ = write!(text, "{set} = frozenset((\n{names}))\n\n");
        }
        let keywords: Vec<&Row> = self.rows().filter(|row| row.keyword != Commands::NONE).collect();
        let _ = writeln!(text, "# Text between the values of a sequence, unless it is a comma.\nSEPARATORS = {{");
        let mut separators: Vec<(String, &str)> =
            keywords.iter().filter(|row| row.separator != ",").map(|row| (name(row), row.separator)).collect();
        separators.sort_unstable();
        separators.dedup();
        for (keyword, separator) in separators {
            let _ = writeln!(text, "    \"{keyword}\": \"{separator}\",");
        }
        let _ = writeln!(text, "}}\n\n# Names in other programs, and the keywords that they may mean.\nSYNONYMS = (");
        for row in keywords {
            for synonym in row.synonyms {
                let _ = writeln!(text, "    (\"{}\", \"{}\"),", synonym.replace('-', "_"), name(row));
            }
        }
        text + ")\n"
    }
}
