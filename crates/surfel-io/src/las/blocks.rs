//! Reading of a LAS file's points block by block, for passes that need each point once. Memory doesn't grow with the
//! number of points.

use super::header::Header;
use super::records::Columns;
use super::{PointFacts, Sink, field, read_records, tell};
use crate::color::{linear_of_8_bit, linear_of_16_bit};
use crate::context::Context;
use crate::error::{Fault, Problem};
use crate::format::Format;
use crate::survey::Source;
use glam::DVec3;
use std::io::SeekFrom;
use surfel_model::PointCloud;

/// Properties of a file as a whole, which [`read`] returns after it has passed all points on.
pub(crate) struct Blocks {
    /// An empty point cloud with the comments that apply to all points of the file.
    pub(crate) cloud: PointCloud,
    pub(crate) bounds: Option<(DVec3, DVec3)>,
    /// Minimum and maximum of each colour channel over all points, in linear RGB; `None` if the file has no colours or
    /// only black.
    pub(crate) colors: Option<([f32; 3], [f32; 3])>,
}

struct BlockSink<'a> {
    header: Option<Header>,
    told: PointFacts,
    /// Minimum and maximum 16-bit level of each colour channel over the points so far.
    levels: Option<([u16; 3], [u16; 3])>,
    each: &'a mut dyn FnMut(PointCloud),
}

impl Sink for BlockSink<'_> {
    fn start(&mut self, header: &Header, _: usize) {
        self.header = Some(header.clone());
    }

    fn append(&mut self, records: &mut [u8]) -> Result<(), Problem> {
        let Some(header) = &self.header else { return Ok(()) };
        let count = records.len() / header.record_bytes;
        let mut columns = Columns::new(header, count);
        let color_at = columns.remove_colors();
        columns.append(records);
        self.told.withheld += columns.withheld;
        // `append` has moved the records that aren't withheld to the front.
        let records = &records[..columns.len() * header.record_bytes];
        for record in records.chunks_exact(header.record_bytes) {
            let Some(at) = color_at else { break };
            let rgb = [0, 1, 2].map(|k| u16::from_le_bytes(field(record, at + 2 * k)));
            let (low, high) = self.levels.get_or_insert((rgb, rgb));
            (0..3).for_each(|k| (low[k], high[k]) = (low[k].min(rgb[k]), high[k].max(rgb[k])));
        }
        let Some((low, high)) = columns.ends() else { return Ok(()) };
        // Bounds of the block in the file's coordinates, before rounding to f32. A scale may be negative.
        let at = |p: [i32; 3]| DVec3::new(p[0].into(), p[1].into(), p[2].into()) * header.scale + header.offset;
        let (low, high) = (at(low).min(at(high)), at(low).max(at(high)));
        let (cloud, _) = columns.finish(header);
        let (l, h) = self.told.bounds.unwrap_or((low, high));
        self.told.bounds = Some((l.min(low), h.max(high)));
        self.told.count += cloud.len();
        (self.each)(cloud);
        Ok(())
    }
}

/// Passes all points of a file to `each`, block by block, without colours and row numbers. Returns the properties of
/// the whole file.
pub(crate) fn read(
    source: &mut dyn Source,
    format: Format,
    each: &mut dyn FnMut(PointCloud),
    context: &mut Context<'_>,
) -> Result<Blocks, Fault> {
    let file_bytes = source.seek(SeekFrom::End(0)).map_err(super::unreadable)?;
    let mut header = Header::read(source, file_bytes)?;
    let mut sink = BlockSink { header: None, told: PointFacts::default(), levels: None, each };
    read_records(source, &mut header, file_bytes, context.options.repair, &mut sink)?;
    let BlockSink { mut told, levels, .. } = sink;
    // Same rule as for colours in memory: all black means no colours, and a maximum of 255 means 8 bits.
    let largest = levels.map_or(0, |(_, high)| high.into_iter().max().unwrap_or(0));
    let table = if largest > 255 { linear_of_16_bit() } else { &linear_of_8_bit()[..] };
    let linear = |levels: [u16; 3]| levels.map(|level| table[usize::from(level)]);
    let colors = levels.filter(|_| largest > 0).map(|(low, high)| (linear(low), linear(high)));
    told.has_colors = colors.is_some();
    told.has_8_bit_colors = colors.is_some() && largest <= 255;
    let bounds = told.bounds;
    let cloud = PointCloud { comments: header.comments(), ..PointCloud::default() };
    tell(header, format, told, context)?;
    Ok(Blocks { cloud, bounds, colors })
}
