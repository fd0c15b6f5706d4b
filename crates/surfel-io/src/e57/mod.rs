//! E57 (ASTM E2807): all scans of a file, with their poses applied. The crate `e57` reads pages, packets and bits on
//! its own thread; this module interprets the values.

#[cfg(feature = "laz")]
mod columns;
mod layout;

#[cfg(feature = "laz")]
pub(crate) use columns::{survey, unpack};

use crate::color::{linear_of_8_bit, linear_of_16_bit, linear_of_unit};
use crate::content::Content;
use crate::context::Context;
use crate::crs::Crs;
use crate::error::{Fault, Problem, quote};
use crate::rows::RowNumbers;
use crate::strided::NumberType;
use crate::survey::{Scalar, Source, SparseColumn, format_extent, one_line};
use crate::words::counted;
use ::e57::{E57Reader, PointCloud as Scan, RecordDataType, RecordValue};
use glam::{DVec3, Vec3};
use layout::{Layout, OtherColumn};
use std::collections::{BTreeMap, HashMap};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc;
use surfel_model::{Column3, ExtraColumn, PointCloud};

/// Maximum number of points per batch that the reading thread sends.
const BATCH_POINTS: usize = 8192;
/// Maximum number of values per batch that the reading thread sends.
const BATCH_VALUES: usize = 1 << 18;
/// Maximum number of batches that the reading thread is ahead of the processing.
const BATCHES_AHEAD: usize = 4;
/// Maximum number of bytes that points may take in memory: the first number plus the second times the file's size.
const MAX_DECODED: (u64, u64) = (256 << 20, 256);
/// Maximum number of fields of a point, and of columns of all scans. Real scanners write about 20.
const MAX_FIELDS: usize = 1000;
/// Accuracy to which positions are always stored, in metres; it is finer than that of any scanner. If f32 could round
/// the farthest point by more than a quarter of this length, the rounding errors are stored, too.
const POSITION_ACCURACY_M: f64 = 1e-4;

/// Reader that seeks within its buffer, because the crate `e57` seeks before it reads each page. For the repair of a
/// damaged file, the reader reports the end of the last complete page as the end of the file.
struct Pages<R> {
    reader: BufReader<R>,
    end: Option<u64>,
}

impl<R: Read + Seek> Pages<R> {
    fn new(mut source: R, file_bytes: u64, repair: bool) -> io::Result<Self> {
        let mut size = [0; 8];
        if repair && source.seek(SeekFrom::Start(40)).is_ok() && source.read_exact(&mut size).is_ok() {
            let size = u64::from_le_bytes(size).max(1);
            source.seek(SeekFrom::Start(0))?;
            let reader = BufReader::with_capacity(1 << 16, source);
            return Ok(Self { reader, end: Some(file_bytes / size * size) });
        }
        source.seek(SeekFrom::Start(0))?;
        Ok(Self { reader: BufReader::with_capacity(1 << 16, source), end: None })
    }
}

impl<R: Read + Seek> Read for Pages<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.reader.read(bytes)
    }
}

impl<R: Read + Seek> Seek for Pages<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let to = match (to, self.end) {
            (SeekFrom::Start(to), _) => to,
            (SeekFrom::End(0), Some(end)) => end,
            _ => return self.reader.seek(to),
        };
        let at = self.reader.stream_position()?;
        self.reader.seek_relative(to.wrapping_sub(at) as i64)?;
        Ok(to)
    }
}

fn problem(what: impl std::fmt::Display) -> Problem {
    let what: String = one_line(what.to_string().as_bytes()).chars().take(300).collect();
    Problem::new(format!("is no E57 that can be read: {what}")).help("the file is cut off or damaged: copy it again")
}

/// Column other than position, colour and normal, in the number type that [`columns()`] selects.
enum Typed {
    U8(SparseColumn<u8>),
    U16(SparseColumn<u16>),
    I32(SparseColumn<i32>),
    F32(SparseColumn<f32>),
    F64(SparseColumn<f64>),
}

impl Typed {
    fn new(kind: NumberType) -> Self {
        match kind {
            NumberType::U8 => Self::U8(SparseColumn::default()),
            NumberType::U16 => Self::U16(SparseColumn::default()),
            NumberType::I32 => Self::I32(SparseColumn::default()),
            NumberType::F32 => Self::F32(SparseColumn::default()),
            _ => Self::F64(SparseColumn::default()),
        }
    }

    fn append(&mut self, expected: usize, values: &[f64]) {
        fn all<T: Scalar>(column: &mut SparseColumn<T>, expected: usize, values: &[f64], to: fn(f64) -> T) {
            column.append(values.len(), expected, values.iter().map(|v| to(*v)));
        }
        match self {
            Self::U8(c) => all(c, expected, values, |v| v as u8),
            Self::U16(c) => all(c, expected, values, |v| v as u16),
            Self::I32(c) => all(c, expected, values, |v| v as i32),
            Self::F32(c) => all(c, expected, values, |v| v as f32),
            Self::F64(c) => all(c, expected, values, |v| v),
        }
    }

    fn finish(self, name: String) -> Option<ExtraColumn> {
        match self {
            Self::U8(c) => c.finish(name),
            Self::U16(c) => c.finish(name),
            Self::I32(c) => c.finish(name),
            Self::F32(c) => c.finish(name),
            Self::F64(c) => c.finish(name),
        }
    }
}

/// Points that were read so far, from all scans together.
#[derive(Default)]
struct Points {
    /// Number of points that the file states, but at most as many as fit into the file's size.
    expected: usize,
    origin: Option<DVec3>,
    high: Vec<Vec3>,
    low: Option<Vec<Vec3>>,
    normals: Option<Vec<Vec3>>,
    colors: Option<Vec<[f32; 3]>>,
    extras: BTreeMap<String, Typed>,
    scans: Option<SparseColumn<u32>>,
    kept: RowNumbers,
    invalid: u64,
    colorless: u64,
}

impl Points {
    /// Appends a batch of values: one row for each point, in the scan's layout.
    fn append(&mut self, layout: &Layout<'_>, batch: &[RecordValue]) {
        let all = batch.chunks_exact(layout.scan.prototype.len());
        let rows: Vec<&[RecordValue]> = all.clone().filter(|row| layout.is_valid(row)).collect();
        self.invalid += (all.len() - rows.len()) as u64;
        all.for_each(|row| if layout.is_valid(row) { self.kept.keep() } else { self.kept.skip() });
        let world: Vec<DVec3> = rows.iter().map(|row| layout.place(row)).collect();
        self.place(&world);
        if let Some(normals) = &mut self.normals {
            normals.extend(rows.iter().map(|row| layout.normal(row)));
        }
        if let Some(colors) = &mut self.colors {
            let ranges = layout.color.map_or([(0.0, 255.0); 3], |(_, ranges)| ranges);
            let decode = ranges.map(decoder);
            colors.extend(rows.iter().map(|row| {
                let levels = layout.levels(row);
                self.colorless += u64::from(levels.is_none());
                levels.map_or([1.0; 3], |levels| std::array::from_fn(|k| decode[k](levels[k], ranges[k])))
            }));
        }
        let mut values = Vec::with_capacity(rows.len());
        let by_name: HashMap<&str, _> = layout.extras.iter().rev().map(|e| (e.name.as_str(), e)).collect();
        for (name, column) in &mut self.extras {
            values.clear();
            match by_name.get(name.as_str()) {
                Some(extra) => values.extend(rows.iter().map(|row| layout.extra(row, extra))),
                None => values.resize(rows.len(), 0.0),
            }
            column.append(self.expected, &values);
        }
        if let Some(scans) = &mut self.scans {
            scans.append(rows.len(), self.expected, std::iter::repeat_n(layout.index, rows.len()));
        }
    }

    fn place(&mut self, world: &[DVec3]) {
        let origin = *self.origin.get_or_insert_with(|| {
            let (min, max) = world
                .iter()
                .filter(|p| p.is_finite())
                .fold((DVec3::MAX, DVec3::MIN), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
            if min.x <= max.x { Column3::origin_of(min, max) } else { DVec3::ZERO }
        });
        let finite = world.iter().map(|p| (*p - origin).abs().max_element()).filter(|d| d.is_finite());
        if self.low.is_none() && finite.fold(0.0, f64::max) * 2f64.powi(-24) > POSITION_ACCURACY_M / 4.0 {
            self.low = Some(vec![Vec3::ZERO; self.high.len()]);
        }
        self.high.extend(world.iter().map(|p| (*p - origin).as_vec3()));
        if let Some(low) = &mut self.low {
            low.extend(world.iter().map(|p| {
                let offset = *p - origin;
                let rest = (offset - offset.as_vec3().as_dvec3()).as_vec3();
                if rest.is_finite() { rest } else { Vec3::ZERO }
            }));
        }
    }

    fn finish(self) -> PointCloud {
        let mut extras: Vec<ExtraColumn> = Vec::new();
        extras.extend(self.scans.and_then(|scans| scans.finish("scan".into())));
        extras.extend(self.extras.into_iter().filter_map(|(name, column)| column.finish(name)));
        PointCloud {
            origin: self.origin.unwrap_or_default(),
            positions: Column3::from_parts(self.high, self.low),
            normals: self.normals.map(Column3::from_f32),
            colors: self.colors,
            rows: self.kept.finish(),
            extras,
            ..PointCloud::default()
        }
    }
}

/// Returns the function that converts a colour level to linear light. `range` is the minimum and maximum of levels,
/// which the function also gets. Levels of the ranges 0–255 and 0–65535 are looked up in a table.
fn decoder(range: (f64, f64)) -> fn(f64, (f64, f64)) -> f32 {
    if range == (0.0, 255.0) {
        |v, _| linear_of_8_bit()[v.round().clamp(0.0, 255.0) as usize]
    } else if range == (0.0, 65_535.0) {
        |v, _| linear_of_16_bit()[v.round().clamp(0.0, 65_535.0) as usize]
    } else {
        |v, (min, max)| linear_of_unit((v - min) / (max - min))
    }
}

/// An open E57 file and the descriptions of its scans.
struct File<'a> {
    reader: E57Reader<Pages<&'a mut dyn Source>>,
    scans: Vec<Scan>,
    bytes: u64,
}

impl<'a> File<'a> {
    fn open(source: &'a mut dyn Source, repair: bool) -> Result<Self, Fault> {
        let bytes = source.seek(SeekFrom::End(0)).map_err(problem)?;
        let pages = Pages::new(source, bytes, repair).map_err(problem)?;
        let reader = E57Reader::new(pages).map_err(problem)?;
        let scans = reader.pointclouds();
        Ok(Self { reader, scans, bytes })
    }

    fn crs(&self) -> Crs {
        self.reader.coordinate_metadata().map(crs_of).unwrap_or_default()
    }

    /// Returns the layouts of the scans that have points, or an error if there are none. Adds a note for each scan that
    /// has points but no coordinates, or whose points take no bits in the file; such scans are left out.
    fn layouts<'s>(&self, scans: &'s [Scan], notes: &mut Vec<String>) -> Result<Vec<Layout<'s>>, Fault> {
        let mut layouts = Vec::new();
        for (i, scan) in scans.iter().enumerate().filter(|(_, scan)| scan.records > 0) {
            check_fields(scan.prototype.len(), &format!("scan {} has points of", i + 1))?;
            match Layout::new(scan, i as u32, notes) {
                Some(layout) if layout.bits_per_point() > 0 => layouts.push(layout),
                _ => notes.push(format!("left out scan {}, which has no coordinates", i + 1)),
            }
        }
        notes.dedup();
        if layouts.is_empty() {
            let images = self.reader.images().len();
            let what = format!("is an E57 file of {} scans and {images} images, and no point", scans.len());
            return Err(Problem::new(what).expected("points").into());
        }
        Ok(layouts)
    }

    /// Returns the number of points that a scan states, but at most as many as fit into the file's size.
    fn most_points(&self, layout: &Layout<'_>) -> u64 {
        layout.scan.records.min(self.bytes * 8 / layout.bits_per_point())
    }

    /// Checks that the points don't need much more memory than the file's size justifies. Hostile files could, because
    /// a field with a single value takes no bits in the file.
    fn check_decoded(&self, layouts: &[Layout<'_>], columns: &BTreeMap<String, NumberType>) -> Result<(), Problem> {
        let points = layouts.iter().map(|layout| self.most_points(layout)).fold(0, u64::saturating_add);
        let point_bytes = 24 + columns.values().map(|kind| kind.bytes() as u64).sum::<u64>();
        let most = MAX_DECODED.0.saturating_add(MAX_DECODED.1.saturating_mul(self.bytes));
        if points.saturating_mul(point_bytes) <= most {
            return Ok(());
        }
        let what = format!("says that its {} bytes hold {points} points of {} columns", self.bytes, columns.len());
        Err(Problem::new(what).expected("fewer: the file is damaged, or made to fill the memory"))
    }

    /// Passes the values of each scan's points to `each`, batch by batch. With `repair`, a damaged scan is read as far
    /// as possible, with a note.
    fn read(
        &mut self,
        layouts: &[Layout<'_>],
        repair: bool,
        notes: &mut Vec<String>,
        mut each: impl FnMut(&Layout<'_>, &[RecordValue]) -> Result<(), Problem>,
    ) -> Result<(), Fault> {
        for layout in layouts {
            let (scan, all) = (layout.index + 1, layout.scan.records);
            let mut read = 0;
            let end = read_scan(&mut self.reader, layout, &mut |batch| {
                read += batch.len() / layout.scan.prototype.len();
                each(layout, batch)
            })?;
            match end {
                Err(error) if repair => {
                    let why = one_line(error.to_string().as_bytes());
                    let why: String = why.chars().take(200).collect();
                    notes.push(format!("scan {scan} is damaged: took {read} of its {all} points ({why})"));
                }
                end => end.map_err(|error| {
                    problem(format!("scan {scan}, {all} points: {error} after {read}"))
                        .help("copy the file again; `repair` takes the points before the damage")
                })?,
            }
        }
        Ok(())
    }

    /// Adds notes about dropped points, points without a colour, and unused images.
    fn note_left_out(&self, invalid: u64, colorless: u64, notes: &mut Vec<String>) {
        if invalid > 0 {
            notes.push(format!("left out {} flagged as invalid", counted(invalid, "points")));
        }
        if colorless > 0 {
            notes.push(format!("{} without a colour: white", counted(colorless, "points")));
        }
        let images = self.reader.images().len();
        if images > 0 {
            notes.push(format!("left out {}", counted(images as u64, "images")));
        }
    }
}

/// Checks that points don't have more fields than any scanner writes. Each field takes memory for every point.
fn check_fields(fields: usize, what: &str) -> Result<(), Problem> {
    if fields <= MAX_FIELDS {
        return Ok(());
    }
    let problem = Problem::new(format!("{what} {fields} fields")).expected(format!("at most {MAX_FIELDS}"));
    Err(problem.help("the file is damaged, or made to fill the memory"))
}

/// Returns the names of the columns of all scans other than position, colour and normal. Each has the smallest number
/// type for its values if all scans agree on this type, else f64.
fn columns(layouts: &[Layout<'_>]) -> Result<BTreeMap<String, NumberType>, Problem> {
    let mut columns: BTreeMap<String, NumberType> = BTreeMap::new();
    for layout in layouts {
        for OtherColumn { name, record, .. } in &layout.extras {
            let kind = match layout.scan.prototype[*record].data_type {
                RecordDataType::Single { .. } => NumberType::F32,
                RecordDataType::Integer { min: 0.., max: ..=255 } => NumberType::U8,
                RecordDataType::Integer { min: 0.., max: ..=65_535 } => NumberType::U16,
                RecordDataType::Integer { min: -2_147_483_648.., max: ..=2_147_483_647 } => NumberType::I32,
                _ => NumberType::F64,
            };
            let known = *columns.get(name).unwrap_or(&kind);
            columns.insert(name.clone(), if known == kind { kind } else { NumberType::F64 });
        }
        check_fields(columns.len(), "its scans have points of")?;
    }
    Ok(columns)
}

/// Adds a note for each column that some scans lack. The points of a scan without the column get the value 0 in it.
fn note_missing(layouts: &[Layout<'_>], columns: &BTreeMap<String, NumberType>, notes: &mut Vec<String>) {
    let has = |layout: &Layout<'_>, name: &str| layout.extras.iter().any(|extra| extra.name == name);
    for name in columns.keys() {
        let without = layouts.iter().filter(|layout| !has(layout, name)).count();
        if without > 0 {
            let name = quote(name);
            let have = if without == 1 { "has" } else { "have" };
            notes.push(format!("{without} of its {} scans {have} no {name}: it is 0 for these points", layouts.len()));
        }
    }
}

/// Returns the problem of a file whose points are all flagged as invalid.
fn none_valid(invalid: u64) -> Problem {
    Problem::new(format!("holds no point but {invalid} that are flagged as invalid")).expected("at least one")
}

/// Runs a function that reads an E57 file, and converts panics to an error. Damaged files may violate assumptions of
/// the crate `e57`.
fn guarded<T>(read: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let problem = Problem::new("is damaged: its packets or its XML make no sense");
        Err(problem.help("copy the file again").into())
    })
}

pub(crate) fn read(source: &mut dyn Source, context: &mut Context<'_>) -> Result<Content, Fault> {
    guarded(|| read_scans(source, context))
}

fn read_scans(source: &mut dyn Source, context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut file = File::open(source, context.options.repair)?;
    let (scans, mut notes) = (std::mem::take(&mut file.scans), Vec::new());
    let layouts = file.layouts(&scans, &mut notes)?;
    let expected = layouts.iter().map(|l| file.most_points(l)).fold(0, u64::saturating_add);
    let mut points = Points { expected: expected.min(file.bytes * 8) as usize, ..Points::default() };
    points.normals = layouts.iter().any(|l| l.normal.is_some()).then(Vec::new);
    points.colors = layouts.iter().any(|l| l.color.is_some()).then(Vec::new);
    points.scans = (layouts.len() > 1).then(SparseColumn::default);
    let columns = columns(&layouts)?;
    note_missing(&layouts, &columns, &mut notes);
    file.check_decoded(&layouts, &columns)?;
    points.extras = columns.into_iter().map(|(name, kind)| (name, Typed::new(kind))).collect();
    file.read(&layouts, context.options.repair, &mut notes, |layout, batch| {
        points.append(layout, batch);
        Ok(())
    })?;
    let (invalid, colorless) = (points.invalid, points.colorless);
    let mut cloud = points.finish();
    if cloud.is_empty() {
        return Err(none_valid(invalid).into());
    }
    cloud.viewpoint = if let [layout] = &layouts[..] { layout.viewpoint() } else { None };
    let crs = file.crs();
    cloud.comments = crs.comments();
    file.note_left_out(invalid, colorless, &mut notes);
    let by = file.reader.library_version().map(|v| format!(" by {}", quote(v))).unwrap_or_default();
    let bounds = cloud.bounds().map_or_else(Default::default, |(lo, hi)| format_extent(hi - lo));
    let scans = match layouts.len() {
        1 => "one scan".to_owned(),
        n => format!("{n} scans"),
    };
    let colors = if cloud.colors.is_some() { "" } else { ", no colours" };
    context.note(format!("E57{by}: {} points in {scans}, {bounds} m, {}{colors}", cloud.len(), crs.words()));
    notes.into_iter().for_each(|note| context.note(note));
    context.points(cloud)
}

fn crs_of(text: &str) -> Crs {
    let text = one_line(text.as_bytes());
    let code = text.strip_prefix("EPSG:").or_else(|| text.strip_prefix("epsg:")).and_then(|code| code.parse().ok());
    Crs { wkt: (code.is_none() && text.contains('[')).then_some(text), code, ..Crs::default() }
}

/// Reads a scan as far as possible, and passes its values to `each` in batches of whole points. Reading has its own
/// thread, because the crate's decoding takes as long as the processing here. The inner result is an error if one ended
/// the reading early.
///
/// # Errors
/// [`Problem`] if `each` returns one.
fn read_scan<R: Read + Seek + Send>(
    reader: &mut E57Reader<R>,
    layout: &Layout<'_>,
    each: &mut dyn FnMut(&[RecordValue]) -> Result<(), Problem>,
) -> Result<Result<(), ::e57::Error>, Problem> {
    let width = layout.scan.prototype.len();
    let rows = match reader.pointcloud_raw(layout.scan) {
        Ok(rows) => rows,
        Err(error) => return Ok(Err(error)),
    };
    let (send, receive) = mpsc::sync_channel::<Vec<RecordValue>>(BATCHES_AHEAD);
    let batch_values = width * (BATCH_VALUES / width.max(1)).clamp(1, BATCH_POINTS);
    std::thread::scope(|scope| {
        let reading = scope.spawn(move || {
            let new = || Vec::with_capacity(batch_values);
            let mut batch = new();
            let mut end = Ok(());
            for row in rows {
                match row {
                    Ok(row) => batch.extend(row),
                    Err(error) => {
                        end = Err(error);
                        break;
                    }
                }
                if batch.len() >= batch_values && send.send(std::mem::replace(&mut batch, new())).is_err() {
                    return Ok(());
                }
            }
            let _ = send.send(batch);
            end
        });
        let taken = receive.into_iter().try_for_each(|batch| each(&batch));
        let end = reading.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        taken.map(|()| end)
    })
}
