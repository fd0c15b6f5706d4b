//! Readers of points as columns of printed numbers: XYZ, TXT, CSV, ASC and PTS; and PTX, whose scans have poses.

use crate::ascii::{Lines, each_line, number};
use crate::bytes::Bytes;
use crate::column_roles;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, list, quote, unwritable};
use crate::point_columns::{self, Named, Roles, Source};
use crate::raw_rows;
use crate::rows::RowNumbers;
use crate::strided::{NumberType, Strided};
use crate::text_rows::{MAX_COLUMNS, POINTS, Plan, is_comment, is_missing, names};
use crate::words::counted;
use std::io::Write;
use surfel_model::TableColumns;

/// Description of points that were written as rows of `f64` numbers, and metadata of the text file that they come from.
#[derive(Default)]
pub(crate) struct Table {
    width: usize,
    /// Number of values at the end of each row that [`Table::columns`] doesn't return.
    hidden: usize,
    rows: usize,
    names: Option<Vec<String>>,
    /// Last comment before the points, if it has as many words as a row has columns, but doesn't name a position. It is
    /// quoted in a note.
    comment: Option<String>,
    /// Number of each column in the file, counted from 1, for messages.
    numbers: Vec<usize>,
    comments: Vec<String>,
}

impl Table {
    /// Creates the description of a table without rows, whose columns have these names.
    pub(crate) fn with_names(names: &[&str]) -> Self {
        let names = names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        Self { width: names.len(), names: Some(names), ..Self::default() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows == 0
    }

    pub(crate) fn push(&mut self, row: &[f64], data: &mut dyn Write) -> Result<(), Fault> {
        let mut bytes = [0; 8 * (MAX_COLUMNS + 1)];
        bytes.as_chunks_mut().0.iter_mut().zip(row).for_each(|(bytes, v)| *bytes = v.to_le_bytes());
        self.rows += 1;
        Ok(data.write_all(&bytes[..8 * row.len()]).map_err(unwritable)?)
    }

    /// Returns the columns of the rows in `data`, with empty names.
    fn unnamed<'a>(&self, data: Bytes<'a>) -> Vec<Named<'a>> {
        let (stride, rows) = (8 * self.width, self.rows);
        let column = |i: usize| Strided::new(data, 8 * i, stride, rows, NumberType::F64, false);
        let named = |i: usize| Some(Named { name: String::new(), values: column(i)? });
        (0..self.width - self.hidden).filter_map(named).collect()
    }

    /// Returns the columns of the rows in `data` with their names, and their roles.
    pub(crate) fn columns<'a>(
        &self,
        data: Bytes<'a>,
        context: &mut Context<'_>,
    ) -> Result<(Vec<Named<'a>>, Roles), Fault> {
        let mut columns = self.unnamed(data);
        if let Some((names, roles)) = self.header(&columns) {
            for (column, name) in columns.iter_mut().zip(names) {
                column.name = name;
            }
            return Ok((columns, roles));
        }
        let (roles, reasons) = Roles::by_content(&mut columns, &self.numbers)?;
        if self.width > 3 || !reasons.is_empty() || self.comment.is_some() {
            let names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
            let why = match (&self.names, &self.comment) {
                (Some(names), _) => format!("the line of names has {}", names.len()),
                (None, Some(comment)) => format!("the comment above them, {}, doesn't name x, y and z", quote(comment)),
                (None, None) => "no first line names them".into(),
            };
            context.note(column_roles::as_note(&format!("took the columns as {}: {why}", list(&names)), &reasons));
        }
        Ok((columns, roles))
    }

    /// Returns the column names that the file states, and the roles by these names. Returns `None` if the names don't
    /// match the columns.
    fn header(&self, columns: &[Named<'_>]) -> Option<(Vec<String>, Roles)> {
        let width = self.width - self.hidden;
        let mut names = self.names.clone()?;
        if names.len() > width {
            names.truncate(width.max(names.iter().rposition(|name| !name.is_empty())? + 1));
        }
        if names.len() > width {
            names.retain(|name| !name.is_empty());
        }
        let values = || columns.iter().map(|c| c.values).collect::<Vec<Strided<'_>>>();
        // Tables written by R have row names, whose column has no name.
        if names.len() + 1 == width && column_roles::begins_with_index(&values()) {
            names.insert(0, String::new());
        }
        let roles = Roles::by_name(names.iter().map(String::as_str)).filter(|_| names.len() == width)?;
        let is_index = names[0].is_empty() && column_roles::begins_with_index(&values());
        for (i, name) in names.iter_mut().enumerate().filter(|(_, name)| name.is_empty()) {
            *name = if i == 0 && is_index { "index".to_owned() } else { format!("column_{}", i + 1) };
        }
        Some((names, roles))
    }
}

pub(crate) fn read(bytes: &[u8], pts: bool, context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut data = Vec::new();
    let mut table = unpack(Bytes::Memory(bytes), pts, &mut data, context)?;
    let (columns, roles) = table.columns(Bytes::Memory(&data), context)?;
    point_columns::build(columns, &roles, Source::Text, std::mem::take(&mut table.comments), context)
}

/// Names of the columns of a PTS file that has all seven.
const PTS_COLUMNS: [&str; 7] = ["x", "y", "z", "intensity", "red", "green", "blue"];
/// Description of the expected columns, for messages about text files.
const EXPECTED: &str = "x y z [intensity] [r g b] [nx ny nz], as numbers";
/// Advice to the user for a table whose columns Surfel doesn't recognise.
const NAME_THEM: &str = "`columns=x,y,z,_,r,g,b` names the columns; _ leaves one out";

/// Parses a text file, and writes the values of all points to `data` as rows of `f64`. Returns the description of these
/// rows. `pts` is true for PTS files.
pub(crate) fn unpack(
    bytes: Bytes<'_>,
    pts: bool,
    data: &mut dyn Write,
    context: &mut Context<'_>,
) -> Result<Table, Fault> {
    let head = bytes.at_most(0, 1 << 20);
    let named = context.options.columns.clone();
    named.as_ref().map_or(Ok(()), raw_rows::check)?;
    if named.as_ref().is_some_and(TableColumns::is_typed) {
        let problem = Problem::new("is text, and `columns` gives types, as of binary numbers");
        return Err(problem.expected("names alone, such as x,y,z,intensity").into());
    }
    let plan = Plan::of(&head, head.len() == bytes.len(), named.as_ref())?;
    let mut lines = PointLines {
        // If the user or the plan excludes columns, the number of cells per row is known already.
        cells: plan.kept.as_ref().map_or(0, Vec::len),
        plan,
        named: named.is_some(),
        pts,
        table: Table::default(),
        header: None,
        last_comment: String::new(),
        row: Vec::with_capacity(MAX_COLUMNS),
        ends_in_bytes: true,
        stated_points: 0,
        lines_before: 0,
        incomplete: SkippedLines::default(),
        others: SkippedLines::default(),
    };
    each_line(bytes, |number, line| lines.line(number, line, data))?;
    if lines.table.rows == 0 {
        return Err(Problem::new("holds no point").expected("lines of x y z [intensity] [r g b] [nx ny nz]").into());
    }
    lines.name_columns(named.as_ref(), context);
    lines.note(context);
    Ok(lines.table)
}

/// Number of lines that were skipped for one reason, and the first of them, for a note.
#[derive(Default)]
struct SkippedLines {
    count: u64,
    /// Number of the first skipped line in the file, counted from 1.
    first: usize,
}

impl SkippedLines {
    fn add(&mut self, line_number: usize) {
        self.first = if self.count == 0 { line_number } else { self.first };
        self.count += 1;
    }
}

/// Reader of the lines of a text file of points.
struct PointLines {
    plan: Plan,
    /// True if the user named the columns ([`crate::LoadOptions::columns`]).
    named: bool,
    /// True for PTS files.
    pts: bool,
    table: Table,
    /// Number of cells in a row, the same in all rows; 0 until the plan or the first row determines it.
    cells: usize,
    header: Option<Vec<String>>,
    last_comment: String,
    /// Numbers of the current row that are read.
    row: Vec<f64>,
    /// True while all rows end in three bytes after four other numbers, as the colours of a PTS file do.
    ends_in_bytes: bool,
    /// Number of points that the file states, in all of its scans together.
    stated_points: u64,
    /// Number of lines before the points that are neither comments nor points.
    lines_before: u64,
    /// Rows that were skipped because of an empty cell.
    incomplete: SkippedLines,
    /// Lines that were skipped because they don't begin with the word that marks points.
    others: SkippedLines,
}

/// Result of parsing the cells of a line.
struct Cells<'a> {
    count: usize,
    /// Value of the first cell, if it is a number.
    first: Option<f64>,
    /// First cell to be read that is no number; the cells after it aren't parsed.
    bad: Option<&'a [u8]>,
    /// True if a cell to be read is empty or states that its value is missing.
    is_incomplete: bool,
}

impl PointLines {
    /// Parses a line of the file. If it is a point, writes the point's numbers to `data`.
    fn line(&mut self, line_number: usize, line: &[u8], data: &mut dyn Write) -> Result<(), Fault> {
        if is_comment(line) {
            self.comment(line);
            return Ok(());
        }
        if self.plan.is_other_record(line) {
            self.others.add(line_number);
            return Ok(());
        }
        let at = Location::Line(line_number);
        let Cells { count, first, bad, is_incomplete } = self.parse(line, at)?;
        if let Some(word) = bad {
            return self.words(line, word, at);
        }
        // A PTS file states the number of points before each scan.
        if let Some(points) = first.filter(|_| count == 1 && (self.pts || self.table.rows == 0)) {
            self.stated_points = self.stated_points.saturating_add(points.max(0.0) as u64);
            return Ok(());
        }
        let dialect = self.plan.dialect;
        if is_incomplete && count == self.cells || count < self.cells && dialect.has_empty_cell(line) {
            self.incomplete.add(line_number);
            return Ok(());
        }
        if self.cells == 0 {
            self.cells = count;
        }
        if count != self.cells && self.named && self.table.rows == 0 {
            self.lines_before += 1;
            return Ok(());
        }
        if self.table.width == 0 {
            self.table.width = self.row.len();
            if self.table.width < 3 {
                let problem = Problem::new(format!("found {} numbers", self.table.width)).at(at);
                return Err(problem.expected("at least x y z").into());
            }
        }
        if count != self.cells || self.row.len() != self.table.width {
            let mut problem = Problem::new(format!("found {count} numbers")).at(at);
            if !dialect.has_decimal_commas && line.contains(&b',') {
                problem =
                    problem.help("if its commas are decimal points, write points instead: they also divide columns");
            }
            return Err(problem.expected(format!("{}, as in the lines before", self.cells)).into());
        }
        let is_byte = |level: &f64| (0.0..=255.0).contains(level) && level.fract() == 0.0;
        self.ends_in_bytes &= self.row.len() == PTS_COLUMNS.len() && self.row[4..].iter().all(is_byte);
        self.table.push(&self.row, data)
    }

    /// Stores one of the first 1000 comments before the points, which may name the columns.
    fn comment(&mut self, line: &[u8]) {
        if self.table.rows > 0 || self.table.comments.len() >= 1000 {
            return;
        }
        let text = String::from_utf8_lossy(line.trim_ascii());
        let text = text.trim_start_matches(['#', '/']).trim();
        // The last comment before the points that contains column names.
        self.header = names(text.as_bytes(), self.plan.dialect).or(self.header.take());
        if !text.is_empty() {
            text.clone_into(&mut self.last_comment);
            self.table.comments.push(text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect());
        }
    }

    /// Parses the cells of a line; the numbers that are read become the current row.
    fn parse<'a>(&mut self, line: &'a [u8], at: Location) -> Result<Cells<'a>, Fault> {
        let (dialect, kept) = (self.plan.dialect, self.plan.kept.as_deref());
        self.row.clear();
        let first = dialect.words(line).next().and_then(|word| dialect.number(word));
        let mut cells = Cells { count: 0, first, bad: None, is_incomplete: false };
        for word in dialect.words(line) {
            let is_kept = kept.is_none_or(|kept| kept.get(cells.count).copied().unwrap_or(true));
            cells.count += 1;
            if cells.count > MAX_COLUMNS {
                return Err(Problem::new(format!("more than {MAX_COLUMNS} columns")).at(at).into());
            }
            match dialect.number(word) {
                _ if !is_kept => {}
                Some(value) => self.row.push(value),
                None if is_missing(word) => cells.is_incomplete = true,
                None => {
                    cells.bad = Some(word);
                    break;
                }
            }
        }
        Ok(cells)
    }

    /// Handles a line that contains a word instead of a number. Before the points, the line must name the columns,
    /// unless the user did; later it is an error.
    fn words(&mut self, line: &[u8], word: &[u8], at: Location) -> Result<(), Fault> {
        if self.table.rows > 0 {
            let problem = Problem::new(format!("found {}", quote(word))).at(at).expected("a number");
            let help = "if the whole column holds words, leave it out by _, as in `columns=x,y,z,_`";
            return Err(problem.help(help).into());
        }
        self.lines_before += 1;
        if self.named {
            return Ok(());
        }
        self.header = Some(names(line, self.plan.dialect).ok_or_else(|| {
            let found = format!("found {} where points were expected", quote(word));
            let is_grid = word.eq_ignore_ascii_case(b"ncols") && self.table.rows == 0;
            let help = if is_grid { "gdal2xyz.py writes the points of an Esri ASCII grid" } else { NAME_THEM };
            Problem::new(found).at(at).expected(EXPECTED).help(help)
        })?);
        Ok(())
    }

    /// Determines the names of the table's columns: those of the user, those of the file's header, or those of the
    /// format.
    fn name_columns(&mut self, named: Option<&TableColumns>, context: &mut Context<'_>) {
        let (plan, table, cells) = (&self.plan, &mut self.table, self.cells);
        table.numbers = plan.numbers(cells);
        if let Some(columns) = named {
            table.names = Some(
                columns
                    .columns()
                    .iter()
                    .filter_map(|column| column.name.as_deref().map(raw_rows::canonical_name))
                    .collect(),
            );
            return;
        }
        let header = self.header.take();
        let has_word_per_column = |text: &String| {
            [plan.dialect.words(text.as_bytes()).count(), text.split_whitespace().count()].contains(&cells)
        };
        let last_comment = std::mem::take(&mut self.last_comment);
        table.comment = Some(last_comment).filter(|text| header.is_none() && has_word_per_column(text));
        plan.notes(header.as_deref().filter(|names| names.len() == cells)).into_iter().for_each(|n| context.note(n));
        table.names = header.map(|names| chosen(names, plan.kept.as_deref()));
        if self.pts && self.ends_in_bytes && table.names.is_none() {
            table.names = Some(PTS_COLUMNS.map(str::to_owned).to_vec());
        }
    }

    /// Adds notes on how lines were interpreted, on skipped lines, and on a wrong number of points in the file.
    fn note(&self, context: &mut Context<'_>) {
        if self.plan.dialect.has_decimal_commas {
            context.note("took commas as decimal points: blanks or semicolons divide the columns".into());
        }
        if self.named && self.lines_before > 1 {
            context.note(format!("left out {} before the points", counted(self.lines_before, "lines")));
        }
        let SkippedLines { count, first } = self.incomplete;
        if count > 0 {
            let rows = counted(count, "rows");
            context.note(format!("left out {rows} with an empty cell, the first in line {first}"));
        }
        let SkippedLines { count, first } = self.others;
        if let Some(word) = self.plan.point_word.filter(|_| count > 0) {
            let (lines, word) = (counted(count, "lines"), quote(word));
            context.note(format!("left out {lines} that don't begin with {word}, the first in line {first}"));
        }
        let (stated, found) = (self.stated_points, self.table.rows);
        if stated > 0 && stated != found as u64 {
            context.note(format!("the file says that it has {}, and has {found}", counted(stated, "points")));
        }
    }
}

/// Returns the names of the columns that are read. `kept` states which columns of the file these are; it is ignored if
/// it doesn't have one entry per name.
fn chosen(names: Vec<String>, kept: Option<&[bool]>) -> Vec<String> {
    match kept.filter(|kept| kept.len() == names.len()) {
        Some(kept) => names.into_iter().zip(kept).filter(|(_, kept)| **kept).map(|(name, _)| name).collect(),
        None => names,
    }
}

/// True if `head`, the start of a file, begins like a PTX file: two lines of one number, four of three numbers, and
/// four of four.
pub(crate) fn looks_like_ptx(head: &[u8]) -> bool {
    let mut lines = Lines::new(head);
    [1, 1, 3, 3, 3, 3, 4, 4, 4, 4].into_iter().all(|n| {
        lines.next().is_some_and(|(_, line)| {
            let words = POINTS.words(line);
            words.map(number).try_fold(0, |n, v| Some(n + usize::from(v?.is_finite()))) == Some(n)
        })
    })
}

/// Reads the scans of a PTX file. Each scan has rows and columns of points, and a pose of its scanner, which is applied
/// to its points.
pub(crate) fn read_ptx(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let (mut data, mut rows) = (Vec::new(), RowNumbers::default());
    let table = unpack_ptx(Bytes::Memory(bytes), &mut data, Some(&mut rows), context)?;
    let (columns, roles) = table.columns(Bytes::Memory(&data), context)?;
    let mut content = point_columns::build(columns, &roles, Source::Text, Vec::new(), context)?;
    rows.give(&mut content);
    Ok(content)
}

/// Header lines of a scan in a PTX file, which precede its points: how many numbers each line has, and a description of
/// them for messages. The lines of the pose aren't used, because the matrix includes it.
const SCAN_LINES: [(usize, &str); 10] = {
    let (count, pose, matrix) =
        ((1, "the scan's columns and rows"), (3, "the scanner's pose"), (4, "the scan's matrix"));
    [count, count, pose, pose, pose, pose, matrix, matrix, matrix, matrix]
};

/// Parses a PTX file, and writes the values of its points to `data` as rows of `f64`. Drops points at exactly 0, 0, 0
/// with a note. Records in `kept` the row numbers of these points in the file.
pub(crate) fn unpack_ptx(
    bytes: Bytes<'_>,
    data: &mut dyn Write,
    mut kept: Option<&mut RowNumbers>,
    context: &mut Context<'_>,
) -> Result<Table, Fault> {
    let mut table = Table::default();
    let (mut scans, mut no_return) = (0_u32, 0_u64);
    // Number of header lines read of the current scan, its numbers of columns and rows, its matrix, and the number of
    // its points left to read.
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
        for word in POINTS.words(line).take(8) {
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
                // The matrix includes the scanner's position and axes.
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
                // Points are row vectors, multiplied by the matrix from the right.
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
    let names = PTS_COLUMNS.iter().take(table.width - 1);
    table.hidden = usize::from(scans == 1);
    table.names = Some(names.copied().chain((scans > 1).then_some("scan")).map(str::to_owned).collect());
    Ok(table)
}
