//! Input files of a COPC conversion: checks that they can be one file, and the variable length records that are copied.

use super::column_input::ColumnInput;
use crate::error::ShowPath as _;
use crate::error::{IoError, Location, Problem, READ};
use crate::format::Format;
use crate::las::copc::output::Record;
use crate::las::copc::records;
use crate::las::header::{Header, POINT_BYTES};
use crate::las::{Sink, field, read_records, unreadable};
use crate::survey::Source;
use glam::DVec3;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use surfel_model::TableColumns;

/// Maximum number of bytes of a variable length record that is copied. Inputs with a larger one are refused.
const MAX_RECORD_BYTES: u64 = 1 << 20;
/// Maximum number of variable length records that are copied from an input. Inputs with more are refused.
const MAX_RECORDS: usize = 256;

/// Inputs that are written as one file, and the column names of the tables among them.
#[derive(Clone, Copy)]
pub(super) struct Sources<'a> {
    pub(super) paths: &'a [PathBuf],
    pub(super) columns: Option<&'a TableColumns>,
}

/// An input file.
pub(super) struct Input {
    pub(super) path: PathBuf,
    pub(super) file_bytes: u64,
    pub(super) header: Header,
    /// Offset of this input's integer coordinates from the first input's, in steps.
    pub(super) shift: [i64; 3],
    /// Bounds of the points as the header states them, relative to the first input's offset; zeros where a bound isn't
    /// finite.
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
    /// Converter of points to records, for files that aren't LAS.
    columns: Option<ColumnInput>,
}

impl Input {
    /// Opens the same file again, to read it a second time.
    pub(super) fn again(&self) -> Result<Self, Stop> {
        match &self.columns {
            None => Ok(open(&self.path)?.0),
            Some(columns) => Ok(Self::of_columns(&self.path, self.file_bytes, columns.clone())),
        }
    }

    fn of_columns(path: &Path, file_bytes: u64, columns: ColumnInput) -> Self {
        let (path, header) = (path.to_path_buf(), columns.header());
        Self { path, file_bytes, header, shift: [0; 3], low: [0.0; 3], high: [0.0; 3], columns: Some(columns) }
    }

    /// Returns the variable length records that the output gets from this input. `raw` is the start of its header, of
    /// 375 bytes.
    pub(super) fn records(&self, raw: &[u8]) -> Result<Vec<Record>, Stop> {
        if let Some(columns) = &self.columns {
            return Ok(columns.records());
        }
        let (.., mut file) = open(&self.path)?;
        raw_records(&mut file, raw, self.file_bytes).map_err(|problem| invalid(&self.path, problem))
    }

    /// Returns the position of the scanner, if one scanner recorded all points.
    pub(super) fn viewpoint(&self) -> Option<DVec3> {
        self.columns.as_ref()?.viewpoint()
    }

    /// Passes the points to `sink` as LAS records.
    pub(super) fn read(&mut self, sink: &mut dyn Sink) -> Result<(), Stop> {
        if let Some(columns) = &self.columns {
            return columns.read(&self.path, sink);
        }
        let system = |source| Stop::Input(IoError::System { path: self.path.clone(), action: READ, source });
        // Each input is opened only while it is read: there may be thousands.
        let mut file = File::open(&self.path).map_err(system)?;
        let read = read_records(&mut file, &mut self.header, self.file_bytes, false, sink);
        read.map_err(|problem| invalid(&self.path, problem))
    }
}

/// Reason why a conversion stops early.
pub(super) enum Stop {
    Input(IoError),
    Disk(io::Error),
}

impl Stop {
    /// Converts to an I/O error, as writers of the output return. An input's error is inside it.
    pub(super) fn into_io(self) -> io::Error {
        match self {
            Self::Input(error) => io::Error::other(error),
            Self::Disk(error) => error,
        }
    }
}

impl From<IoError> for Stop {
    fn from(error: IoError) -> Self {
        Self::Input(error)
    }
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Self::Disk(error)
    }
}

pub(super) fn invalid(path: &Path, problem: Problem) -> Stop {
    Stop::Input(IoError::Invalid { path: path.to_path_buf(), problem: Box::new(problem) })
}

/// Opens all inputs in order and returns each with the first 375 bytes of its header. Packed data is unpacked to
/// `folder`.
pub(super) fn open_all(
    Sources { paths, columns: names }: Sources<'_>,
    folder: &Path,
    progress: &dyn Fn(&'static str, u64, u64),
) -> Result<Vec<(Input, Vec<u8>)>, Stop> {
    let mut opened = Vec::with_capacity(paths.len());
    for path in paths {
        let system = |source| Stop::Input(IoError::System { path: path.to_path_buf(), action: READ, source });
        let file_bytes = std::fs::metadata(path).map_err(system)?.len();
        let columns = if is_las(path)? { None } else { ColumnInput::open(path, folder, names, progress)? };
        opened.push(match columns {
            Some(columns) => (Input::of_columns(path, file_bytes, columns), Vec::new()),
            None => {
                let (input, raw, _) = open(path)?;
                (input, raw)
            }
        });
    }
    ColumnInput::agree(&mut opened.iter_mut().filter_map(|(input, _)| input.columns.as_mut()).collect::<Vec<_>>());
    for (input, raw) in &mut opened {
        if let Some(columns) = &input.columns {
            (input.header, *raw) = (columns.header(), columns.raw_header());
        }
    }
    Ok(opened)
}

fn is_las(path: &Path) -> Result<bool, Stop> {
    let system = |source| Stop::Input(IoError::System { path: path.to_path_buf(), action: READ, source });
    let mut head = Vec::new();
    File::open(path).map_err(system)?.take(512).read_to_end(&mut head).map_err(system)?;
    Ok(matches!(Format::from_seekable_signature(&head), Some(Format::Las | Format::Laz | Format::Copc)))
}

/// Opens an input with LAS records; returns it with the first 375 bytes of its header, and the file.
fn open(path: &Path) -> Result<(Input, Vec<u8>, File), Stop> {
    let system = |source| Stop::Input(IoError::System { path: path.to_path_buf(), action: READ, source });
    if !is_las(path)? {
        let problem = Problem::new("holds nothing that can be written as COPC").expected(
            "points alone, without radii or faces, as LAS, LAZ, COPC, E57, PLY, PCD, NPY, NPZ, PTX or columns of text \
             (XYZ, CSV, PTS)",
        );
        return Err(invalid(path, problem));
    }
    let mut file = File::open(path).map_err(system)?;
    let mut raw = Vec::new();
    (&mut file).take(512).read_to_end(&mut raw).map_err(system)?;
    raw.truncate(375);
    let file_bytes = file.seek(SeekFrom::End(0)).map_err(system)?;
    let header = Header::read(&mut file, file_bytes).map_err(|problem| invalid(path, problem))?;
    // Fields that an older, shorter header lacks are zero.
    let own = usize::from(u16::from_le_bytes(field(&raw, 94)));
    raw.truncate(own.max(227));
    raw.resize(375, 0);
    let (path, shift, low, high) = (path.to_path_buf(), [0; 3], [0.0; 3], [0.0; 3]);
    Ok((Input { path, file_bytes, header, shift, low, high, columns: None }, raw, file))
}

/// Returns the number of whole steps (`scale`) from the offset `first` to the offset `other`, per axis. Returns an
/// error if the difference isn't whole to 1/1000 of a step, or is more than 2⁴⁰ steps.
fn shift(scale: DVec3, first: DVec3, other: DVec3) -> Result<[i64; 3], Problem> {
    let steps = (other - first) / scale;
    let whole = steps.round();
    // Offsets of 10⁷ in steps of 10⁻⁵ have a rounding error of about 10⁻⁴ of a step.
    if (steps - whole).abs().max_element() > 1e-3 || whole.abs().max_element() > 2f64.powi(40) {
        let what = format!("has the offset {other}, which is no whole number of steps from the first input's {first}");
        return Err(Problem::new(what).help("convert it by itself, or give its points the first's offset"));
    }
    Ok(whole.to_array().map(|v| v as i64))
}

/// Inputs, and their extent by their headers.
pub(super) struct Gathered {
    pub(super) inputs: Vec<Input>,
    /// Least and largest coordinates relative to the offset of the written file.
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
    /// Number of points.
    pub(super) count: u64,
    pub(super) notes: Vec<String>,
}

/// Checks that the inputs can be written as one file, and finds their shifts and extent. `scale` and `offset` are those
/// of the first input.
pub(super) fn gather(opened: Vec<(Input, Vec<u8>)>, scale: DVec3, offset: DVec3) -> Result<Gathered, Stop> {
    let (mut low, mut high, mut count) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0_u64);
    let (mut inputs, mut notes) = (Vec::<Input>::with_capacity(opened.len()), Vec::new());
    for (mut input, raw) in opened {
        if let Some(first) = inputs.first() {
            check_alike(first, &input).map_err(|problem| invalid(&input.path, problem))?;
        }
        let shifted = shift(scale, offset, input.header.offset);
        input.shift = shifted.map_err(|problem| invalid(&input.path, problem))?;
        for k in 0..3 {
            // Bounds from the header; points outside of them only make the octree larger.
            let ends = [179, 187].map(|at| f64::from_le_bytes(field(&raw, at + 16 * k)));
            let ends = ends.map(|v| if v.is_finite() { v - offset[k] } else { 0.0 });
            (input.low[k], input.high[k]) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            if input.header.count > 0 {
                (low[k], high[k]) = (low[k].min(input.low[k]), high[k].max(input.high[k]));
            }
        }
        count = count.saturating_add(input.header.count);
        if matches!(input.header.format, 4 | 5 | 9 | 10) {
            notes.push(format!("{}: left out its waveforms", input.path.shown()));
        }
        inputs.push(input);
    }
    if count == 0 {
        (low, high) = ([0.0; 3], [0.0; 3]);
    }
    Ok(Gathered { inputs, low, high, count, notes })
}

/// Checks that two inputs can be written as one file.
fn check_alike(first: &Input, other: &Input) -> Result<(), Problem> {
    let (a, b) = (&first.header, &other.header);
    let unlike = |what: &str, found: String, expected: String| {
        let problem = Problem::new(format!("has {what} {found}")).expected(format!("{expected}, as the first input"));
        Err(problem.help("convert files apart that differ"))
    };
    if a.scale != b.scale {
        return unlike("the coordinate scale", b.scale.to_string(), a.scale.to_string());
    }
    let formats = [a.format, b.format].map(records::target);
    if formats[0] != formats[1] {
        return unlike("points of format", b.format.to_string(), a.format.to_string());
    }
    let names = |h: &Header| h.extra.iter().map(|e| e.name.clone()).collect::<Vec<_>>().join(", ");
    let bytes = |h: &Header| h.record_bytes - POINT_BYTES[usize::from(h.format)];
    if a.extra != b.extra || bytes(a) != bytes(b) {
        let words = |h: &Header| format!("{} ({})", bytes(h), names(h));
        return unlike("extra bytes", words(b), words(a));
    }
    if a.crs != b.crs {
        return unlike("", b.crs.words(), a.crs.words());
    }
    Ok(())
}

/// Reads the variable length records that the output gets from an input: all but those that Surfel writes anew, such as
/// LASzip's. `raw` is the start of the input's header. Extended records become ordinary ones if they are short enough.
fn raw_records(source: &mut dyn Source, raw: &[u8], file_bytes: u64) -> Result<Vec<Record>, Problem> {
    let u32_at = |at: usize| u32::from_le_bytes(field(raw, at));
    let start = u64::from(u32_at(96));
    let mut found = Vec::new();
    let header_bytes = u64::from(u16::from_le_bytes(field(raw, 94))).max(227);
    read_list(source, (header_bytes, start), u32_at(100), false, &mut found)?;
    if raw[25] >= 4 {
        let at = u64::from_le_bytes(field(raw, 235));
        if at >= start {
            read_list(source, (at, file_bytes), u32_at(243), true, &mut found)?;
        }
    }
    Ok(found)
}

fn read_list(
    source: &mut dyn Source,
    (mut at, end): (u64, u64),
    count: u32,
    extended: bool,
    found: &mut Vec<Record>,
) -> Result<(), Problem> {
    let head_bytes = if extended { 60 } else { 54 };
    for _ in 0..count {
        if at.checked_add(head_bytes).is_none_or(|next| next > end) {
            break;
        }
        let mut head = [0; 60];
        source.seek(SeekFrom::Start(at)).map_err(unreadable)?;
        let head = &mut head[..head_bytes as usize];
        source.read_exact(head).map_err(unreadable)?;
        let length =
            if extended { u64::from_le_bytes(field(head, 20)) } else { u64::from(u16::from_le_bytes(field(head, 20))) };
        at += head_bytes;
        if length > end - at {
            break;
        }
        let mut record = Record { head: field(head, 0), description: field(head, head.len() - 32), data: Vec::new() };
        at += length;
        let made_anew =
            [("laszip encoded", 22_204), ("copc", 1), ("copc", 1000), ("LASF_Spec", 7), ("LASF_Spec", 65_535)];
        if made_anew.iter().any(|(user, id)| record.is(user, *id)) {
            continue;
        }
        if length > MAX_RECORD_BYTES || found.len() >= MAX_RECORDS {
            let what = "has variable length records that are larger or more than any real ones";
            return Err(Problem::new(what).at(Location::Byte(at as usize)).help("the file is damaged"));
        }
        record.data.resize(length as usize, 0);
        source.read_exact(&mut record.data).map_err(unreadable)?;
        found.push(record);
    }
    Ok(())
}
