//! LAS, LAZ and COPC files as one COPC file, in memory that doesn't grow with them.
//!
//! Points are sorted into cells of a grid in a temporary file, those beside a cell's border also into its neighbours'
//! margins. Some cells at a time are then read back, their points get splats and levels, and nodes become chunks in a
//! second such file, of which the output is put together at the end.

use super::super::header::{Header, POINT_BYTES};
use super::super::{Sink, field, read_records, unreadable};
use super::build::{CELL_BITS, Coded, LEAF_POINTS, Part, levels};
use super::octants::{BITS, code};
use super::output::{Chunk, Cube, Record, Summary, Template};
use super::spill::{List, Spill, unnamed};
use super::{LEVEL_COLORS, LEVEL_NORMALS, NORMALS, RADIUS, output, records};
use crate::error::{IoError, Location, Problem, READ};
use crate::format::Format;
use crate::survey::Source;
use ::laz::laszip::LasZipCompressor;
use ::laz::{LazVlr, LazVlrBuilder};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs::File;
use std::hash::Hash;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use surfel_model::{Column3, PointCloud};

/// How many points are in memory.
#[derive(Clone, Copy)]
struct Limits {
    /// Points of a cell that the grid is made for, on a surface.
    cell_points: u64,
    /// Most points of a part, but for more in one place.
    most_points: u64,
    /// Most points of all parts that are in memory, unless one has more.
    held_points: u64,
}

/// Bytes of a point that is in memory, with its normal and radius, and of what else there is.
const HELD_POINT_BYTES: u64 = 350;
const OTHER_BYTES: u64 = 256 << 20;
/// Bytes that writing takes: those of one part.
pub const LEAST_MEMORY: u64 = 1 << 30;

impl Limits {
    /// What fits into so many bytes. Only how many parts are made at once depends on it, not what is written.
    fn new(memory: u64) -> Self {
        let (cell_points, most_points) = (1_000_000, 2_000_000);
        let useful = cell_points * rayon::current_num_threads() as u64;
        let room = memory.saturating_sub(OTHER_BYTES) / HELD_POINT_BYTES;
        Self { cell_points, most_points, held_points: room.min(useful).max(most_points) }
    }
}

/// Parts see the points beyond their border that are nearer than their side over this: some 16 of a surface's points,
/// where it has as many of them as a cell is made for.
const MARGIN: i64 = 64;
/// Most cells that points are sorted into.
const MOST_CELLS: usize = 1 << 16;
/// Bytes of upper nodes that are compressed at a time.
const BATCH_BYTES: usize = 64 << 20;

/// The splat of a point: where its surface faces, and how far it reaches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointSplat {
    /// Unit normal; zero if it is unknown.
    pub normal: [f32; 3],
    /// Radius, object units; 0 if it is unknown.
    pub radius: f32,
}

/// Makes a splat of each of some points that lie together.
pub type Prepare<'a> = &'a (dyn Fn(&PointCloud) -> Result<Vec<PointSplat>, String> + Sync);

/// What was written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CopcReport {
    /// Points.
    pub points: u64,
    /// Nodes with points.
    pub nodes: usize,
    /// Levels, the root's among them.
    pub levels: u32,
    /// What the user should know, as sentences without a full stop.
    pub notes: Vec<String>,
}

/// One of the inputs.
struct Input {
    path: PathBuf,
    file: File,
    file_bytes: u64,
    header: Header,
    /// What its grid's numbers need to be those of the first input's.
    shift: [i64; 3],
}

/// Writes the points of LAS, LAZ and COPC files as one COPC file, each point once, with all that its record says: what
/// was format 0 to 5 becomes 6 or 7, and waveforms are left out. Inputs must agree in scale, in whole steps between
/// their offsets, in the format's columns, in extra bytes and in the coordinate reference system.
///
/// Each point also gets, as extra bytes, the mean colour of the points that it stands for at its level; with `prepare`
/// its radius, its normal and the mean normal too, which is called for some parts of the cloud at once, each with the
/// points around it. Deterministic, whatever the number of threads. `progress` is told a stage's name, how much of it
/// is done and of how much. It takes about `memory` bytes, but not less than [`LEAST_MEMORY`].
///
/// # Errors
/// [`IoError::Invalid`] for an input that isn't one of these, is damaged or doesn't go with the first;
/// [`IoError::Exists`] and [`IoError::System`] as [`crate::atomic::write`].
pub fn save_copc(
    inputs: &[PathBuf],
    output: &Path,
    overwrite: bool,
    memory: u64,
    prepare: Option<Prepare<'_>>,
    progress: &dyn Fn(&'static str, u64, u64),
) -> Result<CopcReport, IoError> {
    save(inputs, output, overwrite, prepare, progress, Limits::new(memory))
}

fn save(
    inputs: &[PathBuf],
    output: &Path,
    overwrite: bool,
    prepare: Option<Prepare<'_>>,
    progress: &dyn Fn(&'static str, u64, u64),
    limits: Limits,
) -> Result<CopcReport, IoError> {
    let mut report = None;
    let mut fault = None;
    let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let written = crate::atomic::write(output, overwrite, |sink| {
        let mut writer = match Writer::new(inputs, folder, prepare, progress, limits) {
            Ok(writer) => writer,
            Err(found) => return Err(stopped(&mut fault, found)),
        };
        if let Err(found) = writer.sort_all().and_then(|()| writer.build()) {
            return Err(stopped(&mut fault, found));
        }
        let made = writer.finish(sink)?;
        report = Some(made);
        Ok(())
    });
    match fault {
        Some(fault) => Err(fault),
        None => written.map(|()| report.unwrap_or_default()),
    }
}

/// Ends the writing; the fault itself is told afterwards.
fn stopped(fault: &mut Option<IoError>, found: Stop) -> io::Error {
    match found {
        Stop::Input(found) => {
            *fault = Some(found);
            io::Error::other("an input can't be read")
        }
        Stop::Disk(error) => error,
    }
}

/// Why writing ends early.
enum Stop {
    Input(IoError),
    Disk(io::Error),
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Self::Disk(error)
    }
}

fn invalid(path: &Path, problem: Problem) -> Stop {
    Stop::Input(IoError::Invalid { path: path.to_path_buf(), problem: Box::new(problem) })
}

/// The grid that points are sorted into, on the inputs' own steps.
#[derive(Clone, Copy, Debug)]
struct Grid {
    /// Steps of the grid's unit in a step of each axis: 1 where axes have the same scale.
    steps: DVec3,
    unit: f64,
    /// Least corner, in units.
    low: [i64; 3],
    /// Units in the side of the finest cell of the octree.
    finest: i64,
    /// Finest cells along a cell of the grid, as a power of two.
    cell_bits: u32,
}

impl Grid {
    fn new(scale: DVec3, low: [f64; 3], longest: f64, count: u64, limits: Limits) -> Self {
        let magnitude = scale.abs();
        // 2²¹ units are in a step at most, so that a position of 32 bits has 53.
        let unit = magnitude.min_element().max(magnitude.max_element() * 2f64.powi(-21));
        let longest = (longest / unit).clamp(0.0, 2f64.powi(53)) as i64 + 1;
        let mut depth = 0;
        while depth < CELL_BITS && count >> (2 * depth) > limits.cell_points {
            depth += 1;
        }
        let side = (longest >> depth) + 1;
        // A side of finest · 2^cell_bits, where finest has 8 bits, so that no side is more than 1/128 longer.
        let side_bits = i64::BITS - side.leading_zeros();
        let cell_bits = side_bits.saturating_sub(8).clamp(CELL_BITS, BITS - depth);
        let finest = ((side - 1) >> cell_bits) + 1;
        let low = [0, 1, 2].map(|k| (low[k] / unit).clamp(-2f64.powi(60), 2f64.powi(60)).floor() as i64);
        Self { steps: scale / unit, unit, low, finest, cell_bits }
    }

    fn side(&self) -> i64 {
        self.finest << self.cell_bits
    }

    fn units(&self, position: [i32; 3]) -> [i64; 3] {
        let on = |k: usize| match self.steps[k] {
            1.0 => i64::from(position[k]),
            steps => (f64::from(position[k]) * steps).round() as i64,
        };
        [0, 1, 2].map(|k| on(k) - self.low[k])
    }

    fn cell(&self, position: [i32; 3]) -> [i64; 3] {
        let side = self.side();
        self.units(position).map(|u| u.div_euclid(side))
    }
}

/// Calls `each` for every other cell of a grid that a point is nearer to than `side` / [`MARGIN`].
fn in_reach(units: [i64; 3], side: i64, each: &mut dyn FnMut([i64; 3]) -> io::Result<()>) -> io::Result<()> {
    let reach = side / MARGIN;
    let ways = units.map(|u| match u.rem_euclid(side) {
        within if within < reach => -1,
        within if within >= side - reach => 1,
        _ => 0,
    });
    if ways == [0; 3] {
        return Ok(());
    }
    let cell = units.map(|u| u.div_euclid(side));
    // Bits say along which axes it is another cell.
    for axes in 1..8 {
        let is_along = |k: usize| axes >> k & 1 == 1;
        if (0..3).all(|k| !is_along(k) || ways[k] != 0) {
            each([0, 1, 2].map(|k| cell[k] + if is_along(k) { ways[k] } else { 0 }))?;
        }
    }
    Ok(())
}

/// The octree over the grid's cells.
#[derive(Clone, Copy, Debug)]
struct Frame {
    /// Least corner of the root, in units from the grid's.
    low: [i64; 3],
    /// Bits of codes.
    bits: u32,
    /// Units in the side of the finest cell.
    finest: i64,
    /// Level of the parts that points are sorted into.
    depth: u32,
}

impl Frame {
    fn code(&self, units: [i64; 3]) -> u64 {
        code([0, 1, 2].map(|k| ((units[k] - self.low[k]) / self.finest) as u32))
    }

    /// The octant of a level that a point is in.
    fn octant(&self, units: [i64; 3], level: u32) -> u64 {
        self.code(units) >> (3 * (self.bits - level))
    }
}

/// A part of the cloud that is in memory.
struct Loaded {
    part: Part,
    records: Vec<u8>,
    /// Those around it.
    margin: Vec<u8>,
}

/// What became of a part.
struct Made {
    points: u64,
    /// Compressed nodes: level, code, number of points, bytes.
    packed: Vec<(u32, u64, u64, Vec<u8>)>,
    /// Records of nodes that other parts have points of, too.
    upper: Vec<((u32, u64), Vec<u8>)>,
}

fn position(record: &[u8]) -> [i32; 3] {
    [0, 4, 8].map(|at| i32::from_le_bytes(field(record, at)))
}

struct Writer<'a> {
    inputs: Vec<Input>,
    folder: PathBuf,
    prepare: Option<Prepare<'a>>,
    progress: &'a dyn Fn(&'static str, u64, u64),
    template: Template,
    /// Bytes of the standard's fields and of the inputs' extra ones.
    sorted_bytes: usize,
    /// Normals of the inputs: where they are, and of which type.
    normals: Option<[(usize, u8, f64, f64); 3]>,
    /// Extra bytes of Surfel have normals.
    adds_normals: bool,
    grid: Grid,
    spill: Spill<[i64; 3]>,
    /// Records of points beside a cell, by that cell; none without `prepare`.
    margins: Spill<[i64; 3]>,
    /// Parts that wait for others to be made with.
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
    done: u64,
    notes: Vec<String>,
}

impl<'a> Writer<'a> {
    fn new(
        paths: &[PathBuf],
        folder: &Path,
        prepare: Option<Prepare<'a>>,
        progress: &'a dyn Fn(&'static str, u64, u64),
        limits: Limits,
    ) -> Result<Self, Stop> {
        let mut opened = paths.iter().map(|path| Ok((open(path)?, path))).collect::<Result<Vec<_>, Stop>>()?;
        let Some(((first, raw), path)) = opened.first_mut() else {
            return Err(Stop::Disk(io::Error::other("no input is given")));
        };
        let records = raw_records(&mut first.file, raw, first.file_bytes).map_err(|e| invalid(path, e))?;
        let format = records::target(first.header.format);
        let after = POINT_BYTES[usize::from(first.header.format)];
        let extra = &first.header.extra;
        // What Surfel added to a file that it wrote is made anew; it is at the end.
        let own = extra.iter().find(|e| e.name == RADIUS || e.name == LEVEL_COLORS[0]).map(|e| e.at);
        let kept = own.unwrap_or(first.header.record_bytes - after);
        let normals = NORMALS.map(|name| extra.iter().find(|e| e.name == name && e.at < kept));
        let normals = match normals {
            [Some(x), Some(y), Some(z)] => Some([x, y, z].map(|e| {
                let (scale, offset) = e.scaled.unwrap_or((1.0, 0.0));
                (POINT_BYTES[usize::from(format)] + e.at, e.kind, scale, offset)
            })),
            _ => None,
        };
        let adds_normals = prepare.is_some() && normals.is_none();
        let described = records.iter().find(|r| r.is("LASF_Spec", 4)).map(|r| r.data.clone()).unwrap_or_default();
        let (descriptions, added) = descriptions(&described, kept, prepare.is_some(), adds_normals, format >= 7);
        let mut records: Vec<Record> = records.into_iter().filter(|r| !r.is("LASF_Spec", 4)).collect();
        if !descriptions.is_empty() {
            records.push(Record::new("LASF_Spec", 4, descriptions));
        }
        let mut header = raw.clone();
        header.resize(375, 0);
        let (scale, offset) = (first.header.scale, first.header.offset);
        let template = Template { header, records, format, extra_bytes: kept + added, scale, offset };
        let mut notes = Vec::new();
        let (mut low, mut high, mut count) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0_u64);
        let mut inputs: Vec<Input> = Vec::with_capacity(opened.len());
        for ((mut input, raw), path) in opened {
            if let Some(first) = inputs.first() {
                check_alike(first, &input).map_err(|problem| invalid(path, problem))?;
            }
            input.shift = shift(scale, offset, input.header.offset).map_err(|problem| invalid(path, problem))?;
            for k in 0..3 {
                // As the header says; points outside of that only make the octree grow.
                let ends = [179, 187].map(|at| f64::from_le_bytes(field(&raw, at + 16 * k)));
                let ends = ends.map(|v| if v.is_finite() { v - offset[k] } else { 0.0 });
                (low[k], high[k]) = (low[k].min(ends[0].min(ends[1])), high[k].max(ends[0].max(ends[1])));
            }
            count = count.saturating_add(input.header.count);
            if matches!(input.header.format, 4 | 5 | 9 | 10) {
                notes.push(format!("{}: left out its waveforms", input.path.display()));
            }
            inputs.push(input);
        }
        let longest = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        let grid = Grid::new(scale, low, longest, count, limits);
        let sorted_bytes = POINT_BYTES[usize::from(format)] + kept;
        let laz = LazVlrBuilder::default().with_point_format(format, (kept + added) as u16);
        let laz = laz.map_err(|e| io::Error::other(e.to_string()))?.with_variable_chunk_size().build();
        Ok(Self {
            inputs,
            folder: folder.to_path_buf(),
            prepare,
            progress,
            template,
            sorted_bytes,
            normals,
            adds_normals,
            grid,
            spill: Spill::new(folder)?,
            margins: Spill::new(folder)?,
            waiting: Vec::new(),
            upper: Spill::new(folder)?,
            laz,
            chunks: Vec::new(),
            chunk_file: unnamed(folder)?,
            chunk_bytes: 0,
            taken: HashSet::new(),
            summary: Summary::default(),
            cube: None,
            limits,
            done: 0,
            notes,
        })
    }

    /// Sorts the points of all inputs into cells.
    fn sort_all(&mut self) -> Result<(), Stop> {
        let all = self.inputs.iter().fold(0_u64, |sum, input| sum.saturating_add(input.header.count));
        for mut input in std::mem::take(&mut self.inputs) {
            let mut sorter = Sorter {
                writer: self,
                format: input.header.format,
                input_bytes: input.header.record_bytes,
                shift: input.shift,
                all,
                record: Vec::new(),
                failed: None,
            };
            let read = read_records(&mut input.file, &mut input.header, input.file_bytes, false, &mut sorter);
            match (sorter.failed.take(), read) {
                (Some(error), _) => return Err(error.into()),
                (None, read) => read.map_err(|problem| invalid(&input.path, problem))?,
            }
            let notes = input.header.notes.drain(..);
            self.notes.extend(notes.map(|note| format!("{}: {note}", input.path.display())));
        }
        match self.summary.count {
            0 => Err(Stop::Disk(io::Error::other("the inputs hold no point, expected at least one"))),
            _ => Ok(()),
        }
    }

    /// The octree that holds all cells, and the level of its octants that hold them each. Cells of which more than 128
    /// are along its side are put together.
    fn frame(&mut self) -> (Frame, BTreeMap<u64, Vec<[i64; 3]>>) {
        let cells: Vec<[i64; 3]> = self.spill.sizes().map(|(cell, _)| cell).collect();
        let end = |k: usize, fold: fn(i64, i64) -> i64| cells.iter().map(|c| c[k]).reduce(fold).unwrap_or(0);
        let low = [0, 1, 2].map(|k| end(k, i64::min));
        let most = (0..3).map(|k| end(k, i64::max).abs_diff(low[k]) + 1).max().unwrap_or(1);
        let levels = most.next_power_of_two().trailing_zeros();
        if levels == 0 {
            return (self.frame_of_one_cell(), BTreeMap::from([(0, cells)]));
        }
        let (side, mut bits, mut finest) = (self.grid.side(), levels + self.grid.cell_bits, self.grid.finest);
        while bits > BITS {
            (bits, finest) = (bits - 1, finest * 2);
        }
        let depth = levels.min(CELL_BITS);
        let frame = Frame { low: low.map(|l| l * side), bits, finest, depth };
        let mut parts: BTreeMap<u64, Vec<[i64; 3]>> = BTreeMap::new();
        for cell in cells {
            let at = [0, 1, 2].map(|k| (cell[k].abs_diff(low[k]) >> (levels - depth)) as u32);
            parts.entry(code(at)).or_default().push(cell);
        }
        parts.values_mut().for_each(|cells| cells.sort_unstable());
        (frame, parts)
    }

    /// The octree of points that are all in one cell, which may be much larger than they need.
    fn frame_of_one_cell(&self) -> Frame {
        let ends = [self.summary.low, self.summary.high].map(|end| self.grid.units(end));
        let low = [0, 1, 2].map(|k| ends[0][k].min(ends[1][k]));
        let longest = (0..3).map(|k| ends[0][k].abs_diff(ends[1][k])).max().unwrap_or(0) as i64;
        let mut bits = BITS;
        while bits > CELL_BITS && longest >> (bits - 1) == 0 {
            bits -= 1;
        }
        Frame { low, bits, finest: (longest >> bits) + 1, depth: 0 }
    }

    /// Gives all points their levels, and compresses the nodes.
    fn build(&mut self) -> Result<(), Stop> {
        let (frame, parts) = self.frame();
        let side = (frame.finest << frame.bits) as f64 * self.grid.unit;
        let low = [0, 1, 2].map(|k| (self.grid.low[k] + frame.low[k]) as f64 * self.grid.unit);
        let center = self.template.offset + DVec3::from(low) + 0.5 * side;
        let spacing = side / f64::from(1_u32 << CELL_BITS);
        self.cube = Some(Cube { center, half: 0.5 * side, spacing });
        // How many points the octants have that the parts are in.
        let bytes: HashMap<[i64; 3], u64> = self.spill.sizes().collect();
        let mut counts: HashMap<(u32, u64), u64> = HashMap::new();
        for (code, cells) in &parts {
            let points = cells.iter().map(|cell| bytes[cell]).sum::<u64>() / self.sorted_bytes as u64;
            (0..=frame.depth).for_each(|l| *counts.entry((l, code >> (3 * (frame.depth - l)))).or_default() += points);
        }
        self.done = 0;
        let mut sorted = std::mem::replace(&mut self.spill, Spill::new(&self.folder)?);
        let mut margins = std::mem::replace(&mut self.margins, Spill::new(&self.folder)?);
        for (code, cells) in parts {
            let is_leaf = |l: &u32| counts[&(*l, code >> (3 * (frame.depth - l)))] <= LEAF_POINTS;
            let leaf_at = (0..frame.depth).find(is_leaf);
            let lists = cells.iter().map(|cell| sorted.take(*cell)).collect();
            let around = cells.iter().map(|cell| margins.take(*cell)).collect();
            self.part(&frame, (frame.depth, code, leaf_at), (&mut sorted, lists), (&mut margins, around))?;
        }
        drop((sorted, margins));
        self.make_waiting(&frame)?;
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

    /// Reads the points of an octant, and of its octants one by one where they are too many.
    fn part<K: Copy + Eq + Hash>(
        &mut self,
        frame: &Frame,
        (depth, octant, leaf_at): (u32, u64, Option<u32>),
        (spill, lists): (&mut Spill<K>, Vec<List>),
        (margins, around): (&mut Spill<K>, Vec<List>),
    ) -> Result<(), Stop> {
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
                self.part(frame, (depth + 1, octant, None), (&mut apart, lists), (&mut beside, around))?;
            }
            return Ok(());
        }
        let waiting = self.waiting.iter().map(|part| part.records.len() / size).sum::<usize>() as u64;
        if waiting + points > self.limits.held_points {
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
                // Cells that have become one have been each other's neighbours.
                block.chunks_exact(size).filter(|r| !is_inside(r)).for_each(|r| margin.extend_from_slice(r));
                Ok(())
            })?;
        }
        self.waiting.push(Loaded { part: Part { bits: frame.bits, depth, leaf_at }, records, margin });
        Ok(())
    }

    /// Makes nodes of the parts that are in memory.
    fn make_waiting(&mut self, frame: &Frame) -> Result<(), Stop> {
        let waiting = std::mem::take(&mut self.waiting);
        // Of larger cells than a part one part takes a point, and those after it don't.
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
        let Self { prepare, template, sorted_bytes, normals, adds_normals, grid, laz, .. } = self;
        let (sorted_bytes, normals, adds_normals) = (*sorted_bytes, *normals, *adds_normals);
        Maker { prepare: *prepare, template, sorted_bytes, normals, adds_normals, grid: *grid, laz }
    }

    fn compress(&mut self, nodes: Vec<((u32, u64), Vec<u8>)>) -> io::Result<()> {
        let packed = packed(nodes, &self.laz)?;
        self.write(packed)
    }

    fn write(&mut self, packed: Vec<(u32, u64, u64, Vec<u8>)>) -> io::Result<()> {
        use std::io::Write;
        self.chunk_file.seek(SeekFrom::Start(self.chunk_bytes))?;
        for (level, code, points, bytes) in packed {
            self.chunk_file.write_all(&bytes)?;
            let bytes = bytes.len() as u64;
            self.chunks.push(Chunk { level, code, at: self.chunk_bytes, bytes, points });
            self.chunk_bytes += bytes;
        }
        Ok(())
    }

    fn finish(mut self, sink: &mut dyn io::Write) -> io::Result<CopcReport> {
        let levels = self.chunks.iter().map(|chunk| chunk.level + 1).max().unwrap_or(0);
        let report = CopcReport { points: self.summary.count, nodes: self.chunks.len(), levels, notes: self.notes };
        let Some(cube) = self.cube else { return Err(io::Error::other("no octree was built")) };
        output::write(sink, &self.template, &self.laz, (&self.summary, &cube), self.chunks, &mut self.chunk_file)?;
        Ok(report)
    }
}

/// What makes nodes of parts, several at once.
struct Maker<'a> {
    prepare: Option<Prepare<'a>>,
    template: &'a Template,
    sorted_bytes: usize,
    normals: Option<[(usize, u8, f64, f64); 3]>,
    adds_normals: bool,
    grid: Grid,
    laz: &'a LazVlr,
}

impl Maker<'_> {
    /// Gives the points of one octant their levels, and compresses the nodes that are in it.
    fn make(&self, frame: &Frame, loaded: &Loaded, taken: &mut HashSet<(u32, u64)>) -> io::Result<Made> {
        let (size, Loaded { part, records, margin }) = (self.sorted_bytes, loaded);
        let splats = self.splats(records, margin)?;
        let mut coded: Vec<Coded> = records
            .par_chunks_exact(size)
            .enumerate()
            .map(|(i, record)| (frame.code(self.grid.units(position(record))), i as u32))
            .collect();
        coded.par_sort_unstable();
        let color_at = (self.template.format >= 7).then_some(30);
        let mut filtered = Filtered { records, size, color_at, splats: splats.as_deref(), of: HashMap::new() };
        let level_of = levels(&coded, part, taken, &mut |i, group| {
            filtered.add(coded[i].1, coded[group].iter().map(|point| point.1));
        });
        let mut nodes: BTreeMap<(u32, u64), Vec<u32>> = BTreeMap::new();
        for ((code, i), level) in coded.iter().zip(&level_of) {
            let level = u32::from(*level);
            nodes.entry((level, code >> (3 * (frame.bits - level)))).or_default().push(*i);
        }
        drop((coded, level_of));
        let whole = |key: (u32, u64), mut indices: Vec<u32>| {
            // Scan order compresses best.
            indices.sort_unstable();
            let mut bytes = Vec::with_capacity(indices.len() * (size + self.template.extra_bytes));
            for i in indices {
                bytes.extend_from_slice(&records[i as usize * size..][..size]);
                filtered.write(i, self.adds_normals, &mut bytes);
            }
            (key, bytes)
        };
        let made: Vec<_> = nodes.into_par_iter().map(|(key, indices)| whole(key, indices)).collect();
        let (inner, upper): (Vec<_>, Vec<_>) = made.into_iter().partition(|((level, _), _)| *level >= part.depth);
        Ok(Made { points: (records.len() / size) as u64, packed: packed(inner, self.laz)?, upper })
    }

    /// The splats of points among those around them, zeros of those that are flagged as withheld.
    fn splats(&self, records: &[u8], margin: &[u8]) -> io::Result<Option<Vec<PointSplat>>> {
        let Some(prepare) = self.prepare else { return Ok(None) };
        let rows = || records.chunks_exact(self.sorted_bytes);
        let kept = || rows().chain(margin.chunks_exact(self.sorted_bytes)).filter(|record| !is_withheld(record));
        let grid: Vec<[i32; 3]> = kept().map(position).collect();
        let (origin, positions) = super::super::records::on_grid(grid, self.template.scale, self.template.offset);
        let normals = self.normals.map(|fields| {
            let of = |r: &[u8]| {
                fields.map(|(at, kind, scale, offset)| super::super::records::value_of(kind)(&r[at..]) * scale + offset)
            };
            Column3::from_f32(kept().map(|r| DVec3::from(of(r)).as_vec3()).collect())
        });
        let cloud = PointCloud { origin, positions, normals, ..PointCloud::default() };
        let made = if cloud.is_empty() { Vec::new() } else { prepare(&cloud).map_err(io::Error::other)? };
        if made.len() != cloud.len() {
            return Err(io::Error::other("a part of the cloud has fewer splats than points"));
        }
        let mut made = made.into_iter();
        let next = |r: &[u8]| if is_withheld(r) { PointSplat::default() } else { made.next().unwrap_or_default() };
        Ok(Some(rows().map(next).collect()))
    }
}

fn is_withheld(record: &[u8]) -> bool {
    record[15] & 4 != 0
}

/// A chunk of these points.
fn pack(points: &[u8], laz: &LazVlr) -> io::Result<Vec<u8>> {
    let other = |e: ::laz::LasZipError| io::Error::other(e.to_string());
    let mut compressor = LasZipCompressor::new(Cursor::new(Vec::new()), laz.clone()).map_err(other)?;
    compressor.compress_many(points)?;
    compressor.finish_current_chunk()?;
    // Before it is the place of a table of chunks, which the file has one of.
    Ok(compressor.into_inner().into_inner().split_off(8))
}

/// Level, octant, number of points, and their chunk.
type Packed = (u32, u64, u64, Vec<u8>);

/// Nodes as chunks.
fn packed(nodes: Vec<((u32, u64), Vec<u8>)>, laz: &LazVlr) -> io::Result<Vec<Packed>> {
    let size = laz.items_size() as usize;
    let packed = nodes.into_par_iter().map(|((level, code), bytes)| {
        let points = (bytes.len() / size) as u64;
        Ok((level, code, points, pack(&bytes, laz)?))
    });
    packed.collect()
}

/// What points stand for at their levels.
struct Filtered<'a> {
    records: &'a [u8],
    size: usize,
    color_at: Option<usize>,
    splats: Option<&'a [PointSplat]>,
    /// Mean colour, and mean normal.
    of: HashMap<u32, ([u16; 3], [i8; 3])>,
}

impl Filtered<'_> {
    fn record(&self, i: u32) -> &[u8] {
        &self.records[i as usize * self.size..][..self.size]
    }

    fn color(&self, i: u32) -> [u16; 3] {
        let at = self.color_at.unwrap_or(0);
        [0, 2, 4].map(|k| u16::from_le_bytes(field(self.record(i), at + k)))
    }

    fn normal(&self, i: u32) -> [f32; 3] {
        self.splats.map_or([0.0; 3], |splats| splats[i as usize].normal)
    }

    /// Point `i` stands for others, itself among them.
    fn add(&mut self, i: u32, others: impl Iterator<Item = u32>) {
        let own = glam::Vec3::from(self.normal(i));
        let (mut count, mut color, mut normal) = (0_u64, [0.0_f64; 3], glam::Vec3::ZERO);
        let table = crate::color::linear_of_16_bit();
        for other in others.filter(|other| !is_withheld(self.record(*other))) {
            count += 1;
            if self.color_at.is_some() {
                let levels = self.color(other);
                (0..3).for_each(|k| color[k] += f64::from(table[usize::from(levels[k])]));
            }
            let n = glam::Vec3::from(self.normal(other));
            // Both sides of a thin sheet don't cancel.
            normal += if n.dot(own) < 0.0 { -n } else { n };
        }
        if count > 1 {
            let color = color.map(|sum| (surfel_math::srgb::encode(sum / count as f64) * 65_535.0).round() as u16);
            self.of.insert(i, (color, eight_bits(normal.normalize_or_zero().to_array())));
        }
    }

    /// Appends the extra bytes of a point.
    fn write(&self, i: u32, adds_normals: bool, out: &mut Vec<u8>) {
        let filtered = self.of.get(&i);
        if let Some(splats) = self.splats {
            let splat = &splats[i as usize];
            // Eight bits behind the point: what comes after compresses to nothing. Rounded up, so that nothing opens.
            let bits = splat.radius.to_bits();
            out.extend_from_slice(&(bits.saturating_add(0x7fff) & 0xffff_8000).to_le_bytes());
            let own = eight_bits(splat.normal);
            let bytes = |n: [i8; 3]| n.map(|v| v as u8);
            if adds_normals {
                out.extend_from_slice(&bytes(own));
            }
            out.extend_from_slice(&bytes(filtered.map_or(own, |f| f.1)));
        }
        if self.color_at.is_some() {
            let color = filtered.map_or_else(|| self.color(i), |f| f.0);
            color.iter().for_each(|level| out.extend_from_slice(&level.to_le_bytes()));
        }
    }
}

fn eight_bits(normal: [f32; 3]) -> [i8; 3] {
    normal.map(|v| (v * 127.0).round() as i8)
}

/// Takes the records of one input.
struct Sorter<'w, 'a> {
    writer: &'w mut Writer<'a>,
    format: u8,
    input_bytes: usize,
    shift: [i64; 3],
    all: u64,
    record: Vec<u8>,
    /// Why the disk took no more.
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
            writer.summary.add(&self.record, at);
            let units = writer.grid.units(at);
            let mut sorted = writer.spill.append(writer.grid.cell(at), &self.record);
            if writer.prepare.is_some() && !is_withheld(&self.record) {
                let margins = &mut writer.margins;
                let mut add = |cell| margins.append(cell, &self.record);
                sorted = sorted.and_then(|()| in_reach(units, writer.grid.side(), &mut add));
            }
            if sorted.is_ok() && writer.spill.count() > MOST_CELLS {
                // The header's bounds are wrong: cells of twice the side.
                writer.grid.finest *= 2;
                let halved = |cell: [i64; 3]| cell.map(|c| c.div_euclid(2));
                sorted = writer.spill.merge(halved).and_then(|()| writer.margins.merge(halved));
            }
            if let Err(error) = sorted {
                self.failed = Some(error);
                return Err(Problem::new("can't be sorted"));
            }
        }
        (writer.progress)("sorting points", writer.summary.count, self.all);
        Ok(())
    }
}

/// Opens an input, and reads its header.
fn open(path: &Path) -> Result<(Input, Vec<u8>), Stop> {
    let system = |source| Stop::Input(IoError::System { path: path.to_path_buf(), action: READ, source });
    let mut file = File::open(path).map_err(system)?;
    let mut raw = Vec::new();
    (&mut file).take(512).read_to_end(&mut raw).map_err(system)?;
    if !matches!(Format::of_survey(&raw), Some(Format::Las | Format::Laz | Format::Copc)) {
        let problem = Problem::new("is no LAS, LAZ or COPC file").expected("one: only these are written as COPC");
        return Err(invalid(path, problem));
    }
    raw.truncate(375);
    let file_bytes = file.seek(SeekFrom::End(0)).map_err(system)?;
    let header = Header::read(&mut file, file_bytes).map_err(|problem| invalid(path, problem))?;
    // What older headers lack is what follows them.
    let own = usize::from(u16::from_le_bytes(field(&raw, 94)));
    raw.truncate(own.max(227));
    raw.resize(375, 0);
    Ok((Input { path: path.to_path_buf(), file, file_bytes, header, shift: [0; 3] }, raw))
}

/// Steps from an offset to another one.
fn shift(scale: DVec3, first: DVec3, other: DVec3) -> Result<[i64; 3], Problem> {
    let steps = (other - first) / scale;
    let whole = steps.round();
    // Offsets of 10⁷ in steps of 10⁻⁵ are rounded by some 10⁻⁴ of a step.
    if (steps - whole).abs().max_element() > 1e-3 || whole.abs().max_element() > 2f64.powi(40) {
        let what = format!("has the offset {other}, which is no whole number of steps from the first input's {first}");
        return Err(Problem::new(what).help("convert it by itself, or give its points the first's offset"));
    }
    Ok(whole.to_array().map(|v| v as i64))
}

/// Checks that two inputs can be one file.
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

/// The variable length records that are copied; extended ones become ordinary ones where they are short enough.
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

/// Most bytes of a variable length record that is copied, and most records.
const MAX_RECORD_BYTES: u64 = 1 << 20;
const MAX_RECORDS: usize = 256;

/// The descriptions of the inputs' extra bytes, of which `kept` are kept, and of Surfel's, and how many the latter are.
fn descriptions(given: &[u8], kept: usize, splats: bool, normals: bool, colors: bool) -> (Vec<u8>, usize) {
    let mut out = Vec::new();
    let mut described = 0;
    for record in given.chunks_exact(192) {
        let bytes = match record[2] {
            0 => usize::from(record[3]),
            kind @ 1..=30 => {
                [1, 1, 2, 2, 4, 4, 8, 8, 4, 8][usize::from(kind - 1) % 10] * usize::from((kind - 1) / 10 + 1)
            }
            _ => 0,
        };
        if described + bytes > kept {
            break;
        }
        described += bytes;
        out.extend_from_slice(record);
    }
    // Bytes that nobody describes.
    while described < kept {
        let bytes = (kept - described).min(255);
        out.extend_from_slice(&description("", 0, "", false));
        let at = out.len() - 192;
        out[at + 3] = bytes as u8;
        described += bytes;
    }
    let mut bytes = 0;
    let mut add = |name: &str, kind: u8, size: usize, what: &str| {
        out.extend_from_slice(&description(name, kind, what, kind == 2));
        bytes += size;
    };
    if splats {
        add(RADIUS, 9, 4, "radius of the point's splat");
        let of_point = NORMALS.iter().filter(|_| normals).map(|name| (*name, "unit normal"));
        for (name, what) in of_point.chain(LEVEL_NORMALS.map(|name| (name, "mean normal at its level"))) {
            add(name, 2, 1, what);
        }
    }
    if colors {
        LEVEL_COLORS.iter().for_each(|name| add(name, 3, 2, "mean colour at its level"));
    }
    (out, bytes)
}

/// The description of one value among extra bytes; a scaled one counts in 1/127.
fn description(name: &str, kind: u8, what: &str, scaled: bool) -> [u8; 192] {
    let mut d = [0; 192];
    d[2] = kind;
    d[4..4 + name.len()].copy_from_slice(name.as_bytes());
    d[160..160 + what.len()].copy_from_slice(what.as_bytes());
    if scaled {
        d[3] = 8;
        d[112..120].copy_from_slice(&(1.0_f64 / 127.0).to_le_bytes());
    }
    d
}

#[cfg(test)]
mod tests {
    use super::super::Copc;
    use super::*;

    /// A LAS file of format 6, whose times number its points.
    fn las_of(points: &[[i32; 3]]) -> Vec<u8> {
        let mut bytes = vec![0; 375];
        bytes[..4].copy_from_slice(b"LASF");
        bytes[24..26].copy_from_slice(&[1, 4]);
        bytes[94..96].copy_from_slice(&375_u16.to_le_bytes());
        bytes[96..100].copy_from_slice(&375_u32.to_le_bytes());
        bytes[104] = 6;
        bytes[105..107].copy_from_slice(&30_u16.to_le_bytes());
        (0..3).for_each(|k| bytes[131 + 8 * k..139 + 8 * k].copy_from_slice(&0.01_f64.to_le_bytes()));
        (0..3).for_each(|k| bytes[179 + 16 * k..187 + 16 * k].copy_from_slice(&1000_f64.to_le_bytes()));
        bytes[247..255].copy_from_slice(&(points.len() as u64).to_le_bytes());
        for (i, at) in points.iter().enumerate() {
            at.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
            bytes.extend_from_slice(&[0; 10]);
            bytes.extend_from_slice(&(i as f64).to_le_bytes());
        }
        bytes
    }

    fn random(seed: u64) -> impl FnMut() -> u64 {
        let mut random = seed;
        move || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            random
        }
    }

    /// Points on a sheet, and half of them in one hundredth of it.
    fn las(count: u64) -> Vec<u8> {
        let mut next = random(3);
        let point = |i: u64| {
            let (random, within) = (next(), if i.is_multiple_of(2) { 100_000 } else { 10_000 });
            [(random >> 16) % within, (random >> 36) % within, (random >> 50) % 500].map(|v| v as i32)
        };
        las_of(&(0..count).map(point).collect::<Vec<_>>())
    }

    #[test]
    fn file_does_not_depend_on_how_many_parts_are_made_at_once() {
        let folder = std::env::temp_dir().join(format!("surfel-copc-held-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let input = folder.join("in.las");
        std::fs::write(&input, las(200_000)).unwrap();
        let prepare = |cloud: &PointCloud| {
            let splat = |i: usize| PointSplat { normal: [0.0, 0.0, 1.0], radius: cloud.len() as f32 + i as f32 };
            Ok((0..cloud.len()).map(splat).collect())
        };
        let written = |held_points: u64| {
            let output = folder.join(format!("{held_points}.copc.laz"));
            let limits = Limits { cell_points: 20_000, most_points: 30_000, held_points };
            save(std::slice::from_ref(&input), &output, true, Some(&prepare), &|_, _, _| (), limits).unwrap();
            std::fs::read(output).unwrap()
        };
        let one_by_one = written(0);
        assert!(written(60_000) == one_by_one && written(u64::MAX) == one_by_one);
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(Limits::new(0).held_points, 2_000_000);
        assert!(Limits::new(1 << 40).held_points >= 2_000_000);
    }

    /// Normal and radius of each point of hills of `side`² points, half a metre apart and 100 m wide at least, by the
    /// points' numbers.
    fn hill_splats(side: u64, limits: Limits) -> Vec<(DVec3, f64)> {
        let folder = std::env::temp_dir().join(format!("surfel-copc-borders-{}-{side}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let mut next = random(9);
        let point = |i: u64| {
            let mut jittered = |cell: u64| (cell * 50 + (next() >> 40) % 40) as f64;
            let (x, y) = (jittered(i % side), jittered(i / side));
            let z = 300.0 * (x / 900.0).sin() * (y / 1100.0).cos();
            [x, y, z].map(|v| v.round() as i32)
        };
        let points: Vec<[i32; 3]> = (0..side * side).map(point).collect();
        let mut bytes = las_of(&points);
        for (k, high) in [side as f64 * 0.5, side as f64 * 0.5, 10.0].into_iter().enumerate() {
            bytes[179 + 16 * k..187 + 16 * k].copy_from_slice(&high.to_le_bytes());
            bytes[187 + 16 * k..195 + 16 * k].copy_from_slice(&0_f64.to_le_bytes());
        }
        let (input, output) = (folder.join("in.las"), folder.join("out.copc.laz"));
        std::fs::write(&input, bytes).unwrap();
        let prepare = |cloud: &PointCloud| {
            let options = surfel_sample::PointOptions { ellipses: false, ..Default::default() };
            let made = surfel_sample::splats_from_points(cloud, &options, &surfel_sample::NoProgress);
            let (splats, _) = made.map_err(|e| e.to_string())?;
            let splat = |i: usize| {
                let normal = surfel_math::basis::unit(splats.normal(i)).as_vec3().to_array();
                PointSplat { normal, radius: splats.radius_max(i) as f32 }
            };
            Ok((0..splats.len()).map(splat).collect())
        };
        save(&[input], &output, true, Some(&prepare), &|_, _, _| (), limits).unwrap();
        let loaded = crate::load(&output, &crate::LoadOptions::default()).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let crate::Content::Points(points) = loaded.content else { panic!("no points") };
        let column = |name: &str| &points.extras.iter().find(|e| e.name == name).unwrap().values;
        let (numbers, radii) = (column("gps_time"), column(RADIUS));
        let mut splats = vec![(DVec3::ZERO, 0.0); points.len()];
        for i in 0..points.len() {
            let normal = points.normals.as_ref().unwrap().get(i).normalize();
            splats[numbers.get(i) as usize] = (normal, radii.get(i));
        }
        splats
    }

    #[test]
    fn splats_at_borders_of_parts_are_those_of_the_whole_cloud() {
        let side = 512;
        let whole = hill_splats(side, Limits { cell_points: 1_000_000, most_points: 1_000_000, held_points: 0 });
        // Cells of 128² points or of 256², divided once or twice; margins are two points wide at least, where those of
        // real files are eight. Two are enough for normals and for all radii but one in a hundred. Radii are decided
        // in f32 about a run of points, and parts have other runs: one of 262,144 was found to differ by 2 %.
        for (cell_points, most_points, most_grown_share) in
            [(16_384, 100_000, 0.01), (65_536, 20_000, 1e-5), (262_144, 20_000, 1e-5)]
        {
            let parts = hill_splats(side, Limits { cell_points, most_points, held_points: 0 });
            let (mut turned, mut grown) = (0, 0);
            let (mut most_turned, mut most_grown) = (0.0_f64, 0.0_f64);
            for ((normal, radius), (n, r)) in whole.iter().zip(&parts) {
                let degrees = normal.dot(*n).abs().min(1.0).acos().to_degrees();
                let ratio = (r / radius).ln().abs();
                turned += u32::from(degrees > 1.0);
                grown += u32::from(ratio > 0.01);
                (most_turned, most_grown) = (most_turned.max(degrees), most_grown.max(ratio));
            }
            let found = format!("{turned} turned by {most_turned:.4} at most, {grown} grown by e^{most_grown:.4}");
            let name = format!("cells of {cell_points}, parts of {most_points}");
            assert!(turned == 0 && f64::from(grown) <= most_grown_share * whole.len() as f64, "{name}: {found}");
        }
    }

    #[test]
    fn levels_do_not_depend_on_how_many_points_are_in_memory() {
        let folder = std::env::temp_dir().join(format!("surfel-copc-limits-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let input = folder.join("in.las");
        std::fs::write(&input, las(300_000)).unwrap();
        let nodes = |most_points: u64| {
            let output = folder.join(format!("{most_points}.copc.laz"));
            let limits = Limits { cell_points: 100_000, most_points, held_points: most_points };
            save(std::slice::from_ref(&input), &output, true, None, &|_, _, _| (), limits).unwrap();
            let copc = Copc::open(&output).unwrap().unwrap();
            copc.nodes().iter().map(|n| (n.level, n.cell, n.points)).collect::<Vec<_>>()
        };
        let at_once = nodes(1_000_000);
        assert!(at_once.len() > 8 && at_once.iter().map(|n| n.2).sum::<u64>() == 300_000);
        // 60,000 divides cells, 45,000 more of what they are divided into; a leaf must fit.
        assert_eq!(nodes(60_000), at_once);
        assert_eq!(nodes(45_000), at_once);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
