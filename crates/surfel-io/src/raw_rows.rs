//! Reader of binary files without a header: rows of numbers whose types and names `--columns` states.

#![cfg_attr(not(all(feature = "npy", feature = "points")), allow(dead_code))]

use crate::bytes::Bytes;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem, list};
use crate::format::{Format, is_binary};
use crate::point_columns::{self, Named, Roles, Source};
use crate::strided::{NumberType, Strided};
use crate::words::counted;
use std::path::Path;
use surfel_model::{NumberFormat, TableColumns};

/// Maximum number of rows, spread over the file, whose coordinates are checked for plausibility.
const MAX_CHECKED_ROWS: usize = 1000;
/// Range of the absolute values of plausible coordinates; 0 is plausible, too. If numbers are read as a wrong type,
/// some are usually outside.
const COORDINATES: std::ops::RangeInclusive<f64> = 1e-30..=1e15;

/// Usual layouts of rows in `.bin` files without a header, as `--columns` states them: KITTI and many others; nuScenes;
/// indoor data sets.
const COMMON_LAYOUTS: [&str; 3] = ["f4:x,y,z,intensity", "f4:x,y,z,intensity,_", "f4:x,y,z,r,g,b"];
/// Smallest number of rows from which a layout is detected. Fewer rows may fit a wrong layout by chance.
const MIN_ROWS: usize = 100;
/// Maximum number of rows that are examined to detect a layout.
const EXAMINED_ROWS: usize = 1 << 16;
/// Range of the absolute values of plausible coordinates of a scan, in metres; 0 is plausible, too.
const SCANNED: std::ops::RangeInclusive<f32> = 1e-7..=1e4;
/// Largest value that is plausible as an intensity or a colour when a layout is detected.
const MAX_INTENSITY: f32 = 255.0;

/// Returns the layout of a `.bin` file without a header if its values fit exactly one usual layout.
pub(crate) fn detected(name: &Path, bytes: &[u8]) -> Option<TableColumns> {
    if !name.extension().is_some_and(|end| end.eq_ignore_ascii_case("bin")) {
        return None;
    }
    let mut fitting = COMMON_LAYOUTS.iter().filter_map(|text| {
        let columns: TableColumns = text.parse().ok()?;
        fits(bytes, &columns).then_some(columns)
    });
    let found = fitting.next();
    found.filter(|_| fitting.next().is_none())
}

/// True if a file consists of at least [`MIN_ROWS`] whole rows with this layout, of which the first [`EXAMINED_ROWS`]
/// are plausible. Then coordinates are 0 or in [`SCANNED`], none is 0 in all rows, and the values of other named
/// columns are from 0 to [`MAX_INTENSITY`].
fn fits(bytes: &[u8], columns: &TableColumns) -> bool {
    let row_bytes = columns.row_bytes();
    if !bytes.len().is_multiple_of(row_bytes) || bytes.len() / row_bytes < MIN_ROWS {
        return false;
    }
    let is_named: Vec<bool> = columns.columns().iter().map(|column| column.name.is_some()).collect();
    let mut largest = [0.0_f32; 3];
    let is_plausible = bytes.chunks_exact(row_bytes).take(EXAMINED_ROWS).all(|row| {
        let numbers = row.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]));
        numbers.zip(&is_named).enumerate().all(|(i, (number, is_named))| match largest.get_mut(i) {
            Some(largest) => {
                *largest = largest.max(number.abs());
                number == 0.0 || SCANNED.contains(&number.abs())
            }
            None => !is_named || (0.0..=MAX_INTENSITY).contains(&number),
        })
    });
    // A column of zeros is no coordinate.
    is_plausible && largest.iter().all(|largest| *largest > 0.0)
}

/// Checks that columns include a position.
///
/// # Errors
/// A message that states what was expected, as a sentence without a subject.
pub fn check_columns(columns: &TableColumns) -> Result<(), String> {
    check(columns).map_err(|problem| problem.to_string().replace('\n', ","))
}

/// Checks that columns include a position, like [`check_columns`], but returns a [`Problem`], which a reader can
/// report.
pub(crate) fn check(columns: &TableColumns) -> Result<(), Problem> {
    let names: Vec<&str> = columns.columns().iter().filter_map(|column| column.name.as_deref()).collect();
    let problem = || Problem::new(format!("has no position among the columns {}", list(&names))).expected("x, y and z");
    Roles::by_name(names.iter().copied()).map(|_| ()).ok_or_else(problem)
}

/// Returns the problem of a table with `found` columns, where `--columns` states another number.
pub(crate) fn wrong_count(found: usize, columns: &TableColumns) -> Problem {
    let expected = format!("{found}, as its rows have; _ leaves a column out");
    let named = counted(columns.columns().len() as u64, "columns");
    Problem::new(format!("has {} and `columns` names {named}", counted(found as u64, "columns"))).expected(expected)
}

/// True if `--columns` states types, the start of the file is binary, and the file's name isn't that of another format
/// than XYZ or PTS.
pub(crate) fn is_raw(name: &Path, head: &[u8], columns: Option<&TableColumns>) -> bool {
    let hint = Format::from_extension(name);
    columns.is_some_and(TableColumns::is_typed)
        && matches!(hint, None | Some(Format::Xyz | Format::Pts))
        && is_binary(head)
}

/// Returns the name by which readers look up a column: "intensity" for "i" or "I", and all other names unchanged.
pub(crate) fn canonical_name(name: &str) -> String {
    if name.eq_ignore_ascii_case("i") { "intensity".to_owned() } else { name.to_owned() }
}

fn number_type(format: NumberFormat) -> NumberType {
    match (format.letter, format.bytes) {
        ('f', 2) => NumberType::F16,
        ('f', 4) => NumberType::F32,
        ('i', 1) => NumberType::I8,
        ('i', 2) => NumberType::I16,
        ('i', 4) => NumberType::I32,
        ('i', 8) => NumberType::I64,
        ('u', 1) => NumberType::U8,
        ('u', 2) => NumberType::U16,
        ('u', 4) => NumberType::U32,
        ('u', 8) => NumberType::U64,
        _ => NumberType::F64,
    }
}

/// Returns the columns of a file whose layout is `columns`, and their roles.
pub(crate) fn columns_in<'a>(bytes: Bytes<'a>, columns: &TableColumns) -> Result<(Vec<Named<'a>>, Roles), Fault> {
    check(columns)?;
    let row_bytes = columns.row_bytes();
    if row_bytes == 0 || bytes.len() == 0 || !bytes.len().is_multiple_of(row_bytes) {
        let found = format!("has {}, which are no whole rows of {row_bytes}", counted(bytes.len() as u64, "bytes"));
        let expected = format!("the {row_bytes} bytes of {columns} in each row");
        let help = "name all columns of a row by `columns`: _ leaves one out";
        return Err(Problem::new(found).expected(expected).help(help).into());
    }
    let rows = bytes.len() / row_bytes;
    let (mut named, mut at) = (Vec::new(), 0);
    for column in columns.columns() {
        let Some(format) = column.format else { continue };
        if let Some(name) = &column.name {
            let values = Strided::new(bytes, at, row_bytes, rows, number_type(format), format.big_endian);
            let values = values.ok_or_else(|| Problem::new("the rows lie outside of the file"))?;
            named.push(Named { name: canonical_name(name), values });
        }
        at += usize::from(format.bytes);
    }
    let roles = Roles::by_name(named.iter().map(|c| c.name.as_str()))
        .ok_or_else(|| Problem::new("has columns without a position").expected("x, y and z"))?;
    check_coordinates(roles.position.map(|i| &named[i]), columns)?;
    Ok((named, roles))
}

/// Checks the coordinates of up to [`MAX_CHECKED_ROWS`] rows, spread over the file. Returns an error if more than 5 %
/// of these rows have an implausible coordinate: the types are wrong, or columns are missing.
fn check_coordinates(position: [&Named<'_>; 3], columns: &TableColumns) -> Result<(), Problem> {
    let rows = position[0].values.len();
    let (mut wrong, mut seen, mut first) = (0, 0, None);
    for row in (0..rows).step_by(rows.div_ceil(MAX_CHECKED_ROWS).max(1)) {
        let is_odd = |v: f64| v != 0.0 && !COORDINATES.contains(&v.abs());
        let odd = position.iter().find(|c| is_odd(c.values.at(row)));
        seen += 1;
        wrong += usize::from(odd.is_some());
        first = first.or(odd.map(|c| (row, c.values.at(row), c.name.as_str())));
    }
    let Some((row, value, name)) = first.filter(|_| wrong * 20 > seen) else { return Ok(()) };
    let problem = Problem::new(format!("its rows don't hold {columns}: {name} of row {} is {value:e}", row + 1));
    Err(problem.expected("coordinates").help("check the types, and that `columns` names all columns of a row"))
}

/// Reads a binary file without a header.
pub(crate) fn read(bytes: Bytes<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let Some(columns) = context.options.columns.clone() else {
        return Err(Problem::new("has no header").help(RAW_HELP).into());
    };
    let (named, roles) = columns_in(bytes, &columns)?;
    point_columns::build(named, &roles, Source::Typed, Vec::new(), context)
}

/// Advice to the user for a binary file without a header.
pub(crate) const RAW_HELP: &str =
    "`columns=f4:x,y,z,intensity` reads numbers without a header, here float32 as in KITTI's files";
