//! Splitting of text lines into cells, and selection of the columns with numbers.

#![cfg_attr(not(all(feature = "npy", feature = "points")), allow(dead_code))]

use crate::ascii::{Lines, number};
use crate::error::Problem;
use crate::point_columns::Roles;
use crate::raw_rows::wrong_count;
use surfel_model::TableColumns;

/// Maximum number of columns of a text file. Files with more are refused.
pub(crate) const MAX_COLUMNS: usize = 128;
/// Maximum number of lines that are examined to detect a decimal comma.
const JUDGED_LINES: usize = 100;
/// Maximum number of lines that are examined to choose the separator and to detect columns of words.
const PLANNED_LINES: usize = 1000;
/// Words that mark the lines of points in files that also have other lines, such as `p x y z` beside `d 1 1 1`. Letter
/// case matters, because capital letters are chemical elements.
const POINT_WORDS: [&[u8]; 7] = [b"p", b"v", b"pt", b"pnt", b"point", b"vertex", b"vtx"];

/// Separator between the cells of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Divider {
    /// Any number of blanks, commas and semicolons, together one separator.
    Any,
    /// Any number of blanks and semicolons, together one separator. Commas are decimal marks.
    NoComma,
    /// This character alone, each one a separator, so that a cell may be empty or contain blanks.
    Each(u8),
}

/// Separator and decimal mark of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Dialect {
    divider: Divider,
    pub(crate) has_decimal_commas: bool,
}

/// Dialect of most point files: any separator, and decimal points.
pub(crate) const POINTS: Dialect = Dialect { divider: Divider::Any, has_decimal_commas: false };
/// Dialect of tables with decimal commas.
const DECIMAL_COMMAS: Dialect = Dialect { divider: Divider::NoComma, has_decimal_commas: true };

impl Dialect {
    /// Detects the dialect from the first lines; lines that begin with a word are ignored. Decimal commas are chosen if
    /// a word contains a comma, and every line is a single number or at least three, between blanks and semicolons. A
    /// decimal comma must have digits on both sides.
    pub(crate) fn of(head: &[u8]) -> Self {
        let mut with_comma = false;
        for (_, line) in Lines::new(head).filter(|(_, line)| !is_comment(line)).take(JUDGED_LINES) {
            let mut words = DECIMAL_COMMAS.words(line).peekable();
            if words.peek().is_some_and(|w| w.first().is_some_and(|b| b.is_ascii_alphabetic() || *b == b'"')) {
                continue;
            }
            let (mut count, mut numbers) = (0, true);
            for word in words {
                count += 1;
                with_comma |= word.contains(&b',');
                numbers &= DECIMAL_COMMAS.number(word).is_some();
            }
            // A single number on a line is a count.
            if !numbers || count == 2 || count == 0 {
                return POINTS;
            }
        }
        if with_comma { DECIMAL_COMMAS } else { POINTS }
    }

    /// Returns the cells of a line, without quotes. Cells can be empty only if a single character separates them.
    pub(crate) fn words(self, line: &[u8]) -> Words<'_> {
        Words { divider: self.divider, rest: Some(line) }
    }

    /// True if two commas or semicolons have nothing but blanks between them, or a line begins or ends with one. Commas
    /// don't count if they are decimal marks.
    pub(crate) fn has_empty_cell(self, line: &[u8]) -> bool {
        let commas = !self.has_decimal_commas;
        let mut cells = line.split(move |&b| b == b';' || commas && b == b',');
        cells.any(|cell| unquoted(cell.trim_ascii()).is_empty())
    }

    pub(crate) fn number(self, word: &[u8]) -> Option<f64> {
        let Some(comma) = word.iter().position(|&b| b == b',').filter(|_| self.has_decimal_commas) else {
            return number(word);
        };
        let (whole, fraction) = (&word[..comma], &word[comma + 1..]);
        let digits = whole.last().is_some_and(u8::is_ascii_digit) && fraction.first().is_some_and(u8::is_ascii_digit);
        number(&[whole, b".", fraction].concat()).filter(|_| digits)
    }
}

/// Iterator over the cells of a line.
pub(crate) struct Words<'a> {
    divider: Divider,
    rest: Option<&'a [u8]>,
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        if let Divider::Each(divider) = self.divider {
            let rest = self.rest?;
            let end = cell_end(rest, divider);
            self.rest = rest.get(end + 1..);
            return Some(unquoted(rest[..end].trim_ascii()));
        }
        let commas = self.divider == Divider::Any;
        let divides = |b: &u8| b.is_ascii_whitespace() || *b == b';' || commas && *b == b',';
        loop {
            let rest = self.rest?;
            let end = rest.iter().position(divides).unwrap_or(rest.len());
            self.rest = rest.get(end + 1..);
            let word = unquoted(&rest[..end]);
            if !word.is_empty() {
                return Some(word);
            }
        }
    }
}

/// Returns the end of the first cell in `rest`; a separator within quotes doesn't end the cell.
fn cell_end(rest: &[u8], divider: u8) -> usize {
    let mut quoted = false;
    let is_quoted = rest.trim_ascii_start().first() == Some(&b'"');
    let ends = |b: &u8| {
        quoted ^= is_quoted && *b == b'"';
        *b == divider && !quoted
    };
    rest.iter().position(ends).unwrap_or(rest.len())
}

/// Returns a cell's text without enclosing quotes, which some programs write around all values.
fn unquoted(word: &[u8]) -> &[u8] {
    word.strip_prefix(b"\"").and_then(|word| word.strip_suffix(b"\"")).unwrap_or(word)
}

/// True if a line is empty or a comment, so that it contains no point in any format.
pub(crate) fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//")
}

/// True if a cell is empty, or states that a value is missing, as `NA` and `null` do.
pub(crate) fn is_missing(cell: &[u8]) -> bool {
    cell.is_empty() || [&b"NA"[..], b"N/A", b"null", b"none"].iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// Interpretation of a text file: its dialect, and the columns that are read.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    pub(crate) dialect: Dialect,
    /// For each column of the file, true if it contains numbers and is read; `None` if all columns are read.
    pub(crate) kept: Option<Vec<bool>>,
    /// Numbers, from 1, of columns that aren't read because they contain words.
    pub(crate) words: Vec<usize>,
    /// Numbers, from 1, of columns that aren't read because they are mostly empty.
    pub(crate) empty: Vec<usize>,
    /// Word that begins every line of a point, one of [`POINT_WORDS`]. Lines that begin with another word are skipped.
    /// `None` if points aren't marked.
    pub(crate) point_word: Option<&'static [u8]>,
}

/// A dialect that may be that of a file, and statistics of the cells into which it splits the first lines.
struct Trial {
    dialect: Dialect,
    width: usize,
    /// Number of the examined lines that have `width` cells.
    rows: usize,
    /// Number of cells that are numbers, for each column.
    numbers: Vec<usize>,
    /// Number of cells without a value, for each column.
    empty: Vec<usize>,
}

impl Trial {
    fn of(dialect: Dialect, lines: &[&[u8]], expected: Option<usize>) -> Option<Self> {
        let mut widths = std::collections::BTreeMap::new();
        lines.iter().for_each(|line| *widths.entry(dialect.words(line).count()).or_insert(0_usize) += 1);
        let (width, rows) = match expected {
            Some(width) => (width, widths.get(&width).copied()?),
            None => widths.into_iter().max_by_key(|(width, count)| (*count, *width))?,
        };
        if !(3..=MAX_COLUMNS).contains(&width) {
            return None;
        }
        let (mut numbers, mut empty) = (vec![0; width], vec![0; width]);
        for line in lines.iter().filter(|line| dialect.words(line).count() == width) {
            for (i, cell) in dialect.words(line).enumerate() {
                numbers[i] += usize::from(dialect.number(cell).is_some());
                empty[i] += usize::from(is_missing(cell));
            }
        }
        Some(Self { dialect, width, rows, numbers, empty })
    }

    /// Returns true for each column in which at least half of the cells are numbers.
    fn kept(&self) -> Vec<bool> {
        self.numbers.iter().map(|count| count * 2 >= self.rows).collect()
    }

    fn plan(&self) -> Plan {
        let kept = self.kept();
        let left = || (0..self.width).filter(|i| !kept[*i]);
        let is_empty = |i: &usize| self.empty[*i] * 2 > self.rows;
        let words = left().filter(|i| !is_empty(i)).map(|i| i + 1).collect();
        let empty = left().filter(is_empty).map(|i| i + 1).collect();
        Plan { dialect: self.dialect, words, empty, kept: Some(kept), point_word: None }
    }
}

impl Plan {
    /// Chooses the plan from the start of a file; `is_whole` is true if that is the whole file. If all words of all
    /// lines are numbers, each word is a cell. Otherwise a single separator is searched for, so that cells may contain
    /// words or be empty.
    ///
    /// # Errors
    /// [`Problem`] if fewer than half of the examined lines have as many cells as `columns` states.
    pub(crate) fn of(head: &[u8], is_whole: bool, columns: Option<&TableColumns>) -> Result<Self, Problem> {
        let dialect = Dialect::of(head);
        let plain = Self { dialect, kept: None, words: Vec::new(), empty: Vec::new(), point_word: None };
        let mut lines: Vec<&[u8]> = Lines::new(head).map(|(_, line)| line).filter(|l| !is_comment(l)).collect();
        if !is_whole && head.last() != Some(&b'\n') {
            lines.pop();
        }
        lines.truncate(PLANNED_LINES);
        let is_count = |line: &&&[u8]| dialect.words(line).count() == 1;
        let rows: Vec<&[u8]> = lines.iter().filter(|line| !is_count(line)).copied().collect();
        let mut dialects = vec![dialect];
        for divider in [b',', b';', b'\t'] {
            if divider != b',' || !dialect.has_decimal_commas {
                dialects.push(Dialect { divider: Divider::Each(divider), ..dialect });
            }
        }
        if let Some(columns) = columns {
            return Self::of_columns(columns, &dialects, &rows);
        }
        if are_plain(dialect, &rows) {
            return Ok(plain);
        }
        let is_header = |line: &&[u8]| dialect.words(line).filter(|word| dialect.number(word).is_some()).count() < 3;
        let body = &rows[usize::from(rows.len() > 1 && rows.first().is_some_and(is_header))..];
        let fits = |trial: &Trial| {
            let numbers = trial.kept().iter().filter(|kept| **kept).count();
            trial.rows * 5 >= body.len() * 4 && numbers >= 3
        };
        // If semicolons or tabs separate cells, a comma between digits is a decimal point.
        for divider in [b';', b'\t'] {
            let decimal = Dialect { divider: Divider::Each(divider), has_decimal_commas: true };
            let has_comma =
                |line: &&[u8]| decimal.words(line).any(|w| w.contains(&b',') && decimal.number(w).is_some());
            let trial = Trial::of(decimal, body, None).filter(fits);
            if let Some(trial) = trial.filter(|_| body.iter().any(has_comma)) {
                return Ok(trial.plan().with_point_word(&rows));
            }
        }
        // A single separator has priority: words may contain blanks.
        let trials = dialects.iter().filter_map(|dialect| Trial::of(*dialect, body, None));
        let mut fitting: Vec<Trial> = trials.filter(fits).collect();
        fitting.sort_by_key(|trial| {
            let is_any = !matches!(trial.dialect.divider, Divider::Each(_));
            (std::cmp::Reverse(trial.kept().iter().filter(|kept| **kept).count()), is_any)
        });
        Ok(fitting.first().map_or(plain, |trial| trial.plan().with_point_word(&rows)))
    }

    /// Detects the word that begins the lines of points: one of [`POINT_WORDS`] with which more than half of `rows`, at
    /// the start of a file, begin. If the first line names the columns, the words are values of a column, and no word
    /// is chosen.
    fn with_point_word(mut self, rows: &[&[u8]]) -> Self {
        let is_left_out = self.kept.as_ref().is_some_and(|kept| kept.first() == Some(&false));
        let is_named = rows.first().is_some_and(|line| names(line, self.dialect).is_some());
        let is_usual = |word: &[u8]| {
            let begins = |row: &&&[u8]| self.first_word(row) == Some(word);
            rows.iter().filter(begins).count() * 2 > rows.len()
        };
        self.point_word = POINT_WORDS.into_iter().find(|word| is_left_out && !is_named && is_usual(word));
        self
    }

    /// Returns the word with which a line begins; `None` if it begins with a number.
    fn first_word<'a>(&self, line: &'a [u8]) -> Option<&'a [u8]> {
        self.dialect.words(line).next().filter(|word| self.dialect.number(word).is_none())
    }

    /// True if a line begins with another word than the lines of points do, so that it is skipped.
    pub(crate) fn is_other_record(&self, line: &[u8]) -> bool {
        let Some(expected) = self.point_word else { return false };
        self.first_word(line).is_some_and(|word| word != expected)
    }

    fn of_columns(columns: &TableColumns, dialects: &[Dialect], rows: &[&[u8]]) -> Result<Self, Problem> {
        let names = columns.columns();
        let kept: Vec<bool> = names.iter().map(|column| column.name.is_some()).collect();
        let trials = dialects.iter().filter_map(|dialect| Trial::of(*dialect, rows, Some(names.len())));
        let numbers = |trial: &Trial| {
            let of_kept = trial.numbers.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(count, _)| *count);
            of_kept.min().unwrap_or(0)
        };
        let best = trials.max_by_key(|trial| (trial.rows, numbers(trial)));
        match best {
            Some(trial) if trial.rows * 2 >= rows.len() => {
                let plan = Self { kept: Some(kept), words: Vec::new(), empty: Vec::new(), ..trial.plan() };
                Ok(plan.with_point_word(rows))
            }
            _ => {
                let found = dialects.iter().filter_map(|dialect| Trial::of(*dialect, rows, None));
                let found = found.max_by_key(|trial| trial.rows).map_or(0, |trial| trial.width);
                Err(wrong_count(found, columns))
            }
        }
    }

    /// Returns the numbers, from 1, of the columns that are read, among `width` columns of the file.
    pub(crate) fn numbers(&self, width: usize) -> Vec<usize> {
        match &self.kept {
            Some(kept) => kept.iter().enumerate().filter(|(_, kept)| **kept).map(|(i, _)| i + 1).collect(),
            None => (1..=width).collect(),
        }
    }

    /// Returns notes for the user about columns that aren't read.
    pub(crate) fn notes(&self, names: Option<&[String]>) -> Vec<String> {
        let place = |i: &usize| match names.and_then(|names| names.get(i - 1)).filter(|name| !name.is_empty()) {
            Some(name) => format!("{i} ({})", name.chars().take(60).flat_map(char::escape_debug).collect::<String>()),
            None => i.to_string(),
        };
        let note = |places: &[usize], holds: [&str; 2]| {
            let shown: Vec<String> = places.iter().map(place).collect();
            let plural = usize::from(places.len() > 1);
            (!places.is_empty()).then(|| {
                let what = ["column", "columns"][plural];
                format!("left out {what} {}: {} {}", shown.join(", "), ["it", "they"][plural], holds[plural])
            })
        };
        // A separator at the end of all lines makes no column.
        let is_named = |i: &usize| names.and_then(|names| names.get(i - 1)).is_some_and(|name| !name.is_empty());
        let named: Vec<usize> = self.empty.iter().copied().filter(is_named).collect();
        let notes = [
            note(&self.words, ["holds words, not numbers", "hold words, not numbers"]),
            note(&named, ["is mostly empty", "are mostly empty"]),
        ];
        notes.into_iter().flatten().collect()
    }
}

/// True if rows are plain numbers: all words are numbers, except in the first line. The lines have equal numbers of
/// words, or fewer where a cell is empty. At most half of the rows have an empty cell.
fn are_plain(dialect: Dialect, rows: &[&[u8]]) -> bool {
    let mut width = None;
    // If most rows have an empty cell, a column is empty.
    if rows.iter().filter(|line| dialect.has_empty_cell(line)).count() * 2 > rows.len() {
        return false;
    }
    for (i, line) in rows.iter().enumerate() {
        if !dialect.words(line).all(|word| dialect.number(word).is_some()) {
            if i == 0 {
                continue;
            }
            return false;
        }
        let count = dialect.words(line).count();
        let known = *width.get_or_insert(count);
        if count != known && !(count < known && dialect.has_empty_cell(line)) {
            return false;
        }
    }
    true
}

/// Returns the column names that a line states, if a position is among them. A name may be empty if a single character
/// separates names.
pub(crate) fn names(line: &[u8], dialect: Dialect) -> Option<Vec<String>> {
    let text = |w: &[u8]| String::from_utf8_lossy(w).trim_matches(|c| matches!(c, '"' | '/' | '#')).trim().to_owned();
    // Names separated by commas, semicolons or tabs may contain blanks.
    let of = |divides: &dyn Fn(u8) -> bool, has_empty: bool| {
        let words = line.trim_ascii().split(|&b| divides(b)).map(|w| text(w.trim_ascii()));
        let words = words.map(|w| if w.eq_ignore_ascii_case("i") { "intensity".to_owned() } else { w });
        let found: Vec<String> = words.filter(|w| has_empty || !w.is_empty()).take(MAX_COLUMNS + 1).collect();
        Roles::by_name(found.iter().map(String::as_str)).map(|_| found)
    };
    let commas = !dialect.has_decimal_commas;
    of(&|b| matches!(b, b';' | b'\t') || commas && b == b',', true)
        .or_else(|| of(&|b| matches!(b, b',' | b';') || b.is_ascii_whitespace(), false))
}

/// True if `head`, the start of a file, looks like a table. Either the first line consists of at least three numbers,
/// or the second one does, below a count or names of a position. Or the first line has names of a position, and at
/// least three columns contain numbers.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    let dialect = Dialect::of(head);
    let mut lines = Lines::new(head).map(|(_, line)| line).filter(|line| !is_comment(line));
    let is_row =
        |line: &[u8]| dialect.words(line).count() >= 3 && dialect.words(line).all(|w| dialect.number(w).is_some());
    let is_count = |line: &[u8]| std::str::from_utf8(line.trim_ascii()).is_ok_and(|n| n.parse::<u64>().is_ok());
    let is_names = |line: &[u8]| names(line, POINTS).is_some();
    let Some(first) = lines.next() else { return false };
    let second = lines.next();
    is_row(first)
        || (is_count(first) || is_names(first)) && second.is_some_and(is_row)
        || is_names(first) && second.is_some() && is_table(head)
}

/// True if `head`, the start of a file, isn't plain numbers, but can be split into columns of which at least three
/// contain numbers.
pub(crate) fn is_table(head: &[u8]) -> bool {
    // Format detection passes a multiple of 4096 bytes; with any other length, `head` is the whole file.
    let is_whole = !head.len().is_multiple_of(4096);
    Plan::of(head, is_whole, None).is_ok_and(|plan| plan.kept.is_some())
}
