//! Writing of COPC files and of shards for them.

use crate::words::counted;
use crate::{Error, memory};
use std::path::{Path, PathBuf};
use surfel_io::atomic::Temporary;
pub use surfel_io::copc::resume_folder;
use surfel_io::copc::{CopcOptions, CopcReport, MIN_MEMORY, PointSplat, save_temporary_copc};
use surfel_model::{PointCloud, TableColumns};
use surfel_sample::{PointOptions, Progress};

/// Smallest number of points of a chunk from which normals and radii are estimated.
const MIN_POINTS: usize = 16;

/// True if a file's name ends in .copc.laz, so that [`save_copc`] writes a COPC file.
pub fn is_copc(output: &Path) -> bool {
    output.file_name().is_some_and(|name| name.to_string_lossy().to_ascii_lowercase().ends_with(".copc.laz"))
}

/// True if a file's name ends in .shard, so that [`save_copc`] writes a shard of a COPC file ([`CopcRequest::shard`]).
pub fn is_shard(output: &Path) -> bool {
    output.extension().is_some_and(|e| e.eq_ignore_ascii_case("shard"))
}

/// Options for writing a COPC file.
#[derive(Clone, Debug, Default)]
pub struct CopcRequest {
    /// True if an existing file is replaced.
    pub overwrite: bool,
    /// Approximate memory budget in bytes; `None` uses [`memory::default_budget`].
    pub memory: Option<u64>,
    /// True if progress is saved in the folder [`resume_folder`], so that an interrupted run continues from there.
    pub resume: bool,
    /// Shard to write, as its index and the number of shards, to a file that ends in .shard. The COPC file is merged
    /// from all shards.
    pub shard: Option<[u32; 2]>,
    /// Column names for tables among the inputs ([`ConvertOptions::columns`](surfel_model::ConvertOptions::columns)).
    pub columns: Option<TableColumns>,
}

/// Returns the numbers of points, nodes and levels of a COPC file as text for a message.
pub fn summary(report: &CopcReport) -> String {
    let [points, nodes, levels] =
        [(report.points, "points"), (report.nodes as u64, "nodes"), (report.levels as u64, "levels")]
            .map(|(n, what)| counted(n, what));
    format!("{points} in {nodes} of {levels}")
}

/// Writes point files as one COPC file ([`surfel_io::copc::save_copc`]), writes a shard of it, or merges shards.
/// Normals and radii are estimated and stored, so that views needn't estimate them.
///
/// # Errors
/// [`Error::Usage`] for a memory budget below [`surfel_io::copc::MIN_MEMORY`]; otherwise as
/// [`surfel_io::copc::save_copc`].
pub fn save_copc(
    inputs: &[PathBuf],
    output: &Path,
    request: &CopcRequest,
    progress: &dyn Progress,
) -> Result<CopcReport, Error> {
    if let Some(bytes) = request.memory.filter(|bytes| *bytes < MIN_MEMORY) {
        let problem = format!("`memory={bytes}`: writing by levels takes at least {MIN_MEMORY} bytes (200M)");
        return Err(Error::Usage(problem));
    }
    let options = CopcOptions {
        overwrite: request.overwrite,
        memory: request.memory.or_else(memory::default_budget).unwrap_or(MIN_MEMORY),
        resume: request.resume,
        shard: request.shard,
        columns: request.columns.clone(),
    };
    let written = |progress: &dyn Fn(&'static str, u64, u64)| {
        surfel_io::copc::save_copc(inputs, output, &options, Some(&splats_of_part), progress)
    };
    Ok(by_stages(progress, written)?)
}

/// Writes a temporary COPC file in `folder` like [`save_copc`]. `columns` are the column names of the input. The file
/// is deleted when the returned value is dropped.
pub(crate) fn save_temporary(
    (input, columns): (&Path, Option<&TableColumns>),
    folder: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Temporary, Error> {
    let written = |progress: &dyn Fn(&'static str, u64, u64)| {
        save_temporary_copc((&[input.to_path_buf()], columns), folder, memory, Some(&splats_of_part), progress)
    };
    Ok(by_stages(progress, written)?.0)
}

/// Estimates the normals and radii of the points of one chunk of a cloud, which the COPC file stores. Returns unknown
/// values (zeros) for chunks of few points.
fn splats_of_part(points: &PointCloud) -> Result<Vec<PointSplat>, String> {
    if points.len() < MIN_POINTS {
        return Ok(vec![PointSplat::default(); points.len()]);
    }
    let options = PointOptions { coincident: usize::MAX, ellipses: false, ..PointOptions::default() };
    let made = surfel_sample::splats_from_points(points, &options, &surfel_sample::NoProgress);
    let (cloud, _) = made.map_err(|e| e.to_string())?;
    let splat = |i: usize| {
        let normal = surfel_math::basis::unit(cloud.normal(i)).as_vec3().to_array();
        PointSplat { normal, radius: cloud.radius_max(i) as f32 }
    };
    Ok((0..cloud.len()).map(splat).collect())
}

/// Runs `write`, and forwards its progress (stage name, amount done, total amount of the stage) to `progress`.
fn by_stages<T>(progress: &dyn Progress, write: impl FnOnce(&dyn Fn(&'static str, u64, u64)) -> T) -> T {
    let stage = std::cell::RefCell::new(("", 0));
    let tell = |name: &'static str, done: u64, all: u64| {
        let mut last = stage.borrow_mut();
        if last.0 != name {
            progress.stage(name, all);
            *last = (name, 0);
        }
        progress.advance(done.saturating_sub(last.1));
        last.1 = done;
    };
    write(&tell)
}
