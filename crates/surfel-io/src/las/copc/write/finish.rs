//! Last step of a conversion: assembles the COPC file from the nodes on disk.

use super::build::Octree;
use super::conversion::Conversion;
use super::{CopcReport, shards};
use crate::las::copc::output::{self, Chunk};
use std::io::{self, Write};

/// Writes the COPC file of an octree to `sink`, and returns the report on it.
pub(super) fn finish(conversion: &Conversion<'_>, octree: Octree, sink: &mut dyn Write) -> io::Result<CopcReport> {
    let Octree { cube, nodes, summary, notes } = octree;
    let mut file = nodes.chunks;
    let (chunks, all) = (std::mem::take(&mut file.chunks), file.bytes);
    let report = shards::report(&summary, &chunks, notes);
    let copied = |bytes| (conversion.task.progress)("writing the file", bytes, all);
    let mut read = |chunk: &Chunk, bytes: &mut [u8]| file.read(chunk, bytes);
    let layout = &conversion.layout;
    output::write(sink, &layout.template, &layout.laz, (&summary, &cube), (chunks, &mut read), &copied)?;
    Ok(report)
}
