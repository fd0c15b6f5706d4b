//! The public header block and the variable length records of LAS (ASPRS LAS 1.4 R15). Versions 1.0 to 1.3 have fewer
//! fields. Version 1.5 adds fields after byte 375, which aren't needed to find the points.

use crate::crs::{Crs, GeoKeys};
use crate::error::{Location, Problem};
use crate::survey::{Source, one_line};
use glam::DVec3;
use std::io::{self, SeekFrom};

/// Maximum number of bytes of a variable length record that is read; larger ones are ignored. Well-known text (WKT) has
/// a few thousand.
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// Fields of a LAS header, and contents of the variable length records.
#[derive(Clone, Debug)]
pub(super) struct Header {
    /// Minor version of LAS: 4 for LAS 1.4.
    pub(super) minor: u8,
    /// Name of the program that wrote the file.
    pub(super) software: String,
    /// Point data record format, 0 to 10.
    pub(super) format: u8,
    pub(super) compressed: bool,
    /// Number of bytes of a point record, with extra bytes.
    pub(super) record_bytes: usize,
    /// Byte offset of the point data. In a file compressed in chunks, the offset of the chunk table takes the first 8
    /// bytes there, and the first chunk follows.
    pub(super) start: u64,
    /// Byte offset at which the points end at the latest, because something else or the end of the file follows.
    pub(super) end: u64,
    /// Number of points that the header states.
    pub(super) count: u64,
    pub(super) scale: DVec3,
    pub(super) offset: DVec3,
    pub(super) crs: Crs,
    pub(super) extra: Vec<ExtraField>,
    /// Data of LASzip's variable length record, which describes the compression.
    pub(super) laszip: Option<Vec<u8>>,
    pub(super) notes: Vec<String>,
    /// Number of extra bytes of a point that are described by a variable length record.
    pub(super) described: usize,
    /// True if points that are flagged as withheld are read, too.
    pub(super) reads_withheld: bool,
}

/// A number among the extra bytes of a point.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ExtraField {
    pub(super) name: String,
    /// Number of the field's type in the LAS standard, from 1 (unsigned char) to 10 (double).
    pub(super) kind: u8,
    /// Byte offset among the extra bytes, which begin after the standard's fields.
    pub(super) at: usize,
    /// Factor by which the stored number is multiplied, and number that is then added, if the file states them.
    pub(super) scaled: Option<(f64, f64)>,
}

impl ExtraField {
    /// Returns the number of bytes of a field, by the number of its type in the LAS standard.
    pub(super) fn bytes(kind: u8) -> usize {
        match kind {
            1 | 2 => 1,
            3 | 4 => 2,
            5 | 6 | 9 => 4,
            _ => 8,
        }
    }
}

/// Suffix of a name that extra bytes have in a file if their column has the name of a field of LAS. Other programs
/// refuse extra bytes of such a name. The description of these extra bytes is [`RENAMED`], and Surfel reads their name
/// without the suffix.
pub(super) const RENAMED_SUFFIX: &str = "_2";
/// Description of extra bytes whose name has the suffix [`RENAMED_SUFFIX`]; at most 32 bytes.
pub(super) const RENAMED: &str = "column without the suffix _2";

/// Number of bytes of a point record by point format, without extra bytes.
pub(super) const POINT_BYTES: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(super::field(bytes, at))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(super::field(bytes, at))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(super::field(bytes, at))
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(super::field(bytes, at))
}

fn vector_at(bytes: &[u8], at: usize) -> DVec3 {
    DVec3::new(f64_at(bytes, at), f64_at(bytes, at + 8), f64_at(bytes, at + 16))
}

/// Fills `bytes` from the source's current position on, unless the source ends before. Returns the number of bytes
/// read.
fn read_some(source: &mut dyn Source, bytes: &mut [u8]) -> io::Result<usize> {
    let mut got = 0;
    while got < bytes.len() {
        match source.read(&mut bytes[got..]) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(got)
}

impl Header {
    /// Returns the comments of the point cloud, which state its coordinate reference system, scale and offset.
    pub(super) fn comments(&self) -> Vec<String> {
        let triple = |v: DVec3| format!("{} {} {}", v.x, v.y, v.z);
        let mut comments = self.crs.comments();
        comments.push(format!("las_scale {}", triple(self.scale)));
        comments.push(format!("las_offset {}", triple(self.offset)));
        comments
    }

    pub(super) fn read(source: &mut dyn Source, file_bytes: u64) -> Result<Self, Problem> {
        let mut bytes = [0; 375];
        source.seek(SeekFrom::Start(0)).map_err(super::unreadable)?;
        let got = read_some(source, &mut bytes).map_err(super::unreadable)?;
        if !bytes.starts_with(b"LASF") {
            let problem = Problem::new("doesn't start with 'LASF'").expected("LAS, the format of LiDAR points");
            let is_log = bytes.starts_with(b"~") || bytes.starts_with(b"#");
            return Err(if is_log {
                problem.help("files of well logs have the same extension: they have no points")
            } else {
                problem
            });
        }
        if got < 227 {
            let what = format!("ends within its LAS header, after {got} bytes");
            return Err(Problem::new(what).expected("227 bytes at least"));
        }
        let (major, minor) = (bytes[24], bytes[25]);
        if major != 1 || minor > 5 {
            let what = format!("is LAS {major}.{minor}");
            return Err(Problem::new(what).at(Location::Byte(24)).expected("LAS 1.0 to 1.5"));
        }
        let header_bytes = u64::from(u16_at(&bytes, 94));
        let start = u64::from(u32_at(&bytes, 96));
        let compressed = bytes[104] & 0xc0 != 0;
        let format = bytes[104] & 0x3f;
        let record_bytes = usize::from(u16_at(&bytes, 105));
        let Some(&least) = POINT_BYTES.get(usize::from(format)) else {
            let what = format!("has points of format {format}");
            return Err(Problem::new(what).at(Location::Byte(104)).expected("formats 0 to 10"));
        };
        if minor == 5 && format < 6 {
            let what = format!("is LAS 1.5 with points of format {format}");
            return Err(Problem::new(what).at(Location::Byte(104)).expected("formats 6 to 10, as LAS 1.5 has them"));
        }
        if record_bytes < least {
            let what = format!("has points of {record_bytes} bytes in format {format}");
            return Err(Problem::new(what).at(Location::Byte(105)).expected(format!("{least} bytes at least")));
        }
        if start < 227 || start > file_bytes {
            let what = format!("says that its points begin at byte {start} of {file_bytes}");
            return Err(Problem::new(what).at(Location::Byte(96)).help("the file is cut off or damaged"));
        }
        let (scale, offset) = (vector_at(&bytes, 131), vector_at(&bytes, 155));
        if !scale.is_finite() || !offset.is_finite() || scale.cmpeq(DVec3::ZERO).any() {
            let what = format!("has the coordinate scale {scale} and offset {offset}");
            return Err(Problem::new(what).at(Location::Byte(131)).expected("finite numbers, and no scale of 0"));
        }
        let newest = minor >= 4 && header_bytes >= 375 && got >= 375;
        let legacy = u64::from(u32_at(&bytes, 107));
        let count = if newest { u64_at(&bytes, 247) } else { 0 };
        let mut header = Self {
            minor,
            software: one_line(&bytes[58..90]),
            format,
            compressed,
            record_bytes,
            start,
            end: file_bytes,
            count: if count == 0 { legacy } else { count },
            scale,
            offset,
            crs: Crs::default(),
            extra: Vec::new(),
            laszip: None,
            notes: Vec::new(),
            described: 0,
            reads_withheld: false,
        };
        // Waveforms (LAS 1.3) and extended records (1.4) follow the points.
        if minor >= 3 && header_bytes >= 235 && u16_at(&bytes, 6) & 2 != 0 {
            header.end_at(u64_at(&bytes, 227));
        }
        let records = u32_at(&bytes, 100);
        let found = header.read_records(source, header_bytes.max(227), start, records, false)?;
        if found < records {
            header.notes.push(format!("the header says {records} variable length records, there are {found}"));
        }
        if newest {
            let (at, records) = (u64_at(&bytes, 235), u32_at(&bytes, 243));
            if records > 0 && at >= start {
                header.end_at(at);
                let found = header.read_records(source, at, file_bytes, records, true)?;
                if found < records {
                    let what = format!("the header says {records} extended records, there are {found}");
                    header.notes.push(what);
                }
            }
        }
        Ok(header)
    }

    fn end_at(&mut self, at: u64) {
        if at > self.start {
            self.end = self.end.min(at);
        }
    }

    /// Reads variable length records, or extended ones, and extracts the supported ones. Returns the number of records
    /// found, supported or not.
    fn read_records(
        &mut self,
        source: &mut dyn Source,
        mut at: u64,
        end: u64,
        records: u32,
        extended: bool,
    ) -> Result<u32, Problem> {
        let head_bytes: u64 = if extended { 60 } else { 54 };
        let (mut keys, mut doubles, mut texts) = (None, Vec::new(), String::new());
        let mut found = 0;
        while found < records && at.checked_add(head_bytes).is_some_and(|next| next <= end) {
            let mut head = [0; 60];
            source.seek(SeekFrom::Start(at)).map_err(super::unreadable)?;
            let head = &mut head[..head_bytes as usize];
            source.read_exact(head).map_err(super::unreadable)?;
            let user = one_line(&head[2..18]);
            let id = u16_at(head, 18);
            let length = if extended { u64_at(head, 20) } else { u64::from(u16_at(head, 20)) };
            at += head_bytes;
            if length > end - at {
                break;
            }
            at += length;
            found += 1;
            let wanted = matches!(
                (user.as_str(), id),
                ("LASF_Projection", 2112 | 34_735 | 34_736 | 34_737) | ("LASF_Spec", 4) | ("laszip encoded", 22_204)
            );
            if !wanted || length > MAX_RECORD_BYTES {
                continue;
            }
            let mut data = vec![0; length as usize];
            source.read_exact(&mut data).map_err(super::unreadable)?;
            match id {
                2112 => self.crs.wkt = Some(one_line(&data)).filter(|text| !text.is_empty()),
                34_735 => keys = Some(data.chunks_exact(2).map(|b| u16_at(b, 0)).collect::<Vec<_>>()),
                34_736 => doubles = data.chunks_exact(8).map(|b| f64_at(b, 0)).collect(),
                34_737 => texts = one_line(&data),
                4 => self.read_extra_fields(&data),
                _ => self.laszip = Some(data),
            }
        }
        if let Some(keys) = keys {
            self.crs.geotiff = Some(GeoKeys { directory: keys, doubles, text: texts });
        }
        Ok(found)
    }

    /// Parses the variable length record that states names and types of the extra bytes.
    fn read_extra_fields(&mut self, data: &[u8]) {
        let room = self.record_bytes - POINT_BYTES[usize::from(self.format)];
        let mut at = 0;
        for record in data.chunks_exact(192) {
            let (kind, options) = (record[2], record[3]);
            let stored = one_line(&record[4..36]);
            let own = stored.strip_suffix(RENAMED_SUFFIX).filter(|_| one_line(&record[160..192]) == RENAMED);
            let name = own.unwrap_or(&stored).to_owned();
            // Types 11 to 30 are pairs and triples of types 1 to 10. Type 0 is a number of bytes given by the options.
            let (kind, parts) = match kind {
                1..=30 => ((kind - 1) % 10 + 1, usize::from((kind - 1) / 10 + 1)),
                _ => (0, 1),
            };
            let bytes = if kind == 0 { usize::from(options) } else { ExtraField::bytes(kind) };
            for part in 0..parts {
                if at + bytes > room {
                    self.notes.push(format!("the extra bytes of its points end before {}", crate::error::quote(&name)));
                    self.described = room;
                    return;
                }
                if kind != 0 {
                    let scale = if options & 8 != 0 { f64_at(record, 112 + 8 * part) } else { 1.0 };
                    let offset = if options & 16 != 0 { f64_at(record, 136 + 8 * part) } else { 0.0 };
                    let scaled = (scale.is_finite() && offset.is_finite() && (scale, offset) != (1.0, 0.0))
                        .then_some((scale, offset));
                    let name = match (name.as_str(), parts) {
                        ("", 1) => format!("extra_{at}"),
                        (name, 1) => name.to_owned(),
                        (name, _) => format!("{name}_{part}"),
                    };
                    self.extra.push(ExtraField { name, kind, at, scaled });
                }
                at += bytes;
            }
        }
        self.described = at;
    }

    /// Returns the number of extra bytes of a point that no variable length record describes.
    pub(super) fn undescribed_bytes(&self) -> usize {
        self.record_bytes.saturating_sub(POINT_BYTES[usize::from(self.format)] + self.described)
    }
}
