//! LAS, LAZ and COPC files as one COPC file, in memory that doesn't grow with them.
//!
//! Points are sorted into cells of a grid in a temporary file, those beside a cell's border also into its neighbours'
//! margins. Some cells at a time are then read back, their points get splats and levels, and nodes become chunks in a
//! second such file, of which the output is put together at the end.

mod extra_bytes;
mod grid;
mod inputs;
mod parts;

use super::build::{CELL_BITS, LEAF_POINTS, Part};
use super::octants::{BITS, code};
use super::output::{Chunk, Cube, Record, Summary, Template};
use super::spill::{List, Spill, unnamed};
use super::{LEVEL_COLORS, NORMALS, RADIUS, output, records};
use crate::error::{IoError, Problem};
use crate::las::header::{Header, POINT_BYTES};
use crate::las::{Sink, field, read_records};
use ::laz::{LazVlr, LazVlrBuilder};
use extra_bytes::descriptions;
use glam::DVec3;
use grid::{Frame, Grid, in_reach};
use inputs::{Input, Stop, check_alike, invalid, open, raw_records, shift};
use parts::{Loaded, Made, Maker, Packed, is_withheld, packed, position};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs::File;
use std::hash::Hash;
use std::io::{self, Seek, SeekFrom};
use std::path::{Path, PathBuf};

pub use parts::{PointSplat, Prepare};

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

/// Most cells that points are sorted into.
const MOST_CELLS: usize = 1 << 16;
/// Bytes of upper nodes that are compressed at a time.
const BATCH_BYTES: usize = 64 << 20;

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
        let grid = Grid::new(scale, low, longest, count, limits.cell_points);
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

    fn write(&mut self, packed: Vec<Packed>) -> io::Result<()> {
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
        let copied = |bytes| (self.progress)("writing the file", bytes, self.chunk_bytes);
        let source = (self.chunks, &mut self.chunk_file);
        output::write(sink, &self.template, &self.laz, (&self.summary, &cube), source, &copied)?;
        Ok(report)
    }
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

#[cfg(test)]
mod tests;
