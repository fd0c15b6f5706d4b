//! Writing of point files as one COPC file, in memory that doesn't grow with the input.
//!
//! A conversion has three steps, and data flows from one to the next:
//!
//! 1. `sort` sorts points into grid cells in a temporary file. Points near a cell's border are also written to the
//!    margins of its neighbours.
//! 2. `build` builds the octree part by part; a part is a subtree that is built in memory. Points of some parts
//!    are read back, get splats and levels, and their nodes become compressed chunks in a second temporary file.
//! 3. `finish` assembles the output from these chunks, or `shards` writes them as a shard.

mod build;
mod column_input;
mod conversion;
mod extra_bytes;
mod finish;
mod grid;
mod inputs;
mod layout;
mod limits;
mod nodes;
mod parts;
mod resume;
mod shard_range;
mod shards;
mod sort;
mod standard_fields;
mod value_range;

use crate::atomic::Temporary;
use crate::error::{IoError, Problem};
use conversion::{Conversion, Opened, Task};
use inputs::{Sources, Stop};
use limits::Limits;
use nodes::{BuiltState, Nodes};
use resume::{Manifest, ResumeFolder};
use serde::{Deserialize, Serialize};
use sort::{SortedState, Sorter};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use surfel_model::TableColumns;

pub use limits::MIN_MEMORY;
pub use parts::{PointSplat, Prepare};

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
    /// Approximate memory to use, in bytes. Less than [`MIN_MEMORY`] counts as [`MIN_MEMORY`].
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

/// Writes the points of LAS, LAZ and COPC files as one COPC file, each point once, with all fields of its record. Point
/// formats 0 to 5 become 6 or 7; waveforms are dropped. Inputs must agree in coordinate scale, fields of the converted
/// point format, extra bytes and coordinate reference system, and their offsets must differ by whole steps. Points of
/// E57, PLY, PCD, NPY, NPZ, PTX, COLMAP, text and rows without a header become records. The step of their coordinates
/// is a power of two, the same for all these inputs.
///
/// If the points have colours, each gets, as extra bytes, the mean colour of the points that it represents at its
/// level. With `prepare`, each point also gets its radius, the mean normal and, unless the inputs have normals, its own
/// normal. `prepare` runs for several parts of the cloud in parallel, each with the points around it. The output is
/// deterministic, whatever the number of threads. `progress` receives a stage's name, the amount done and the total.
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
            let problem =
                Problem::new("is a shard of a conversion, which can't be divided again").expected("its inputs");
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
    let (sources, limits) = (Sources { paths: inputs, columns }, Limits::new(memory));
    let task = Task { sources, folder, kept: None, shard: None, prepare, limits, progress };
    write_by(task, |content| Temporary::write(folder, content))
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
        let opened = ResumeFolder::open(output, &Manifest::new(inputs, prepare.is_some(), options)?)?;
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
    let sources = Sources { paths: inputs, columns: options.columns.as_ref() };
    let task = Task { sources, folder, kept: kept.as_ref(), shard: options.shard, prepare, limits, progress };
    let ((), report) = write_by(task, |content| crate::atomic::write(output, options.overwrite, content))?;
    if let Some(kept) = kept {
        kept.remove();
    }
    Ok(report)
}

/// A callback that writes a file's content.
type Content<'a> = &'a mut dyn FnMut(&mut dyn Write) -> io::Result<()>;

/// Runs a conversion and writes its output by `write`, which gets a callback that writes the content. Returns the
/// result of `write` and the report.
fn write_by<T>(
    task: Task<'_>,
    write: impl FnOnce(Content<'_>) -> Result<T, IoError>,
) -> Result<(T, CopcReport), IoError> {
    let mut report = CopcReport::default();
    let made = write(&mut |sink| {
        let mut counted = Counted { sink, bytes: 0 };
        report = convert(task, &mut counted).map_err(Stop::into_io)?;
        if let Some(kept) = task.kept {
            kept.written(counted.bytes, &report)?;
        }
        Ok(())
    });
    let made = made.map_err(|error| match task.kept {
        Some(kept) => kept.blamed(error),
        None => error,
    })?;
    Ok((made, report))
}

/// Sorts the points, builds the octree and writes the file or shard to `sink`.
fn convert(task: Task<'_>, sink: &mut dyn Write) -> Result<CopcReport, Stop> {
    let (conversion, Opened { mut inputs, grid, notes }) = Conversion::open(task)?;
    let (mut sorted, mut built) = (None::<SortedState>, None::<BuiltState>);
    if let Some(kept) = task.kept {
        (sorted, built) = (kept.load(resume::SORTED)?, kept.load(resume::BUILT)?);
    }
    let nodes = Nodes::open(&conversion, built.filter(|_| sorted.is_some()).unwrap_or_default())?;
    let sorted = Sorter::open(&conversion, grid, notes, sorted)?.sort(&mut inputs)?;
    let octree = build::build(&conversion, &inputs, sorted, nodes)?;
    Ok(match task.shard {
        Some(shard) => shards::write(&conversion, &inputs, octree, shard, sink)?,
        None => finish::finish(&conversion, octree, sink)?,
    })
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

#[cfg(test)]
mod tests;
