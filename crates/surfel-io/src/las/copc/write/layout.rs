//! Layout of the records of a conversion, which follows from the first input.

use super::extra_bytes::descriptions;
use super::inputs::{Input, Stop, invalid};
use crate::error::Problem;
use crate::las::copc::output::{Record, Template};
use crate::las::copc::records;
use crate::las::copc::{LEVEL_COLORS, NORMALS, RADIUS};
use crate::las::header::POINT_BYTES;
use ::laz::LazVlr;

/// Layout of the records that are sorted and written.
pub(super) struct Layout {
    pub(super) template: Template,
    /// LASzip variable length record of the output, which describes the compression of its points.
    pub(super) laz: LazVlr,
    /// Number of bytes of a sorted record: the standard's fields and the inputs' extra bytes, without those that Surfel
    /// computes again.
    pub(super) sorted_bytes: usize,
    /// Components of the normal in the inputs' extra bytes; `None` if there are none. Of each component: byte offset in
    /// a record, number of the type in the LAS standard, factor, and number that is then added.
    pub(super) normals: Option<[(usize, u8, f64, f64); 3]>,
    /// True if Surfel's extra bytes include normals.
    pub(super) adds_normals: bool,
}

impl Layout {
    /// Determines the layout from the first input and `raw`, the first 375 bytes of its header. With `prepares`, points
    /// get Surfel's extra bytes for splats.
    pub(super) fn of(first: &Input, raw: &[u8], prepares: bool) -> Result<Self, Stop> {
        let records = first.records(raw)?;
        let format = records::target(first.header.format);
        let after = POINT_BYTES[usize::from(first.header.format)];
        let extra = &first.header.extra;
        // Extra bytes that Surfel wrote into an input are at the end of its records, and are computed again.
        let own = extra.iter().find(|e| e.name == RADIUS || e.name == LEVEL_COLORS[0]).map(|e| e.at);
        let kept_bytes = own.unwrap_or(first.header.record_bytes - after);
        let normals = NORMALS.map(|name| extra.iter().find(|e| e.name == name && e.at < kept_bytes));
        let normals = match normals {
            [Some(x), Some(y), Some(z)] => Some([x, y, z].map(|e| {
                let (scale, offset) = e.scaled.unwrap_or((1.0, 0.0));
                (POINT_BYTES[usize::from(format)] + e.at, e.kind, scale, offset)
            })),
            _ => None,
        };
        let adds_normals = prepares && normals.is_none();
        let described = records.iter().find(|r| r.is("LASF_Spec", 4)).map(|r| r.data.clone()).unwrap_or_default();
        let (descriptions, added) = descriptions(&described, kept_bytes, prepares, adds_normals, format >= 7);
        let mut records: Vec<Record> = records.into_iter().filter(|r| !r.is("LASF_Spec", 4)).collect();
        if !descriptions.is_empty() {
            records.push(Record::new("LASF_Spec", 4, descriptions));
        }
        let point_bytes = POINT_BYTES[usize::from(format)] + kept_bytes + added;
        if point_bytes > usize::from(u16::MAX) {
            let what = format!("has points of {} bytes, which become {point_bytes}", first.header.record_bytes);
            let problem = Problem::new(what).expected(format!("at most {}, to be written by levels", u16::MAX));
            return Err(invalid(&first.path, problem));
        }
        let mut header = raw.to_vec();
        header.resize(375, 0);
        let (scale, offset) = (first.header.scale, first.header.offset);
        let extra_bytes = kept_bytes + added;
        let template =
            Template { header, records, format, extra_bytes, scale: scale.to_array(), offset: offset.to_array() };
        let sorted_bytes = POINT_BYTES[usize::from(format)] + kept_bytes;
        Ok(Self { laz: template.laz()?, template, sorted_bytes, normals, adds_normals })
    }
}
