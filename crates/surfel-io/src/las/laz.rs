//! Points compressed by LASzip, decoded by the crate `laz`. The crate doesn't check the number of chunks, the lengths
//! of their layers and the number of decoded points; this module checks them first.

use super::header::Header;
use super::{Sink, field, unreadable};
use crate::error::{Location, Problem};
use crate::survey::Source;
use crate::words::counted;
use ::laz::laszip::{ChunkTable, ChunkTableEntry};
use ::laz::{DecompressionSelection, LasZipDecompressor, LasZipError, LazItemRecordBuilder, LazItemType, LazVlr};
use std::collections::BTreeMap;
use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;

/// Maximum number of bytes that points may take after decoding: the first number plus the second times the file's size.
/// Files with more are refused. Ordinary scans expand 4 to 20 times, grids of equal points up to thousands of times.
const MAX_DECODED: (u64, u64) = (256 << 20, 256);
/// Maximum number of points, and of their bytes, in chunks that are decoded together. A single larger chunk is decoded
/// alone.
const MAX_GROUP: (u64, u64) = (1 << 20, 24 << 20);

fn damaged(error: &LasZipError) -> Problem {
    Problem::new(format!("is damaged: {error}")).help("the file is cut off or damaged: copy it again")
}

/// Number of bytes and points of a compressed chunk.
#[derive(Clone, Copy, Debug)]
struct Chunk {
    bytes: u64,
    points: u64,
}

/// Passes all points to `sink`. With `repair`, reads the complete chunks of a truncated file, if its chunks are layered
/// or of a fixed size.
pub(super) fn read(
    source: &mut dyn Source,
    header: &mut Header,
    file_bytes: u64,
    repair: bool,
    sink: &mut dyn Sink,
) -> Result<(), Problem> {
    let (vlr, kind) = checked_vlr(header)?;
    let layered = is_layered(&vlr);
    match (kind, layered) {
        (1, false) => read_in_one_piece(source, header, vlr, file_bytes, sink),
        (2, false) | (3, true) => {
            let table = table_place(source, header, file_bytes)
                .and_then(|place| read_table(source, header, &vlr, place, file_bytes));
            let chunks = match table {
                Err(_) if repair && layered => complete_chunks(source, header, &vlr, file_bytes)?,
                Err(_) if repair && !vlr.uses_variable_size_chunks() => {
                    return read_without_table(source, header, vlr, file_bytes, sink);
                }
                // Without a table, `repair` reads the same two kinds of files: chunks of layers, and chunks of a fixed
                // size.
                Err(problem) if layered || !vlr.uses_variable_size_chunks() => {
                    return Err(problem.help("the file is cut off: copy it again, or `repair` takes the whole chunks"));
                }
                table => table?,
            };
            read_chunks(source, header, &vlr, file_bytes, chunks, sink)
        }
        _ => Err(Problem::new(format!("is compressed in a way that is not known (LASzip's compressor {kind})"))),
    }
}

fn is_layered(vlr: &LazVlr) -> bool {
    vlr.items().iter().any(|item| matches!(item.version(), 3 | 4))
}

/// Returns the LASzip record and the kind of compressor that it states. The record's items are checked against the
/// header. The record is removed from the header, so this function succeeds only once per header.
pub(super) fn checked_vlr(header: &mut Header) -> Result<(LazVlr, u16), Problem> {
    let Some(mut record) = header.laszip.take() else {
        return Err(Problem::new("says that its points are compressed, and lacks the record of LASzip that says how"));
    };
    if record.len() < 34 {
        return Err(Problem::new("has a record of LASzip that is too short").expected("34 bytes at least"));
    }
    // Compressor kinds: all points in one piece (1), in chunks (2), and in chunks of layers (3).
    let kind = u16::from_le_bytes(field(&record, 0));
    if kind == 1 {
        // A single piece has no chunks. A variable chunk size would make the crate read a chunk table.
        record[12..16].copy_from_slice(&1_u32.to_le_bytes());
    }
    let vlr = LazVlr::from_buffer(&record).map_err(|e| damaged(&e))?;
    check_items(&vlr, header)?;
    Ok((vlr, kind))
}

/// Checks that the items that LASzip's record lists are the fields of the header's point format.
fn check_items(vlr: &LazVlr, header: &Header) -> Result<(), Problem> {
    let extra = header.record_bytes - super::header::POINT_BYTES[usize::from(header.format)];
    let expected = LazItemRecordBuilder::default_for_point_format_id(header.format, extra as u16);
    let expected = expected.map_err(|e| damaged(&e))?;
    let newer = header.format >= 6;
    let found = vlr.items().iter();
    let known = found.clone().all(|item| if newer { matches!(item.version(), 3 | 4) } else { item.version() <= 2 });
    let same = vlr.items().len() == expected.len()
        && found.zip(&expected).all(|(a, b)| a.item_type() == b.item_type() && a.size() == b.size());
    if known && same {
        return Ok(());
    }
    let what = format!("its record of LASzip doesn't describe points of format {}", header.format);
    Err(Problem::new(what).help("the file is damaged, or by a program that adds to the standard"))
}

pub(super) fn check_size(header: &Header, points: u64, file_bytes: u64) -> Result<(), Problem> {
    let decoded = u128::from(points) * header.record_bytes as u128;
    if decoded > u128::from(MAX_DECODED.0) + u128::from(MAX_DECODED.1) * u128::from(file_bytes) {
        let what = format!("says that its {file_bytes} bytes hold {points} points");
        return Err(Problem::new(what).expected("fewer: the file is damaged, or made to fill the memory"));
    }
    Ok(())
}

/// Resizes `bytes` to `length`; new bytes are 0. Returns an error if there isn't enough memory: one chunk may contain
/// all points of a file.
fn resize(bytes: &mut Vec<u8>, length: usize) -> Result<(), Problem> {
    if bytes.try_reserve_exact(length.saturating_sub(bytes.len())).is_err() {
        let what = format!("has a chunk of {length} bytes of points, which the system gives no memory for");
        return Err(Problem::new(what).help("free memory, or write the file again in smaller chunks"));
    }
    bytes.resize(length, 0);
    Ok(())
}

/// Maximum number of compressed bytes that [`first_points`] reads. If the first points need more, none are decoded.
const MAX_FIRST: u64 = 64 << 20;

/// Decodes points of a file's first chunk, at most `most`. Returns `None` if there are none, if the file is damaged,
/// and if more than [`MAX_FIRST`] bytes would be read. Also returns `None` for files in one piece, and for chunks
/// without layers that vary in size.
pub(super) fn first_points(
    source: &mut dyn Source,
    header: &mut Header,
    file_bytes: u64,
    most: u64,
) -> Option<Vec<u8>> {
    let (vlr, kind) = checked_vlr(header).ok()?;
    let (at, size) = (header.start + 8, header.record_bytes as u64);
    let left = file_bytes.checked_sub(at)?;
    let wanted = most.min(header.count);
    let (points, bytes) = match (kind, is_layered(&vlr)) {
        // Without layers, points follow one another; a compressed point is hardly larger than twice its record.
        (2, false) if !vlr.uses_variable_size_chunks() => {
            (wanted.min(u64::from(vlr.chunk_size())), left.min(2 * wanted * size + 4096))
        }
        (3, true) => {
            let (points, bytes) = layers_at(source, at, &vlr, header.record_bytes).ok()?;
            (wanted.min(points), bytes)
        }
        _ => return None,
    };
    if points == 0 || bytes > left.min(MAX_FIRST) {
        return None;
    }
    let mut packed = vec![0; bytes as usize];
    source.seek(SeekFrom::Start(at)).ok()?;
    source.read_exact(&mut packed).ok()?;
    let mut records = vec![0; (points * size) as usize];
    decode(&packed, &mut records, &vlr, &[(points, bytes)]).ok()?;
    Some(records)
}

/// Reads a file of LASzip's compressor 1. Its points are a single piece without chunks, whose end is known only from
/// the header's count.
fn read_in_one_piece(
    source: &mut dyn Source,
    header: &mut Header,
    vlr: LazVlr,
    file_bytes: u64,
    sink: &mut dyn Sink,
) -> Result<(), Problem> {
    check_size(header, header.count, file_bytes)?;
    sink.start(header, header.count as usize);
    source.seek(SeekFrom::Start(header.start)).map_err(unreadable)?;
    let mut decoder = LasZipDecompressor::new(BufReader::new(source), vlr).map_err(|e| damaged(&e))?;
    let (mut left, mut bytes) = (header.count as usize, Vec::new());
    while left > 0 {
        let now = left.min(super::BLOCK_BYTES / header.record_bytes + 1);
        bytes.resize(now * header.record_bytes, 0);
        decoder.decompress_many(&mut bytes).map_err(unreadable)?;
        sink.append(&mut bytes)?;
        left -= now;
    }
    Ok(())
}

/// Returns the byte offset of the table of chunks, which follows the points.
fn table_place(source: &mut dyn Source, header: &Header, file_bytes: u64) -> Result<u64, Problem> {
    let mut number = |at: u64| {
        let mut bytes = [0; 8];
        source.seek(SeekFrom::Start(at)).map_err(unreadable)?;
        source.read_exact(&mut bytes).map_err(unreadable)?;
        Ok::<i64, Problem>(i64::from_le_bytes(bytes))
    };
    let begin = header.start + 8;
    let mut place = number(header.start)?;
    if place == -1 {
        // A writer that can't seek stores the offset at the end of the file.
        place = number(file_bytes.saturating_sub(8))?;
    }
    match u64::try_from(place) {
        Ok(place) if place >= begin && place <= file_bytes.saturating_sub(8) => Ok(place),
        _ => {
            let what = format!("says that the table of its compressed chunks is at byte {place} of {file_bytes}");
            Err(Problem::new(what).help("the file is cut off: copy it again"))
        }
    }
}

/// Reads the table of chunks, which states the size of each chunk. The chunks follow one another in the file.
fn read_table(
    source: &mut dyn Source,
    header: &Header,
    vlr: &LazVlr,
    place: u64,
    file_bytes: u64,
) -> Result<Vec<Chunk>, Problem> {
    let at = Location::Byte(place as usize);
    let mut head = [0; 8];
    source.seek(SeekFrom::Start(place)).map_err(unreadable)?;
    source.read_exact(&mut head).map_err(unreadable)?;
    let count = u64::from(u32::from_le_bytes(field(&head, 4)));
    let compressed = place - header.start - 8;
    // Each chunk begins with an uncompressed point.
    if count > compressed / header.record_bytes as u64 {
        let what = format!("says that its {compressed} bytes of points are {count} chunks");
        return Err(Problem::new(what).at(at).help("the file is damaged"));
    }
    // A compressed entry is two 32-bit numbers; their coding adds a few bits at worst.
    let most = (file_bytes - place).min(64 + 16 * count);
    let mut table = vec![0; most as usize];
    source.seek(SeekFrom::Start(place)).map_err(unreadable)?;
    source.read_exact(&mut table).map_err(unreadable)?;
    let variable = vlr.uses_variable_size_chunks();
    let entries = ChunkTable::read(&mut Cursor::new(table), variable).map_err(|e| damaged(&e.into()))?;
    let mut total = 0_u64;
    let mut chunks = Vec::with_capacity(entries.len());
    for entry in &entries {
        // Writers that end a chunk early write an empty chunk.
        if entry.byte_count == 0 {
            continue;
        }
        total = total.saturating_add(entry.byte_count);
        if entry.byte_count < header.record_bytes as u64 || total > compressed {
            let what = "has a table of chunks that doesn't fit its bytes";
            return Err(Problem::new(what).at(at).help("the file is damaged"));
        }
        let points = if variable { entry.point_count } else { u64::from(vlr.chunk_size()) };
        chunks.push(Chunk { bytes: entry.byte_count, points });
    }
    Ok(chunks)
}

fn read_chunks(
    source: &mut dyn Source,
    header: &mut Header,
    vlr: &LazVlr,
    file_bytes: u64,
    mut chunks: Vec<Chunk>,
    sink: &mut dyn Sink,
) -> Result<(), Problem> {
    let size = header.record_bytes;
    let layered = is_layered(vlr);
    let mut start = header.start + 8;
    if layered {
        // Layered chunks state their own number of points.
        let mut at = start;
        for chunk in &mut chunks {
            chunk.points = chunk.points.min(check_layers(source, at, chunk.bytes, vlr, size)?);
            at += chunk.bytes;
        }
    }
    let sum = |chunks: &[Chunk]| chunks.iter().fold(0_u64, |sum, c| sum.saturating_add(c.points));
    let there = sum(&chunks);
    // The last chunk of a fixed size may be shorter: only the header's count shows it.
    let said = header.count;
    let certain = if layered || vlr.uses_variable_size_chunks() {
        there
    } else {
        sum(&chunks[..chunks.len().saturating_sub(1)]) + u64::from(!chunks.is_empty())
    };
    if said < certain || said > there {
        let took = if said == 0 { certain } else { said.min(there) };
        header.notes.push(format!("the header says {}, the file holds {there}: took {took}", counted(said, "points")));
        header.count = took;
    }
    let mut left = header.count;
    for chunk in &mut chunks {
        chunk.points = chunk.points.min(left);
        left -= chunk.points;
    }
    chunks.retain(|chunk| chunk.points > 0);
    check_size(header, header.count, file_bytes)?;
    sink.start(header, header.count as usize);
    let mut done = 0;
    let (mut packed, mut bytes) = (Vec::new(), Vec::new());
    let mut chunks = chunks.as_slice();
    while !chunks.is_empty() {
        let (mut points, mut packed_bytes, mut group) = (0, 0, 0);
        while let Some(chunk) = chunks.get(group)
            && group < 2 * rayon::current_num_threads()
        {
            let more = points + chunk.points;
            if group > 0 && (more > MAX_GROUP.0 || more * size as u64 > MAX_GROUP.1) {
                break;
            }
            (points, packed_bytes, group) = (more, packed_bytes + chunk.bytes, group + 1);
        }
        let (now, rest) = chunks.split_at(group);
        resize(&mut packed, packed_bytes as usize)?;
        source.seek(SeekFrom::Start(start)).map_err(unreadable)?;
        source.read_exact(&mut packed).map_err(unreadable)?;
        bytes.clear();
        resize(&mut bytes, points as usize * size)?;
        let entries: Vec<(u64, u64)> = now.iter().map(|c| (c.points, c.bytes)).collect();
        decode(&packed, &mut bytes, vlr, &entries).map_err(|e| {
            let what = format!("is damaged among points {done} to {}: {e}", done + points);
            Problem::new(what).at(Location::Byte(start as usize)).help("the file is damaged: copy it again")
        })?;
        sink.append(&mut bytes)?;
        done += points;
        start += packed_bytes;
        chunks = rest;
    }
    Ok(())
}

/// Note for the user about points that were read without a table of chunks.
const CUT_OFF: &str =
    "the table of its compressed chunks is missing, as of a file that is cut off: took the whole ones";

/// Finds the complete layered chunks of a file that lacks the table of chunks, up to the header's count of points.
fn complete_chunks(
    source: &mut dyn Source,
    header: &mut Header,
    vlr: &LazVlr,
    file_bytes: u64,
) -> Result<Vec<Chunk>, Problem> {
    let (mut chunks, mut at, mut left) = (Vec::new(), header.start + 8, header.count);
    while left > 0 && at < file_bytes {
        // Bytes that aren't a chunk end the search.
        let Ok((points, bytes)) = layers_at(source, at, vlr, header.record_bytes) else { break };
        if points == 0 || bytes > file_bytes - at {
            break;
        }
        chunks.push(Chunk { bytes, points });
        (at, left) = (at + bytes, left.saturating_sub(points));
    }
    header.notes.push(CUT_OFF.into());
    Ok(chunks)
}

/// A source that refuses to seek, so that the crate `laz` reads no chunk table.
struct NonSeekable<'a>(BufReader<&'a mut dyn Source>);

impl Read for NonSeekable<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.0.read(bytes)
    }
}

impl Seek for NonSeekable<'_> {
    fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
        Err(io::ErrorKind::NotSeekable.into())
    }
}

/// Reads the complete chunks of a truncated file, one after another. All chunks but the last have the same number of
/// points.
fn read_without_table(
    source: &mut dyn Source,
    header: &mut Header,
    vlr: LazVlr,
    file_bytes: u64,
    sink: &mut dyn Sink,
) -> Result<(), Problem> {
    let said = header.count;
    let chunk = u64::from(vlr.chunk_size()).max(1);
    sink.start(header, 0);
    source.seek(SeekFrom::Start(header.start)).map_err(unreadable)?;
    let mut decoder = LasZipDecompressor::new(NonSeekable(BufReader::new(source)), vlr).map_err(|e| damaged(&e))?;
    let mut bytes = Vec::new();
    let mut took = 0;
    while took < said {
        let now = chunk.min(said - took);
        check_size(header, took + now, file_bytes)?;
        bytes.clear();
        resize(&mut bytes, now as usize * header.record_bytes)?;
        if decoder.decompress_many(&mut bytes).is_err() {
            break;
        }
        sink.append(&mut bytes)?;
        took += now;
    }
    header.notes.push(CUT_OFF.into());
    header.notes.push(format!("the header says {said} points, the file holds {took} in whole chunks: took {took}"));
    Ok(())
}

/// Checks that the layers of the chunk at byte offset `at` fit into its `bytes` bytes, and returns its number of
/// points.
fn check_layers(source: &mut dyn Source, at: u64, bytes: u64, vlr: &LazVlr, size: usize) -> Result<u64, Problem> {
    let problem = || {
        let what = "has a compressed chunk whose layers don't fit into it";
        Problem::new(what).at(Location::Byte(at as usize)).help("the file is damaged: copy it again")
    };
    match layers_at(source, at, vlr, size) {
        Ok((points, there)) if there <= bytes => Ok(points),
        Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => Err(unreadable(error)),
        _ => Err(problem()),
    }
}

/// Returns the number of layers in which LASzip compresses an item, a group of a point's fields.
fn layers_of(kind: LazItemType) -> usize {
    match kind {
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(n) => usize::from(n),
        _ => 1,
    }
}

/// Returns the number of points and the number of bytes of the layered chunk at byte offset `at`, as the chunk states
/// them. `size` is the number of bytes of a point record.
fn layers_at(source: &mut dyn Source, at: u64, vlr: &LazVlr, size: usize) -> io::Result<(u64, u64)> {
    let layers: usize = vlr.items().iter().map(|item| layers_of(item.item_type())).sum();
    let mut numbers = vec![0; 4 + 4 * layers];
    source.seek(SeekFrom::Start(at + size as u64))?;
    source.read_exact(&mut numbers)?;
    let mut numbers = numbers.chunks_exact(4).map(|n| u64::from(u32::from_le_bytes(field(n, 0))));
    let points = numbers.next().unwrap_or(0);
    let head_bytes = (size + 4 + 4 * layers) as u64;
    Ok((points, head_bytes + numbers.sum::<u64>()))
}

/// Checks that the layers of the chunk at `at` fit into its `bytes` bytes. Returns the chunk's number of points, if the
/// chunk states it.
pub(super) fn chunk_points(
    source: &mut dyn Source,
    at: u64,
    bytes: u64,
    vlr: &LazVlr,
    size: usize,
) -> Result<Option<u64>, Problem> {
    if is_layered(vlr) { check_layers(source, at, bytes, vlr, size).map(Some) } else { Ok(None) }
}

/// Removes layers from a chunk, so that they aren't decoded: those of the colours if `colors` is true, and those of the
/// extra bytes that are true in `extra`. The chunk begins at byte `start` of `packed` and ends at its end. All points
/// of the chunk get zeros for removed layers. A chunk without layers stays unchanged. [`chunk_points`] must have
/// checked the chunk.
pub(super) fn leave_out(packed: &mut Vec<u8>, start: usize, vlr: &LazVlr, colors: bool, extra: &[bool]) {
    if !is_layered(vlr) {
        return;
    }
    // Removed layers, and the bytes of their values in the first point, which is uncompressed.
    let mut left_out: BTreeMap<usize, Range<usize>> = BTreeMap::new();
    let (mut layers, mut at) = (0, start);
    for item in vlr.items() {
        match item.item_type() {
            LazItemType::RGB14 | LazItemType::RGBNIR14 if colors => {
                left_out.insert(layers, at..at + 6);
            }
            LazItemType::Byte14(_) => {
                let marked = (0..).zip(extra).filter(|(_, is_left_out)| **is_left_out);
                left_out.extend(marked.map(|(i, _)| (layers + i, at + i..at + i + 1)));
            }
            _ => {}
        }
        layers += layers_of(item.item_type());
        at += usize::from(item.size());
    }
    let sizes_at = at + 4;
    let mut from = sizes_at + 4 * layers;
    let mut to = from;
    for layer in 0..layers {
        let size_at = sizes_at + 4 * layer;
        let bytes = u32::from_le_bytes(field(packed, size_at)) as usize;
        if let Some(of_first) = left_out.get(&layer) {
            packed[size_at..size_at + 4].fill(0);
            packed[of_first.clone()].fill(0);
        } else {
            packed.copy_within(from..from + bytes, to);
            to += bytes;
        }
        from += bytes;
    }
    packed.truncate(to);
}

/// Returns the selection of fields that splats are made of. Layers of other fields aren't decoded, which saves time.
pub(super) fn of_splats() -> DecompressionSelection {
    let base = DecompressionSelection::base();
    base.decompress_z().decompress_flags().decompress_rgb().decompress_extra_bytes()
}

/// Decodes consecutive chunks to point records. `chunks` states the number of points and the number of bytes of each.
pub(super) fn decode(packed: &[u8], points: &mut [u8], vlr: &LazVlr, chunks: &[(u64, u64)]) -> Result<(), LasZipError> {
    decode_some(packed, points, vlr, chunks, DecompressionSelection::all())
}

/// Decodes selected fields of consecutive chunks to point records. `chunks` states the number of points and the number
/// of bytes of each.
pub(super) fn decode_some(
    packed: &[u8],
    points: &mut [u8],
    vlr: &LazVlr,
    chunks: &[(u64, u64)],
    fields: DecompressionSelection,
) -> Result<(), LasZipError> {
    let entry = |c: &(u64, u64)| ChunkTableEntry { point_count: c.0, byte_count: c.1 };
    let entries: Vec<ChunkTableEntry> = chunks.iter().map(entry).collect();
    ::laz::laszip::parallel::par_decompress_selective(packed, points, vlr, &entries, fields)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_that_no_memory_holds_are_refused() {
        let mut bytes = vec![7; 3];
        assert!(resize(&mut bytes, 5).is_ok());
        assert_eq!(bytes, [7, 7, 7, 0, 0]);
        assert!(resize(&mut bytes, 2).is_ok());
        let problem = resize(&mut bytes, isize::MAX as usize).unwrap_err().to_string();
        assert!(problem.contains("gives no memory for"), "{problem}");
    }
}
