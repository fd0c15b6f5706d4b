//! HTML pages of text, tables, charts and images in a single file.

use crate::chart::Chart;
use std::fmt::Write;

const STYLE: &str = "\
body{font:15px/1.5 sans-serif;margin:2em auto;max-width:76em;padding:0 1em;background:#fff;color:#111}\
h2{border-top:1px solid #ccc;padding-top:.6em;margin-top:2em}h2.bad{border-left:.5em solid #c00;padding-left:.5em}\
p{max-width:52em}table{border-collapse:collapse;margin:.8em 0;font-size:13px}\
td,th{border:1px solid #ccc;padding:.15em .6em;text-align:left}td.n{text-align:right;font-variant-numeric:tabular-nums}\
tr.good td{background:#eef7ea}tr.bad td{background:#fbe6e2}\
figure{display:inline-block;margin:.4em 1em .4em 0;vertical-align:top}figcaption{font-size:12px}\
figure img{width:192px;image-rendering:pixelated;background:#888}code{background:#f3f3f3;padding:0 .2em}";

/// Page under construction.
#[derive(Clone, Debug)]
pub struct Page {
    body: String,
    title: String,
}

/// Table for a page, a terminal or a Markdown file. On pages, numeric cells are right-aligned.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Column headings.
    pub head: Vec<String>,
    /// Cells, row by row.
    pub rows: Vec<Vec<String>>,
    /// Highlighted rows: index, and true if the highlight is positive.
    pub marked: Vec<(usize, bool)>,
}

impl Table {
    /// Creates an empty table.
    pub fn new(head: &[&str]) -> Self {
        Self { head: head.iter().map(|&h| h.to_owned()).collect(), ..Self::default() }
    }

    /// Returns the table as Markdown.
    pub fn markdown(&self) -> String {
        let row = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule = vec!["---".to_owned(); self.head.len()];
        row(&self.head) + &row(&rule) + &self.rows.iter().map(|r| row(r)).collect::<String>()
    }

    /// Returns the table as text in aligned columns.
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
    /// Creates a page with a title and no content.
    pub fn new(title: &str) -> Self {
        Self { body: format!("<h1>{}</h1>", escape(title)), title: escape(title) }
    }

    /// Begins a section.
    pub fn section(&mut self, title: &str) {
        // Writing to a string can't fail, here and in the functions below.
        let _ = write!(self.body, "<h2>{}</h2>", escape(title));
    }

    /// Begins a section about a failure.
    pub fn failed_section(&mut self, title: &str) {
        let _ = write!(self.body, "<h2 class=\"bad\">{}</h2>", escape(title));
    }

    /// Adds a heading within a section.
    pub fn heading(&mut self, title: &str) {
        let _ = write!(self.body, "<h3>{}</h3>", escape(title));
    }

    /// Adds a paragraph of plain text.
    pub fn paragraph(&mut self, words: &str) {
        let _ = write!(self.body, "<p>{}</p>", escape(words));
    }

    /// Adds preformatted text, whose lines don't wrap.
    pub fn preformatted(&mut self, text: &str) {
        let _ = write!(self.body, "<pre>{}</pre>", escape(text));
    }

    /// Adds a chart.
    pub fn chart(&mut self, chart: &Chart) {
        let _ = write!(self.body, "<figure>{}</figure>", chart.svg());
    }

    /// Adds an image, given as the bytes of a PNG file, above its caption.
    pub fn image(&mut self, caption: &str, png: &[u8]) {
        let (caption, data) = (escape(caption), base64(png));
        let _ = write!(self.body, "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\">");
        let _ = write!(self.body, "<figcaption>{caption}</figcaption></figure>");
    }

    /// Adds a table.
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

    /// Returns the HTML file.
    pub fn html(&self) -> String {
        let head = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">";
        format!("{head}<title>{}</title><style>{STYLE}</style>{}</html>\n", self.title, self.body)
    }
}

/// Escapes text for HTML, in an element or a quoted attribute.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Encodes bytes as in RFC 4648, §4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |i: usize| u32::from(group.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let is_padding = digit > group.len();
            let value = (bits >> (18 - 6 * digit)) as usize & 63;
            text.push(if is_padding { '=' } else { char::from(DIGITS[value]) });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_shows_words_as_they_are() {
        let mut page = Page::new("a < b");
        page.paragraph("<script>");
        page.preformatted("<a href=\"x\">&");
        let mut table = Table::new(&["name", "value"]);
        table.rows.push(vec!["x".into(), "−1.5".into()]);
        table.marked.push((0, false));
        page.table(&table);
        let html = page.html();
        assert!(html.contains("a &lt; b") && html.contains("<p>&lt;script&gt;</p>"));
        assert!(html.contains("<pre>&lt;a href=&quot;x&quot;&gt;&amp;</pre>"));
        assert!(html.contains("<tr class=\"bad\"><td>x<td class=\"n\">−1.5</tr>"));
    }

    #[test]
    fn table_is_the_same_in_markdown_and_in_columns() {
        let mut table = Table::new(&["name", "n"]);
        table.rows.push(vec!["long name".into(), "1".into()]);
        assert_eq!(table.markdown(), "| name | n |\n| --- | --- |\n| long name | 1 |\n");
        assert_eq!(table.text(), "name       n\nlong name  1\n");
    }

    #[test]
    fn base64_of_the_rfcs_examples() {
        let pairs =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE=")];
        for (bytes, text) in pairs {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xbf]), "+/+/");
    }
}
