//! First step of a conversion: sorts the points of all inputs into grid cells on disk.

use super::conversion::Conversion;
use super::grid::{Grid, each_near_cell};
use super::inputs::{Input, Stop};
use super::parts::{is_withheld, position};
use super::resume;
use crate::error::Problem;
use crate::error::ShowPath as _;
use crate::las::Sink;
use crate::las::copc::output::Summary;
use crate::las::copc::records;
use crate::las::copc::spill::{Index, List, Spill};
use crate::las::header::{Header, POINT_BYTES};
use serde::{Deserialize, Serialize};
use std::hash::Hash;
use std::io;
use std::path::Path;

/// Lists of point records on disk. The key of a list is a grid cell or an octant.
pub(super) struct Spills<K> {
    pub(super) points: Spill<K>,
    /// Records of points near a border, by the neighbouring cell or octant; empty without `prepare`.
    pub(super) margins: Spill<K>,
}

/// Lists of the records of points in an octant, and lists of those in its margin.
pub(super) struct Lists {
    pub(super) points: Vec<List>,
    pub(super) margin: Vec<List>,
}

impl<K: Copy + Eq + Hash> Spills<K> {
    pub(super) fn new(folder: &Path) -> io::Result<Self> {
        Ok(Self { points: Spill::new(folder)?, margins: Spill::new(folder)? })
    }

    /// Removes and returns the lists of some keys.
    pub(super) fn take(&mut self, keys: &[K]) -> Lists {
        let points = keys.iter().map(|key| self.points.take(*key)).collect();
        Lists { points, margin: keys.iter().map(|key| self.margins.take(*key)).collect() }
    }

    /// Writes all records from memory to disk.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.points.flush()?;
        self.margins.flush()
    }

    /// Changes the key of each list to `key(old key)`. Lists that get the same key are joined.
    fn merge(&mut self, key: impl Fn(K) -> K) -> io::Result<()> {
        self.points.merge(&key)?;
        self.margins.merge(key)
    }
}

/// Saved state after the points of `inputs` inputs are sorted.
#[derive(Deserialize, Serialize)]
pub(super) struct SortedState {
    inputs: usize,
    finest: i64,
    points: Index<[i64; 3]>,
    margins: Index<[i64; 3]>,
    summary: Summary,
    notes: Vec<String>,
}

/// Points of all inputs by grid cell.
pub(super) struct SortedPoints {
    pub(super) grid: Grid,
    pub(super) cells: Spills<[i64; 3]>,
    pub(super) summary: Summary,
    pub(super) notes: Vec<String>,
}

/// Sorts the points of one input after the other.
pub(super) struct Sorter<'a> {
    conversion: &'a Conversion<'a>,
    sorted: SortedPoints,
    /// Number of inputs whose points were sorted by an earlier run.
    inputs_sorted: usize,
    /// Number of points read so far, for reports of progress.
    read: u64,
    /// Number of points to read.
    all: u64,
}

impl<'a> Sorter<'a> {
    /// Opens the lists of grid cells on disk. They contain the points of an earlier run if `state` is given.
    pub(super) fn open(
        conversion: &'a Conversion<'a>,
        mut grid: Grid,
        notes: Vec<String>,
        state: Option<SortedState>,
    ) -> Result<Self, Stop> {
        let (finest, points, margins, summary) = (grid.finest, Index::default(), Index::default(), Summary::default());
        let state = state.unwrap_or(SortedState { inputs: 0, finest, points, margins, summary, notes });
        grid.finest = state.finest;
        let cells = Spills {
            points: Spill::of(conversion.file(resume::POINTS, state.points.end)?, state.points),
            margins: Spill::of(conversion.file(resume::MARGINS, state.margins.end)?, state.margins),
        };
        let sorted = SortedPoints { grid, cells, summary: state.summary, notes: state.notes };
        Ok(Self { conversion, sorted, inputs_sorted: state.inputs, read: 0, all: 0 })
    }

    /// Sorts the points of all inputs that this shard needs.
    pub(super) fn sort(mut self, inputs: &mut [Input]) -> Result<SortedPoints, Stop> {
        let Conversion { task, layout, shard_range, .. } = self.conversion;
        let needed: Vec<bool> =
            (0..inputs.len()).map(|i| shard_range.as_ref().is_none_or(|range| range.needs(i))).collect();
        let counts = inputs.iter().zip(&needed).map(|(input, needed)| if *needed { input.header.count } else { 0 });
        self.all = counts.clone().fold(0, u64::saturating_add);
        self.read = counts.take(self.inputs_sorted).fold(0, u64::saturating_add);
        let (mut stored, count) = (self.sorted.summary.count, inputs.len());
        for (i, input) in inputs.iter_mut().enumerate().skip(self.inputs_sorted) {
            if needed[i] {
                self.sort_input(i, input)?;
            }
            let unstored = (self.sorted.summary.count - stored).saturating_mul(layout.sorted_bytes as u64);
            if unstored >= task.limits.kept_bytes || i + 1 == count {
                self.keep(i + 1)?;
                stored = self.sorted.summary.count;
            }
        }
        if self.sorted.summary.count == 0 && shard_range.is_none() {
            let others = if count > 1 { ", and no other input does" } else { "" };
            let problem = Problem::new(format!("holds no point{others}")).expected("at least one");
            return Err(self.conversion.invalid(problem));
        }
        Ok(self.sorted)
    }

    fn sort_input(&mut self, index: usize, input: &mut Input) -> Result<(), Stop> {
        let (format, input_bytes, shift) = (input.header.format, input.header.record_bytes, input.shift);
        let mut sink =
            InputSink { sorter: self, input: index, format, input_bytes, shift, record: Vec::new(), failed: None };
        let read = input.read(&mut sink);
        match sink.failed.take() {
            Some(error) => return Err(error.into()),
            None => read?,
        }
        let notes = input.header.notes.drain(..);
        self.sorted.notes.extend(notes.map(|note| format!("{}: {note}", input.path.shown())));
        Ok(())
    }

    /// Saves the state after `inputs` sorted inputs, if the conversion saves progress.
    fn keep(&mut self, inputs: usize) -> Result<(), Stop> {
        let Some(kept) = self.conversion.task.kept else { return Ok(()) };
        let SortedPoints { grid, cells, summary, notes } = &mut self.sorted;
        let (points, margins) = (cells.points.stored()?, cells.margins.stored()?);
        let (summary, notes) = (summary.clone(), notes.clone());
        Ok(kept.save(resume::SORTED, &SortedState { inputs, finest: grid.finest, points, margins, summary, notes })?)
    }

    /// Adds a point record to its grid cell. If the conversion estimates splats and the point isn't withheld, also adds
    /// the record to the margins of the cells near it. Cells of other shards get nothing. If a conversion of a whole
    /// file gets more than `most_cells` cells, their side is doubled. `position` is in steps of the coordinate scale,
    /// and `units` in grid units.
    fn add(&mut self, record: &[u8], position: [i32; 3], units: [i64; 3]) -> io::Result<()> {
        let Conversion { task, shard_range, .. } = self.conversion;
        let SortedPoints { grid, cells, summary, .. } = &mut self.sorted;
        let owns = |cell| shard_range.as_ref().is_none_or(|range| range.owns(cell));
        let cell = grid.cell(units);
        if owns(cell) {
            summary.add(record, position);
            cells.points.append(cell, record)?;
        }
        if task.prepare.is_some() && !is_withheld(record) {
            let mut add = |cell| if owns(cell) { cells.margins.append(cell, record) } else { Ok(()) };
            each_near_cell(units, grid.side(), &mut add)?;
        }
        if shard_range.is_none() && cells.points.count() > task.limits.most_cells {
            // Points are outside the bounds in their headers, which a shard refuses: double the cells' side.
            grid.finest *= 2;
            cells.merge(|cell| cell.map(|c| c.div_euclid(2)))?;
        }
        Ok(())
    }
}

/// A sink that converts the records of one input and passes them to a sorter.
struct InputSink<'w, 'a> {
    sorter: &'w mut Sorter<'a>,
    /// Index of the input.
    input: usize,
    format: u8,
    input_bytes: usize,
    shift: [i64; 3],
    /// Buffer for the converted record.
    record: Vec<u8>,
    /// Error of the temporary files, if writing to them failed.
    failed: Option<io::Error>,
}

impl InputSink<'_, '_> {
    /// Converts an input's record to the format of the output, relative to the first input's offset; returns its
    /// position, in steps.
    fn convert(&mut self, input: &[u8]) -> Result<[i32; 3], Problem> {
        let layout = &self.sorter.conversion.layout;
        let extra = layout.sorted_bytes - POINT_BYTES[usize::from(layout.template.format)];
        let after = POINT_BYTES[usize::from(self.format)];
        self.record.clear();
        records::append(self.format, input, &mut self.record);
        self.record.extend_from_slice(&input[after..after + extra]);
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
        Ok(at)
    }
}

impl Sink for InputSink<'_, '_> {
    fn start(&mut self, _: &Header, _: usize) {}

    fn append(&mut self, records: &mut [u8]) -> Result<(), Problem> {
        for record in records.chunks_exact(self.input_bytes) {
            let position = self.convert(record)?;
            let units = self.sorter.sorted.grid.units(position);
            if let Some(range) = &self.sorter.conversion.shard_range {
                range.check(self.input, units)?;
            }
            if let Err(error) = self.sorter.add(&self.record, position, units) {
                self.failed = Some(error);
                return Err(Problem::new("can't be sorted"));
            }
        }
        self.sorter.read += (records.len() / self.input_bytes) as u64;
        (self.sorter.conversion.task.progress)("sorting points", self.sorter.read, self.sorter.all);
        Ok(())
    }
}
