//! LAS 1.0 to 1.5, LAZ and COPC: points of laser scanners. A COPC file is a LAZ file whose chunks are the nodes of an
//! octree; its points are those of all nodes.
//!
//! The file is read in blocks and is never in memory as a whole. Counts in the header are checked before they are used.
//! The crate `laz` decodes compressed chunks, as many at a time as there are threads.

#![cfg_attr(not(feature = "laz"), allow(unused, unreachable_pub))]

pub(crate) mod blocks;
#[cfg(feature = "laz")]
pub mod copc;
mod header;
#[cfg(feature = "laz")]
mod laz;
mod records;

use crate::RegularFile;
use crate::content::Content;
use crate::context::Context;
use crate::crs::IN_DEGREES;
use crate::error::{Fault, Problem};
use crate::format::Format;
use crate::point_count::PointCount;
use crate::survey::{Source, format_extent};
use crate::words::counted;
use glam::DVec3;
use header::Header;
use records::Columns;
use std::io::{self, Read, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use surfel_model::TableColumns;

/// Name of the extra bytes with the radius of a point's splat. Surfel writes them to LAS files.
pub const RADIUS: &str = "splat_radius";
/// Number of bytes of uncompressed points that are read at a time.
const BLOCK_BYTES: usize = 2 << 20;

/// Returns `N` bytes of a record, from byte `at`.
fn field<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&bytes[at..at + N]);
    out
}

fn unreadable(error: io::Error) -> Problem {
    Problem::new(format!("can't be read to its end: {error}")).help("the file is cut off, or the disk fails")
}

/// A receiver of a file's point records, block by block.
trait Sink {
    /// Prepares the receiver for `count` points; 0 if the number is unknown. It is called once, before any records are
    /// appended.
    fn start(&mut self, header: &Header, count: usize);
    /// Appends a block of whole records. The receiver may move records within the block.
    fn append(&mut self, records: &mut [u8]) -> Result<(), Problem>;
}

impl Sink for Option<Columns> {
    fn start(&mut self, header: &Header, count: usize) {
        *self = Some(Columns::new(header, count));
    }

    fn append(&mut self, records: &mut [u8]) -> Result<(), Problem> {
        if let Some(columns) = self {
            columns.append(records);
        }
        Ok(())
    }
}

/// Passes all points of a file to `sink`. With `repair`, reads the complete chunks of a truncated compressed file.
fn read_records(
    source: &mut dyn Source,
    header: &mut Header,
    file_bytes: u64,
    repair: bool,
    sink: &mut dyn Sink,
) -> Result<(), Problem> {
    if !header.compressed {
        return read_plain(source, header, sink);
    }
    #[cfg(feature = "laz")]
    {
        // The crate `laz` expects valid streams: damaged ones make it panic where overflow checks are on.
        let read = AssertUnwindSafe(|| laz::read(source, header, file_bytes, repair, sink));
        catch_unwind(read).unwrap_or_else(|_| {
            let problem = Problem::new("is damaged: its compressed points make no sense");
            Err(problem.help("copy the file again"))
        })
    }
    #[cfg(not(feature = "laz"))]
    Err(Problem::not_built("LAZ", "laz"))
}

/// Number of points at the start of a file that are read to estimate the memory per point. Columns that are zero
/// everywhere take no memory, and the header doesn't state which these are.
const EXAMINED_POINTS: u64 = 4096;
/// Memory per point, in bytes, of 32-bit positions. If the rounding error of f32 is stored, too, as the positions' low
/// part, it takes as many bytes again.
const POSITION_BYTES: u64 = 12;
/// Memory per point, in bytes, that reading takes in addition to the columns. Measured peaks for 2 million points of
/// LAS are within 6 % of the estimate. LAZ files with few columns take up to half more, since the C library's allocator
/// doesn't return all memory.
const READING_BYTES: u64 = 12;

/// Reads the first points of a file, at most [`EXAMINED_POINTS`], as whole records. Returns `None` if they can't be
/// read.
fn first_records(source: &mut dyn Source, header: &mut Header, file_bytes: u64) -> Option<Vec<u8>> {
    if !header.compressed {
        let size = header.record_bytes as u64;
        let points = EXAMINED_POINTS.min(header.count).min((header.end - header.start) / size);
        let mut records = vec![0; (points * size) as usize];
        source.seek(SeekFrom::Start(header.start)).ok()?;
        source.read_exact(&mut records).ok()?;
        return Some(records);
    }
    #[cfg(feature = "laz")]
    {
        // Damaged streams make the crate `laz` panic where overflow checks are on.
        let read = AssertUnwindSafe(|| laz::first_points(source, header, file_bytes, EXAMINED_POINTS));
        catch_unwind(read).ok().flatten()
    }
    #[cfg(not(feature = "laz"))]
    None
}

/// Estimates the number of points of a file that can be converted to COPC, and the memory per point
/// ([`PointCount::row_bytes`]), without reading all points. Returns `None` for other files and for invalid headers.
/// `columns` is as in [`crate::LoadOptions`].
#[cfg_attr(not(feature = "laz"), expect(unused_variables, reason = "no other formats are written by levels"))]
pub fn survey_points(path: &Path, columns: Option<&TableColumns>) -> Option<PointCount> {
    let mut file = RegularFile::open(path).ok()??;
    let mut head = Vec::new();
    (&mut file).take(512).read_to_end(&mut head).ok()?;
    if !matches!(Format::from_seekable_signature(&head), Some(Format::Las | Format::Laz | Format::Copc)) {
        #[cfg(feature = "laz")]
        return crate::column_file::survey(path, columns).map(|survey| survey.count);
        #[cfg(not(feature = "laz"))]
        return None;
    }
    let file_bytes = file.file_bytes();
    let mut header = Header::read(&mut file, file_bytes).ok()?;
    let points = if header.compressed {
        #[cfg(feature = "laz")]
        laz::check_size(&header, header.count, file_bytes).ok()?;
        header.count
    } else {
        header.count.min((header.end - header.start) / header.record_bytes as u64)
    };
    let mut columns = Columns::new(&header, 0);
    if let Some(mut records) = first_records(&mut file, &mut header, file_bytes) {
        columns.append(&mut records);
    }
    let has = |name: &str| header.extra.iter().any(|e| e.name == name);
    // Bounds in the header, in this order: largest x, smallest x, largest y, smallest y, largest z, smallest z.
    let bound = |k: usize| head.get(179 + 8 * k..187 + 8 * k).map_or(0.0, |bytes| f64::from_le_bytes(field(bytes, 0)));
    let [max, min] = [0, 1].map(|k| DVec3::new(bound(k), bound(2 + k), bound(4 + k)));
    let low_bytes = if records::needs_low_part(min, max, header.scale) { POSITION_BYTES } else { 0 };
    let is_examined = columns.len() > 0;
    let extra_bytes = if is_examined { columns.extra_bytes() } else { header.record_bytes };
    Some(PointCount {
        points,
        has_radii: has(RADIUS),
        has_normals: has("NormalX"),
        has_colors: if is_examined { columns.any_color() } else { records::has_colors(header.format) },
        row_bytes: READING_BYTES + POSITION_BYTES + low_bytes + extra_bytes as u64,
    })
}

pub(crate) fn read(source: &mut dyn Source, format: Format, context: &mut Context<'_>) -> Result<Content, Fault> {
    let file_bytes = source.seek(SeekFrom::End(0)).map_err(unreadable)?;
    let mut header = Header::read(source, file_bytes)?;
    header.reads_withheld = context.options.withheld;
    let mut columns = None;
    read_records(source, &mut header, file_bytes, context.options.repair, &mut columns)?;
    finish(columns, header, format, None, context)
}

/// Returns the points that were read as content, and adds notes about them. `of` is the number of points in the file,
/// if only some were read.
fn finish(
    columns: Option<Columns>,
    header: Header,
    format: Format,
    of: Option<u64>,
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let columns = columns.unwrap_or_else(|| Columns::new(&header, 0));
    let (count, withheld) = (columns.len(), columns.withheld);
    let (mut points, has_8_bit_colors) = columns.finish(&header);
    points.comments = header.comments();
    let (bounds, has_colors) = (points.bounds(), points.colors.is_some());
    if bounds.is_some_and(|bounds| header.crs.degrees_note(bounds, Some(header.scale)).is_some()) {
        points.comments.push(IN_DEGREES.to_owned());
    }
    tell(header, format, PointFacts { count, of, withheld, bounds, has_colors, has_8_bit_colors }, context)?;
    context.points(points)
}

/// Properties of the points that were read, for the notes of [`tell`].
#[derive(Default)]
struct PointFacts {
    count: usize,
    /// Number of points in the file, if only some were read.
    of: Option<u64>,
    withheld: u64,
    bounds: Option<(DVec3, DVec3)>,
    has_colors: bool,
    /// True if the file stores 8-bit colours in 16-bit fields (range 0–255).
    has_8_bit_colors: bool,
}

/// Adds notes about the points that were read; returns an error if there are none.
fn tell(mut header: Header, format: Format, told: PointFacts, context: &mut Context<'_>) -> Result<(), Problem> {
    let PointFacts { count, of, withheld, bounds, has_colors, has_8_bit_colors } = told;
    if count == 0 {
        let what = match withheld {
            0 => "holds no point".to_owned(),
            n => format!("holds no point but {n} that are flagged as withheld"),
        };
        return Err(Problem::new(what).expected("at least one"));
    }
    let mut notes = std::mem::take(&mut header.notes);
    let undescribed = header.undescribed_bytes();
    if undescribed > 0 {
        notes.push(format!("left out {undescribed} extra bytes of each point that the file doesn't describe"));
    }
    if has_8_bit_colors {
        notes.push("its colours count to 255 instead of 65535: taken as 8 bits".into());
    }
    if withheld > 0 {
        let points = counted(withheld, "points");
        notes.push(format!("left out {points} flagged as withheld (`classes=all` reads them)"));
    }
    if matches!(header.format, 4 | 5 | 9 | 10) {
        notes.push("left out its waveforms".into());
    }
    let by = match header.software.as_str() {
        "" => String::new(),
        name => format!(" by {}", crate::error::quote(name)),
    };
    notes.extend(bounds.and_then(|bounds| header.crs.degrees_note(bounds, Some(header.scale))));
    let extent = bounds.map_or_else(Default::default, |(lo, hi)| hi - lo);
    let version = match format {
        Format::Las => format!("LAS 1.{}", header.minor),
        packed => format!("{packed} (LAS 1.{})", header.minor),
    };
    let colors = if has_colors { "" } else { ", no colours" };
    context.note(format!(
        "{version} of point format {}{by}: {count}{} points, {}, {}{colors}",
        header.format,
        of.map_or_else(String::new, |all| format!(" of {all}")),
        format_extent(extent),
        header.crs.words(),
    ));
    notes.into_iter().for_each(|note| context.note(note));
    Ok(())
}

/// Reads uncompressed points, and passes them to `sink` in blocks.
fn read_plain(source: &mut dyn Source, header: &mut Header, sink: &mut dyn Sink) -> Result<(), Problem> {
    let size = header.record_bytes;
    let there = (header.end - header.start) / size as u64;
    let said = header.count;
    let count = match said {
        0 => there,
        said => said.min(there),
    };
    if said != count {
        header.notes.push(format!("the header says {}, the file holds {there}: took {count}", counted(said, "points")));
    } else if there > said + said / 1000 + 1000 {
        header.notes.push(format!(
            "the header says {}: left out what follows, room for {}",
            counted(said, "points"),
            there - said
        ));
    }
    sink.start(header, count as usize);
    source.seek(SeekFrom::Start(header.start)).map_err(unreadable)?;
    let block = (BLOCK_BYTES / size).max(1);
    let (mut left, mut bytes) = (count as usize, Vec::new());
    while left > 0 {
        let now = left.min(block);
        bytes.resize(now * size, 0);
        source.read_exact(&mut bytes).map_err(unreadable)?;
        sink.append(&mut bytes)?;
        left -= now;
    }
    Ok(())
}
