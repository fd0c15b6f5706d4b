//! COLMAP's sparse points: `points3D.txt` and `points3D.bin`. Positions, colours, reprojection errors and track lengths
//! are read; identifiers and the tracks themselves aren't.

use crate::ascii::{Lines, each_line, number, words};
use crate::bytes::Bytes;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, quote};
use crate::point_columns::{self, Source};
use crate::points::Table;
use std::io::{Read, Write};
use std::path::Path;

/// Names of the columns that are read from a file of COLMAP's points.
const NAMES: [&str; 8] = ["x", "y", "z", "red", "green", "blue", "error", "track_length"];
/// Number of values of a point in a text file before its track.
const BEFORE_TRACK: usize = 8;
/// Number of values of a track element in a text file: index of an image, and index of the point in the image.
const PER_ELEMENT: usize = 2;
/// Number of bytes of a point in a binary file before its track: identifier, position, colour, error, and track length.
const POINT_BYTES: usize = 8 + 3 * 8 + 3 + 8 + 8;
/// Number of bytes of a track element in a binary file: index of an image, and index of the point in the image.
const ELEMENT_BYTES: u64 = 8;
/// Maximum number of lines of a text file that are examined to detect COLMAP's format, without comments and blank
/// lines.
const MAX_DETECTION_LINES: usize = 100;

/// True if a file with the name `name` and the first bytes `head` is COLMAP's `points3D.txt`. Either the first comments
/// name its columns; or the complete lines of `head`, at most [`MAX_DETECTION_LINES`], are points. In the latter case,
/// the name must begin with `points3D`, or the tracks must differ in length.
pub(crate) fn looks_like(name: &Path, head: &[u8]) -> bool {
    let lines = || Lines::new(head).map(|(_, line)| line.trim_ascii()).filter(|line| !line.is_empty());
    let has = |line: &[u8], text: &[u8]| line.windows(text.len()).any(|part| part.eq_ignore_ascii_case(text));
    let is_comment = |line: &&[u8]| line.starts_with(b"#");
    if lines().take_while(is_comment).any(|line| has(line, b"POINT3D_ID") && has(line, b"TRACK[]")) {
        return true;
    }
    // The last line may be incomplete.
    let mut rows: Vec<&[u8]> = lines().filter(|line| !is_comment(line)).take(MAX_DETECTION_LINES).collect();
    if head.last() != Some(&b'\n') && rows.len() > 1 {
        rows.pop();
    }
    let first = rows.first().map_or(0, |line| words(line).count());
    let is_named = name.file_name().is_some_and(|name| name.to_string_lossy().to_lowercase().starts_with("points3d"));
    let differ = rows.iter().any(|line| words(line).count() != first);
    !rows.is_empty() && (is_named || differ) && rows.iter().all(|line| is_row(line))
}

/// True if a line is a point of `points3D.txt`: whole numbers except for the position and the error, colours from 0 to
/// 255, an error of −1 or at least 0, and complete pairs in the track.
fn is_row(line: &[u8]) -> bool {
    let mut count = 0;
    let fits = words(line).all(|word| {
        let value = number(word).filter(|v| v.is_finite());
        let fits = value.is_some_and(|v| match count {
            1..=3 => true,
            7 => v >= 0.0 || v == -1.0,
            4..=6 => v.fract() == 0.0 && (0.0..=255.0).contains(&v),
            _ => v.fract() == 0.0 && v >= 0.0,
        });
        count += 1;
        fits
    });
    fits && count >= BEFORE_TRACK && (count - BEFORE_TRACK).is_multiple_of(PER_ELEMENT)
}

/// True if the bytes of a file are those of `points3D.bin`: the stated number of points, at least one, fills the file,
/// and all positions and errors are finite. Reads up to the whole file if its size allows the stated number.
pub(crate) fn looks_like_binary(bytes: Bytes<'_>) -> bool {
    let count = bytes.at_most(0, 8);
    let Some(count) = count.first_chunk().map(|count| u64::from_le_bytes(*count)) else { return false };
    if count == 0 || count.saturating_mul(POINT_BYTES as u64) > bytes.len() as u64 {
        return false;
    }
    each_record(bytes, |_, record| {
        let is_finite = record.position.iter().chain([&record.error]).all(|v| v.is_finite());
        if is_finite { Ok(()) } else { Err(Problem::new("no point").into()) }
    })
    .is_ok()
}

/// Returns the number of points that `points3D.bin` states, if the file is large enough for that many points without
/// tracks; else `None`.
#[cfg(feature = "laz")]
pub(crate) fn count(bytes: Bytes<'_>) -> Option<u64> {
    let count = u64::from_le_bytes(*bytes.at_most(0, 8).first_chunk()?);
    (count.saturating_mul(POINT_BYTES as u64) <= bytes.len() as u64).then_some(count)
}

/// A point of `points3D.bin`, without its track.
struct Record {
    position: [f64; 3],
    color: [u8; 3],
    error: f64,
    track_length: u64,
}

/// Passes the points of `points3D.bin` and their indices, from 0, to `each`. The file is read once, and only one point
/// is in memory at a time.
fn each_record(bytes: Bytes<'_>, mut each: impl FnMut(u64, Record) -> Result<(), Fault>) -> Result<(), Fault> {
    let mut reader = std::io::BufReader::new(bytes.reader());
    let (mut at, length) = (8_u64, bytes.len() as u64);
    let cut = |at: u64, index: u64, count: u64| {
        let problem = Problem::new(format!("the file ends in point {} of {count}", index + 1));
        Fault::from(problem.at(Location::Byte(at as usize)).help("copy the file again: it is incomplete"))
    };
    let mut count = [0; 8];
    reader.read_exact(&mut count).map_err(|_| cut(0, 0, 0))?;
    let count = u64::from_le_bytes(count);
    for index in 0..count {
        let mut raw = [0; POINT_BYTES];
        reader.read_exact(&mut raw).map_err(|_| cut(at, index, count))?;
        at += POINT_BYTES as u64;
        let eight = |at: usize| raw[at..].first_chunk::<8>().copied().unwrap_or_default();
        let float = |at: usize| f64::from_le_bytes(eight(at));
        let track_length = u64::from_le_bytes(eight(POINT_BYTES - 8));
        let track_bytes = track_length.saturating_mul(ELEMENT_BYTES);
        if track_bytes > length - at {
            return Err(cut(at, index, count));
        }
        // The bytes to skip are usually in the buffer.
        let skipped = std::io::copy(&mut reader.by_ref().take(track_bytes), &mut std::io::sink());
        if skipped.ok() != Some(track_bytes) {
            return Err(cut(at, index, count));
        }
        at += track_bytes;
        let position = [8, 16, 24].map(float);
        each(index, Record { position, color: [raw[32], raw[33], raw[34]], error: float(35), track_length })?;
    }
    if at != length {
        let problem = Problem::new(format!("has {} bytes after its {count} points", length - at));
        return Err(problem.at(Location::Byte(at as usize)).expected("points3D.bin of COLMAP").into());
    }
    Ok(())
}

/// Writes the values of all points of a text or binary file to `data`. Returns the table that describes the columns in
/// `data`.
pub(crate) fn unpack(bytes: Bytes<'_>, data: &mut dyn Write) -> Result<Table, Fault> {
    let mut table = Table::with_names(&NAMES);
    let mut add = |[x, y, z]: [f64; 3], [r, g, b]: [f64; 3], error: f64, track_length: f64| {
        table.push(&[x, y, z, r, g, b, error, track_length], data)
    };
    if is_text(bytes) {
        each_line(bytes, |line_number, line| {
            let line = line.trim_ascii();
            if line.is_empty() || line.starts_with(b"#") {
                return Ok(());
            }
            let at = Location::Line(line_number);
            let (mut values, mut count) = ([0.0; BEFORE_TRACK], 0);
            for word in words(line) {
                let wrong = || Problem::new(format!("found {}", quote(word))).at(at).expected("a number");
                let value = number(word).ok_or_else(wrong)?;
                if let Some(place) = values.get_mut(count) {
                    *place = value;
                }
                count += 1;
            }
            if count < BEFORE_TRACK || !(count - BEFORE_TRACK).is_multiple_of(PER_ELEMENT) {
                let expected = "POINT3D_ID X Y Z R G B ERROR, and pairs of IMAGE_ID and POINT2D_IDX";
                return Err(Problem::new(format!("found {count} numbers")).at(at).expected(expected).into());
            }
            let [_, x, y, z, r, g, b, error] = values;
            add([x, y, z], [r, g, b], error, ((count - BEFORE_TRACK) / PER_ELEMENT) as f64)
        })?;
    } else {
        each_record(bytes, |_, point| {
            add(point.position, point.color.map(f64::from), point.error, point.track_length as f64)
        })?;
    }
    if table.is_empty() {
        return Err(Problem::new("holds no point").expected("points of COLMAP").into());
    }
    Ok(table)
}

fn is_text(bytes: Bytes<'_>) -> bool {
    // A point count below 2⁵⁶ has a zero among its eight bytes.
    !bytes.at_most(0, 8).contains(&0)
}

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut data = Vec::new();
    let table = unpack(Bytes::Memory(bytes), &mut data)?;
    let (columns, roles) = table.columns(Bytes::Memory(&data), context)?;
    point_columns::build(columns, &roles, Source::Text, Vec::new(), context)
}
