//! Assembly of the COPC file: header, variable length records, chunks, chunk table and hierarchy. A *chunk* is the
//! compressed points of a node.

use super::super::header::POINT_BYTES;
use super::octants::cell;
use super::spill::{Changed, checksum};
use super::{ENTRY_BYTES, INFO_BYTES};
use ::laz::laszip::{ChunkTable, ChunkTableEntry};
use ::laz::{LazVlr, LazVlrBuilder};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};

/// A variable length record of the output: either copied from the input, or made by Surfel.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub(super) struct Record {
    /// Reserved bytes, user ID and record ID, as in the file.
    pub(super) head: [u8; 20],
    pub(super) description: [u8; 32],
    pub(super) data: Vec<u8>,
}

impl Record {
    pub(super) fn new(user: &str, id: u16, data: Vec<u8>) -> Self {
        let mut head = [0; 20];
        head[2..2 + user.len()].copy_from_slice(user.as_bytes());
        head[18..].copy_from_slice(&id.to_le_bytes());
        Self { head, description: [0; 32], data }
    }

    pub(super) fn is(&self, user: &str, id: u16) -> bool {
        self.head[2..18].split(|b| *b == 0).next() == Some(user.as_bytes()) && self.head[18..] == id.to_le_bytes()
    }

    fn is_extended(&self) -> bool {
        self.data.len() > usize::from(u16::MAX)
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.head);
        match self.is_extended() {
            true => out.extend_from_slice(&(self.data.len() as u64).to_le_bytes()),
            false => out.extend_from_slice(&(self.data.len() as u16).to_le_bytes()),
        }
        out.extend_from_slice(&self.description);
        out.extend_from_slice(&self.data);
    }
}

/// Statistics of all points, which the output's header states.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct Summary {
    pub(super) count: u64,
    pub(super) low: [i32; 3],
    pub(super) high: [i32; 3],
    /// Number of points by their return number; return 1 is at index 0.
    pub(super) returns: [u64; 15],
    #[serde(with = "bits")]
    pub(super) gps_time: [f64; 2],
}

/// Serialisation of floats by their bits, because JSON can't express infinite numbers.
mod bits {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(times: &[f64; 2], serializer: S) -> Result<S::Ok, S::Error> {
        times.map(f64::to_bits).serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 2], D::Error> {
        <[u64; 2]>::deserialize(deserializer).map(|times| times.map(f64::from_bits))
    }
}

impl Default for Summary {
    fn default() -> Self {
        Self {
            count: 0,
            low: [i32::MAX; 3],
            high: [i32::MIN; 3],
            returns: [0; 15],
            gps_time: [f64::INFINITY, f64::NEG_INFINITY],
        }
    }
}

impl Summary {
    /// Adds a point record of format 6, 7 or 8 to the statistics.
    pub(super) fn add(&mut self, record: &[u8], position: [i32; 3]) {
        self.count += 1;
        for (k, v) in position.into_iter().enumerate() {
            self.low[k] = self.low[k].min(v);
            self.high[k] = self.high[k].max(v);
        }
        if let Some(count) = usize::from(record[14] & 15).checked_sub(1).and_then(|i| self.returns.get_mut(i)) {
            *count += 1;
        }
        let time = f64::from_le_bytes(super::super::field(record, 22));
        if time.is_finite() {
            self.gps_time = [self.gps_time[0].min(time), self.gps_time[1].max(time)];
        }
    }

    /// Adds the statistics of other points to these.
    pub(super) fn add_all(&mut self, other: &Self) {
        self.count = self.count.saturating_add(other.count);
        for k in 0..3 {
            self.low[k] = self.low[k].min(other.low[k]);
            self.high[k] = self.high[k].max(other.high[k]);
        }
        self.returns.iter_mut().zip(other.returns).for_each(|(sum, count)| *sum = sum.saturating_add(count));
        self.gps_time = [self.gps_time[0].min(other.gps_time[0]), self.gps_time[1].max(other.gps_time[1])];
    }
}

/// The cube of the octree's root, in coordinates of the file, and the spacing of points at the root.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub(super) struct Cube {
    pub(super) center: [f64; 3],
    pub(super) half: f64,
    pub(super) spacing: f64,
}

/// Octant and byte range of a node's compressed points in a file of chunks.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub(super) struct Chunk {
    /// Index of the file with the chunk, if there are several such files.
    #[serde(skip)]
    pub(super) file: usize,
    pub(super) level: u32,
    pub(super) code: u64,
    pub(super) at: u64,
    pub(super) bytes: u64,
    pub(super) points: u64,
    /// Checksum of the chunk's bytes.
    pub(super) sum: u32,
}

/// Header fields and variable length records that the output copies from the first input.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub(super) struct Template {
    /// The first 375 bytes of the first input's header; bytes that the header lacks are zero.
    pub(super) header: Vec<u8>,
    pub(super) records: Vec<Record>,
    pub(super) format: u8,
    pub(super) extra_bytes: usize,
    pub(super) scale: [f64; 3],
    pub(super) offset: [f64; 3],
}

impl Template {
    /// Returns the size of a point record in the output, in bytes.
    pub(super) fn record_bytes(&self) -> usize {
        POINT_BYTES[usize::from(self.format)] + self.extra_bytes
    }

    /// Returns the LASzip variable length record, which describes the compression of the output.
    pub(super) fn laz(&self) -> io::Result<LazVlr> {
        let laz = LazVlrBuilder::default().with_point_format(self.format, self.extra_bytes as u16);
        Ok(laz.map_err(|e| io::Error::other(e.to_string()))?.with_variable_chunk_size().build())
    }
}

/// Callback that reads the bytes of a chunk.
pub(super) type ReadChunk<'a> = &'a mut dyn FnMut(&Chunk, &mut [u8]) -> io::Result<()>;

/// Writes the COPC file. Chunks are in order of level, so that the coarse levels can be read at once. `read` reads the
/// bytes of a chunk; `copied` receives the number of chunk bytes written so far, as progress.
pub(super) fn write(
    out: &mut dyn Write,
    of: &Template,
    laz: &LazVlr,
    (summary, cube): (&Summary, &Cube),
    (mut chunks, read): (Vec<Chunk>, ReadChunk<'_>),
    copied: &dyn Fn(u64),
) -> io::Result<()> {
    chunks.sort_unstable_by_key(|chunk| (chunk.level, chunk.code));
    let mut laszip = Vec::new();
    laz.write_to(&mut laszip)?;
    let (long, short): (Vec<&Record>, Vec<&Record>) = of.records.iter().partition(|r| r.is_extended());
    let laszip = Record::new("laszip encoded", 22_204, laszip);
    let own = [54 + INFO_BYTES, 54 + laszip.data.len()];
    let start = (375 + own.iter().sum::<usize>() + short.iter().map(|r| 54 + r.data.len()).sum::<usize>()) as u64;
    let mut table = ChunkTable::with_capacity(chunks.len());
    let (mut at, mut hierarchy) = (start + 8, Vec::with_capacity(chunks.len() * ENTRY_BYTES));
    for entry in with_parents(&chunks) {
        let (level, code, chunk) = entry;
        hierarchy.extend_from_slice(&(level as i32).to_le_bytes());
        cell(code).iter().for_each(|v| hierarchy.extend_from_slice(&(*v as i32).to_le_bytes()));
        let (offset, bytes, points) = chunk.map_or((0, 0, 0), |c| (at, c.bytes as i32, c.points as i32));
        hierarchy.extend_from_slice(&offset.to_le_bytes());
        hierarchy.extend_from_slice(&bytes.to_le_bytes());
        hierarchy.extend_from_slice(&points.to_le_bytes());
        if let Some(chunk) = chunk {
            table.push(ChunkTableEntry { point_count: chunk.points, byte_count: chunk.bytes });
            at += chunk.bytes;
        }
    }
    let mut packed_table = Vec::new();
    table.write_to(&mut packed_table, laz)?;
    let extended_at = at + packed_table.len() as u64;
    let hierarchy_at = extended_at + 60;

    let mut head = of.header.clone();
    let records = Records { count: short.len() + 2, extended_at, extended: long.len() + 1 };
    header(&mut head, of, summary, start, records);
    let mut info = Vec::with_capacity(INFO_BYTES);
    let time = if summary.gps_time[0] <= summary.gps_time[1] { summary.gps_time } else { [0.0; 2] };
    for value in cube.center.into_iter().chain([cube.half, cube.spacing]) {
        info.extend_from_slice(&value.to_le_bytes());
    }
    info.extend_from_slice(&hierarchy_at.to_le_bytes());
    info.extend_from_slice(&(hierarchy.len() as u64).to_le_bytes());
    time.iter().for_each(|t| info.extend_from_slice(&t.to_le_bytes()));
    info.resize(INFO_BYTES, 0);
    Record::new("copc", 1, info).write(&mut head);
    laszip.write(&mut head);
    short.iter().for_each(|record| record.write(&mut head));
    head.extend_from_slice(&(at as i64).to_le_bytes());
    out.write_all(&head)?;
    let (mut bytes, mut done) = (Vec::new(), 0);
    for chunk in &chunks {
        bytes.resize(chunk.bytes as usize, 0);
        read(chunk, &mut bytes)?;
        if checksum(&bytes) != chunk.sum {
            return Err(io::Error::other(Changed(chunk.at)));
        }
        out.write_all(&bytes)?;
        done += chunk.bytes;
        copied(done);
    }
    out.write_all(&packed_table)?;
    let mut tail = Vec::new();
    // The hierarchy is stored as an extended record, even if it is short.
    let mut pages = Record::new("copc", 1000, Vec::new());
    pages.description[..13].copy_from_slice(b"EPT Hierarchy");
    tail.extend_from_slice(&pages.head);
    tail.extend_from_slice(&(hierarchy.len() as u64).to_le_bytes());
    tail.extend_from_slice(&pages.description);
    tail.extend_from_slice(&hierarchy);
    long.iter().for_each(|record| record.write(&mut tail));
    out.write_all(&tail)
}

/// Returns the level, Morton code and chunk of the nodes with chunks and of their ancestors, in order of level.
/// Ancestors without points have no chunk.
fn with_parents(chunks: &[Chunk]) -> Vec<(u32, u64, Option<Chunk>)> {
    let mut nodes: std::collections::BTreeMap<(u32, u64), Option<Chunk>> = std::collections::BTreeMap::new();
    for chunk in chunks {
        for above in 1..=chunk.level {
            nodes.entry((chunk.level - above, chunk.code >> (3 * above))).or_default();
        }
        nodes.insert((chunk.level, chunk.code), Some(*chunk));
    }
    nodes.into_iter().map(|((level, code), chunk)| (level, code, chunk)).collect()
}

/// Number of variable length records, number of extended ones (EVLRs), and position of the latter, for the output's
/// header.
struct Records {
    count: usize,
    /// Byte offset in the file of the extended variable length records.
    extended_at: u64,
    extended: usize,
}

/// Converts `h`, the header of the first input, to that of the output. `start` is the byte offset of the output's point
/// data.
fn header(h: &mut [u8], of: &Template, summary: &Summary, start: u64, records: Records) {
    let mut put = |at: usize, bytes: &[u8]| h[at..at + bytes.len()].copy_from_slice(bytes);
    let mut software = [0; 32];
    let name = concat!("Surfel ", env!("CARGO_PKG_VERSION")).as_bytes();
    software[..name.len()].copy_from_slice(name);
    put(0, b"LASF");
    put(24, &[1, 4]);
    put(58, &software);
    put(94, &375_u16.to_le_bytes());
    put(96, &(start as u32).to_le_bytes());
    put(100, &(records.count as u32).to_le_bytes());
    put(104, &[of.format | 0x80]);
    put(105, &(of.record_bytes() as u16).to_le_bytes());
    // Legacy point counts of LAS 1.0 to 1.3.
    put(107, &[0; 24]);
    for k in 0..3 {
        put(131 + 8 * k, &of.scale[k].to_le_bytes());
        put(155 + 8 * k, &of.offset[k].to_le_bytes());
        let ends = [summary.high[k], summary.low[k]].map(|v| f64::from(v) * of.scale[k] + of.offset[k]);
        put(179 + 16 * k, &ends[0].max(ends[1]).to_le_bytes());
        put(187 + 16 * k, &ends[0].min(ends[1]).to_le_bytes());
    }
    // No waveforms.
    put(227, &[0; 8]);
    put(235, &records.extended_at.to_le_bytes());
    put(243, &(records.extended as u32).to_le_bytes());
    put(247, &summary.count.to_le_bytes());
    for (i, count) in summary.returns.iter().enumerate() {
        put(255 + 8 * i, &count.to_le_bytes());
    }
    // The flags of GPS time and synthetic returns are copied; the WKT flag is set if there is a WKT record.
    let flags = u16::from_le_bytes([h[6], h[7]]) & 0b1001;
    let wkt = if of.records.iter().any(|r| r.is("LASF_Projection", 2112)) { 16 } else { 0 };
    h[6..8].copy_from_slice(&(flags | wkt).to_le_bytes());
}
