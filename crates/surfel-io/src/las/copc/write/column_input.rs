//! Conversion of point files in columns (PLY, PCD, NPY, NPZ, E57, PTX, COLMAP points, text, and rows without a header)
//! to LAS records.
//!
//! Coordinates become whole numbers of steps from an offset. The step is a power of two and, like the offset, the same
//! for all inputs. The step is the coarsest one that loses nothing. Where coordinates have finer digits, the step is
//! the finest one that reaches the farthest point in 2³⁰ steps. f32 coordinates therefore keep every bit unless they
//! are less than 1/64 of the farthest coordinate. Other coordinates move by at most half a step, 2⁻³⁰ of the farthest.

use super::extra_bytes::description;
use super::inputs::{Stop, invalid};
use super::standard_fields::StandardField;
use super::value_range::ValueRange;
use crate::color::nearest_16_bit;
use crate::column_file::ColumnFile;
use crate::column_roles::ROUNDED_ONE;
use crate::columns::{f32_is_enough, rounding_note};
use crate::crs::Crs;
use crate::error::{IoError, Problem, quote};
use crate::format::Format;
use crate::las::Sink;
use crate::las::copc::output::Record;
use crate::las::copc::{LEVEL_COLORS, LEVEL_NORMALS, NORMALS, RADIUS};
use crate::las::header::{ExtraField, Header, POINT_BYTES, RENAMED};
use crate::ply::colors::{ColorScale, ColorType};
use crate::strided::{NumberType, Strided, block_rows, read_rows};
use crate::words::counted;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use surfel_model::TableColumns;

/// Maximum number of steps between the offset and the farthest point, as a power of two.
const STEP_BITS: i32 = 30;

/// Statistics of all points of a file, which decide the record layout and the coordinate steps.
#[derive(Clone, Debug)]
struct Measured {
    /// Number of points with finite coordinates.
    count: u64,
    /// Ranges of x, y and z over the points with finite coordinates.
    position: [ValueRange; 3],
    /// Exponent of the last significant bit of all coordinates, as [`last_bit`] returns it; `i32::MAX` if all are 0.
    finest: i32,
    /// Range of each column over all points.
    columns: Vec<ValueRange>,
}

impl Measured {
    fn none(columns: usize) -> Self {
        let none = ValueRange::none();
        Self { count: 0, position: [none; 3], finest: i32::MAX, columns: vec![none; columns] }
    }

    /// Returns the minimum and the maximum corner of the points' bounds.
    fn ends(&self) -> [DVec3; 2] {
        [0, 1].map(|end| DVec3::from(self.position.map(|r| if end == 0 { r.min } else { r.max })))
    }

    fn join(mut self, other: &Self) -> Self {
        self.count = self.count.saturating_add(other.count);
        self.finest = self.finest.min(other.finest);
        self.position.iter_mut().zip(&other.position).for_each(|(a, b)| a.join(b));
        self.columns.iter_mut().zip(&other.columns).for_each(|(a, b)| a.join(b));
        self
    }
}

/// Returns the exponent of a number's last significant bit; `i32::MAX` for zero.
fn last_bit(value: f64) -> i32 {
    let bits = value.to_bits();
    let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, bits & ((1 << 52) - 1));
    match (exponent, fraction) {
        (0, 0) => i32::MAX,
        (0, _) => fraction.trailing_zeros() as i32 - 1074,
        _ => (fraction | 1 << 52).trailing_zeros() as i32 + exponent - 1075,
    }
}

/// Returns the exponent of a power of two greater than `value`; −1021, that of the smallest normal number, for zero.
fn power_above(value: f64) -> i32 {
    ((value.to_bits() >> 52 & 0x7ff) as i32 - 1022).max(-1021)
}

/// An extra-bytes field: the source column, the byte offset in a record, and the type number of the LAS standard.
#[derive(Clone, Debug)]
struct Extra {
    column: usize,
    at: usize,
    kind: u8,
}

/// Standard field of a record, and the column that fills it.
#[derive(Clone, Copy, Debug)]
struct Filled {
    column: usize,
    field: StandardField,
}

/// Encoding of a file's colours, with the indices of the colour columns.
#[derive(Clone, Copy, Debug)]
enum Colors {
    /// sRGB levels from 0 to this maximum.
    Levels([usize; 3], f64),
    /// Linear light.
    Linear([usize; 3]),
    /// Three 8-bit channels packed into a 32-bit number.
    Packed(usize),
}

/// A point file in columns that is read as if it were a LAS file.
#[derive(Clone, Debug)]
pub(super) struct ColumnInput {
    file: Arc<ColumnFile>,
    measured: Measured,
    colors: Option<Colors>,
    /// Note about the assumed range of colour values.
    color_note: Option<String>,
    /// Note that coordinates were rounded before conversion, if they are 32-bit floats far from the origin.
    rounding_note: Option<String>,
    /// Standard fields of a record, such as the classification, that columns of the same name fill.
    filled: Vec<Filled>,
    /// Notes about columns that are named like a standard field that can't store their values.
    renaming_notes: Vec<String>,
    extra: Vec<Extra>,
    names: Vec<String>,
    scale: f64,
    offset: DVec3,
    /// True if coordinates are rounded to f32, as they are where the whole file is read at once.
    rounds: bool,
}

impl ColumnInput {
    /// Opens a point file in columns and measures its values; returns `None` for other files. Text and compressed data
    /// are unpacked to a temporary file in `folder`.
    pub(super) fn open(
        path: &Path,
        folder: &Path,
        columns: Option<&TableColumns>,
        progress: &dyn Fn(&'static str, u64, u64),
    ) -> Result<Option<Self>, IoError> {
        let Some(file) = ColumnFile::open(path, folder, columns)? else { return Ok(None) };
        let measured = file.with(path, |columns| measure(&file, columns, progress))?;
        let (extra, names) = (Vec::new(), Vec::new());
        let (scale, offset, rounds) = (1.0, DVec3::ZERO, false);
        let file = Arc::new(file);
        Ok(Some(Self {
            file,
            measured,
            colors: None,
            color_note: None,
            rounding_note: None,
            filled: Vec::new(),
            renaming_notes: Vec::new(),
            extra,
            names,
            scale,
            offset,
            rounds,
        }))
    }

    /// Assigns the same coordinate steps, and the same layout for columns of equal name, to inputs that are written as
    /// one file.
    pub(super) fn agree(inputs: &mut [&mut Self]) {
        let mut all = Measured::none(0);
        // Value ranges by column name, wherever in its file the column is.
        let mut by_name: BTreeMap<String, ValueRange> = BTreeMap::new();
        for input in inputs.iter() {
            all = all.join(&input.measured);
            for (name, range) in input.file.names.iter().zip(&input.measured.columns) {
                by_name.entry(name.clone()).and_modify(|known| known.join(range)).or_insert(*range);
            }
        }
        let (scale, offset) = steps(&all);
        let [low, high] = all.ends();
        for input in inputs {
            let are_rounded = input.file.roles.position.iter().all(|i| input.file.places[*i].kind == NumberType::F32);
            let [low_of, high_of] = input.measured.ends();
            input.rounding_note = if are_rounded { rounding_note(low_of, high_of) } else { None };
            (input.scale, input.offset) = (scale, offset);
            input.rounds = !input.file.is_typed() && f32_is_enough(low, high);
            let ranges: Vec<ValueRange> = input.file.names.iter().map(|name| by_name[name]).collect();
            input.lay_out(&ranges);
        }
    }

    /// Assigns columns to the fields of a record by the value ranges over all inputs.
    fn lay_out(&mut self, ranges: &[ValueRange]) {
        let file = self.file.clone();
        let (roles, kind) = (&file.roles, |i: usize| file.places[i].kind);
        let largest = |set: [usize; 3]| set.iter().fold(0.0, |most: f64, i| most.max(ranges[*i].max));
        let whole = |set: [usize; 3]| set.iter().all(|i| ranges[*i].whole);
        let kinds = |set: [usize; 3]| ColorType::of(set.map(kind));
        (self.colors, self.color_note) = (None, None);
        if let Some(set) = roles.color {
            let (color_type, most) = (kinds(set), largest(set));
            let scale = match () {
                // E57 colours are already scaled to 16 bits by the limits that the file states.
                () if file.format == Format::E57 && color_type == ColorType::Short => ColorScale::Encoded(65_535.0),
                () if file.is_typed() => ColorScale::of(color_type, most, whole(set), file.float_colors),
                () if color_type == ColorType::Byte => ColorScale::Encoded(255.0),
                () if most <= ROUNDED_ONE && color_type == ColorType::Float => ColorScale::Encoded(1.0),
                () => ColorScale::Encoded(if most <= 255.0 { 255.0 } else { 65_535.0 }),
            };
            self.color_note = if file.format == Format::Ply { scale.note(color_type, most) } else { None };
            self.colors = Some(match scale {
                ColorScale::Linear => Colors::Linear(set),
                ColorScale::Encoded(most) => Colors::Levels(set, most),
            });
        }
        let packed = roles.packed_color.map(|(i, _)| i);
        self.colors = self.colors.or(packed.map(Colors::Packed));
        let used = |i: usize| {
            let is_in = |set: Option<[usize; 3]>| set.is_some_and(|set| set.contains(&i));
            roles.position.contains(&i) || is_in(roles.color) || is_in(roles.normal) || packed == Some(i)
        };
        self.filled = fillings(&file.names, ranges, used);
        self.renaming_notes.clear();
        let mut at = POINT_BYTES[usize::from(self.format())];
        let (mut extra, mut names) = (Vec::new(), Vec::new());
        let mut add = |column: usize, name: String, kind: u8| {
            extra.push(Extra { column, at, kind });
            names.push(name);
            at += ExtraField::bytes(kind);
        };
        for (column, name) in roles.normal.into_iter().flatten().zip(NORMALS) {
            add(column, name.to_owned(), 9);
        }
        let is_own = |name: &str| {
            [RADIUS].iter().chain(&NORMALS).chain(&LEVEL_COLORS).chain(&LEVEL_NORMALS).any(|own| *own == name)
        };
        for (i, name) in file.names.iter().enumerate() {
            let name: String = name.chars().filter(char::is_ascii_graphic).take(31).collect();
            if used(i) || self.filled.iter().any(|filled| filled.column == i) || is_own(&name) {
                continue;
            }
            let name = if name.is_empty() { format!("column_{}", i + 1) } else { name };
            if let Some(stored) = StandardField::renamed(&name) {
                self.renaming_notes.push(format!(
                    "its column {} doesn't fit the LAS field of that name, so other programs find it as {}",
                    quote(&name),
                    quote(&stored)
                ));
            }
            let kind = match kind(i) {
                NumberType::U8 => 1,
                NumberType::I8 => 2,
                NumberType::U16 => 3,
                NumberType::I16 => 4,
                NumberType::U32 => 5,
                NumberType::I32 => 6,
                NumberType::U64 => 7,
                NumberType::I64 => 8,
                NumberType::F16 | NumberType::F32 => 9,
                // Printed numbers become f32, as they do where the whole file is read at once.
                NumberType::F64 if file.is_text() && ranges[i].max < f64::from(1 << 24) => 9,
                NumberType::F64 => 10,
            };
            add(i, name, kind);
        }
        (self.extra, self.names) = (extra, names);
    }

    fn format(&self) -> u8 {
        if self.colors.is_some() { 7 } else { 6 }
    }

    fn record_bytes(&self) -> usize {
        let after = self.extra.last().map(|extra| extra.at + ExtraField::bytes(extra.kind));
        after.unwrap_or(POINT_BYTES[usize::from(self.format())])
    }

    /// Returns the header that an equivalent LAS file would have.
    pub(super) fn header(&self) -> Header {
        let start = POINT_BYTES[usize::from(self.format())];
        let extra = self.extra.iter().zip(&self.names);
        let extra = extra.map(|(extra, name)| ExtraField {
            name: name.clone(),
            kind: extra.kind,
            at: extra.at - start,
            scaled: None,
        });
        let left_out = self.file.rows as u64 - self.measured.count;
        let dropped = || format!("dropped {} whose coordinates are not finite", counted(left_out, "points"));
        let crs = &self.file.crs;
        let unsaid = || format!("left out its system, {}: COPC takes well-known text alone", crs.words());
        let is_unsaid = *crs != Crs::default() && self.wkt().is_none();
        let notes = self.file.notes.iter().chain(&self.color_note).chain(&self.rounding_note);
        let notes = notes.chain(&self.renaming_notes).cloned();
        Header {
            minor: 4,
            software: String::new(),
            format: self.format(),
            compressed: false,
            record_bytes: self.record_bytes(),
            start: 0,
            end: 0,
            count: self.measured.count,
            scale: DVec3::splat(self.scale),
            offset: self.offset,
            crs: Crs { wkt: self.wkt().cloned(), ..Crs::default() },
            extra: extra.collect(),
            laszip: None,
            notes: notes.chain((left_out > 0).then(dropped)).chain(is_unsaid.then(unsaid)).collect(),
            described: self.record_bytes() - POINT_BYTES[usize::from(self.format())],
            reads_withheld: false,
        }
    }

    /// Returns the first 375 bytes of a LAS header, with only the bounds filled in.
    pub(super) fn raw_header(&self) -> Vec<u8> {
        let mut raw = vec![0; 375];
        for (k, range) in self.measured.position.iter().enumerate() {
            for (at, end) in [(179, range.max), (187, range.min)] {
                raw[at + 16 * k..at + 16 * k + 8].copy_from_slice(&end.to_le_bytes());
            }
        }
        raw
    }

    /// Returns the variable length records that describe the extra bytes and the coordinate reference system.
    pub(super) fn records(&self) -> Vec<Record> {
        let described = self.extra.iter().zip(&self.names);
        let described = described.flat_map(|(extra, name)| match StandardField::renamed(name) {
            Some(stored) => description(&stored, extra.kind, RENAMED, false),
            None => description(name, extra.kind, "", false),
        });
        let described: Vec<u8> = described.collect();
        let described = (!described.is_empty()).then(|| Record::new("LASF_Spec", 4, described));
        let wkt = self.wkt().map(|wkt| Record::new("LASF_Projection", 2112, [wkt.as_bytes(), &[0]].concat()));
        described.into_iter().chain(wkt).collect()
    }

    /// Returns the WKT of the file's coordinate reference system, unless it is too long for a variable length record.
    fn wkt(&self) -> Option<&String> {
        self.file.crs.wkt.as_ref().filter(|wkt| wkt.len() < usize::from(u16::MAX))
    }

    /// Returns the position of the scanner, if one scanner recorded all points.
    pub(super) fn viewpoint(&self) -> Option<DVec3> {
        self.file.viewpoint
    }

    /// Passes the points to `sink` as LAS records.
    pub(super) fn read(&self, path: &Path, sink: &mut dyn Sink) -> Result<(), Stop> {
        let read = self.file.with(path, |columns| self.read_columns(columns, sink))?;
        read.map_err(|problem| invalid(path, problem))
    }

    fn read_columns(&self, columns: &[Strided<'_>], sink: &mut dyn Sink) -> Result<(), Problem> {
        let (rows, block) = (self.file.rows, block_rows(columns));
        let blocks: Vec<usize> = (0..rows).step_by(block).collect();
        for some in blocks.chunks(2 * rayon::current_num_threads()) {
            let made = some.par_iter().map_init(
                || (Vec::new(), vec![Vec::new(); columns.len()]),
                |(bytes, numbers), start| {
                    let end = rows.min(start + block);
                    read_rows(columns, *start..end, bytes, numbers);
                    self.block(end - start, numbers)
                },
            );
            let made: Vec<Vec<u8>> = made.collect();
            made.into_iter().try_for_each(|mut records| sink.append(&mut records))?;
        }
        Ok(())
    }

    /// Returns the records of a block of rows, without the rows whose coordinates aren't finite.
    fn block(&self, rows: usize, numbers: &[Vec<f64>]) -> Vec<u8> {
        let size = self.record_bytes();
        let mut records = Vec::with_capacity(rows * size);
        let (position, per_unit) = (self.file.roles.position, 1.0 / self.scale);
        #[allow(clippy::needless_range_loop, reason = "a row is one of each column's numbers")]
        for row in 0..rows {
            let mut at = DVec3::from(position.map(|i| numbers[i][row]));
            if self.rounds {
                at = at.as_vec3().as_dvec3();
            }
            if !at.is_finite() {
                continue;
            }
            let start = records.len();
            records.resize(start + size, 0);
            let record = &mut records[start..];
            let mut put = |at: usize, bytes: &[u8]| record[at..at + bytes.len()].copy_from_slice(bytes);
            let steps = ((at - self.offset) * per_unit).round();
            steps.to_array().iter().enumerate().for_each(|(k, v)| put(4 * k, &(*v as i32).to_le_bytes()));
            // Return 1 of 1.
            put(14, &[0x11]);
            if let Some(colors) = self.colors {
                let levels = levels(colors, |i| numbers[i][row]);
                levels.iter().enumerate().for_each(|(k, level)| put(30 + 2 * k, &level.to_le_bytes()));
            }
            for Extra { column, at, kind } in &self.extra {
                let value = numbers[*column][row];
                match kind {
                    1 => put(*at, &(value as u8).to_le_bytes()),
                    2 => put(*at, &(value as i8).to_le_bytes()),
                    3 => put(*at, &(value as u16).to_le_bytes()),
                    4 => put(*at, &(value as i16).to_le_bytes()),
                    5 => put(*at, &(value as u32).to_le_bytes()),
                    6 => put(*at, &(value as i32).to_le_bytes()),
                    7 => put(*at, &(value as u64).to_le_bytes()),
                    8 => put(*at, &(value as i64).to_le_bytes()),
                    9 => put(*at, &(value as f32).to_le_bytes()),
                    _ => put(*at, &value.to_le_bytes()),
                }
            }
            for Filled { column, field } in &self.filled {
                field.put(record, numbers[*column][row]);
            }
        }
        records
    }
}

/// Returns the columns that fill standard fields of a record, each field at most once. `used` is true for columns that
/// are stored otherwise.
fn fillings(names: &[String], ranges: &[ValueRange], used: impl Fn(usize) -> bool) -> Vec<Filled> {
    let mut filled: Vec<Filled> = Vec::new();
    for (column, (name, range)) in names.iter().zip(ranges).enumerate().filter(|(column, _)| !used(*column)) {
        if let Some(field) = StandardField::for_column(name, range)
            && filled.iter().all(|other| other.field != field)
        {
            filled.push(Filled { column, field });
        }
    }
    // A return number says nothing without the number of returns.
    if filled.iter().filter(|filled| filled.field.is_of_returns()).count() == 1 {
        filled.retain(|filled| !filled.field.is_of_returns());
    }
    filled
}

/// Returns a row's colours as sRGB-encoded 16-bit levels (0–65535).
fn levels(colors: Colors, number: impl Fn(usize) -> f64) -> [u16; 3] {
    match colors {
        Colors::Levels(set, most) => set.map(|i| (number(i) / most * 65_535.0 + 0.5).clamp(0.0, 65_535.0) as u16),
        Colors::Linear(set) => set.map(|i| nearest_16_bit(number(i) as f32)),
        Colors::Packed(i) => [16, 8, 0].map(|shift| (number(i) as u32 >> shift & 255) as u16 * 257),
    }
}

/// Returns the coordinate step and the offset of the written records, in units of the file. The step is a power of two,
/// selected as the module's description says.
fn steps(all: &Measured) -> (f64, DVec3) {
    let [low, high] = all.ends();
    let most = low.abs().max(high.abs()).max_element();
    if all.count == 0 || most == 0.0 {
        return (1.0, DVec3::ZERO);
    }
    // The offset is a multiple of a power of two greater than the extent, so that differences from it are exact.
    let extent = power_above((high - low).max_element().max(most * 2f64.powi(-50)));
    let is_far = most * 0.25 > 2f64.powi(extent);
    let (mut offset, mut finest) = (DVec3::ZERO, all.finest);
    if is_far {
        offset = (0.5 * (low + high) / 2f64.powi(extent)).round() * 2f64.powi(extent);
        finest = finest.min(extent);
    }
    let farthest = power_above((low - offset).abs().max((high - offset).abs()).max_element());
    // The limits keep the inverse and the square of the scale finite and nonzero.
    (2f64.powi((farthest - STEP_BITS).max(finest).clamp(-500, 1000)), offset)
}

fn measure(file: &ColumnFile, columns: &[Strided<'_>], progress: &dyn Fn(&'static str, u64, u64)) -> Measured {
    let (rows, block) = (file.rows, block_rows(columns));
    let blocks: Vec<usize> = (0..rows).step_by(block).collect();
    let none = Measured::none(columns.len());
    let mut all = none.clone();
    for some in blocks.chunks(64 * rayon::current_num_threads()) {
        let measured = some.par_iter().map_init(
            || (Vec::new(), vec![Vec::new(); columns.len()]),
            |(bytes, numbers), start| {
                let end = rows.min(start + block);
                read_rows(columns, *start..end, bytes, numbers);
                let mut found = none.clone();
                #[allow(clippy::needless_range_loop, reason = "a row is one of each column's numbers")]
                for row in 0..end - start {
                    let at = file.roles.position.map(|i| numbers[i][row]);
                    if at.iter().all(|v| v.is_finite()) {
                        found.count += 1;
                        found.position.iter_mut().zip(at).for_each(|(range, v)| range.add(v));
                        found.finest = at.iter().fold(found.finest, |finest, v| finest.min(last_bit(*v)));
                    }
                }
                found
                    .columns
                    .iter_mut()
                    .zip(numbers.iter())
                    .for_each(|(range, v)| v.iter().for_each(|v| range.add(*v)));
                found
            },
        );
        let measured: Vec<Measured> = measured.collect();
        all = measured.iter().fold(all, Measured::join);
        progress("measuring points", rows.min(some[some.len() - 1] + block) as u64, rows as u64);
    }
    all
}

#[cfg(test)]
mod tests;
