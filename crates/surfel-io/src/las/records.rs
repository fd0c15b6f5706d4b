//! Conversion of point records of any format to columns. Records are converted in blocks, the columns of a block in
//! parallel.

use super::field;
use super::header::{ExtraField, Header, POINT_BYTES};
use crate::rows::RowNumbers;
use crate::survey::{Scalar, SparseColumn, WideColors, take_normals};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use surfel_model::{Column3, ExtraColumn, PointCloud};

/// True if a point format has colours.
pub(super) fn has_colors(format: u8) -> bool {
    matches!(format, 2 | 3 | 5 | 7 | 8 | 10)
}

/// An extra column to which blocks of point records are appended.
trait Gather: Send {
    fn append(&mut self, records: &[u8], record_bytes: usize, expected: usize);
    /// Returns the number of bytes that a value takes in memory; 0 while all values are zero.
    fn value_bytes(&self) -> usize;
    fn finish(self: Box<Self>) -> Option<ExtraColumn>;
}

/// A column of numbers, and the function that reads a number from a point record.
struct Field<T, F> {
    name: String,
    column: SparseColumn<T>,
    read: F,
}

impl<T: Scalar, F: Fn(&[u8]) -> T + Send> Gather for Field<T, F> {
    fn append(&mut self, records: &[u8], record_bytes: usize, expected: usize) {
        let values = records.chunks_exact(record_bytes).map(&self.read);
        self.column.append(records.len() / record_bytes, expected, values);
    }

    fn value_bytes(&self) -> usize {
        if self.column.is_zero() { 0 } else { size_of::<T>() }
    }

    fn finish(self: Box<Self>) -> Option<ExtraColumn> {
        self.column.finish(self.name)
    }
}

/// Columns of the points read so far.
pub(super) struct Columns {
    record_bytes: usize,
    /// Number of points for which columns reserve memory.
    expected: usize,
    /// Bit of byte 15 of a record that flags the point as withheld; 0 if withheld points are read, too.
    withheld_bit: u8,
    pub(super) withheld: u64,
    rows: RowNumbers,
    grid: Vec<[i32; 3]>,
    /// Byte offset of the colours in a record, and the colours read so far; `None` if the point format has none.
    colors: Option<(usize, WideColors)>,
    extras: Vec<Box<dyn Gather>>,
}

impl Columns {
    pub(super) fn new(header: &Header, expected: usize) -> Self {
        let mut columns = Self::of_splats(header, expected);
        columns.extras.clear();
        columns.add_fields(header.format);
        if header.reads_withheld {
            let bit = withheld_bit(header.format);
            columns.add("withheld", move |r| u8::from(r[15] & bit != 0));
        }
        let after = POINT_BYTES[usize::from(header.format)];
        header.extra.iter().for_each(|extra| columns.add_extra(extra, after + extra.at));
        columns
    }

    /// Creates only the columns that splats are made of: positions, colours and extra bytes. Scaled extra bytes are
    /// f32.
    pub(super) fn of_splats(header: &Header, expected: usize) -> Self {
        let format = header.format;
        let has_colors = has_colors(format);
        let color_at = match format {
            2 => 20,
            3 | 5 => 28,
            _ => 30,
        };
        let colors = has_colors.then(|| (color_at, WideColors::default()));
        let withheld_bit = if header.reads_withheld { 0 } else { withheld_bit(format) };
        let grid = Vec::with_capacity(expected);
        let mut columns = Self {
            record_bytes: header.record_bytes,
            expected,
            withheld_bit,
            withheld: 0,
            grid,
            colors,
            rows: RowNumbers::default(),
            extras: Vec::new(),
        };
        let after = POINT_BYTES[usize::from(format)];
        for extra in &header.extra {
            let (at, read) = (after + extra.at, value_of(extra.kind));
            match extra.scaled {
                Some((scale, offset)) => {
                    columns.add(&extra.name, move |r| (read(&r[at..]) * scale + offset) as f32);
                }
                None => columns.add_extra(extra, at),
            }
        }
        columns
    }

    fn add<T: Scalar + 'static>(&mut self, name: &str, read: impl Fn(&[u8]) -> T + Send + 'static) {
        self.extras.push(Box::new(Field { name: name.to_owned(), column: SparseColumn::default(), read }));
    }

    fn add_fields(&mut self, format: u8) {
        self.add("intensity", |r| u16::from_le_bytes(field(r, 12)));
        if format < 6 {
            self.add("return_number", |r| r[14] & 7);
            self.add("number_of_returns", |r| (r[14] >> 3) & 7);
            self.add("scan_direction", |r| (r[14] >> 6) & 1);
            self.add("edge_of_flight_line", |r| r[14] >> 7);
            self.add("classification", |r| r[15] & 31);
            self.add("synthetic", |r| (r[15] >> 5) & 1);
            self.add("key_point", |r| (r[15] >> 6) & 1);
            self.add("scan_angle", |r| r[16] as i8);
            self.add("user_data", |r| r[17]);
            self.add("point_source_id", |r| u16::from_le_bytes(field(r, 18)));
            if matches!(format, 1 | 3 | 4 | 5) {
                self.add("gps_time", |r| f64::from_le_bytes(field(r, 20)));
            }
        } else {
            self.add("return_number", |r| r[14] & 15);
            self.add("number_of_returns", |r| r[14] >> 4);
            self.add("synthetic", |r| r[15] & 1);
            self.add("key_point", |r| (r[15] >> 1) & 1);
            self.add("overlap", |r| (r[15] >> 3) & 1);
            self.add("scanner_channel", |r| (r[15] >> 4) & 3);
            self.add("scan_direction", |r| (r[15] >> 6) & 1);
            self.add("edge_of_flight_line", |r| r[15] >> 7);
            self.add("classification", |r| r[16]);
            self.add("user_data", |r| r[17]);
            // The standard's unit is 0.006 degrees.
            self.add("scan_angle", |r| (f64::from(i16::from_le_bytes(field(r, 18))) * 0.006) as f32);
            self.add("point_source_id", |r| u16::from_le_bytes(field(r, 20)));
            self.add("gps_time", |r| f64::from_le_bytes(field(r, 22)));
            if matches!(format, 8 | 10) {
                self.add("nir", |r| u16::from_le_bytes(field(r, 36)));
            }
        }
    }

    fn add_extra(&mut self, extra: &ExtraField, at: usize) {
        let name = &extra.name;
        if let Some((scale, offset)) = extra.scaled {
            let read = value_of(extra.kind);
            return self.add(name, move |r| read(&r[at..]) * scale + offset);
        }
        match extra.kind {
            1 => self.add(name, move |r| r[at]),
            2 => self.add(name, move |r| r[at] as i8),
            3 => self.add(name, move |r| u16::from_le_bytes(field(r, at))),
            4 => self.add(name, move |r| i16::from_le_bytes(field(r, at))),
            5 => self.add(name, move |r| u32::from_le_bytes(field(r, at))),
            6 => self.add(name, move |r| i32::from_le_bytes(field(r, at))),
            9 => self.add(name, move |r| f32::from_le_bytes(field(r, at))),
            kind => {
                let read = value_of(kind);
                self.add(name, move |r| read(&r[at..]));
            }
        }
    }

    /// Returns the number of points that were appended so far.
    pub(super) fn len(&self) -> usize {
        self.grid.len()
    }

    /// Returns the bytes per point in memory of the columns other than position and colour. Columns of zeros take none.
    pub(super) fn extra_bytes(&self) -> usize {
        self.extras.iter().map(|extra| extra.value_bytes()).sum()
    }

    /// True if some point read so far has a colour other than black.
    pub(super) fn any_color(&self) -> bool {
        self.colors.as_ref().is_some_and(|(_, colors)| colors.any())
    }

    /// Appends whole records, except withheld ones. The appended records are moved to the front of `records`.
    pub(super) fn append(&mut self, records: &mut [u8]) {
        let size = self.record_bytes;
        let mut kept = 0;
        for start in (0..records.len()).step_by(size) {
            if records[start + 15] & self.withheld_bit != 0 {
                self.withheld += 1;
                self.rows.skip();
                continue;
            }
            self.rows.keep();
            if kept < start {
                records.copy_within(start..start + size, kept);
            }
            kept += size;
        }
        let records = &records[..kept];
        let Self { grid, colors, extras, expected, .. } = self;
        rayon::join(
            || {
                let i32_at = |r: &[u8], at| i32::from_le_bytes(field(r, at));
                grid.extend(records.chunks_exact(size).map(|r| [i32_at(r, 0), i32_at(r, 4), i32_at(r, 8)]));
                if let Some((at, colors)) = colors {
                    let level = |r: &[u8], k: usize| u16::from_le_bytes(field(r, *at + 2 * k));
                    colors.append(*expected, records.chunks_exact(size).map(|r| [0, 1, 2].map(|k| level(r, k))));
                }
            },
            || extras.par_iter_mut().for_each(|sink| sink.append(records, size, *expected)),
        );
    }

    /// Appends the records that pass `keeps`. The colours of rejected records still count in the detection of the
    /// colours' range ([`WideColors::see`]).
    pub(super) fn append_kept(&mut self, records: &mut [u8], keeps: impl Fn(&[u8]) -> bool + Sync + Send) {
        let (size, bit) = (self.record_bytes, self.withheld_bit);
        let is_kept: Vec<bool> = records.par_chunks_exact(size).map(keeps).collect();
        if let Some((at, colors)) = &mut self.colors {
            let shown = records.chunks_exact(size).filter(|r| r[15] & bit == 0);
            colors.see(shown.map(|r| [0, 1, 2].map(|k| u16::from_le_bytes(field(r, *at + 2 * k)))));
        }
        let mut end = 0;
        for (i, _) in is_kept.iter().enumerate().filter(|(_, is_kept)| **is_kept) {
            records.copy_within(i * size..(i + 1) * size, end);
            end += size;
        }
        self.append(&mut records[..end]);
    }

    /// Returns the bounds of the points as stored integers, in steps of the header's scale; `None` without points.
    pub(super) fn ends(&self) -> Option<([i32; 3], [i32; 3])> {
        let first = *self.grid.first()?;
        Some(self.grid.iter().fold((first, first), |(low, high), p| {
            ([0, 1, 2].map(|k| low[k].min(p[k])), [0, 1, 2].map(|k| high[k].max(p[k])))
        }))
    }

    /// Removes the column of colours, so that colours aren't converted. Returns their byte offset in a record; `None`
    /// if there are no colours.
    pub(super) fn remove_colors(&mut self) -> Option<usize> {
        self.colors.take().map(|(at, _)| at)
    }

    /// Returns the points, and true if their colours range over 0–255 instead of 0–65535.
    pub(super) fn finish(self, header: &Header) -> (PointCloud, bool) {
        let (origin, positions) = on_grid(self.grid, header.scale, header.offset);
        let (colors, have_8_bits) = self.colors.and_then(|(_, colors)| colors.finish()).unzip();
        let mut extras: Vec<ExtraColumn> = self.extras.into_iter().filter_map(Gather::finish).collect();
        let normals = take_normals(&mut extras);
        let rows = self.rows.finish();
        let points = PointCloud { origin, positions, normals, colors, rows, extras, ..PointCloud::default() };
        (points, have_8_bits.unwrap_or(false))
    }
}

/// Returns the bit of byte 15 that flags a point as withheld, for the point format `format`.
fn withheld_bit(format: u8) -> u8 {
    if format < 6 { 0x80 } else { 0x04 }
}

/// Returns the function that reads a number among the extra bytes, by the number of its type in the LAS standard.
pub(super) fn value_of(kind: u8) -> fn(&[u8]) -> f64 {
    match kind {
        1 => |r| r[0].into(),
        2 => |r| (r[0] as i8).into(),
        3 => |r| u16::from_le_bytes(field(r, 0)).into(),
        4 => |r| i16::from_le_bytes(field(r, 0)).into(),
        5 => |r| u32::from_le_bytes(field(r, 0)).into(),
        6 => |r| i32::from_le_bytes(field(r, 0)).into(),
        7 => |r| u64::from_le_bytes(field(r, 0)) as f64,
        8 => |r| i64::from_le_bytes(field(r, 0)) as f64,
        9 => |r| f32::from_le_bytes(field(r, 0)).into(),
        _ => |r| f64::from_le_bytes(field(r, 0)),
    }
}

/// True if f32 may round coordinates between `min` and `max` by more than a quarter of the grid step `scale`, when they
/// are stored relative to the origin that [`Column3::origin_of`] returns. The rounding error is then stored, too, as
/// the low part of the positions.
pub(super) fn needs_low_part(min: DVec3, max: DVec3, scale: DVec3) -> bool {
    let origin = Column3::origin_of(min, max);
    // f32 rounds by at most 2⁻²⁴ of a number.
    let lost = (min - origin).abs().max((max - origin).abs()) * 2f64.powi(-24);
    lost.cmpgt(scale.abs() * 0.25).any()
}

/// Converts points i·scale + offset, where i are the integers of `grid`, to positions relative to an origin. Returns
/// the origin and the positions. The memory of the grid is reused. The rounding error of f32 is stored as a low part if
/// it exceeds a quarter of a grid step. Otherwise the grid point would be ambiguous.
pub(super) fn on_grid(mut grid: Vec<[i32; 3]>, scale: DVec3, offset: DVec3) -> (DVec3, Column3) {
    let ends = |(low, high): ([i32; 3], [i32; 3]), (l, h): ([i32; 3], [i32; 3])| {
        ([0, 1, 2].map(|k| low[k].min(l[k])), [0, 1, 2].map(|k| high[k].max(h[k])))
    };
    let (low, high) = grid.par_iter().map(|p| (*p, *p)).reduce(|| ([i32::MAX; 3], [i32::MIN; 3]), ends);
    if grid.is_empty() {
        return (DVec3::ZERO, Column3::default());
    }
    let at = |p: [i32; 3]| DVec3::new(p[0].into(), p[1].into(), p[2].into()) * scale + offset;
    let (a, b) = (at(low), at(high));
    let (min, max) = (a.min(b), a.max(b));
    let origin = Column3::origin_of(min, max);
    let rest = offset - origin;
    let from_origin = |p: [i32; 3]| DVec3::new(p[0].into(), p[1].into(), p[2].into()) * scale + rest;
    let lows = needs_low_part(min, max, scale).then(|| {
        let low = |p: &[i32; 3]| from_origin(*p) - from_origin(*p).as_vec3().as_dvec3();
        grid.par_iter().map(|p| low(p).as_vec3()).collect::<Vec<Vec3>>()
    });
    // The f32 bits have the size and alignment of the vectors, so that the memory is reused.
    grid.par_iter_mut().for_each(|p| *p = from_origin(*p).as_vec3().to_array().map(|v| v.to_bits() as i32));
    let highs: Vec<Vec3> = grid.into_iter().map(|p| Vec3::from(p.map(|v| f32::from_bits(v as u32)))).collect();
    (origin, Column3::from_parts(highs, lows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_the_grid_are_certain_at_any_place_and_fineness() {
        let scales = [1e-5, 1e-3, 0.01, -0.25];
        let offsets = [DVec3::ZERO, DVec3::new(637_012.25, 4_851_233.0, -12.5), DVec3::new(-1e7, 1e7, 0.001)];
        for scale in scales {
            for offset in offsets {
                let mut random = 7_u64;
                let mut next = || {
                    random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (random >> 33) as i32 - (1 << 30)
                };
                for shift in [0, 4, 12] {
                    let grid: Vec<[i32; 3]> =
                        (0..999).map(|_| [next() >> shift, next() >> shift, next() >> 16]).collect();
                    let scale = DVec3::splat(scale);
                    let (origin, column) = on_grid(grid.clone(), scale, offset);
                    for (i, p) in grid.iter().enumerate() {
                        let step = (origin + column.get(i) - offset) / scale;
                        assert_eq!(step.round().to_array().map(|v| v as i32), *p, "{scale} {offset} {shift}");
                    }
                }
            }
        }
    }

    #[test]
    fn kilometre_in_millimetres_needs_no_low_part() {
        let grid = vec![[0, 0, 0], [1_000_000, 1_000_000, 50_000]];
        let (origin, column) = on_grid(grid.clone(), DVec3::splat(0.001), DVec3::new(6e5, 5e6, 100.0));
        assert!(column.low().is_none() && origin.x > 5.9e5);
        let (_, fine) = on_grid(grid, DVec3::new(0.001, 0.001, 1e-6), DVec3::new(6e5, 5e6, 100.0));
        assert!(fine.low().is_some());
    }
}
