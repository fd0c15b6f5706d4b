//! The nodes of an octree on disk: compressed chunks, and records of nodes that are still incomplete. A *chunk* is the
//! compressed points of a node. A *part* is a subtree of the octree that is built in memory.

use super::conversion::Conversion;
use super::inputs::Stop;
use super::parts::{Packed, packed};
use super::resume;
use crate::las::copc::octants::VoxelKey;
use crate::las::copc::output::Chunk;
use crate::las::copc::spill::{Index, Spill, checksum};
use ::laz::LazVlr;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};

/// Number of bytes of point records from which on a batch of nodes above the parts is compressed.
const BATCH_BYTES: usize = 64 << 20;

/// Temporary file with the chunks of compressed nodes, and the position of each chunk.
pub(super) struct ChunkFile {
    file: File,
    pub(super) chunks: Vec<Chunk>,
    /// Number of bytes of all chunks.
    pub(super) bytes: u64,
}

impl ChunkFile {
    pub(super) fn new(file: File) -> Self {
        Self { file, chunks: Vec::new(), bytes: 0 }
    }

    pub(super) fn append(&mut self, nodes: Vec<Packed>) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.bytes))?;
        for Packed { key: VoxelKey { level, code }, points, bytes } in nodes {
            self.file.write_all(&bytes)?;
            let (sum, bytes) = (checksum(&bytes), bytes.len() as u64);
            self.chunks.push(Chunk { file: 0, level, code, at: self.bytes, bytes, points, sum });
            self.bytes += bytes;
        }
        Ok(())
    }

    pub(super) fn read(&mut self, chunk: &Chunk, bytes: &mut [u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(chunk.at))?;
        self.file.read_exact(bytes)
    }

    /// Returns the file, to be read from its start.
    pub(super) fn rewound(&mut self) -> io::Result<&mut File> {
        self.file.rewind()?;
        Ok(&mut self.file)
    }
}

/// Saved state after `parts` parts are built.
#[derive(Default, Deserialize, Serialize)]
pub(super) struct BuiltState {
    parts: usize,
    points: u64,
    chunks: Vec<Chunk>,
    chunk_bytes: u64,
    upper: Index<VoxelKey>,
}

/// Nodes of the parts that are built so far, and points of nodes above the parts.
pub(super) struct Nodes {
    pub(super) chunks: ChunkFile,
    /// Point records of nodes above the parts, which are compressed when all parts are built.
    pub(super) upper: Spill<VoxelKey>,
    /// Number of parts that an earlier run built.
    pub(super) parts_built: usize,
    /// Number of points of all built parts.
    pub(super) points: u64,
}

impl Nodes {
    /// Opens the nodes on disk, with those of an earlier run's `state`.
    pub(super) fn open(conversion: &Conversion<'_>, state: BuiltState) -> Result<Self, Stop> {
        let BuiltState { parts, points, chunks, chunk_bytes: bytes, upper } = state;
        let upper = Spill::of(conversion.file(resume::UPPER, upper.end)?, upper);
        let chunks = ChunkFile { file: conversion.file(resume::CHUNKS, bytes)?, chunks, bytes };
        Ok(Self { chunks, upper, parts_built: parts, points })
    }

    /// Saves the state after `parts` built parts, if the conversion saves progress.
    pub(super) fn keep(&mut self, conversion: &Conversion<'_>, parts: usize) -> Result<(), Stop> {
        let Some(kept) = conversion.task.kept else { return Ok(()) };
        self.chunks.file.sync_data()?;
        let (chunks, upper) = (std::mem::take(&mut self.chunks.chunks), self.upper.stored()?);
        let state = BuiltState { parts, points: self.points, chunks, chunk_bytes: self.chunks.bytes, upper };
        kept.save(resume::BUILT, &state)?;
        self.chunks.chunks = state.chunks;
        Ok(())
    }

    /// Compresses the nodes above the parts.
    pub(super) fn compress_upper(&mut self, laz: &LazVlr) -> io::Result<()> {
        let mut keys: Vec<VoxelKey> = self.upper.sizes().map(|(key, _)| key).collect();
        keys.sort_unstable();
        let mut batch: Vec<(VoxelKey, Vec<u8>)> = Vec::new();
        for key in keys {
            let list = self.upper.take(key);
            batch.push((key, self.upper.bytes_of(&[list])?));
            if batch.iter().map(|(_, records)| records.len()).sum::<usize>() > BATCH_BYTES {
                self.chunks.append(packed(std::mem::take(&mut batch), laz)?)?;
            }
        }
        self.chunks.append(packed(batch, laz)?)
    }
}
