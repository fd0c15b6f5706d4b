//! Settings of a conversion that no step changes: its task, the layout of its records, and its shard.

use super::grid::Grid;
use super::inputs::{Gathered, Input, Sources, Stop, gather, invalid, open_all};
use super::layout::Layout;
use super::limits::Limits;
use super::parts::Prepare;
use super::resume::ResumeFolder;
use super::shard_range::ShardRange;
use crate::error::Problem;
use crate::las::copc::spill::unnamed;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Callback that receives a stage's name, the amount done and the total.
pub(super) type Progress<'a> = &'a dyn Fn(&'static str, u64, u64);

/// Inputs, folders, shard and limits of one conversion to COPC.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    pub(super) sources: Sources<'a>,
    /// Folder of temporary files.
    pub(super) folder: &'a Path,
    /// Resume folder, if progress is saved.
    pub(super) kept: Option<&'a ResumeFolder>,
    /// Index and count of the shard to write; `None` for a whole file.
    pub(super) shard: Option<[u32; 2]>,
    pub(super) prepare: Option<Prepare<'a>>,
    pub(super) limits: Limits,
    pub(super) progress: Progress<'a>,
}

/// A conversion whose inputs are checked.
pub(super) struct Conversion<'a> {
    /// The task, with limits that are scaled to the size of the records.
    pub(super) task: Task<'a>,
    pub(super) layout: Layout,
    /// Path of the first input, for error messages.
    pub(super) first: PathBuf,
    /// The shard that is written; `None` for a whole file.
    pub(super) shard_range: Option<ShardRange>,
}

/// Opened inputs of a conversion.
pub(super) struct Opened {
    pub(super) inputs: Vec<Input>,
    /// Grid over the inputs' bounds.
    pub(super) grid: Grid,
    pub(super) notes: Vec<String>,
}

impl<'a> Conversion<'a> {
    /// Opens the inputs and checks that they can be written as one file.
    pub(super) fn open(task: Task<'a>) -> Result<(Self, Opened), Stop> {
        let opened = open_all(task.sources, task.folder, task.progress)?;
        let Some((first, raw)) = opened.first() else {
            return Err(Stop::Disk(io::Error::other("no input is given")));
        };
        let layout = Layout::of(first, raw, task.prepare.is_some())?;
        let (scale, offset, first) = (first.header.scale, first.header.offset, first.path.clone());
        let limits = task.limits.of_points(layout.sorted_bytes as u64);
        let Gathered { inputs, low, high, count, notes } = gather(opened, scale, offset)?;
        let grid = Grid::new(scale, [low, high], count, (limits.cell_points, limits.most_cells));
        let shard_range = task.shard.map(|shard| ShardRange::new(shard, &inputs, grid, scale));
        Ok((Self { task: Task { limits, ..task }, layout, first, shard_range }, Opened { inputs, grid, notes }))
    }

    /// Opens the file `name` of the resume folder and truncates it to its `bytes` valid bytes. If progress isn't saved,
    /// creates an anonymous temporary file instead.
    pub(super) fn file(&self, name: &str, bytes: u64) -> Result<File, Stop> {
        match self.task.kept {
            Some(kept) => kept.file(name, bytes),
            None => Ok(unnamed(self.task.folder)?),
        }
    }

    /// Returns an error that names the first input.
    pub(super) fn invalid(&self, problem: Problem) -> Stop {
        invalid(&self.first, problem)
    }
}
