//! A page: words, tables and charts in one HTML file.

use crate::chart::Chart;
use std::fmt::Write;

const STYLE: &str = "\
body{font:15px/1.5 sans-serif;margin:2em auto;max-width:76em;padding:0 1em;background:#fff;color:#111}\
h2{border-top:1px solid #ccc;padding-top:.6em;margin-top:2em}p{max-width:52em}\
table{border-collapse:collapse;margin:.8em 0;font-size:13px}td,th{border:1px solid #ccc;padding:.15em .6em;text-align:left}\
td.n{text-align:right;font-variant-numeric:tabular-nums}tr.good td{background:#eef7ea}tr.bad td{background:#fbe6e2}\
figure{display:inline-block;margin:.4em 1em .4em 0;vertical-align:top}code{background:#f3f3f3;padding:0 .2em}";

/// A page that is being written.
#[derive(Clone, Debug)]
pub struct Page {
    body: String,
    title: String,
}

/// A table of a page. Cells that are numbers are set to the right.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Names of columns.
    pub head: Vec<String>,
    /// Cells, row by row.
    pub rows: Vec<Vec<String>>,
    /// Rows that stand out: index, and whether for good.
    pub marked: Vec<(usize, bool)>,
}

impl Table {
    /// An empty table.
    pub fn new(head: &[&str]) -> Self {
        Self { head: head.iter().map(|&h| h.to_owned()).collect(), ..Self::default() }
    }

    /// The table as Markdown.
    pub fn markdown(&self) -> String {
        let row = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule = vec!["---".to_owned(); self.head.len()];
        row(&self.head) + &row(&rule) + &self.rows.iter().map(|r| row(r)).collect::<String>()
    }

    /// The table as text in columns.
    pub fn text(&self) -> String {
        let rows = || std::iter::once(&self.head).chain(&self.rows);
        let width = |column: usize| rows().filter_map(|r| Some(r.get(column)?.chars().count())).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.head.len()).map(width).collect();
        let line = |row: &Vec<String>| {
            let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}")).collect();
            cells.join("  ").trim_end().to_owned() + "\n"
        };
        rows().map(line).collect()
    }
}

impl Page {
    /// A page with nothing but its title.
    pub fn new(title: &str) -> Self {
        Self { body: format!("<h1>{}</h1>", escape(title)), title: escape(title) }
    }

    /// Begins a section.
    pub fn section(&mut self, title: &str) {
        // Writing to a string can't fail, here and below.
        let _ = write!(self.body, "<h2>{}</h2>", escape(title));
    }

    /// A heading within a section.
    pub fn heading(&mut self, title: &str) {
        let _ = write!(self.body, "<h3>{}</h3>", escape(title));
    }

    /// A paragraph of plain words.
    pub fn paragraph(&mut self, words: &str) {
        let _ = write!(self.body, "<p>{}</p>", escape(words));
    }

    /// A chart.
    pub fn chart(&mut self, chart: &Chart) {
        let _ = write!(self.body, "<figure>{}</figure>", chart.svg());
    }

    /// A table.
    pub fn table(&mut self, table: &Table) {
        self.body.push_str("<table><tr>");
        for name in &table.head {
            let _ = write!(self.body, "<th>{}", escape(name));
        }
        self.body.push_str("</tr>");
        for (index, row) in table.rows.iter().enumerate() {
            let class = match table.marked.iter().find(|(at, _)| *at == index) {
                Some((_, true)) => " class=\"good\"",
                Some((_, false)) => " class=\"bad\"",
                None => "",
            };
            let _ = write!(self.body, "<tr{class}>");
            for cell in row {
                let first = cell.trim_start_matches(['-', '−', '<', '+']).chars().next();
                let number = first.is_some_and(|c| c.is_ascii_digit() || c == '∞');
                let class = if number { " class=\"n\"" } else { "" };
                let _ = write!(self.body, "<td{class}>{}", escape(cell));
            }
            self.body.push_str("</tr>");
        }
        self.body.push_str("</table>");
    }

    /// The file.
    pub fn html(&self) -> String {
        format!(
            "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{}</title><style>{STYLE}</style>{}</html>\n",
            self.title, self.body
        )
    }
}

/// Text as it stands in HTML, in an element or a quoted attribute.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_shows_words_as_they_are() {
        let mut page = Page::new("a < b");
        page.paragraph("<script>");
        let mut table = Table::new(&["name", "value"]);
        table.rows.push(vec!["x".into(), "−1.5".into()]);
        table.marked.push((0, false));
        page.table(&table);
        let html = page.html();
        assert!(html.contains("a &lt; b") && html.contains("<p>&lt;script&gt;</p>"));
        assert!(html.contains("<tr class=\"bad\"><td>x<td class=\"n\">−1.5</tr>"));
    }

    #[test]
    fn table_is_the_same_in_markdown_and_in_columns() {
        let mut table = Table::new(&["name", "n"]);
        table.rows.push(vec!["long name".into(), "1".into()]);
        assert_eq!(table.markdown(), "| name | n |\n| --- | --- |\n| long name | 1 |\n");
        assert_eq!(table.text(), "name       n\nlong name  1\n");
    }
}
