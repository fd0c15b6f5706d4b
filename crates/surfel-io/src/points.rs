//! Points as columns of printed numbers: XYZ, TXT, CSV, ASC and PTS; and PTX, whose scans have poses.

use crate::ascii::{Lines, each_line, number};
use crate::bytes::Bytes;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, list, quote, unwritable};
use crate::point_columns::{self, Named, Roles, Source};
use crate::rows::KeptRows;
use crate::strided::{NumberType, Strided};
use crate::words::counted;
use std::io::Write;

/// Most columns of a file.
const MAX_COLUMNS: usize = 64;
/// Lines by which a decimal comma is told.
const JUDGED_LINES: usize = 100;

/// How a line is divided and its numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Dialect {
    /// Blanks, commas and semicolons divide.
    Points,
    /// Blanks and semicolons divide; a comma is a decimal point.
    DecimalCommas,
}

impl Dialect {
    /// Decimal commas are believed where no line makes sense without them: all words that blanks and semicolons leave
    /// are numbers, three of them at least, and a comma has digits on either side.
    fn of(head: &[u8]) -> Self {
        let mut with_comma = false;
        for (_, line) in Lines::new(head).filter(|(_, line)| !is_comment(line)).take(JUDGED_LINES) {
            let mut words = Self::DecimalCommas.words(line).peekable();
            if words.peek().is_some_and(|w| w.first().is_some_and(|b| b.is_ascii_alphabetic() || *b == b'"')) {
                continue;
            }
            let (mut count, mut numbers) = (0, true);
            for word in words {
                count += 1;
                with_comma |= word.contains(&b',');
                numbers &= Self::DecimalCommas.number(word).is_some();
            }
            // A count stands alone.
            if !numbers || count == 2 || count == 0 {
                return Self::Points;
            }
        }
        if with_comma { Self::DecimalCommas } else { Self::Points }
    }

    fn words(self, line: &[u8]) -> impl Iterator<Item = &[u8]> {
        let commas = self == Self::Points;
        let words = line.split(move |&b| b.is_ascii_whitespace() || b == b';' || commas && b == b',');
        words.map(unquoted).filter(|w| !w.is_empty())
    }

    /// True if two dividing signs of a table have nothing between them, or a line begins or ends with one.
    fn has_empty_cell(self, line: &[u8]) -> bool {
        let commas = self == Self::Points;
        let mut cells = line.split(move |&b| b == b';' || commas && b == b',');
        cells.any(|cell| unquoted(cell.trim_ascii()).is_empty())
    }

    fn number(self, word: &[u8]) -> Option<f64> {
        let Some(comma) = word.iter().position(|&b| b == b',').filter(|_| self == Self::DecimalCommas) else {
            return number(word);
        };
        let (whole, fraction) = (&word[..comma], &word[comma + 1..]);
        let digits = whole.last().is_some_and(u8::is_ascii_digit) && fraction.first().is_some_and(u8::is_ascii_digit);
        number(&[whole, b".", fraction].concat()).filter(|_| digits)
    }
}

/// A value without the quotes around it, as some programs write all of them.
fn unquoted(word: &[u8]) -> &[u8] {
    word.strip_prefix(b"\"").and_then(|word| word.strip_suffix(b"\"")).unwrap_or(word)
}

/// True if `head`, the start of a file, has a line of at least three numbers before anything else but names and a
/// count.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    let dialect = Dialect::of(head);
    let mut lines = Lines::new(head).map(|(_, line)| line).filter(|line| !is_comment(line));
    let is_row =
        |line: &[u8]| dialect.words(line).count() >= 3 && dialect.words(line).all(|w| dialect.number(w).is_some());
    let is_count = |line: &[u8]| std::str::from_utf8(line.trim_ascii()).is_ok_and(|n| n.parse::<u64>().is_ok());
    let is_head = |line: &[u8]| is_count(line) || names(line, Dialect::Points).is_some();
    lines.next().is_some_and(|line| is_row(line) || is_head(line) && lines.next().is_some_and(is_row))
}

fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//")
}

/// Numbers in rows of the same width, each as the 8 bytes of an `f64`, and what was told of them.
#[derive(Default)]
pub(crate) struct Table {
    width: usize,
    /// Numbers at the end of a row that are no column.
    hidden: usize,
    rows: usize,
    names: Option<Vec<String>>,
    comments: Vec<String>,
}

impl Table {
    fn push(&mut self, row: &[f64], data: &mut dyn Write) -> Result<(), Fault> {
        let mut bytes = [0; 8 * (MAX_COLUMNS + 1)];
        bytes.as_chunks_mut().0.iter_mut().zip(row).for_each(|(bytes, v)| *bytes = v.to_le_bytes());
        self.rows += 1;
        Ok(data.write_all(&bytes[..8 * row.len()]).map_err(unwritable)?)
    }

    /// The columns of the rows, which are `data`, by these names.
    fn named<'a>(&self, names: Option<Vec<String>>, data: Bytes<'a>) -> Vec<Named<'a>> {
        let mut names = names.unwrap_or_default();
        names.resize(self.width, String::new());
        let (stride, rows) = (8 * self.width, self.rows);
        let column = |i: usize| Strided::new(data, 8 * i, stride, rows, NumberType::F64, false);
        names.truncate(self.width - self.hidden);
        names.into_iter().enumerate().filter_map(|(i, name)| Some(Named { name, values: column(i)? })).collect()
    }

    /// The columns of the rows, which are `data`, and what they are.
    pub(crate) fn columns<'a>(&self, data: Bytes<'a>, context: &mut Context<'_>) -> (Vec<Named<'a>>, Roles) {
        let named = self.names.as_ref().map(Vec::len);
        let header = self.names.clone().filter(|names: &Vec<String>| names.len() == self.width);
        let roles = header.as_ref().and_then(|names| Roles::by_name(names.iter().map(String::as_str)));
        let mut columns = self.named(header, data);
        let roles = roles.unwrap_or_else(|| {
            columns.iter_mut().for_each(|c| c.name.clear());
            let roles = Roles::by_content(&mut columns);
            if self.width > 3 {
                let names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
                let why =
                    named.map_or_else(|| "no first line names them".into(), |n| format!("the line of names has {n}"));
                context.note(format!("took the columns as {}: {why}", list(&names)));
            }
            roles
        });
        (columns, roles)
    }
}

pub(crate) fn read(bytes: &[u8], pts: bool, context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut data = Vec::new();
    let mut table = unpack(Bytes::Memory(bytes), pts, &mut data, context)?;
    let (columns, roles) = table.columns(Bytes::Memory(&data), context);
    point_columns::build(columns, &roles, Source::Text, std::mem::take(&mut table.comments), context)
}

/// Writes the numbers of all points to `data`.
pub(crate) fn unpack(
    bytes: Bytes<'_>,
    pts: bool,
    data: &mut dyn Write,
    context: &mut Context<'_>,
) -> Result<Table, Fault> {
    let dialect = Dialect::of(&bytes.at_most(0, 1 << 20));
    let mut said = 0_u64;
    let (mut incomplete, mut first_incomplete) = (0_usize, 0);
    let mut table = Table::default();
    let mut row: Vec<f64> = Vec::with_capacity(MAX_COLUMNS);
    each_line(bytes, |line_number, line| {
        if is_comment(line) {
            if table.width == 0 && table.comments.len() < 1000 {
                let text = String::from_utf8_lossy(line.trim_ascii());
                let text = text.trim_start_matches(['#', '/']).trim();
                // The last comment before the points that names columns, names theirs.
                table.names = names(text.as_bytes(), dialect).or(table.names.take());
                if !text.is_empty() {
                    table.comments.push(text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect());
                }
            }
            return Ok(());
        }
        let at = Location::Line(line_number);
        row.clear();
        let mut bad = None;
        for word in dialect.words(line) {
            match dialect.number(word) {
                Some(value) if row.len() < MAX_COLUMNS => row.push(value),
                Some(_) => return Err(Problem::new(format!("more than {MAX_COLUMNS} columns")).at(at).into()),
                None => {
                    bad = Some(word);
                    break;
                }
            }
        }
        if let Some(word) = bad {
            if table.width == 0 {
                table.names = Some(names(line, dialect).ok_or_else(|| {
                    let found = format!("found {} where points were expected", quote(word));
                    Problem::new(found).at(at).expected("x y z [intensity] [r g b] [nx ny nz], as numbers")
                })?);
                return Ok(());
            }
            return Err(Problem::new(format!("found {}", quote(word))).at(at).expected("a number").into());
        }
        if row.len() < table.width && dialect.has_empty_cell(line) {
            first_incomplete = if incomplete == 0 { line_number } else { first_incomplete };
            incomplete += 1;
            return Ok(());
        }
        // A PTS file has the number of points before each scan.
        if row.len() == 1 && (pts || table.width == 0) {
            said = said.saturating_add(row[0].max(0.0) as u64);
            return Ok(());
        }
        if table.width == 0 {
            table.width = row.len();
            if table.width < 3 {
                let problem = Problem::new(format!("found {} numbers", table.width)).at(at);
                return Err(problem.expected("at least x y z").into());
            }
        }
        if row.len() != table.width {
            let mut problem = Problem::new(format!("found {} numbers", row.len())).at(at);
            if dialect == Dialect::Points && line.contains(&b',') {
                problem =
                    problem.help("if its commas are decimal points, write points instead: they also divide columns");
            }
            return Err(problem.expected(format!("{}, as in the lines before", table.width)).into());
        }
        table.push(&row, data)
    })?;
    if table.width == 0 {
        return Err(Problem::new("holds no point").expected("lines of x y z [intensity] [r g b] [nx ny nz]").into());
    }
    if dialect == Dialect::DecimalCommas {
        context.note("took commas as decimal points: blanks or semicolons divide the columns".into());
    }
    if incomplete > 0 {
        let rows = counted(incomplete as u64, "rows");
        context.note(format!("left out {rows} with an empty cell, the first in line {first_incomplete}"));
    }
    if said > 0 && said != table.rows as u64 {
        context.note(format!("the file says that it has {}, and has {}", counted(said, "points"), table.rows));
    }
    Ok(table)
}

/// The names of columns that a line gives, if these include a position.
fn names(line: &[u8], dialect: Dialect) -> Option<Vec<String>> {
    let text = |w: &[u8]| String::from_utf8_lossy(w).trim_matches(|c| matches!(c, '"' | '/' | '#')).to_owned();
    // Where commas, semicolons or tabs divide, a name may hold blanks.
    let of = |divides: &dyn Fn(u8) -> bool| {
        let words = line.trim_ascii().split(|&b| divides(b)).map(|w| text(w.trim_ascii()));
        let words = words.map(|w| if w.eq_ignore_ascii_case("i") { "intensity".to_owned() } else { w });
        let found: Vec<String> = words.filter(|w| !w.is_empty()).take(MAX_COLUMNS + 1).collect();
        Roles::by_name(found.iter().map(String::as_str)).map(|_| found)
    };
    let commas = dialect == Dialect::Points;
    of(&|b| matches!(b, b';' | b'\t') || commas && b == b',')
        .or_else(|| of(&|b| matches!(b, b',' | b';') || b.is_ascii_whitespace()))
}

/// True if `head`, the start of a file, is that of a PTX file: two counts, four lines of three numbers, four of four.
pub(crate) fn looks_like_ptx(head: &[u8]) -> bool {
    let mut lines = Lines::new(head);
    [1, 1, 3, 3, 3, 3, 4, 4, 4, 4].into_iter().all(|n| {
        lines.next().is_some_and(|(_, line)| {
            let words = Dialect::Points.words(line);
            words.map(number).try_fold(0, |n, v| Some(n + usize::from(v?.is_finite()))) == Some(n)
        })
    })
}

/// Reads scans, each with its rows and columns and the pose of its scanner, by which its points are moved.
pub(crate) fn read_ptx(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let (mut data, mut rows) = (Vec::new(), KeptRows::default());
    let table = unpack_ptx(Bytes::Memory(bytes), &mut data, Some(&mut rows), context)?;
    let (columns, roles) = table.columns(Bytes::Memory(&data), context);
    let mut content = point_columns::build(columns, &roles, Source::Text, Vec::new(), context)?;
    rows.give(&mut content);
    Ok(content)
}

/// Lines of a scan before its points: two counts, the scanner's pose, and the matrix, which has that, too.
const SCAN_LINES: [(usize, &str); 10] = {
    let (count, pose, matrix) =
        ((1, "the scan's columns and rows"), (3, "the scanner's pose"), (4, "the scan's matrix"));
    [count, count, pose, pose, pose, pose, matrix, matrix, matrix, matrix]
};

/// Writes the numbers of all points of a PTX file to `data`, and which of its points these are to `kept`.
pub(crate) fn unpack_ptx(
    bytes: Bytes<'_>,
    data: &mut dyn Write,
    mut kept: Option<&mut KeptRows>,
    context: &mut Context<'_>,
) -> Result<Table, Fault> {
    let mut table = Table::default();
    let (mut scans, mut no_return) = (0_u32, 0_u64);
    // Lines of the scan so far, before its points, and how many of these are left.
    let (mut lines, mut counts, mut matrix, mut left) = (0, [0_u64; 2], [[0.0; 4]; 4], 0);
    let mut row: Vec<f64> = Vec::with_capacity(9);
    each_line(bytes, |line_number, line| {
        if line.trim_ascii().is_empty() {
            return Ok(());
        }
        let at = Location::Line(line_number);
        let (expected, what) = match SCAN_LINES.get(lines) {
            Some((count, what)) => (std::slice::from_ref(count), *what),
            None => (&[3, 4, 7][..], "x y z intensity red green blue"),
        };
        row.clear();
        for word in Dialect::Points.words(line).take(8) {
            row.push(number(word).ok_or_else(|| {
                Problem::new(format!("found {}", quote(word))).at(at).expected(format!("a number of {what}"))
            })?);
        }
        if !expected.contains(&row.len()) {
            let expected: Vec<String> = expected.iter().map(usize::to_string).collect();
            let problem = Problem::new(format!("found {} numbers", row.len())).at(at);
            return Err(problem.expected(format!("{} of {what}", expected.join(" or "))).into());
        }
        if lines < SCAN_LINES.len() {
            match lines {
                0 | 1 => counts[lines] = row[0].max(0.0) as u64,
                6.. => matrix[lines - 6].copy_from_slice(&row),
                // The scanner's own place and axes are in the matrix, too.
                _ => {}
            }
            (lines, left) = (lines + 1, counts[0].saturating_mul(counts[1]));
        } else {
            left -= 1;
            let p = [row[0], row[1], row[2]];
            if p == [0.0; 3] {
                no_return += 1;
                kept.iter_mut().for_each(|kept| kept.skip());
            } else {
                kept.iter_mut().for_each(|kept| kept.keep());
                // Points are rows that are multiplied by the matrix from the right.
                let moved: [f64; 3] =
                    std::array::from_fn(|k| (0..3).map(|j| p[j] * matrix[j][k]).sum::<f64>() + matrix[3][k]);
                row[..3].copy_from_slice(&moved);
                row.push(scans.into());
                if table.width == 0 {
                    table.width = row.len();
                }
                if table.width != row.len() {
                    let problem = Problem::new(format!("found {} numbers", row.len() - 1)).at(at);
                    return Err(problem.expected(format!("{}, as in the lines before", table.width - 1)).into());
                }
                table.push(&row, data)?;
            }
        }
        if lines == SCAN_LINES.len() && left == 0 {
            (scans, lines) = (scans + 1, 0);
        }
        Ok(())
    })?;
    if lines > 0 {
        let part = SCAN_LINES.get(lines).map_or("the points", |(_, what)| what);
        let problem = Problem::new(format!("the file ends within {part} of scan {}", scans + 1));
        return Err(problem.help("copy or export the file again: it is incomplete").into());
    }
    if table.width == 0 {
        return Err(Problem::new("holds no point").expected("scans of points that aren't all 0 0 0").into());
    }
    if no_return > 0 {
        let points = counted(no_return, "points");
        context.note(format!("left out {points} at 0 0 0: the scanner got no return there"));
    }
    let names = ["x", "y", "z", "intensity", "red", "green", "blue"].iter().take(table.width - 1);
    table.names = Some(names.map(|n| (*n).to_owned()).chain(["scan".to_owned()]).collect());
    table.hidden = usize::from(scans == 1);
    Ok(table)
}
