//! Readers of points as columns of printed numbers: XYZ, TXT, CSV, ASC and PTS; and PTX, whose scans have poses.

use crate::ascii::{Lines, each_line, number};
use crate::bytes::Bytes;
use crate::column_roles;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, list, quote, unwritable};
use crate::point_columns::{self, Named, Roles, Source};
use crate::raw_rows;
use crate::rows::KeptRows;
use crate::strided::{NumberType, Strided};
use crate::text_rows::{MAX_COLUMNS, POINTS, Plan, is_comment, is_missing, names};
use crate::words::counted;
use std::io::Write;
use surfel_model::TableColumns;

/// Description of rows of equal width, stored as 8-byte `f64` numbers, and metadata of the text.
#[derive(Default)]
pub(crate) struct Table {
    width: usize,
    /// Number of values at the end of a row that aren't a column.
    hidden: usize,
    rows: usize,
    names: Option<Vec<String>>,
    /// Last comment before the points, if it has as many words as a row has columns, but doesn't name a position.
    comment: Option<String>,
    /// Numbers of the columns in the file, from 1.
    numbers: Vec<usize>,
    comments: Vec<String>,
}

impl Table {
    /// Creates a table without rows, with named columns.
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

    /// Returns the columns of the rows in `data`, without names.
    fn unnamed<'a>(&self, data: Bytes<'a>) -> Vec<Named<'a>> {
        let (stride, rows) = (8 * self.width, self.rows);
        let column = |i: usize| Strided::new(data, 8 * i, stride, rows, NumberType::F64, false);
        let named = |i: usize| Some(Named { name: String::new(), values: column(i)? });
        (0..self.width - self.hidden).filter_map(named).collect()
    }

    /// Returns the columns of the rows in `data`, and their roles.
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

    /// Returns the column names that the file states, and the roles by name; `None` if they don't match the columns.
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

/// Columns of a complete PTS file.
const PTS_COLUMNS: [&str; 7] = ["x", "y", "z", "intensity", "red", "green", "blue"];
/// Expected columns, for messages about text files.
const EXPECTED: &str = "x y z [intensity] [r g b] [nx ny nz], as numbers";
/// Help text for a table whose columns Surfel doesn't recognise.
const NAME_THEM: &str = "`columns=x,y,z,_,r,g,b` names the columns; _ leaves one out";

/// Writes the numbers of all points to `data`.
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
    let (dialect, kept) = (plan.dialect, plan.kept.as_deref());
    let (mut said, mut before) = (0_u64, 0_u64);
    let (mut incomplete, mut first_incomplete) = (0_usize, 0);
    let (mut others, mut first_other) = (0_u64, 0);
    let mut table = Table::default();
    // Number of cells in a row, the same in all rows; only some are read.
    let mut cells = kept.map_or(0, <[bool]>::len);
    let mut header: Option<Vec<String>> = None;
    let mut last_comment = String::new();
    let mut row: Vec<f64> = Vec::with_capacity(MAX_COLUMNS);
    // True while the last three of seven columns are bytes, as the colours of a PTS file are.
    let mut ends_in_bytes = true;
    each_line(bytes, |line_number, line| {
        if is_comment(line) {
            if table.rows == 0 && table.comments.len() < 1000 {
                let text = String::from_utf8_lossy(line.trim_ascii());
                let text = text.trim_start_matches(['#', '/']).trim();
                // The last comment before the points that contains column names.
                header = names(text.as_bytes(), dialect).or(header.take());
                if !text.is_empty() {
                    text.clone_into(&mut last_comment);
                    table.comments.push(text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect());
                }
            }
            return Ok(());
        }
        if plan.is_other_record(line) {
            first_other = if others == 0 { line_number } else { first_other };
            others += 1;
            return Ok(());
        }
        let at = Location::Line(line_number);
        row.clear();
        let (mut count, mut bad, mut is_incomplete) = (0, None, false);
        let first = dialect.words(line).next().and_then(|word| dialect.number(word));
        for word in dialect.words(line) {
            let is_kept = kept.is_none_or(|kept| kept.get(count).copied().unwrap_or(true));
            count += 1;
            if count > MAX_COLUMNS {
                return Err(Problem::new(format!("more than {MAX_COLUMNS} columns")).at(at).into());
            }
            match dialect.number(word) {
                _ if !is_kept => {}
                Some(value) => row.push(value),
                None if is_missing(word) => is_incomplete = true,
                None => {
                    bad = Some(word);
                    break;
                }
            }
        }
        if let Some(word) = bad {
            if table.rows > 0 {
                let problem = Problem::new(format!("found {}", quote(word))).at(at).expected("a number");
                let help = "if the whole column holds words, leave it out by _, as in `columns=x,y,z,_`";
                return Err(problem.help(help).into());
            }
            before += 1;
            if named.is_some() {
                return Ok(());
            }
            header = Some(names(line, dialect).ok_or_else(|| {
                let found = format!("found {} where points were expected", quote(word));
                let is_grid = word.eq_ignore_ascii_case(b"ncols") && table.rows == 0;
                let help = if is_grid { "gdal2xyz.py writes the points of an Esri ASCII grid" } else { NAME_THEM };
                Problem::new(found).at(at).expected(EXPECTED).help(help)
            })?);
            return Ok(());
        }
        // A PTS file states the number of points before each scan.
        if let Some(points) = first.filter(|_| count == 1 && (pts || table.rows == 0)) {
            said = said.saturating_add(points.max(0.0) as u64);
            return Ok(());
        }
        if is_incomplete && count == cells || count < cells && dialect.has_empty_cell(line) {
            first_incomplete = if incomplete == 0 { line_number } else { first_incomplete };
            incomplete += 1;
            return Ok(());
        }
        if cells == 0 {
            cells = count;
        }
        if count != cells && named.is_some() && table.rows == 0 {
            before += 1;
            return Ok(());
        }
        if table.width == 0 {
            table.width = row.len();
            if table.width < 3 {
                let problem = Problem::new(format!("found {} numbers", table.width)).at(at);
                return Err(problem.expected("at least x y z").into());
            }
        }
        if count != cells || row.len() != table.width {
            let mut problem = Problem::new(format!("found {count} numbers")).at(at);
            if !dialect.has_decimal_commas && line.contains(&b',') {
                problem =
                    problem.help("if its commas are decimal points, write points instead: they also divide columns");
            }
            return Err(problem.expected(format!("{cells}, as in the lines before")).into());
        }
        let is_byte = |level: &f64| (0.0..=255.0).contains(level) && level.fract() == 0.0;
        ends_in_bytes &= row.len() == PTS_COLUMNS.len() && row[4..].iter().all(is_byte);
        table.push(&row, data)
    })?;
    if table.rows == 0 {
        return Err(Problem::new("holds no point").expected("lines of x y z [intensity] [r g b] [nx ny nz]").into());
    }
    table.numbers = plan.numbers(cells);
    if let Some(columns) = &named {
        table.names = Some(
            columns.columns().iter().filter_map(|column| column.name.as_deref().map(raw_rows::usual_name)).collect(),
        );
    } else {
        let has_word_per_column =
            |text: &String| [dialect.words(text.as_bytes()).count(), text.split_whitespace().count()].contains(&cells);
        table.comment = Some(last_comment).filter(|text| header.is_none() && has_word_per_column(text));
        plan.notes(header.as_deref().filter(|names| names.len() == cells)).into_iter().for_each(|n| context.note(n));
        table.names = header.map(|names| chosen(names, kept));
        if pts && ends_in_bytes && table.names.is_none() {
            table.names = Some(PTS_COLUMNS.map(str::to_owned).to_vec());
        }
    }
    if dialect.has_decimal_commas {
        context.note("took commas as decimal points: blanks or semicolons divide the columns".into());
    }
    if named.is_some() && before > 1 {
        context.note(format!("left out {} before the points", counted(before, "lines")));
    }
    if incomplete > 0 {
        let rows = counted(incomplete as u64, "rows");
        context.note(format!("left out {rows} with an empty cell, the first in line {first_incomplete}"));
    }
    if let Some(word) = plan.point_word.filter(|_| others > 0) {
        let (lines, word) = (counted(others, "lines"), quote(word));
        context.note(format!("left out {lines} that don't begin with {word}, the first in line {first_other}"));
    }
    if said > 0 && said != table.rows as u64 {
        context.note(format!("the file says that it has {}, and has {}", counted(said, "points"), table.rows));
    }
    Ok(table)
}

/// Returns the names of the columns that are read, if each column has a name.
fn chosen(names: Vec<String>, kept: Option<&[bool]>) -> Vec<String> {
    match kept.filter(|kept| kept.len() == names.len()) {
        Some(kept) => names.into_iter().zip(kept).filter(|(_, kept)| **kept).map(|(name, _)| name).collect(),
        None => names,
    }
}

/// True if `head`, the start of a file, is that of a PTX file: two counts, four lines of three numbers, four of four.
pub(crate) fn looks_like_ptx(head: &[u8]) -> bool {
    let mut lines = Lines::new(head);
    [1, 1, 3, 3, 3, 3, 4, 4, 4, 4].into_iter().all(|n| {
        lines.next().is_some_and(|(_, line)| {
            let words = POINTS.words(line);
            words.map(number).try_fold(0, |n, v| Some(n + usize::from(v?.is_finite()))) == Some(n)
        })
    })
}

/// Reads scans; each has rows and columns, and the pose of its scanner, which is applied to its points.
pub(crate) fn read_ptx(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let (mut data, mut rows) = (Vec::new(), KeptRows::default());
    let table = unpack_ptx(Bytes::Memory(bytes), &mut data, Some(&mut rows), context)?;
    let (columns, roles) = table.columns(Bytes::Memory(&data), context)?;
    let mut content = point_columns::build(columns, &roles, Source::Text, Vec::new(), context)?;
    rows.give(&mut content);
    Ok(content)
}

/// Lines of a scan before its points: two counts, the scanner's pose, and the matrix, which includes the pose.
const SCAN_LINES: [(usize, &str); 10] = {
    let (count, pose, matrix) =
        ((1, "the scan's columns and rows"), (3, "the scanner's pose"), (4, "the scan's matrix"));
    [count, count, pose, pose, pose, pose, matrix, matrix, matrix, matrix]
};

/// Writes the numbers of all points of a PTX file to `data`, and records in `kept` which points of the file these are.
pub(crate) fn unpack_ptx(
    bytes: Bytes<'_>,
    data: &mut dyn Write,
    mut kept: Option<&mut KeptRows>,
    context: &mut Context<'_>,
) -> Result<Table, Fault> {
    let mut table = Table::default();
    let (mut scans, mut no_return) = (0_u32, 0_u64);
    // Number of header lines of the current scan, and number of points left.
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
