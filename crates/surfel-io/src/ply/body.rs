//! Reader of PLY data, text or binary: each requested property becomes a column of its own type. Counts in the file are
//! checked against the number of bytes present before memory is allocated for them.

use super::encoding::PlyEncoding;
use super::header::{ElementDef, Header, Kind, ScalarType};
use super::table::{Lists, Table};
use crate::ascii::{line_at, number, number_f32};
use crate::bytes::Bytes;
use crate::columns::Numbers;
use crate::error::{Fault, Location, Problem, quote};
use crate::strided::{NumberType, Strided};
use std::ops::Range;
use surfel_model::ExtraValues;

/// Selection of the properties of an element that are read.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum PropertySelection {
    /// No properties: the element is skipped.
    Nothing,
    /// All scalar properties.
    Scalars,
    /// All scalar properties, the integer lists of these names, and MeshLab's texture coordinates (`texcoord`).
    Lists(&'static [&'static str]),
}

/// Name of the list property in which MeshLab stores a face's texture coordinates: u and v of each corner in turn.
pub(super) const COORDINATES: &str = "texcoord";
/// Name of the property in which MeshLab stores the index of a face's texture, counted from 0.
pub(super) const TEXTURE: &str = "texnumber";
/// Reads the elements for which `want` returns properties. Returns the name and the table of each, in the order of the
/// file. Stops after the last requested element.
///
/// Binary elements without lists can be read from an open file. For text and for lists, `bytes` must be in memory.
pub(crate) fn read<'a>(
    bytes: Bytes<'a>,
    header: &Header,
    want: impl Fn(&ElementDef) -> PropertySelection,
) -> Result<Vec<(String, Table<'a>)>, Fault> {
    let memory = if let Bytes::Memory(memory) = bytes { memory } else { &[] };
    let last = header.elements.iter().rposition(|e| want(e) != PropertySelection::Nothing).map_or(0, |i| i + 1);
    let mut tables = Vec::new();
    let mut position = header.body;
    for element in &header.elements[..last] {
        let wanted = want(element);
        let mut columns: Vec<Column<'_>> =
            element.properties.iter().map(|p| Column::new(p.kind, &p.name, wanted)).collect();
        let mut cursor = Cursor { bytes: memory, length: bytes.len(), position, element, row: 0, property: 0 };
        let big_endian = header.encoding == PlyEncoding::BinaryBigEndian;
        match header.encoding {
            PlyEncoding::Ascii => read_ascii(&mut cursor, &mut columns)?,
            _ if element.is_fixed() => read_rows(&mut cursor, bytes, big_endian, &mut columns)?,
            PlyEncoding::BinaryLittleEndian => read_binary::<false>(&mut cursor, &mut columns)?,
            PlyEncoding::BinaryBigEndian => read_binary::<true>(&mut cursor, &mut columns)?,
        }
        position = cursor.position;
        if wanted == PropertySelection::Nothing {
            continue;
        }
        let mut table = Table::default();
        for (column, property) in columns.into_iter().zip(&element.properties) {
            match column {
                Column::Scalar(values) => table.scalars.push((property.name.clone(), Numbers::InMemory(values))),
                Column::Stored(column) => table.scalars.push((property.name.clone(), Numbers::Stored(column))),
                Column::List(lists) => table.lists.push((property.name.clone(), lists)),
                Column::Coordinates(lists) => table.coordinates = Some(lists),
                Column::Skip => {}
            }
        }
        tables.push((element.name.clone(), table));
    }
    Ok(tables)
}

enum Column<'a> {
    Scalar(ExtraValues),
    /// Numbers that stay in the file, and are read on demand.
    Stored(Strided<'a>),
    List(Lists<u32>),
    Coordinates(Lists<f32>),
    Skip,
}

impl Column<'_> {
    fn new(kind: Kind, name: &str, want: PropertySelection) -> Self {
        let is_wanted = want != PropertySelection::Nothing;
        match (kind, want) {
            (Kind::Scalar(t), _) if is_wanted => Self::Scalar(match t {
                ScalarType::I8 => ExtraValues::I8(Vec::new()),
                ScalarType::U8 => ExtraValues::U8(Vec::new()),
                ScalarType::I16 => ExtraValues::I16(Vec::new()),
                ScalarType::U16 => ExtraValues::U16(Vec::new()),
                ScalarType::I32 => ExtraValues::I32(Vec::new()),
                ScalarType::U32 => ExtraValues::U32(Vec::new()),
                ScalarType::F32 => ExtraValues::F32(Vec::new()),
                ScalarType::F64 => ExtraValues::F64(Vec::new()),
            }),
            (Kind::List { item, .. }, PropertySelection::Lists(names))
                if item.is_integer() && names.contains(&name) =>
            {
                Self::List(Lists::default())
            }
            (Kind::List { item, .. }, PropertySelection::Lists(_)) if !item.is_integer() && name == COORDINATES => {
                Self::Coordinates(Lists::default())
            }
            _ => Self::Skip,
        }
    }
}

macro_rules! each {
    ($column:expr, $values:ident => $body:expr) => {
        match $column {
            ExtraValues::I8($values) => $body,
            ExtraValues::U8($values) => $body,
            ExtraValues::I16($values) => $body,
            ExtraValues::U16($values) => $body,
            ExtraValues::I32($values) => $body,
            ExtraValues::U32($values) => $body,
            ExtraValues::F32($values) => $body,
            ExtraValues::F64($values) => $body,
        }
    };
}

/// Reading position in a file's data, with the element, row and property that messages name.
struct Cursor<'a> {
    /// The file's bytes if they are in memory, else empty.
    bytes: &'a [u8],
    /// Length of the file, in bytes.
    length: usize,
    position: usize,
    element: &'a ElementDef,
    row: usize,
    property: usize,
}

impl Cursor<'_> {
    fn place(&self) -> String {
        let property = self.element.properties.get(self.property).map_or("", |p| p.in_file.as_str());
        format!("property {} of element {} number {}", quote(property), quote(&self.element.in_file), self.row)
    }

    fn truncated(&self, needed: u64) -> Fault {
        let count = self.element.count;
        let what = format!(
            "the file ends at byte {}, within element {} number {} of {count}",
            self.length,
            quote(&self.element.in_file),
            self.row
        );
        let expected = format!("at least {needed} more bytes there, as the header says");
        let help = "copy or export the file again: it is incomplete, or its header counts too many";
        Problem::new(what).expected(expected).help(help).into()
    }

    fn remaining(&self) -> usize {
        self.length - self.position
    }
}

/// A Rust number type that corresponds to a scalar type of PLY.
trait Scalar: Copy {
    fn read<const BIG: bool>(bytes: &[u8]) -> Self;
    fn parse(word: &[u8]) -> Option<Self>;
}

macro_rules! scalar {
    ($($t:ty, $parse:expr;)*) => {$(
        impl Scalar for $t {
            #[inline]
            fn read<const BIG: bool>(bytes: &[u8]) -> Self {
                let mut raw = [0; size_of::<$t>()];
                // The caller passes exactly the type's size.
                raw.copy_from_slice(bytes);
                if BIG { <$t>::from_be_bytes(raw) } else { <$t>::from_le_bytes(raw) }
            }

            fn parse(word: &[u8]) -> Option<Self> {
                $parse(word)
            }
        }
    )*};
}

scalar! {
    i8, integer; u8, integer; i16, integer; u16, integer; i32, integer; u32, integer;
    f32, number_f32; f64, number;
}

/// Parses a whole number, which may be written as `255.0`. Returns `None` if the word isn't one, or if `T` can't
/// represent it.
fn integer<T: TryFrom<i64>>(word: &[u8]) -> Option<T> {
    let value = match std::str::from_utf8(word).ok()?.parse::<i64>() {
        Ok(value) => value,
        Err(_) => number(word).filter(|v| v.fract() == 0.0 && v.abs() < 1e15)? as i64,
    };
    T::try_from(value).ok()
}

fn read_binary<const BIG: bool>(cursor: &mut Cursor<'_>, columns: &mut [Column<'_>]) -> Result<(), Fault> {
    let (rows, _) = checked_row_count(cursor)?;
    for row in 0..rows {
        cursor.row = row;
        for (i, column) in columns.iter_mut().enumerate() {
            cursor.property = i;
            match cursor.element.properties[i].kind {
                Kind::Scalar(t) => {
                    let raw = take(cursor, t.bytes())?;
                    if let Column::Scalar(values) = column {
                        each!(values, v => v.push(Scalar::read::<BIG>(raw)));
                    }
                }
                Kind::List { count, item } => {
                    let length = to_i64::<BIG>(count, take(cursor, count.bytes())?);
                    let length = usize::try_from(length).map_err(|_| {
                        Problem::new(format!("a list has {length} items: {}", cursor.place()))
                            .at(Location::Byte(cursor.position))
                            .expected("0 or more")
                    })?;
                    let raw = take(cursor, length.saturating_mul(item.bytes()))?;
                    let items = raw.chunks_exact(item.bytes());
                    // An item takes at least a byte, so the file's size limits the length.
                    match column {
                        Column::List(lists) => {
                            lists.push(items.map(|r| u32::try_from(to_i64::<BIG>(item, r)).unwrap_or(u32::MAX)));
                        }
                        Column::Coordinates(lists) => lists.push(items.map(|r| to_f32::<BIG>(item, r))),
                        _ => {}
                    }
                }
            }
        }
    }
    cursor.row = rows;
    Ok(())
}

fn take<'a>(cursor: &mut Cursor<'a>, length: usize) -> Result<&'a [u8], Fault> {
    if length > cursor.remaining() {
        return Err(cursor.truncated((length - cursor.remaining()) as u64));
    }
    let raw = &cursor.bytes[cursor.position..cursor.position + length];
    cursor.position += length;
    Ok(raw)
}

fn to_i64<const BIG: bool>(kind: ScalarType, raw: &[u8]) -> i64 {
    match kind {
        ScalarType::I8 => i8::read::<BIG>(raw).into(),
        ScalarType::U8 => u8::read::<BIG>(raw).into(),
        ScalarType::I16 => i16::read::<BIG>(raw).into(),
        ScalarType::U16 => u16::read::<BIG>(raw).into(),
        ScalarType::I32 => i32::read::<BIG>(raw).into(),
        ScalarType::U32 => u32::read::<BIG>(raw).into(),
        ScalarType::F32 | ScalarType::F64 => -1,
    }
}

fn to_f32<const BIG: bool>(kind: ScalarType, raw: &[u8]) -> f32 {
    if kind == ScalarType::F64 { f64::read::<BIG>(raw) as f32 } else { f32::read::<BIG>(raw) }
}

/// Returns the number of an element's rows, and the minimum number of bytes of a row: its scalars and the counts of its
/// lists. Both are 0 for an element without properties. Returns an error if fewer bytes remain than the rows need.
fn checked_row_count(cursor: &mut Cursor<'_>) -> Result<(usize, usize), Fault> {
    let properties = &cursor.element.properties;
    let least: usize = properties
        .iter()
        .map(|p| match p.kind {
            Kind::Scalar(t) | Kind::List { count: t, .. } => t.bytes(),
        })
        .sum();
    let count = cursor.element.count;
    if least == 0 {
        cursor.row = usize::try_from(count).unwrap_or(usize::MAX);
        return Ok((0, 0));
    }
    let needed = count.saturating_mul(least as u64);
    if needed > cursor.remaining() as u64 {
        cursor.row = cursor.remaining() / least;
        return Err(cursor.truncated(needed - cursor.remaining() as u64));
    }
    Ok((count as usize, least))
}

/// Sets of three properties that together become one column of vectors or colours. If a binary element without lists
/// has all three, their numbers stay in the file and are read on demand ([`Column::Stored`]).
const COMBINED_PROPERTIES: [[&str; 3]; 5] =
    [["x", "y", "z"], ["nx", "ny", "nz"], ["su", "sv", "sw"], ["tu", "tv", "tw"], ["red", "green", "blue"]];

/// Reads the rows of a binary element without lists, block by block. A block stays in the processor's cache while its
/// columns are extracted.
fn read_rows<'a>(
    cursor: &mut Cursor<'_>,
    bytes: Bytes<'a>,
    big_endian: bool,
    columns: &mut [Column<'a>],
) -> Result<(), Fault> {
    const BLOCK_BYTES: usize = 1 << 18;
    let (rows, stride) = checked_row_count(cursor)?;
    let end = cursor.position + rows * stride;
    let data = bytes.part(cursor.position..end).ok_or_else(|| cursor.truncated(1))?;
    (cursor.position, cursor.row) = (end, rows);
    if rows == 0 {
        return Ok(());
    }
    let properties = &cursor.element.properties;
    let has = |name: &&str| properties.iter().any(|p| p.name == *name);
    let mut offset = 0;
    for (column, property) in columns.iter_mut().zip(properties) {
        let Kind::Scalar(kind) = property.kind else { continue };
        let together =
            COMBINED_PROPERTIES.iter().any(|set| set.contains(&property.name.as_str()) && set.iter().all(&has));
        if let Column::Scalar(values) = column {
            if let Some(stored) = Strided::new(data, offset, stride, rows, number_type(kind), big_endian)
                && together
            {
                *column = Column::Stored(stored);
            } else {
                each!(values, v => v.reserve_exact(rows));
            }
        }
        offset += kind.bytes();
    }
    if !columns.iter().any(|column| matches!(column, Column::Scalar(_))) {
        return Ok(());
    }
    let block_rows = (BLOCK_BYTES / stride).max(1);
    let mut buffer = Vec::new();
    for first in (0..rows).step_by(block_rows) {
        let range = first * stride..rows.min(first + block_rows) * stride;
        let Some(block) = data.part(range).map(|part| part.read_into(&mut buffer)) else { break };
        let mut offset = 0;
        for (column, property) in columns.iter_mut().zip(properties) {
            let Kind::Scalar(kind) = property.kind else { continue };
            let end = offset + kind.bytes();
            match (column, big_endian) {
                (Column::Scalar(values), true) => each!(values, v => pick::<_, true>(v, block, stride, offset..end)),
                (Column::Scalar(values), false) => each!(values, v => pick::<_, false>(v, block, stride, offset..end)),
                _ => {}
            }
            offset = end;
        }
    }
    Ok(())
}

/// Converts a scalar type of PLY to the number type of columns.
pub(super) fn number_type(kind: ScalarType) -> NumberType {
    match kind {
        ScalarType::I8 => NumberType::I8,
        ScalarType::U8 => NumberType::U8,
        ScalarType::I16 => NumberType::I16,
        ScalarType::U16 => NumberType::U16,
        ScalarType::I32 => NumberType::I32,
        ScalarType::U32 => NumberType::U32,
        ScalarType::F32 => NumberType::F32,
        ScalarType::F64 => NumberType::F64,
    }
}

/// Appends one property's values of all rows of `block` to the property's column. `bytes` is the range of the
/// property's bytes in a row, and a row has `stride` bytes.
fn pick<T: Scalar, const BIG: bool>(column: &mut Vec<T>, block: &[u8], stride: usize, bytes: Range<usize>) {
    column.extend(block.chunks_exact(stride).map(|row| T::read::<BIG>(&row[bytes.clone()])));
}

fn read_ascii(cursor: &mut Cursor<'_>, columns: &mut [Column<'_>]) -> Result<(), Fault> {
    if columns.is_empty() {
        return Ok(());
    }
    let rows = usize::try_from(cursor.element.count).unwrap_or(usize::MAX);
    // A value takes at least two bytes, for itself and a separator, which limits the number of rows.
    let backed = rows.min(cursor.remaining() / (2 * columns.len()) + 1);
    for column in columns.iter_mut() {
        if let Column::Scalar(values) = column {
            each!(values, v => v.reserve_exact(backed));
        }
    }
    for row in 0..rows {
        cursor.row = row;
        for (i, column) in columns.iter_mut().enumerate() {
            cursor.property = i;
            let word = next_word(cursor, i == 0)?;
            match column {
                Column::Scalar(values) => each!(values, v => v.push(parse_word(cursor, word)?)),
                _ => {
                    let Kind::List { .. } = cursor.element.properties[i].kind else { continue };
                    let length: i64 = parse_list_word(cursor, word)?;
                    let length = usize::try_from(length).map_err(|_| bad_word(cursor, word, "0 or more list items"))?;
                    if length > cursor.remaining() {
                        return Err(cursor.truncated(length as u64 * 2 - 1));
                    }
                    for _ in 0..length {
                        let word = next_word(cursor, false)?;
                        match column {
                            Column::List(lists) => {
                                let item = parse_list_word(cursor, word)?;
                                lists.items.push(u32::try_from(item).unwrap_or(u32::MAX));
                            }
                            Column::Coordinates(lists) => lists.items.push(parse_word(cursor, word)?),
                            _ => {}
                        }
                    }
                    match column {
                        Column::List(lists) => lists.end(length),
                        Column::Coordinates(lists) => lists.end(length),
                        _ => {}
                    }
                }
            }
        }
    }
    cursor.row = rows;
    Ok(())
}

/// Returns the next word of text data. If `first`, the word is the first value of a row and must begin a line, except
/// in the element's first row. Returns an error if it doesn't, because row and header then disagree, or if the file
/// ends.
fn next_word<'a>(cursor: &mut Cursor<'a>, first: bool) -> Result<&'a [u8], Fault> {
    let bytes = cursor.bytes;
    let mut start = cursor.position;
    let mut new_line = cursor.row == 0 && first;
    while let Some(b) = bytes.get(start).filter(|b| b.is_ascii_whitespace()) {
        new_line |= matches!(b, b'\n' | b'\r');
        start += 1;
    }
    if start == bytes.len() {
        cursor.position = start;
        let values = (cursor.element.properties.len() - cursor.property) as u64;
        return Err(cursor.truncated(2 * values - 1));
    }
    if first && !new_line {
        let (row, element) = (cursor.row.saturating_sub(1), quote(&cursor.element.in_file));
        let what = format!("element {element} number {row} has more values than the header has properties");
        let location = Location::Line(line_at(bytes, start));
        let expected = format!("{} values on a line", cursor.element.properties.len());
        return Err(Problem::new(what).at(location).expected(expected).into());
    }
    let length = bytes[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(bytes.len() - start);
    cursor.position = start + length;
    Ok(&bytes[start..start + length])
}

/// Parses `word` as a number of the type `kind`, and appends the number's little-endian bytes to `out`. Returns `None`
/// if the word isn't a number of this type.
#[cfg(feature = "laz")]
pub(super) fn push_word(kind: ScalarType, word: &[u8], out: &mut Vec<u8>) -> Option<()> {
    macro_rules! push {
        ($t:ty) => {
            out.extend_from_slice(&<$t as Scalar>::parse(word)?.to_le_bytes())
        };
    }
    match kind {
        ScalarType::I8 => push!(i8),
        ScalarType::U8 => push!(u8),
        ScalarType::I16 => push!(i16),
        ScalarType::U16 => push!(u16),
        ScalarType::I32 => push!(i32),
        ScalarType::U32 => push!(u32),
        ScalarType::F32 => push!(f32),
        ScalarType::F64 => push!(f64),
    }
    Some(())
}

fn parse_word<T: Scalar>(cursor: &Cursor<'_>, word: &[u8]) -> Result<T, Fault> {
    T::parse(word).ok_or_else(|| bad_word(cursor, word, "a number of the type that the header gives"))
}

fn parse_list_word(cursor: &Cursor<'_>, word: &[u8]) -> Result<i64, Fault> {
    // `word` is the length of a list or an item of an integer list. Items of skipped lists are never parsed.
    integer(word).ok_or_else(|| bad_word(cursor, word, "a whole number"))
}

fn bad_word(cursor: &Cursor<'_>, word: &[u8], expected: &str) -> Fault {
    let what = format!("found {} as {}", quote(word), cursor.place());
    Problem::new(what).at(Location::Line(line_at(cursor.bytes, cursor.position))).expected(expected).into()
}
