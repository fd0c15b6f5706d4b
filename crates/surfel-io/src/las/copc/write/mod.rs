//! Writing of point files as one COPC file, in memory that doesn't grow with the input.
//!
//! Points are sorted into grid cells in a temporary file. Points near a cell's border are also written to the margins
//! of its neighbours. The octree is then built part by part; a part is a subtree that is built in memory. Points of
//! some parts are read back, get splats and levels, and their nodes become compressed chunks in a second temporary
//! file. The output is assembled from these chunks at the end.

mod column_input;
mod extra_bytes;
mod grid;
mod inputs;
mod parts;
mod resume;
mod shards;
mod share;

use super::build::{CELL_BITS, LEAF_POINTS, Part};
use super::octants::code;
use super::output::{Chunk, Cube, Record, Summary, Template};
use super::spill::{Index, List, Spill, checksum, unnamed};
use super::{LEVEL_COLORS, NORMALS, RADIUS, output, records};
use crate::atomic::Temporary;
use crate::error::ShowPath as _;
use crate::error::{IoError, Problem};
use crate::las::header::{Header, POINT_BYTES};
use crate::las::{Sink, field};
use ::laz::LazVlr;
use extra_bytes::descriptions;
use glam::DVec3;
use grid::{Cells, Frame, Grid, in_reach};
use inputs::{Input, Stop, check_alike, invalid, open_all, shift};
use parts::{Loaded, Made, Maker, Packed, is_withheld, packed, position};
use rayon::prelude::*;
use resume::{Kept, Manifest};
use serde::{Deserialize, Serialize};
use share::Share;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs::File;
use std::hash::Hash;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use surfel_model::TableColumns;

pub use parts::{PointSplat, Prepare};

/// Limits on the points per grid cell, per part, in memory, and between two saved states.
#[derive(Clone, Copy)]
struct Limits {
    /// Number of points of a surface that a grid cell is made for.
    cell_points: u64,
    /// Maximum number of grid cells.
    most_cells: usize,
    /// Maximum number of points of a part; a part whose points are all in one place may have more.
    most_points: u64,
    /// Maximum number of points of all parts in memory together; a single larger part is still built.
    held_points: u64,
    /// Maximum number of points in one place, which no subdivision separates.
    most_in_place: u64,
    /// Bytes of sorted points after which the state is synced to disk, with `resume`.
    kept_bytes: u64,
}

/// Memory per point of a part, in bytes, with its normal and radius; then the fixed memory beside the points.
const HELD_POINT_BYTES: u64 = 160;
const OTHER_BYTES: u64 = 64 << 20;
/// Record size, in bytes, that [`HELD_POINT_BYTES`] includes.
const USUAL_POINT_BYTES: u64 = 64;
/// Minimum memory of a conversion, in bytes: the memory of one part.
pub const LEAST_MEMORY: u64 = 200 << 20;

impl Limits {
    /// Returns the limits that fit into `memory` bytes. Memory decides only how many parts are built at once, not the
    /// output.
    fn new(memory: u64) -> Self {
        let (cell_points, most_points) = (1_000_000, 1_000_000);
        let useful = cell_points * rayon::current_num_threads() as u64;
        let room = memory.saturating_sub(OTHER_BYTES) / HELD_POINT_BYTES;
        let held_points = room.min(useful).max(most_points);
        Self {
            cell_points,
            most_cells: 1 << 18,
            most_points,
            held_points,
            most_in_place: room.max(most_points),
            kept_bytes: 256 << 20,
        }
    }

    /// Scales the limits to records of `bytes` bytes: fewer points fit if records are larger than usual.
    fn of_points(self, bytes: u64) -> Self {
        let fewer = |points: u64| match bytes {
            0..=USUAL_POINT_BYTES => points,
            _ => points.saturating_mul(HELD_POINT_BYTES) / (HELD_POINT_BYTES - USUAL_POINT_BYTES + bytes),
        };
        let Self { most_points, held_points, most_in_place, .. } = self;
        let [most_points, held_points, most_in_place] =
            [most_points, held_points, most_in_place].map(|n| fewer(n).max(1));
        Self { most_points, held_points, most_in_place, ..self }
    }
}

/// Bytes of nodes above the parts that are compressed at a time.
const BATCH_BYTES: usize = 64 << 20;

/// Summary of a written COPC file.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct CopcReport {
    /// Number of points.
    pub points: u64,
    /// Number of nodes with points.
    pub nodes: usize,
    /// Number of levels, including the root's.
    pub levels: u32,
    /// Messages for the user: sentences without a full stop.
    pub notes: Vec<String>,
}

/// Options of a COPC conversion.
#[derive(Clone, Debug, Default)]
pub struct CopcOptions {
    /// True if an existing output is replaced.
    pub overwrite: bool,
    /// Approximate memory to use, in bytes; at least [`LEAST_MEMORY`].
    pub memory: u64,
    /// True if progress is saved in the folder `OUTPUT.resume`, and an interrupted conversion of the same inputs
    /// continues from there. The folder is removed once the output exists. An existing shard of the same inputs isn't
    /// written again.
    pub resume: bool,
    /// Index and count of the shard to write instead of the whole file; the index is less than the count.
    pub shard: Option<[u32; 2]>,
    /// Column names of the tables among the inputs ([`crate::LoadOptions::columns`]).
    pub columns: Option<TableColumns>,
}

/// Inputs that are written as one file, and the column names of the tables among them.
#[derive(Clone, Copy)]
struct Sources<'a> {
    paths: &'a [PathBuf],
    columns: Option<&'a TableColumns>,
}

/// Writes the points of LAS, LAZ and COPC files as one COPC file, each point once, with all fields of its record.
/// Formats 0 to 5 become 6 or 7; waveforms are dropped. Inputs must agree in scale, format columns, extra bytes and
/// coordinate reference system, and their offsets must differ by whole steps. Points of E57, PLY, PCD, NPY, NPZ, PTX
/// and text become records whose step is a power of two, the same for all inputs.
///
/// Each point gets, as extra bytes, the mean colour of the points that it represents at its level. With `prepare`, each
/// point also gets its radius, its normal and the mean normal. `prepare` runs for several parts of the cloud in
/// parallel, each with the points around it. The output is deterministic, whatever the number of threads. `progress`
/// receives a stage's name, the amount done and the total.
///
/// With [`CopcOptions::shard`] the output is one shard. Passing all shards as `inputs` merges them. The merged file
/// doesn't depend on the number of shards. It equals a file written without shards if the bounds in the inputs' headers
/// are exact. If the bounds are wider, the octree may be larger, which a note states; a point outside of them is an
/// error.
///
/// # Errors
/// [`IoError::Invalid`] for an unsupported or damaged input, for one that doesn't match the first, and for a resume
/// folder of another conversion. [`IoError::Exists`] and [`IoError::System`] as [`crate::atomic::write`].
pub fn save_copc(
    inputs: &[PathBuf],
    output: &Path,
    options: &CopcOptions,
    prepare: Option<Prepare<'_>>,
    progress: &dyn Fn(&'static str, u64, u64),
) -> Result<CopcReport, IoError> {
    if let Some(path) = inputs.iter().find(|path| shards::is_shard(path)) {
        if options.shard.is_some() {
            let problem = Problem::new("is a share of a conversion, which can't be shared out").expected("its inputs");
            return Err(IoError::Invalid { path: path.clone(), problem: Box::new(problem) });
        }
        return shards::merge(inputs, output, options.overwrite, progress);
    }
    save(inputs, output, options, prepare, progress, Limits::new(options.memory))
}

/// Returns the folder beside an output in which [`CopcOptions::resume`] saves progress.
pub fn resume_folder(output: &Path) -> PathBuf {
    resume::folder_of(output)
}

/// Writes a COPC file of the inputs to a temporary file in `folder`, which exists as long as the returned
/// [`Temporary`].
///
/// # Errors
/// Errors of [`save_copc`].
pub fn save_temporary_copc(
    (inputs, columns): (&[PathBuf], Option<&TableColumns>),
    folder: &Path,
    memory: u64,
    prepare: Option<Prepare<'_>>,
    progress: &dyn Fn(&'static str, u64, u64),
) -> Result<(Temporary, CopcReport), IoError> {
    let write = |content: Content<'_>| Temporary::write(folder, content);
    let inputs = Sources { paths: inputs, columns };
    write_by(inputs, folder, (None, None), prepare, progress, Limits::new(memory), write)
}

fn save(
    inputs: &[PathBuf],
    output: &Path,
    options: &CopcOptions,
    prepare: Option<Prepare<'_>>,
    progress: &dyn Fn(&'static str, u64, u64),
    limits: Limits,
) -> Result<CopcReport, IoError> {
    let mut kept = None;
    if options.resume {
        let is_there = output.is_file() && !options.overwrite;
        if is_there && !resume::folder_of(output).is_dir() {
            return match options.shard {
                Some(shard) => shards::done(inputs, output, shard),
                None => Err(IoError::Exists { path: output.to_path_buf() }),
            };
        }
        let opened = Kept::open(output, &Manifest::new(inputs, prepare.is_some(), options)?)?;
        if is_there {
            let Some(report) = opened.report_of(output)? else {
                return Err(IoError::Exists { path: output.to_path_buf() });
            };
            opened.remove();
            return Ok(report);
        }
        kept = Some(opened);
    }
    let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let part = (kept.as_ref(), options.shard);
    let write = |content: Content<'_>| crate::atomic::write(output, options.overwrite, content);
    let inputs = Sources { paths: inputs, columns: options.columns.as_ref() };
    let ((), report) = write_by(inputs, folder, part, prepare, progress, limits, write)?;
    if let Some(kept) = kept {
        kept.remove();
    }
    Ok(report)
}

/// A callback that writes a file's content.
type Content<'a> = &'a mut dyn FnMut(&mut dyn Write) -> io::Result<()>;

/// Passes the content to `write` and returns its result. Points are sorted in `folder`.
fn write_by<T>(
    inputs: Sources<'_>,
    folder: &Path,
    (kept, shard): (Option<&Kept>, Option<[u32; 2]>),
    prepare: Option<Prepare<'_>>,
    progress: &dyn Fn(&'static str, u64, u64),
    limits: Limits,
    write: impl FnOnce(Content<'_>) -> Result<T, IoError>,
) -> Result<(T, CopcReport), IoError> {
    let mut report = CopcReport::default();
    let made = write(&mut |sink| {
        let mut writer =
            Writer::new(inputs, folder, (kept, shard), prepare, progress, limits).map_err(Stop::into_io)?;
        writer.sort_all().and_then(|()| writer.build()).map_err(Stop::into_io)?;
        let mut counted = Counted { sink, bytes: 0 };
        report = match shard {
            Some(shard) => shards::write(writer, shard, &mut counted)?,
            None => writer.finish(&mut counted)?,
        };
        if let Some(kept) = kept {
            kept.written(counted.bytes, &report)?;
        }
        Ok(())
    });
    let made = made.map_err(|error| match kept {
        Some(kept) => kept.blamed(error),
        None => error,
    })?;
    Ok((made, report))
}

/// A writer that counts the bytes written.
struct Counted<'a> {
    sink: &'a mut dyn Write,
    bytes: u64,
}

impl Write for Counted<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.sink.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }
}

/// Saved state after the points of `inputs` inputs are sorted.
#[derive(Deserialize, Serialize)]
struct Sorted {
    inputs: usize,
    finest: i64,
    points: Index<[i64; 3]>,
    margins: Index<[i64; 3]>,
    summary: Summary,
    notes: Vec<String>,
}

/// Saved state after `parts` parts are built.
#[derive(Default, Deserialize, Serialize)]
struct Built {
    parts: usize,
    points: u64,
    chunks: Vec<Chunk>,
    chunk_bytes: u64,
    upper: Index<(u32, u64)>,
}

struct Writer<'a> {
    inputs: Vec<Input>,
    folder: PathBuf,
    /// Resume folder, if progress is saved.
    kept: Option<&'a Kept>,
    /// The shard that is written; `None` for a whole file.
    share: Option<Share>,
    prepare: Option<Prepare<'a>>,
    progress: &'a dyn Fn(&'static str, u64, u64),
    template: Template,
    /// Bytes of a sorted record: the standard's fields and the inputs' extra bytes.
    sorted_bytes: usize,
    /// Normal components in the inputs' extra bytes: byte offset, type, scale and offset of each.
    normals: Option<[(usize, u8, f64, f64); 3]>,
    /// Position of the scanner, if one scanner recorded all points.
    viewpoint: Option<DVec3>,
    /// True if Surfel's extra bytes include normals.
    adds_normals: bool,
    grid: Grid,
    spill: Spill<[i64; 3]>,
    /// Records of points near a cell's border, by the neighbouring cell; empty without `prepare`.
    margins: Spill<[i64; 3]>,
    /// Parts in memory that are built together with the next ones.
    waiting: Vec<Loaded>,
    /// Records of nodes above the parts.
    upper: Spill<(u32, u64)>,
    laz: LazVlr,
    chunks: Vec<Chunk>,
    chunk_file: File,
    chunk_bytes: u64,
    taken: HashSet<(u32, u64)>,
    summary: Summary,
    cube: Option<Cube>,
    limits: Limits,
    /// Number of sorted inputs, and of built parts.
    inputs_sorted: usize,
    parts_built: usize,
    /// Number of points read, and of points built.
    read: u64,
    done: u64,
    notes: Vec<String>,
}

/// Layout of the records that are sorted and written.
struct Layout {
    template: Template,
    /// Bytes of a sorted record: the standard's fields and the inputs' extra bytes.
    sorted_bytes: usize,
    /// Normal components in the inputs' extra bytes: byte offset, type, scale and offset of each.
    normals: Option<[(usize, u8, f64, f64); 3]>,
    /// True if Surfel's extra bytes include normals.
    adds_normals: bool,
}

impl Layout {
    /// Returns the layout for inputs like the first one, with the bytes `raw` of its header. With `prepares`, Surfel's
    /// extra bytes are added.
    fn of(first: &Input, raw: &[u8], prepares: bool) -> Result<Self, Stop> {
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
        Ok(Self { template, sorted_bytes, normals, adds_normals })
    }
}

/// Inputs, and their extent by their headers.
struct Gathered {
    inputs: Vec<Input>,
    /// Least and largest coordinates relative to the offset of the written file.
    low: [f64; 3],
    high: [f64; 3],
    /// Number of points.
    count: u64,
}

/// Checks that the inputs are alike, and finds their shifts and extent.
fn gather(
    opened: Vec<(Input, Vec<u8>)>,
    scale: DVec3,
    offset: DVec3,
    notes: &mut Vec<String>,
) -> Result<Gathered, Stop> {
    let (mut low, mut high, mut count) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0_u64);
    let mut inputs: Vec<Input> = Vec::with_capacity(opened.len());
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
    Ok(Gathered { inputs, low, high, count })
}

/// Octant whose points are built together.
#[derive(Clone, Copy)]
struct Octant {
    /// Level below the root.
    depth: u32,
    /// Morton code of the octant at its depth.
    code: u64,
    /// Level of a leaf above the octant, if there is one.
    leaf_at: Option<u32>,
}

impl<'a> Writer<'a> {
    fn new(
        inputs: Sources<'_>,
        folder: &Path,
        (kept, shard): (Option<&'a Kept>, Option<[u32; 2]>),
        prepare: Option<Prepare<'a>>,
        progress: &'a dyn Fn(&'static str, u64, u64),
        limits: Limits,
    ) -> Result<Self, Stop> {
        let opened = open_all(inputs, folder, progress)?;
        let Some((first, raw)) = opened.first() else {
            return Err(Stop::Disk(io::Error::other("no input is given")));
        };
        let Layout { template, sorted_bytes, normals, adds_normals } = Layout::of(first, raw, prepare.is_some())?;
        let (scale, offset) = (first.header.scale, first.header.offset);
        let limits = limits.of_points(sorted_bytes as u64);
        let mut notes = Vec::new();
        let Gathered { inputs, low, high, count } = gather(opened, scale, offset, &mut notes)?;
        let mut grid = Grid::new(scale, [low, high], count, (limits.cell_points, limits.most_cells));
        let laz = template.laz()?;
        let share = shard.map(|shard| Share::new(shard, &inputs, grid, scale));
        let (mut sorted, mut built) = (None, None);
        if let Some(kept) = kept {
            (sorted, built) = (kept.load::<Sorted>(resume::SORTED)?, kept.load::<Built>(resume::BUILT)?);
        }
        let mut built: Built = built.filter(|_| sorted.is_some()).unwrap_or_default();
        let nothing = Sorted {
            inputs: 0,
            finest: grid.finest,
            points: Index::default(),
            margins: Index::default(),
            summary: Summary::default(),
            notes,
        };
        let sorted = sorted.unwrap_or(nothing);
        grid.finest = sorted.finest;
        let file = |name: &str, bytes: u64| match kept {
            Some(kept) => kept.file(name, bytes),
            None => Ok(unnamed(folder)?),
        };
        let upper = Spill::of(file(resume::UPPER, built.upper.end)?, std::mem::take(&mut built.upper));
        Ok(Self {
            folder: folder.to_path_buf(),
            kept,
            share,
            prepare,
            progress,
            template,
            sorted_bytes,
            normals,
            viewpoint: if let [input] = &inputs[..] { input.viewpoint() } else { None },
            adds_normals,
            grid,
            spill: Spill::of(file(resume::POINTS, sorted.points.end)?, sorted.points),
            margins: Spill::of(file(resume::MARGINS, sorted.margins.end)?, sorted.margins),
            waiting: Vec::new(),
            upper,
            laz,
            chunk_file: file(resume::CHUNKS, built.chunk_bytes)?,
            chunk_bytes: built.chunk_bytes,
            chunks: built.chunks,
            taken: HashSet::new(),
            summary: sorted.summary,
            cube: None,
            limits,
            inputs_sorted: sorted.inputs,
            parts_built: built.parts,
            read: inputs.iter().take(sorted.inputs).fold(0, |sum, input| sum.saturating_add(input.header.count)),
            done: built.points,
            notes: sorted.notes,
            inputs,
        })
    }

    /// Sorts the points of all inputs into grid cells.
    fn sort_all(&mut self) -> Result<(), Stop> {
        let mut inputs = std::mem::take(&mut self.inputs);
        let needed: Vec<bool> =
            (0..inputs.len()).map(|i| self.share.as_ref().is_none_or(|share| share.needs(i))).collect();
        let counts = inputs.iter().zip(&needed).filter(|(_, needed)| **needed).map(|(input, _)| input.header.count);
        let all = counts.fold(0_u64, u64::saturating_add);
        let (mut stored, count) = (self.summary.count, inputs.len());
        for (i, input) in inputs.iter_mut().enumerate().skip(self.inputs_sorted) {
            if needed[i] {
                let (format, input_bytes, shift) = (input.header.format, input.header.record_bytes, input.shift);
                let (record, failed) = (Vec::new(), None);
                let mut sorter = Sorter { writer: self, input: i, format, input_bytes, shift, all, record, failed };
                let read = input.read(&mut sorter);
                match sorter.failed.take() {
                    Some(error) => return Err(error.into()),
                    None => read?,
                }
                let notes = input.header.notes.drain(..);
                self.notes.extend(notes.map(|note| format!("{}: {note}", input.path.shown())));
            }
            let unstored = (self.summary.count - stored).saturating_mul(self.sorted_bytes as u64);
            if let Some(kept) = self.kept
                && (unstored >= self.limits.kept_bytes || i + 1 == count)
            {
                let (points, margins) = (self.spill.stored()?, self.margins.stored()?);
                let (finest, summary, notes) = (self.grid.finest, self.summary.clone(), self.notes.clone());
                let state = Sorted { inputs: i + 1, finest, points, margins, summary, notes };
                kept.save(resume::SORTED, &state)?;
                stored = self.summary.count;
            }
        }
        self.inputs = inputs;
        match self.summary.count {
            0 if self.share.is_none() => {
                let others = if count > 1 { ", and no other input does" } else { "" };
                let problem = Problem::new(format!("holds no point{others}")).expected("at least one");
                Err(self
                    .inputs
                    .first()
                    .map_or(Stop::Disk(io::ErrorKind::NotFound.into()), |i| invalid(&i.path, problem)))
            }
            _ => Ok(()),
        }
    }

    /// Returns the octree over all cells, and the cells of each part, in order.
    fn frame(&self) -> (Frame, BTreeMap<u64, Vec<[i64; 3]>>) {
        let mut found: Vec<[i64; 3]> = self.spill.sizes().map(|(cell, _)| cell).collect();
        found.sort_unstable();
        let (frame, cells) = match &self.share {
            Some(share) => (share.frame, share.cells),
            None => {
                let end =
                    |fold: fn(i64, i64) -> i64| [0, 1, 2].map(|k| found.iter().map(|c| c[k]).reduce(fold).unwrap_or(0));
                let cells = Cells::new(end(i64::min), end(i64::max));
                let ends = [self.summary.low, self.summary.high].map(|end| self.grid.units(end));
                let end = |fold: fn(i64, i64) -> i64| [0, 1, 2].map(|k| fold(ends[0][k], ends[1][k]));
                (Frame::over(&self.grid, &cells, [end(i64::min), end(i64::max)]), cells)
            }
        };
        let mut parts: BTreeMap<u64, Vec<[i64; 3]>> = BTreeMap::new();
        for cell in found {
            if let Some(part) = cells.part(cell) {
                parts.entry(part).or_default().push(cell);
            }
        }
        (frame, parts)
    }

    /// Assigns a level to each point and compresses the nodes.
    fn build(&mut self) -> Result<(), Stop> {
        let (frame, parts) = self.frame();
        let side = (frame.finest << frame.bits) as f64 * self.grid.unit;
        let low = [0, 1, 2].map(|k| (self.grid.low[k] + frame.low[k]) as f64 * self.grid.unit);
        let center = (DVec3::from(self.template.offset) + DVec3::from(low) + 0.5 * side).to_array();
        let spacing = side / f64::from(1_u32 << CELL_BITS);
        self.cube = Some(Cube { center, half: 0.5 * side, spacing });
        // Number of points of each octant from the root to the parts' level.
        let bytes: HashMap<[i64; 3], u64> = self.spill.sizes().collect();
        let mut counts: HashMap<(u32, u64), u64> = HashMap::new();
        for (code, cells) in &parts {
            let points = cells.iter().map(|cell| bytes[cell]).sum::<u64>() / self.sorted_bytes as u64;
            (0..=frame.depth).for_each(|l| *counts.entry((l, code >> (3 * (frame.depth - l)))).or_default() += points);
        }
        if let Some(share) = &self.share {
            share.complete(&mut counts, &self.inputs)?;
        }
        let mut sorted = std::mem::replace(&mut self.spill, Spill::new(&self.folder)?);
        let mut margins = std::mem::replace(&mut self.margins, Spill::new(&self.folder)?);
        // From here on the parts use the memory.
        sorted.flush()?;
        margins.flush()?;
        let count = parts.len();
        for (i, (code, cells)) in parts.into_iter().enumerate().skip(self.parts_built) {
            let points = counts[&(frame.depth, code)];
            if !self.waiting.is_empty() && self.waiting_points() + points > self.limits.held_points {
                self.make_waiting(&frame)?;
                self.keep(i)?;
            }
            let is_leaf = |l: &u32| counts[&(*l, code >> (3 * (frame.depth - l)))] <= LEAF_POINTS;
            let leaf_at = (0..frame.depth).find(is_leaf);
            let lists = cells.iter().map(|cell| sorted.take(*cell)).collect();
            let around = cells.iter().map(|cell| margins.take(*cell)).collect();
            let octant = Octant { depth: frame.depth, code, leaf_at };
            self.part(&frame, octant, (&mut sorted, lists), (&mut margins, around))?;
        }
        drop((sorted, margins));
        self.make_waiting(&frame)?;
        self.keep(count)?;
        if self.share.is_some() {
            // Other shards have points of the nodes above, too.
            return Ok(());
        }
        let mut keys: Vec<(u32, u64)> = self.upper.sizes().map(|(key, _)| key).collect();
        keys.sort_unstable();
        let mut batch: Vec<((u32, u64), Vec<u8>)> = Vec::new();
        for key in keys {
            let list = self.upper.take(key);
            let mut records = Vec::with_capacity(list.bytes as usize);
            self.upper.read(&list, &mut |block| {
                records.extend_from_slice(block);
                Ok(())
            })?;
            batch.push((key, records));
            if batch.iter().map(|(_, records)| records.len()).sum::<usize>() > BATCH_BYTES {
                self.compress(std::mem::take(&mut batch))?;
            }
        }
        Ok(self.compress(batch)?)
    }

    /// Saves the state after `parts` parts, none of which is waiting. `taken` needn't be saved. Its cells are octants
    /// of level 7 or more, and parts are of level 7 at most, so no cell extends over two parts.
    fn keep(&mut self, parts: usize) -> Result<(), Stop> {
        let Some(kept) = self.kept else { return Ok(()) };
        self.chunk_file.sync_data()?;
        let (chunks, upper) = (std::mem::take(&mut self.chunks), self.upper.stored()?);
        let state = Built { parts, points: self.done, chunks, chunk_bytes: self.chunk_bytes, upper };
        kept.save(resume::BUILT, &state)?;
        self.chunks = state.chunks;
        Ok(())
    }

    /// Returns the number of points of the waiting parts.
    fn waiting_points(&self) -> u64 {
        self.waiting.iter().map(|part| part.records.len() / self.sorted_bytes).sum::<usize>() as u64
    }

    /// Reads the points of an octant into memory; divides the octant into its children where it has too many points.
    fn part<K: Copy + Eq + Hash>(
        &mut self,
        frame: &Frame,
        octant: Octant,
        (spill, lists): (&mut Spill<K>, Vec<List>),
        (margins, around): (&mut Spill<K>, Vec<List>),
    ) -> Result<(), Stop> {
        let Octant { depth, code: octant, leaf_at } = octant;
        let size = self.sorted_bytes;
        let bytes = |lists: &[List]| lists.iter().map(|list| list.bytes).sum::<u64>();
        let points = bytes(&lists) / size as u64;
        let grid = self.grid;
        let is_inside = |record: &[u8]| frame.octant(grid.units(position(record)), depth) == octant;
        if points > self.limits.most_points && depth + CELL_BITS < frame.bits {
            let [mut apart, mut beside] = [Spill::new(&self.folder)?, Spill::new(&self.folder)?];
            let mut add_beside = |record: &[u8]| {
                let side = frame.finest << (frame.bits - depth - 1);
                let units = grid.units(position(record));
                let from_root = [0, 1, 2].map(|k| units[k] - frame.low[k]);
                in_reach(from_root, side, &mut |cell| match octant == code(cell.map(|c| (c >> 1) as u32)) {
                    true => beside.append(code(cell.map(|c| c as u32)), record),
                    false => Ok(()),
                })
            };
            let has_splats = self.prepare.is_some();
            for list in &lists {
                spill.read(list, &mut |block| {
                    block.chunks_exact(size).try_for_each(|record| {
                        apart.append(frame.octant(grid.units(position(record)), depth + 1), record)?;
                        if has_splats && !is_withheld(record) { add_beside(record) } else { Ok(()) }
                    })
                })?;
            }
            for list in &around {
                margins.read(list, &mut |block| {
                    block.chunks_exact(size).filter(|r| !is_inside(r)).try_for_each(&mut add_beside)
                })?;
            }
            drop((lists, around));
            let mut octants: Vec<u64> = apart.sizes().map(|(octant, _)| octant).collect();
            octants.sort_unstable();
            for octant in octants {
                let (lists, around) = (vec![apart.take(octant)], vec![beside.take(octant)]);
                let child = Octant { depth: depth + 1, code: octant, leaf_at: None };
                self.part(frame, child, (&mut apart, lists), (&mut beside, around))?;
            }
            return Ok(());
        }
        if points > self.limits.most_in_place {
            let what =
                format!("has {points} points in about one place, with the other inputs, which don't fit into memory");
            let problem = Problem::new(what).expected(format!("at most {}", self.limits.most_in_place));
            let problem = problem.help("allow more (`memory`), or leave out equal points before");
            return Err(self
                .inputs
                .first()
                .map_or(Stop::Disk(io::ErrorKind::OutOfMemory.into()), |i| invalid(&i.path, problem)));
        }
        if self.waiting_points() + points > self.limits.held_points {
            self.make_waiting(frame)?;
        }
        let mut records = Vec::with_capacity(bytes(&lists) as usize);
        for list in &lists {
            spill.read(list, &mut |block| {
                records.extend_from_slice(block);
                Ok(())
            })?;
        }
        let mut margin = Vec::new();
        for list in &around {
            margins.read(list, &mut |block| {
                // Grid cells that were merged have each other's points in their margins.
                block.chunks_exact(size).filter(|r| !is_inside(r)).for_each(|r| margin.extend_from_slice(r));
                Ok(())
            })?;
        }
        self.waiting.push(Loaded { part: Part { bits: frame.bits, depth, leaf_at }, records, margin });
        Ok(())
    }

    /// Builds the nodes of the parts in memory.
    fn make_waiting(&mut self, frame: &Frame) -> Result<(), Stop> {
        let waiting = std::mem::take(&mut self.waiting);
        // Selection cells larger than a part are shared: the first part selects a point, and later parts don't. Such
        // parts are therefore built one after another.
        let is_alone = |part: &Loaded| part.part.depth <= CELL_BITS;
        let made: Vec<Made> = if waiting.iter().all(is_alone) {
            let maker = self.maker();
            let made = waiting.into_par_iter().map(|part| maker.make(frame, &part, &mut HashSet::new()));
            made.collect::<io::Result<_>>()?
        } else {
            let mut taken = std::mem::take(&mut self.taken);
            let maker = self.maker();
            let made = waiting.into_iter().map(|part| maker.make(frame, &part, &mut taken));
            let made = made.collect::<io::Result<_>>()?;
            self.taken = taken;
            made
        };
        for made in made {
            for (key, bytes) in made.upper {
                self.upper.append(key, &bytes)?;
            }
            self.write(made.packed)?;
            self.done += made.points;
        }
        (self.progress)("building the octree", self.done, self.summary.count);
        Ok(())
    }

    fn maker(&self) -> Maker<'_> {
        let Self { prepare, template, sorted_bytes, normals, viewpoint, adds_normals, grid, laz, .. } = self;
        let input = self.inputs.first().map_or(Path::new(""), |input| &input.path);
        let (sorted_bytes, normals, viewpoint, adds_normals) = (*sorted_bytes, *normals, *viewpoint, *adds_normals);
        Maker { prepare: *prepare, template, sorted_bytes, normals, viewpoint, adds_normals, grid: *grid, laz, input }
    }

    fn compress(&mut self, nodes: Vec<((u32, u64), Vec<u8>)>) -> io::Result<()> {
        let packed = packed(nodes, &self.laz)?;
        self.write(packed)
    }

    fn write(&mut self, packed: Vec<Packed>) -> io::Result<()> {
        self.chunk_file.seek(SeekFrom::Start(self.chunk_bytes))?;
        for (level, code, points, bytes) in packed {
            self.chunk_file.write_all(&bytes)?;
            let (sum, bytes) = (checksum(&bytes), bytes.len() as u64);
            self.chunks.push(Chunk { file: 0, level, code, at: self.chunk_bytes, bytes, points, sum });
            self.chunk_bytes += bytes;
        }
        Ok(())
    }

    fn finish(self, sink: &mut dyn Write) -> io::Result<CopcReport> {
        let Self { chunks, mut chunk_file, chunk_bytes, template, laz, summary, cube, notes, progress, .. } = self;
        let Some(cube) = cube else { return Err(io::Error::other("no octree was built")) };
        let report = shards::report(&summary, &chunks, notes);
        let copied = |bytes| progress("writing the file", bytes, chunk_bytes);
        let mut read = |chunk: &Chunk, bytes: &mut [u8]| {
            chunk_file.seek(SeekFrom::Start(chunk.at))?;
            chunk_file.read_exact(bytes)
        };
        output::write(sink, &template, &laz, (&summary, &cube), (chunks, &mut read), &copied)?;
        Ok(report)
    }
}

/// A sink that sorts the records of one input into grid cells.
struct Sorter<'w, 'a> {
    writer: &'w mut Writer<'a>,
    /// Index of the input.
    input: usize,
    format: u8,
    input_bytes: usize,
    shift: [i64; 3],
    all: u64,
    record: Vec<u8>,
    /// Error of the temporary file, if writing to it failed.
    failed: Option<io::Error>,
}

impl Sink for Sorter<'_, '_> {
    fn start(&mut self, _: &Header, _: usize) {}

    fn append(&mut self, records: &mut [u8]) -> Result<(), Problem> {
        let writer = &mut *self.writer;
        let extra = writer.sorted_bytes - POINT_BYTES[usize::from(writer.template.format)];
        let after = POINT_BYTES[usize::from(self.format)];
        for r in records.chunks_exact(self.input_bytes) {
            self.record.clear();
            records::append(self.format, r, &mut self.record);
            self.record.extend_from_slice(&r[after..after + extra]);
            let mut at = position(&self.record);
            if self.shift != [0; 3] {
                for (k, (v, shift)) in at.iter_mut().zip(self.shift).enumerate() {
                    *v = i32::try_from(i64::from(*v) + shift).map_err(|_| {
                        let what = "has a point too far from the first input for the first's offset and scale";
                        Problem::new(what).help("convert files apart that are far apart")
                    })?;
                    self.record[4 * k..4 * k + 4].copy_from_slice(&v.to_le_bytes());
                }
            }
            let units = writer.grid.units(at);
            let cell = writer.grid.cell(units);
            let share = writer.share.as_ref();
            if let Some(share) = share {
                share.check(self.input, units)?;
            }
            let owns = |cell| share.is_none_or(|share| share.owns(cell));
            let mut sorted = Ok(());
            if owns(cell) {
                writer.summary.add(&self.record, at);
                sorted = writer.spill.append(cell, &self.record);
            }
            if writer.prepare.is_some() && !is_withheld(&self.record) {
                let margins = &mut writer.margins;
                let mut add = |cell| if owns(cell) { margins.append(cell, &self.record) } else { Ok(()) };
                sorted = sorted.and_then(|()| in_reach(units, writer.grid.side(), &mut add));
            }
            if sorted.is_ok() && share.is_none() && writer.spill.count() > writer.limits.most_cells {
                // Points are outside the bounds in their headers, which a shard refuses: double the cells' side.
                writer.grid.finest *= 2;
                let halved = |cell: [i64; 3]| cell.map(|c| c.div_euclid(2));
                sorted = writer.spill.merge(halved).and_then(|()| writer.margins.merge(halved));
            }
            if let Err(error) = sorted {
                self.failed = Some(error);
                return Err(Problem::new("can't be sorted"));
            }
        }
        writer.read += (records.len() / self.input_bytes) as u64;
        (writer.progress)("sorting points", writer.read, self.all);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
