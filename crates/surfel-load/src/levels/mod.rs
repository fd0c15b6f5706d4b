//! Levels of detail for points: reading what a view needs of a COPC file, and writing COPC files.
//!
//! `read` selects nodes (`selection.rs`), loads them, and marks the points where finer ones are missing (`marks.rs`).
//! Once the points are splats, `close` enlarges those at their level. `write.rs` writes COPC files.

mod marks;
mod selection;
mod write;

pub use crate::level_choice::{Levels, Seen};

pub(crate) use marks::{Radii, close, own_columns};
pub(crate) use write::save_temporary;
pub use write::{CopcRequest, is_copc, is_shard, resume_folder, save_copc, summary};

use crate::options::io_options;
use crate::{Error, LoadOptions, memory};
use glam::{DAffine3, DVec3};
use marks::{is_known, mark};
pub(crate) use selection::chosen;
use selection::{CLOSING, Selection, select, sight};
use std::path::Path;
use surfel_io::copc::{Copc, Keeps, NodeColumns, NodePoints};
use surfel_io::{Content, Loaded};
use surfel_model::PointCloud;
use surfel_render::{LevelEnd, View};

/// Largest number of points drawn for a view, unless the options state another.
pub const DEFAULT_MOST_POINTS: u64 = 10_000_000;

/// Report of what was read from a COPC file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelReport {
    /// Points read, and points in the file.
    pub points: [u64; 2],
    /// Nodes read, and nodes in the file.
    pub nodes: [usize; 2],
    /// Compressed bytes read, and in the file.
    pub bytes: [u64; 2],
    /// Largest splat radius in pixels where finer visible points are missing; 0 for an overview.
    pub error_px: f64,
    /// Stop reason of the selection.
    pub end: LevelEnd,
}

impl LevelReport {
    /// True if all points were read.
    pub fn is_whole(&self) -> bool {
        self.points[0] == self.points[1]
    }
}

/// True if `path` is a regular file that can be opened.
fn is_file(path: &Path) -> bool {
    matches!(surfel_io::RegularFile::open(path), Ok(Some(_)))
}

/// True if `path` is a COPC file that can be read.
pub fn has_levels(path: &Path) -> bool {
    matches!(Copc::open(path), Ok(Some(_)))
}

/// Reads the selected nodes of the COPC file at `copc_path`, which is `path` itself or a copy of it. Returns `None` if
/// the options ask for all points, or the file isn't COPC.
pub(crate) fn read(
    path: &Path,
    copc_path: &Path,
    options: &LoadOptions,
) -> Result<Option<(Loaded, LevelReport)>, Error> {
    let Some(levels) = chosen(path, options) else { return Ok(None) };
    let opened = Copc::open(copc_path).or_else(|error| if is_file(copc_path) { Err(error) } else { Ok(None) });
    let Some(copc) = opened? else { return Ok(None) };
    // The allocator still holds memory from writing the file.
    let left = options.level_store.as_ref().filter(|_| path != copc_path).map_or(0, |store| store.left_bytes());
    let budget = options.memory.or_else(memory::default_budget).map(|bytes| bytes.saturating_sub(left));
    let point_bytes = if copc.has_colors() { memory::KNOWN_COLORED_BYTES } else { memory::KNOWN_BYTES };
    let fitting = budget.map_or(u64::MAX, |bytes| bytes / point_bytes);
    let most = options.max_points.map_or(DEFAULT_MOST_POINTS.min(fitting), |most| most as u64);
    let selection = select(&copc, levels, options, most);
    let report = selection.report;
    memory::check(path, report.points[0], point_bytes, options.memory, memory::Remedy::Fewer)?;
    let room = budget.map(|all| all.saturating_sub(report.points[0] * point_bytes));
    let copc = copc.with_cache(options.level_store.as_ref().and_then(|store| store.nodes(room)));
    // A copy names the columns of its source itself.
    let names = options.columns.clone().filter(|_| path == copc_path);
    let io_options = surfel_io::LoadOptions { columns: names, ..io_options(options) };
    let is_partial = selection.is_partial(levels);
    let mut found = load_nodes(&copc, &selection, levels, options, &io_options)?;
    if let Content::Points(points) = &mut found.loaded.content {
        if options.rows || options.label.is_some() {
            points.rows = Some(rows(&copc, &selection.nodes, points, path)?);
        }
        if is_partial {
            mark(&copc, &selection, &found.ends, points);
        }
    }
    if is_partial {
        let limit = match options.max_points {
            Some(_) => "`max_points` ends it",
            None if most < DEFAULT_MOST_POINTS => "`memory` ends it",
            None => "`max_points` raises the limit that ends it",
        };
        found.loaded.notes.push(note(&report, limit));
    }
    Ok(Some((found.loaded, report)))
}

/// Loads the selected nodes: the columns that the options need, of points that the views may show.
fn load_nodes(
    copc: &Copc,
    selection: &Selection,
    levels: &Levels,
    options: &LoadOptions,
    io_options: &surfel_io::LoadOptions,
) -> Result<NodePoints, Error> {
    // Any column may be part of a condition.
    let has_choice = options.chooses_classes() || options.returns.is_some() || options.condition.is_some();
    // An overview reads all columns: it must classify noise, which may not influence the camera.
    let has_values = options.color_by.is_some() || options.label.is_some() || *levels == Levels::Overview;
    let columns = match has_choice || has_values {
        true => NodeColumns::All,
        false => NodeColumns::Splats(if selection.is_partial(levels) { &selection.cut.values } else { &[] }),
    };
    // With more points than `max_points`, some are dropped evenly.
    let is_thinned = options.max_points.is_some_and(|most| selection.report.points[0] > most as u64);
    let sight = sight(levels, copc, options).filter(|_| columns != NodeColumns::All && !is_thinned);
    let shows = |level: u32, center: DVec3, radius: f64| {
        // Finer points may be missing.
        let reach = (radius * options.radius_scale).max(f64::from(CLOSING) * copc.spacing(level));
        !is_known(&(radius as f32)) || sight.as_ref().is_none_or(|sight| sight.shows(center, reach))
    };
    let keeps = sight.is_some().then_some(&shows as Keeps<'_>);
    Ok(copc.kept_points_of(&selection.nodes, (columns, keeps), io_options)?)
}

/// Returns each point's row in the file, for points read from these nodes. `read.rows` holds the rows among all points
/// that were decoded.
fn rows(copc: &Copc, nodes: &[u32], read: &PointCloud, path: &Path) -> Result<Vec<u32>, Error> {
    // Row 4294967295 means that there is no splat.
    if copc.points() >= u64::from(u32::MAX) {
        let problem = format!(
            "has {} points, and rows of a plane end at 4294967294: leave out the planes index and label",
            copc.points()
        );
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
    }
    let first = copc.first_rows();
    let in_file = nodes.iter().flat_map(|node| {
        let first = first[*node as usize];
        (first..first + copc.nodes()[*node as usize].points).map(|row| row as u32)
    });
    Ok(match &read.rows {
        None => in_file.collect(),
        Some(kept) => {
            let in_file: Vec<u32> = in_file.collect();
            kept.iter().map(|row| in_file[*row as usize]).collect()
        }
    })
}

/// Describes which nodes a selection omits, why, and the option that changes it.
fn note(report: &LevelReport, limit: &str) -> String {
    let mebibytes = report.bytes.map(|bytes| bytes as f64 / f64::from(1 << 20));
    let (error_px, finer) = (report.error_px, "`lod_error` draws finer ones");
    let why = match report.end {
        LevelEnd::Points => format!("{limit} at splats of {error_px:.1} px"),
        LevelEnd::Enough => format!("more than 5 points a pixel at splats of {error_px:.2} px; {finer}"),
        LevelEnd::Error => format!("splats of {error_px:.2} px at most; {finer}"),
    };
    format!(
        "drawn by levels: {} of {} nodes, {:.1} of {:.1} MiB read ({why}; `all_levels` draws all points)",
        report.nodes[0], report.nodes[1], mebibytes[0], mebibytes[1]
    )
}

/// Returns a selection of levels for views of an object with this transformation. Projected splats are at most
/// `error_px` pixels large.
pub fn views_of(views: &[View], world_from_object: DAffine3, error_px: f64) -> Levels {
    Seen { views, error_px, sight_px: None }.levels(world_from_object)
}
