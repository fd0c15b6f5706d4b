//! E57 (ASTM E2807): the scans of a file with their poses applied, one after the other. The crate `e57` reads pages,
//! packets and bits, on a thread of its own; what its values mean is told here.

use crate::color::{linear_of_8_bit, linear_of_16_bit, linear_of_unit};
use crate::content::Content;
use crate::context::Context;
use crate::crs::Crs;
use crate::error::{Fault, Problem, quote};
use crate::rows::KeptRows;
use crate::survey::{NORMAL_NAMES, Scalar, Source, SparseColumn, extent_words, one_line};
use crate::words::counted;
use ::e57::{E57Reader, PointCloud as Scan, Record, RecordDataType, RecordName, RecordValue};
use glam::{DMat3, DQuat, DVec3, Vec3};
use std::collections::BTreeMap;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::sync::mpsc;
use surfel_model::{Column3, ExtraColumn, PointCloud};

/// Points that the reading thread hands over at a time, and how many times it may be ahead.
const BATCH: (usize, usize) = (8192, 4);
/// What positions are certain to, in metres: finer than any scanner is. What f32 rounds away is kept where the farthest
/// point is so far that it would be more than a quarter of this.
const CERTAIN_M: f64 = 1e-4;

/// Seeks within what is buffered already: the crate seeks to each page before it reads it. The end is that of the last
/// whole page, if the file is to be repaired.
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

/// A column of one of the types that a prototype asks for.
enum Typed {
    U8(SparseColumn<u8>),
    U16(SparseColumn<u16>),
    I32(SparseColumn<i32>),
    F32(SparseColumn<f32>),
    F64(SparseColumn<f64>),
}

impl Typed {
    /// The smallest that holds every value.
    fn of(kind: &RecordDataType) -> Self {
        match kind {
            RecordDataType::Single { .. } => Self::F32(SparseColumn::default()),
            RecordDataType::Integer { min: 0.., max: ..=255 } => Self::U8(SparseColumn::default()),
            RecordDataType::Integer { min: 0.., max: ..=65_535 } => Self::U16(SparseColumn::default()),
            RecordDataType::Integer { min: -2_147_483_648.., max: ..=2_147_483_647 } => {
                Self::I32(SparseColumn::default())
            }
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

/// The name of the column that an attribute becomes; `None` for those that become something else.
fn column_name(name: &RecordName) -> Option<String> {
    Some(match name {
        RecordName::Intensity => "intensity".into(),
        RecordName::RowIndex => "row_index".into(),
        RecordName::ColumnIndex => "column_index".into(),
        RecordName::ReturnCount => "return_count".into(),
        RecordName::ReturnIndex => "return_index".into(),
        RecordName::TimeStamp => "time_stamp".into(),
        RecordName::Unknown { name, .. } if !NORMAL_NAMES.contains(&plain(name).as_str()) => name.clone(),
        _ => return None,
    })
}

fn plain(name: &str) -> String {
    crate::survey::plain_name(name)
}

/// A value as a number.
fn number(value: &RecordValue, kind: &RecordDataType) -> f64 {
    match (value, kind) {
        (RecordValue::Single(v), _) => f64::from(*v),
        (RecordValue::Double(v), _) => *v,
        (RecordValue::ScaledInteger(v), RecordDataType::ScaledInteger { scale, offset, .. }) => {
            *v as f64 * scale + offset
        }
        (RecordValue::ScaledInteger(v) | RecordValue::Integer(v), _) => *v as f64,
    }
}

/// Bits of a value in the file.
fn bits(kind: &RecordDataType) -> u32 {
    match *kind {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::ScaledInteger { min, max, .. } | RecordDataType::Integer { min, max } => {
            64 - max.abs_diff(min).leading_zeros()
        }
    }
}

/// The least and largest of a channel of colour.
fn color_range(scan: &Scan, record: &Record, channel: usize) -> Option<(f64, f64)> {
    let limits = scan.color_limits.as_ref().and_then(|l| {
        let (min, max) = match channel {
            0 => (&l.red_min, &l.red_max),
            1 => (&l.green_min, &l.green_max),
            _ => (&l.blue_min, &l.blue_max),
        };
        Some((number(min.as_ref()?, &record.data_type), number(max.as_ref()?, &record.data_type)))
    });
    let of_type = || match record.data_type {
        RecordDataType::Single { min, max } => Some((min?.into(), max?.into())),
        RecordDataType::Double { min, max } => Some((min?, max?)),
        RecordDataType::ScaledInteger { min, max, scale, offset } => {
            Some((min as f64 * scale + offset, max as f64 * scale + offset))
        }
        RecordDataType::Integer { min, max } => Some((min as f64, max as f64)),
    };
    let fine = |(min, max): &(f64, f64)| (max - min).is_finite() && max - min > 0.0 && max - min < 1e12;
    limits.filter(fine).or_else(|| of_type().filter(fine))
}

/// Records of red, green and blue, and the range of each.
type ColorRecords = ([usize; 3], [(f64, f64); 3]);

/// How one scan's values become points.
struct Layout<'a> {
    scan: &'a Scan,
    index: u32,
    /// Records of x y z, or of range, azimuth and elevation.
    position: [usize; 3],
    spherical: bool,
    invalid: Option<usize>,
    color: Option<ColorRecords>,
    color_invalid: Option<usize>,
    normal: Option<[usize; 3]>,
    /// Records that become columns, with the one that says that they are invalid.
    extras: Vec<(String, usize, Option<usize>)>,
    rotation: DMat3,
    translation: DVec3,
}

impl<'a> Layout<'a> {
    /// `None` if the scan has no coordinates.
    fn new(scan: &'a Scan, index: u32, notes: &mut Vec<String>) -> Option<Self> {
        let at = |name: &RecordName| scan.prototype.iter().position(|r| r.name == *name);
        let triple = |names: [RecordName; 3]| -> Option<[usize; 3]> {
            let [a, b, c] = names;
            Some([at(&a)?, at(&b)?, at(&c)?])
        };
        let xyz = triple([RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ]);
        let angles = [RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation];
        let (position, spherical) = match xyz {
            Some(xyz) => (xyz, false),
            None => (triple(angles)?, true),
        };
        let state = if spherical { RecordName::SphericalInvalidState } else { RecordName::CartesianInvalidState };
        let color = triple([RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue]).map(|at| {
            let mut assumed = false;
            let ranges = [0, 1, 2].map(|k| {
                color_range(scan, &scan.prototype[at[k]], k).unwrap_or_else(|| {
                    assumed = true;
                    (0.0, 255.0)
                })
            });
            if assumed {
                notes.push("took the colours as from 0 to 255: the file says no limits".into());
            }
            (at, ranges)
        });
        let named = |wanted: &str| {
            let is = |r: &Record| matches!(&r.name, RecordName::Unknown { name, .. } if plain(name) == wanted);
            scan.prototype.iter().position(is)
        };
        let normal = named("normalx").zip(named("normaly")).zip(named("normalz")).map(|((x, y), z)| [x, y, z]);
        let mut extras = Vec::new();
        for (i, record) in scan.prototype.iter().enumerate() {
            let Some(name) = column_name(&record.name) else { continue };
            let invalid = match record.name {
                RecordName::Intensity => at(&RecordName::IsIntensityInvalid),
                RecordName::TimeStamp => at(&RecordName::IsTimeStampInvalid),
                _ => None,
            };
            extras.push((name, i, invalid));
        }
        let pose = scan.transform.clone().unwrap_or_default();
        let (q, t) = (pose.rotation, pose.translation);
        let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
        let turned = rotation.is_finite() && rotation.length() > 1e-9;
        if !turned {
            notes.push(format!("scan {} has no valid rotation: it is left unturned", index + 1));
        }
        let rotation = if turned { DMat3::from_quat(rotation.normalize()) } else { DMat3::IDENTITY };
        Some(Self {
            scan,
            index,
            position,
            spherical,
            invalid: at(&state),
            color,
            color_invalid: at(&RecordName::IsColorInvalid),
            normal,
            extras,
            rotation,
            translation: DVec3::new(t.x, t.y, t.z),
        })
    }

    /// True of the scans of scanners, in whose rows and columns or angles it shows where they stood.
    fn is_seen_from_one_place(&self) -> bool {
        self.spherical || self.scan.has_spherical() || self.scan.has_row_column()
    }

    fn bits_per_point(&self) -> u64 {
        self.scan.prototype.iter().map(|r| u64::from(bits(&r.data_type))).sum()
    }
}

/// The points read so far.
#[derive(Default)]
struct Points {
    /// How many there will be at most.
    expected: usize,
    origin: Option<DVec3>,
    high: Vec<Vec3>,
    low: Option<Vec<Vec3>>,
    normals: Option<Vec<Vec3>>,
    colors: Option<Vec<[f32; 3]>>,
    extras: BTreeMap<String, Typed>,
    scans: Option<SparseColumn<u32>>,
    kept: KeptRows,
    invalid: u64,
    colorless: u64,
}

impl Points {
    /// Appends a batch: the values of a point after the other.
    fn append(&mut self, layout: &Layout<'_>, batch: &[RecordValue]) {
        let records = &layout.scan.prototype;
        let value = |row: &[RecordValue], i: usize| number(&row[i], &records[i].data_type);
        let flagged = |row: &[RecordValue], i: Option<usize>| i.is_some_and(|i| value(row, i) != 0.0);
        let all = batch.chunks_exact(records.len());
        let count = all.len();
        let is_valid = |row: &&[RecordValue]| !flagged(row, layout.invalid);
        let rows: Vec<&[RecordValue]> = all.clone().filter(is_valid).collect();
        all.for_each(|row| if is_valid(&row) { self.kept.keep() } else { self.kept.skip() });
        self.invalid += (count - rows.len()) as u64;
        let world: Vec<DVec3> = rows
            .iter()
            .map(|row| {
                let [a, b, c] = layout.position.map(|i| value(row, i));
                let local = if layout.spherical {
                    let (azimuth, elevation) = (b.sin_cos(), c.sin_cos());
                    a * DVec3::new(elevation.1 * azimuth.1, elevation.1 * azimuth.0, elevation.0)
                } else {
                    DVec3::new(a, b, c)
                };
                layout.rotation * local + layout.translation
            })
            .collect();
        let before = self.high.len();
        self.place(&world);
        if let Some(normals) = &mut self.normals {
            normals.extend(rows.iter().map(|row| match layout.normal {
                Some(n) => (layout.rotation * DVec3::from(n.map(|i| value(row, i)))).as_vec3(),
                None => Vec3::ZERO,
            }));
        }
        if let Some(colors) = &mut self.colors {
            let white = [1.0; 3];
            match layout.color {
                Some((at, ranges)) => {
                    let decode = ranges.map(decoder);
                    colors.extend(rows.iter().map(|row| {
                        if flagged(row, layout.color_invalid) {
                            self.colorless += 1;
                            return white;
                        }
                        std::array::from_fn(|k| decode[k](value(row, at[k]), ranges[k]))
                    }));
                }
                None => {
                    self.colorless += rows.len() as u64;
                    colors.resize(before + rows.len(), white);
                }
            }
        }
        let mut values = Vec::with_capacity(rows.len());
        for (name, column) in &mut self.extras {
            values.clear();
            match layout.extras.iter().find(|(n, ..)| n == name) {
                Some((_, at, invalid)) => {
                    let valid = |row: &[RecordValue]| if flagged(row, *invalid) { 0.0 } else { value(row, *at) };
                    values.extend(rows.iter().map(|row| valid(row)));
                }
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
        if self.low.is_none() && finite.fold(0.0, f64::max) * 2f64.powi(-24) > CERTAIN_M / 4.0 {
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

/// A level as a linear value: by a table where levels count to 255 or 65535.
fn decoder(range: (f64, f64)) -> fn(f64, (f64, f64)) -> f32 {
    if range == (0.0, 255.0) {
        |v, _| linear_of_8_bit()[v.round().clamp(0.0, 255.0) as usize]
    } else if range == (0.0, 65_535.0) {
        |v, _| linear_of_16_bit()[v.round().clamp(0.0, 65_535.0) as usize]
    } else {
        |v, (min, max)| linear_of_unit((v - min) / (max - min))
    }
}

pub(crate) fn read(source: &mut dyn Source, context: &mut Context<'_>) -> Result<Content, Fault> {
    let file_bytes = source.seek(SeekFrom::End(0)).map_err(problem)?;
    let repair = context.options.repair;
    let pages = Pages::new(source, file_bytes, repair).map_err(problem)?;
    let mut reader = E57Reader::new(pages).map_err(problem)?;
    let scans = reader.pointclouds();
    let mut notes = Vec::new();
    let mut layouts = Vec::new();
    for (i, scan) in scans.iter().enumerate().filter(|(_, scan)| scan.records > 0) {
        match Layout::new(scan, i as u32, &mut notes) {
            Some(layout) if layout.bits_per_point() > 0 => layouts.push(layout),
            _ => notes.push(format!("left out scan {}, which has no coordinates", i + 1)),
        }
    }
    notes.dedup();
    if layouts.is_empty() {
        let what =
            format!("is an E57 file of {} scans and {} images, and no point", scans.len(), reader.images().len());
        return Err(Problem::new(what).expected("points").into());
    }
    let fits = |l: &Layout<'_>| l.scan.records.min(file_bytes * 8 / l.bits_per_point());
    let expected = layouts.iter().map(fits).fold(0, u64::saturating_add).min(file_bytes * 8) as usize;
    let mut points = Points { expected, ..Points::default() };
    points.normals = layouts.iter().any(|l| l.normal.is_some()).then(Vec::new);
    points.colors = layouts.iter().any(|l| l.color.is_some()).then(Vec::new);
    points.scans = (layouts.len() > 1).then(SparseColumn::default);
    for layout in &layouts {
        for (name, at, _) in &layout.extras {
            let typed = Typed::of(&layout.scan.prototype[*at].data_type);
            let same =
                points.extras.get(name).is_none_or(|t| std::mem::discriminant(t) == std::mem::discriminant(&typed));
            points.extras.insert(name.clone(), if same { typed } else { Typed::F64(SparseColumn::default()) });
        }
    }
    for layout in &layouts {
        let before = points.kept.read();
        match read_scan(&mut reader, layout, &mut points) {
            Err(error) if repair => {
                let (scan, all) = (layout.index + 1, layout.scan.records);
                let why = one_line(error.to_string().as_bytes());
                let why: String = why.chars().take(200).collect();
                notes.push(format!(
                    "scan {scan} is damaged: took {} of its {all} points ({why})",
                    points.kept.read() - before
                ));
            }
            read => read.map_err(|error| {
                let (scan, all) = (layout.index + 1, layout.scan.records);
                let problem =
                    problem(format!("scan {scan}, {all} points: {error} after {}", points.kept.read() - before));
                problem.help("copy the file again; --repair takes the points before the damage")
            })?,
        }
    }
    let (invalid, colorless) = (points.invalid, points.colorless);
    let mut cloud = points.finish();
    if cloud.is_empty() {
        let what = format!("holds no point but {invalid} that are flagged as invalid");
        return Err(Problem::new(what).expected("at least one").into());
    }
    if let [layout] = layouts.as_slice()
        && layout.is_seen_from_one_place()
        && layout.translation.is_finite()
    {
        cloud.viewpoint = Some(layout.translation);
    }
    let crs = reader.coordinate_metadata().map(crs_of).unwrap_or_default();
    cloud.comments = crs.comments();
    if invalid > 0 {
        notes.push(format!("left out {} flagged as invalid", counted(invalid, "points")));
    }
    if colorless > 0 {
        notes.push(format!("{} without a colour: white", counted(colorless, "points")));
    }
    let images = reader.images().len();
    if images > 0 {
        notes.push(format!("left out {}", counted(images as u64, "images")));
    }
    let by = reader.library_version().map(|v| format!(" by {}", quote(v))).unwrap_or_default();
    let bounds = cloud.bounds().map_or_else(Default::default, |(lo, hi)| extent_words(hi - lo));
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

/// Reads a scan as far as it goes: on a thread of its own, as the crate's work takes as long as ours.
fn read_scan<R: Read + Seek + Send>(
    reader: &mut E57Reader<R>,
    layout: &Layout<'_>,
    points: &mut Points,
) -> Result<(), ::e57::Error> {
    let width = layout.scan.prototype.len();
    let rows = reader.pointcloud_raw(layout.scan)?;
    let (send, receive) = mpsc::sync_channel::<Vec<RecordValue>>(BATCH.1);
    std::thread::scope(|scope| {
        let reading = scope.spawn(move || {
            let new = || Vec::with_capacity(BATCH.0 * width);
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
                if batch.len() >= BATCH.0 * width && send.send(std::mem::replace(&mut batch, new())).is_err() {
                    return Ok(());
                }
            }
            let _ = send.send(batch);
            end
        });
        receive.into_iter().for_each(|batch| points.append(layout, &batch));
        reading.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}
