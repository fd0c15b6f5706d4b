//! Shard files, and merging them into one COPC file.
//!
//! A shard file begins with a signature and the length of a JSON head. The head describes the conversion, the chunks,
//! and the positions of the records of nodes above the parts. The chunks and these records follow.

use super::CopcReport;
use super::build::Octree;
use super::conversion::Conversion;
use super::inputs::Input;
use super::nodes::ChunkFile;
use super::parts::packed;
use crate::error::ShowPath as _;
use crate::error::{IoError, Problem, READ};
use crate::las::copc::octants::{BITS, VoxelKey};
use crate::las::copc::output::{self, Chunk, Cube, Summary, Template};
use crate::las::copc::spill::{Block, Blocks, Index, checksum};
use crate::las::field;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const SIGNATURE: [u8; 8] = *b"SURFELS1";
const HEAD_BYTES: u64 = 16;
/// Number of bytes that are copied at a time.
const COPIED_BYTES: u64 = 8 << 20;

/// Properties that all shards of a conversion share.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct Common {
    version: String,
    /// Size of each input, in bytes.
    inputs: Vec<u64>,
    template: Template,
    cube: Cube,
    /// Minimum and maximum corner of all points by the inputs' headers, in steps of the coordinate scale.
    ends: [[i32; 3]; 2],
}

/// Head of a shard file.
#[derive(Debug, Deserialize, Serialize)]
struct Head {
    /// Index and count of the shard.
    shard: [u32; 2],
    common: Common,
    summary: Summary,
    chunks: Vec<Chunk>,
    chunk_bytes: u64,
    upper: Index<VoxelKey>,
}

/// True if a file is a shard file.
pub(super) fn is_shard(path: &Path) -> bool {
    let mut found = [0; 8];
    File::open(path).and_then(|mut file| file.read_exact(&mut found)).is_ok() && found == SIGNATURE
}

/// Writes a shard file of an octree to `sink`, and returns the report on it.
pub(super) fn write(
    conversion: &Conversion<'_>,
    inputs: &[Input],
    octree: Octree,
    shard: [u32; 2],
    sink: &mut dyn Write,
) -> io::Result<CopcReport> {
    let Octree { cube, nodes, summary, notes } = octree;
    let (mut file, mut records) = (nodes.chunks, nodes.upper);
    let inputs = inputs.iter().map(|input| input.file_bytes).collect();
    let ends = conversion.shard_range.as_ref().map(|range| range.ends).unwrap_or_default();
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let common = Common { version, inputs, template: conversion.layout.template.clone(), cube, ends };
    let mut keys: Vec<(VoxelKey, u64)> = records.sizes().collect();
    keys.sort_unstable();
    let mut upper = Index::default();
    let mut lists = Vec::with_capacity(keys.len());
    for (key, bytes) in &keys {
        let list = [records.take(*key)];
        upper.lists.push((*key, vec![(upper.end, *bytes as usize, checksum(&records.bytes_of(&list)?))]));
        upper.end += bytes;
        lists.extend(list);
    }
    let all = file.bytes + upper.end;
    let progress = |done| (conversion.task.progress)("writing the file", done, all);
    let (chunks, chunk_bytes) = (std::mem::take(&mut file.chunks), file.bytes);
    let report = report(&summary, &chunks, notes);
    let head = serde_json::to_vec(&Head { shard, common, summary, chunks, chunk_bytes, upper })?;
    sink.write_all(&SIGNATURE)?;
    sink.write_all(&(head.len() as u64).to_le_bytes())?;
    sink.write_all(&head)?;
    let chunk_file = file.rewound()?;
    let mut done = 0;
    while done < chunk_bytes {
        let now = (chunk_bytes - done).min(COPIED_BYTES);
        if io::copy(&mut (&mut *chunk_file).take(now), sink)? < now {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        done += now;
        progress(done);
    }
    for (list, (_, bytes)) in lists.into_iter().zip(keys) {
        records.read(&list, &mut |block| sink.write_all(block))?;
        done += bytes;
        progress(done);
    }
    Ok(report)
}

/// Returns the report of an existing shard, if it was made from these inputs in their present state; else an error. The
/// version of Surfel and the sizes of the inputs must match, and no input may be newer than the shard.
pub(super) fn done(inputs: &[PathBuf], output: &Path, shard: [u32; 2]) -> Result<CopcReport, IoError> {
    let found = Shard::open(output)?;
    let stated = |path: &Path| {
        let stated = path.metadata().and_then(|of| Ok((of.len(), of.modified()?)));
        stated.map_err(|source| IoError::System { path: path.to_path_buf(), action: READ, source })
    };
    let written = stated(output)?.1;
    let inputs = inputs.iter().map(|path| Ok((path, stated(path)?))).collect::<Result<Vec<_>, IoError>>()?;
    let Head { shard: [index, count], common, summary, chunks, .. } = &found.head;
    let what = match inputs.iter().find(|(_, (_, changed))| *changed > written) {
        _ if common.version != env!("CARGO_PKG_VERSION") => format!("is of Surfel {}", common.version),
        _ if [*index, *count] != shard => format!("is shard {index} of {count}"),
        _ if !common.inputs.iter().eq(inputs.iter().map(|(_, (bytes, _))| bytes)) => {
            "is a shard of other inputs".into()
        }
        Some((path, _)) => format!("is older than {}", path.shown()),
        None => return Ok(report(summary, chunks, Vec::new())),
    };
    let problem = Problem::new(what).expected(format!("shard {} of {} of these inputs", shard[0], shard[1]));
    let help = "delete it, or give `force`, to write it again";
    Err(IoError::Invalid { path: output.to_path_buf(), problem: Box::new(problem.help(help)) })
}

pub(super) fn report(summary: &Summary, chunks: &[Chunk], notes: Vec<String>) -> CopcReport {
    let levels = chunks.iter().map(|chunk| chunk.level + 1).max().unwrap_or(0);
    CopcReport { points: summary.count, nodes: chunks.len(), levels, notes }
}

/// An open shard file whose head is read.
struct Shard {
    path: PathBuf,
    head: Head,
    /// Byte offset of the first chunk.
    start: u64,
}

impl Shard {
    fn open(path: &Path) -> Result<Self, IoError> {
        let system = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
        let invalid = |problem| IoError::Invalid { path: path.to_path_buf(), problem: Box::new(problem) };
        let damaged = |what: String| invalid(Problem::new(what).help("copy the file again, or write this shard again"));
        let mut file = File::open(path).map_err(system)?;
        let file_bytes = file.metadata().map_err(system)?.len();
        let mut begin = Vec::new();
        (&mut file).take(HEAD_BYTES).read_to_end(&mut begin).map_err(system)?;
        if !begin.starts_with(&SIGNATURE) {
            let problem = Problem::new("is no shard of a conversion").expected("shards only, as others of the inputs");
            return Err(invalid(problem.help("put all that `shard` wrote together, and nothing else")));
        }
        let head_bytes = if begin.len() < 16 { u64::MAX } else { u64::from_le_bytes(field(&begin, 8)) };
        let start = HEAD_BYTES.saturating_add(head_bytes);
        if start > file_bytes {
            return Err(damaged(format!("is cut off within its head, at byte {file_bytes}")));
        }
        let mut json = Vec::new();
        (&mut file).take(head_bytes).read_to_end(&mut json).map_err(system)?;
        let head: Head = serde_json::from_slice(&json).map_err(|e| damaged(format!("has a damaged head: {e}")))?;
        let expected = start.checked_add(head.chunk_bytes).and_then(|v| v.checked_add(head.upper.end));
        if expected != Some(file_bytes) {
            return Err(damaged(format!("has {file_bytes} bytes, and its head says another number")));
        }
        match head.check() {
            Some(what) => Err(damaged(what.to_owned())),
            None => Ok(Self { path: path.to_path_buf(), head, start }),
        }
    }

    /// Fills `bytes` from byte `at` on, counted from the end of the head.
    fn read(&self, file: &mut File, at: u64, bytes: &mut [u8]) -> io::Result<()> {
        file.seek(SeekFrom::Start(self.start + at))?;
        file.read_exact(bytes)
    }
}

impl Head {
    /// Returns a description of the first inconsistency in the head, if there is one.
    fn check(&self) -> Option<&'static str> {
        let Common { template, cube, .. } = &self.common;
        let is_octant = |level: u32, code: u64| level <= BITS && code >> (3 * level) == 0;
        let is_size = |v: f64| v.is_finite() && v > 0.0;
        let sound = matches!(template.format, 6..=8)
            && template.header.len() == 375
            && template.extra_bytes <= usize::from(u16::MAX) - 100
            && template.scale.iter().all(|v| v.is_finite() && *v != 0.0)
            && template.offset.iter().chain(&cube.center).all(|v| v.is_finite())
            && is_size(cube.half)
            && is_size(cube.spacing)
            && self.shard[0] < self.shard[1];
        if !sound {
            return Some("says what can't be of its points");
        }
        let record_bytes = template.record_bytes() as u64;
        let (mut points, mut chunk_bytes, mut upper_bytes) = (0_u64, 0_u64, 0_u64);
        for Chunk { level, code, at, bytes, points: own, .. } in &self.chunks {
            let within = at.checked_add(*bytes).is_some_and(|end| end <= self.chunk_bytes);
            let counts = (1..=i32::MAX as u64).contains(own) && (record_bytes..=i32::MAX as u64).contains(bytes);
            if !within || !counts || !is_octant(*level, *code) {
                return Some("has a node that isn't within it");
            }
            points = points.saturating_add(*own);
            chunk_bytes = chunk_bytes.saturating_add(*bytes);
        }
        for (key, blocks) in &self.upper.lists {
            let within =
                |(at, bytes, _): &Block| at.checked_add(*bytes as u64).is_some_and(|end| end <= self.upper.end);
            let bytes = blocks.iter().fold(0_u64, |sum, block| sum.saturating_add(block.1 as u64));
            if !is_octant(key.level, key.code) || !blocks.iter().all(within) || bytes % record_bytes != 0 {
                return Some("has records of a node that aren't within it");
            }
            points = points.saturating_add(bytes / record_bytes);
            upper_bytes = upper_bytes.saturating_add(bytes);
        }
        if chunk_bytes > self.chunk_bytes || upper_bytes > self.upper.end {
            return Some("has nodes that overlap");
        }
        (points != self.summary.count).then_some("has not as many points as it says")
    }
}

/// Opens all shards of one conversion and returns them in order of their index. Returns an error if a shard is missing
/// or belongs to another conversion.
fn open_all(paths: &[PathBuf]) -> Result<Vec<Shard>, IoError> {
    let mut shards = paths.iter().map(|path| Shard::open(path)).collect::<Result<Vec<_>, _>>()?;
    shards.sort_by_key(|shard| shard.head.shard[0]);
    let count = shards.first().map_or(0, |shard| shard.head.shard[1]);
    for (i, shard) in shards.iter().enumerate() {
        let unlike = |what: String, expected: String, help: &str| {
            let problem = Problem::new(what).expected(expected).help(help);
            IoError::Invalid { path: shard.path.clone(), problem: Box::new(problem) }
        };
        let ([index, of], first) = (shard.head.shard, &shards[0]);
        if of != count || shard.head.common != first.head.common {
            let expected = format!("one of the {count} of the same inputs, as {}", first.path.shown());
            return Err(unlike(format!("is shard {index} of {of} of another conversion"), expected, "write it again"));
        }
        if index as usize != i {
            let what = format!("is shard {index} of {count}, and {i} is not there once");
            return Err(unlike(what, format!("each of 0 to {} once", count - 1), "write those that are missing"));
        }
    }
    if let Some(last) = shards.last().filter(|_| shards.len() < count as usize) {
        let what = format!("is the last of {} shards, expected {count}", shards.len());
        let problem = Problem::new(what).help("write those that are missing");
        return Err(IoError::Invalid { path: last.path.clone(), problem: Box::new(problem) });
    }
    Ok(shards)
}

/// Merges all shards of a conversion into one COPC file.
pub(super) fn merge(
    paths: &[PathBuf],
    output: &Path,
    overwrite: bool,
    progress: &dyn Fn(&'static str, u64, u64),
) -> Result<CopcReport, IoError> {
    let shards = open_all(paths)?;
    let unreadable = |path: &Path, source| IoError::System { path: path.to_path_buf(), action: READ, source };
    let Some(Shard { head: Head { common: Common { template, cube, ends, .. }, .. }, .. }) = shards.first() else {
        return Err(unreadable(output, io::Error::other("no input is given")));
    };
    let (mut summary, mut chunks) = (Summary::default(), Vec::new());
    // For each node above the parts, the indices of the shards with records of it, and the blocks of these records.
    let mut upper: BTreeMap<VoxelKey, Vec<(usize, &Blocks)>> = BTreeMap::new();
    for (i, shard) in shards.iter().enumerate() {
        summary.add_all(&shard.head.summary);
        chunks.extend(shard.head.chunks.iter().map(|chunk| Chunk { file: i, ..*chunk }));
        for (key, blocks) in &shard.head.upper.lists {
            upper.entry(*key).or_default().push((i, blocks));
        }
    }
    let twice = |path: &Path| {
        let problem =
            Problem::new("has a node that another shard has, too").help("the file is damaged: write it again");
        IoError::Invalid { path: path.to_path_buf(), problem: Box::new(problem) }
    };
    let mut keys: Vec<(u32, u64, usize)> = chunks.iter().map(|c| (c.level, c.code, c.file)).collect();
    keys.extend(upper.keys().map(|key| (key.level, key.code, 0)));
    keys.sort_unstable();
    if let Some(same) = keys.windows(2).find(|w| (w[0].0, w[0].1) == (w[1].0, w[1].1)) {
        return Err(twice(&shards[same[1].2].path));
    }
    if summary.count == 0 {
        let problem = Problem::new("holds no point, and no other shard does").expected("at least one");
        return Err(IoError::Invalid { path: shards[0].path.clone(), problem: Box::new(problem) });
    }
    let written = crate::atomic::write(output, overwrite, |sink| {
        let laz = template.laz()?;
        let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut made = ChunkFile::new(crate::las::copc::spill::unnamed(folder)?);
        // The chunks of a shard are consecutive, so that one file is open at a time.
        let mut opened: Option<(usize, File)> = None;
        let mut read = |i: usize, at: u64, bytes: &mut [u8]| {
            let shard: &Shard = &shards[i];
            let mut get = || {
                if opened.as_ref().is_none_or(|(at, _)| *at != i) {
                    opened = Some((i, File::open(&shard.path)?));
                }
                opened.as_mut().map_or(Ok(()), |(_, file)| shard.read(file, at, bytes))
            };
            get().map_err(|source| io::Error::other(unreadable(&shard.path, source)))
        };
        for (key, parts) in &upper {
            let mut records = Vec::new();
            for (i, blocks) in parts {
                for (at, bytes, sum) in *blocks {
                    let end = records.len();
                    records.resize(end + bytes, 0);
                    read(*i, shards[*i].head.chunk_bytes + at, &mut records[end..])?;
                    if checksum(&records[end..]) != *sum {
                        return Err(changed_shard(&shards[*i].path, *at));
                    }
                }
            }
            made.append(packed(vec![(*key, records)], &laz)?)?;
        }
        chunks.extend(made.chunks.iter().map(|chunk| Chunk { file: shards.len(), ..*chunk }));
        let all = chunks.iter().map(|chunk| chunk.bytes).sum();
        let mut read_chunk = |chunk: &Chunk, bytes: &mut [u8]| match chunk.file == shards.len() {
            true => made.read(chunk, bytes),
            false => {
                read(chunk.file, chunk.at, bytes)?;
                let is_same = checksum(bytes) == chunk.sum;
                if is_same { Ok(()) } else { Err(changed_shard(&shards[chunk.file].path, chunk.at)) }
            }
        };
        let copied = |bytes| progress("writing the file", bytes, all);
        output::write(sink, template, &laz, (&summary, cube), (chunks.clone(), &mut read_chunk), &copied)
    });
    written.map(|()| {
        let is_wider = [summary.low, summary.high] != *ends;
        let note = "the inputs' headers have wider bounds than their points: the octree is as large as they say, and \
                    may be smaller without `shard`";
        report(&summary, &chunks, if is_wider { vec![note.to_owned()] } else { Vec::new() })
    })
}

/// Returns the error of a shard whose bytes have changed. `at` is the byte offset from the end of the shard's head.
fn changed_shard(path: &Path, at: u64) -> io::Error {
    let problem = Problem::new(format!("is damaged: bytes from {at} behind its head have changed"));
    let problem = Box::new(problem.help("copy the file again, or write this shard again"));
    io::Error::other(IoError::Invalid { path: path.to_path_buf(), problem })
}
