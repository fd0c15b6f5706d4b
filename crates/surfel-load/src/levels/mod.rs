//! Levels of detail of point files: reads the nodes of a COPC file that a view needs, and writes COPC files.
//!
//! `read` selects nodes (`selection.rs`), loads them, and computes drawing parameters of points where finer ones are
//! missing (`marks.rs`). When points have become splats, `close` enlarges the splats so that each level covers the
//! surface. `write.rs` writes COPC files.

mod marks;
mod selection;
mod write;

pub use crate::level_choice::{Levels, ViewSelection};

pub(crate) use marks::{Radii, close, own_columns};
pub(crate) use write::save_temporary;
pub use write::{CopcRequest, is_copc, is_shard, resume_folder, save_copc, summary};

use crate::options::io_options;
use crate::{Error, LoadOptions, memory};
use glam::{DAffine3, DVec3};
use marks::{is_valid_radius, mark};
pub(crate) use selection::chosen;
use selection::{COVERING_RADIUS, Selection, select, visibility};
use std::path::Path;
use surfel_io::copc::{Copc, NodeColumns, NodePoints, PointFilter};
use surfel_io::{Content, Loaded};
use surfel_model::PointCloud;
use surfel_render::{StopReason, View};

/// Default point budget: the largest number of points that are read from a file for a view.
pub const DEFAULT_POINT_BUDGET: u64 = 10_000_000;

/// Statistics of the nodes that were read from a COPC file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelReport {
    /// Number of points in the nodes that were read, and number in the file.
    pub points: [u64; 2],
    /// Number of nodes that were read, and number in the file.
    pub nodes: [usize; 2],
    /// Number of compressed bytes that were read, and number in the file.
    pub bytes: [u64; 2],
    /// Largest projected splat radius, in pixels, among places in the views where finer points exist but weren't read;
    /// 0 for an overview.
    pub error_px: f64,
    /// Limit that ended the selection of nodes.
    pub end: StopReason,
}

impl LevelReport {
    /// True if all points were read.
    pub fn is_whole(&self) -> bool {
        self.points[0] == self.points[1]
    }
}

/// True if `path` is a regular file that can be opened, not a pipe or a folder.
fn is_file(path: &Path) -> bool {
    matches!(surfel_io::RegularFile::open(path), Ok(Some(_)))
}

/// True if `path` is a COPC file that can be read.
pub fn has_levels(path: &Path) -> bool {
    matches!(Copc::open(path), Ok(Some(_)))
}

/// Reads the selected nodes of a COPC file. `copc_path` is `path` itself, or the path of a COPC copy of it. Returns
/// `None` if all points are to be read ([`chosen`]), or the file isn't COPC.
pub(crate) fn read(
    path: &Path,
    copc_path: &Path,
    options: &LoadOptions,
) -> Result<Option<(Loaded, LevelReport)>, Error> {
    let Some(levels) = chosen(path, options) else { return Ok(None) };
    let opened = Copc::open(copc_path).or_else(|error| if is_file(copc_path) { Err(error) } else { Ok(None) });
    let Some(copc) = opened? else { return Ok(None) };
    // After a COPC copy was written, the allocator still retains memory.
    let left = options.level_store.as_ref().filter(|_| path != copc_path).map_or(0, |store| store.allocator_bytes());
    let budget = options.memory.or_else(memory::default_budget).map(|bytes| bytes.saturating_sub(left));
    let point_bytes = if copc.has_colors() { memory::KNOWN_COLORED_BYTES } else { memory::KNOWN_BYTES };
    let fitting = budget.map_or(u64::MAX, |bytes| bytes / point_bytes);
    let most = options.max_points().map_or(DEFAULT_POINT_BUDGET.min(fitting), |most| most as u64);
    let selection = select(&copc, levels, options, most);
    let report = selection.report;
    memory::check(path, report.points[0], point_bytes, options.memory, memory::Remedy::Fewer)?;
    let room = budget.map(|all| all.saturating_sub(report.points[0] * point_bytes));
    let copc = copc.with_cache(options.level_store.as_ref().and_then(|store| store.nodes(room)));
    // A COPC copy already has the column names of its source.
    let names = options.convert.columns.clone().filter(|_| path == copc_path);
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
        let limit = match options.max_points() {
            Some(_) => "`max_points` ends it",
            None if most < DEFAULT_POINT_BUDGET => "`memory` ends it",
            None => "`max_points` raises the limit that ends it",
        };
        found.loaded.notes.push(note(&report, limit));
    }
    Ok(Some((found.loaded, report)))
}

/// Loads the selected nodes. Reads only the columns that the options need, and only points that the views may show.
fn load_nodes(
    copc: &Copc,
    selection: &Selection,
    levels: &Levels,
    options: &LoadOptions,
    io_options: &surfel_io::LoadOptions,
) -> Result<NodePoints, Error> {
    // A condition may refer to any column.
    let has_choice =
        options.chooses_classes() || options.convert.returns.is_some() || options.convert.condition.is_some();
    // An overview reads all columns, because noise is recognised by its class and must not influence the camera.
    let has_values = options.convert.color_by.is_some() || options.label.is_some() || *levels == Levels::Overview;
    let columns = match has_choice || has_values {
        true => NodeColumns::All,
        false => NodeColumns::Splats(if selection.is_partial(levels) { &selection.cut.values } else { &[] }),
    };
    // If nodes have more points than `max_points`, the excess is dropped evenly.
    let is_thinned = options.max_points().is_some_and(|most| selection.report.points[0] > most as u64);
    let visibility = visibility(levels, copc, options).filter(|_| columns != NodeColumns::All && !is_thinned);
    let shows = |level: u32, center: DVec3, radius: f64| {
        // If finer points are missing, the splat is enlarged to this radius.
        let reach = (radius * options.radius_scale()).max(f64::from(COVERING_RADIUS) * copc.spacing(level));
        !is_valid_radius(&(radius as f32)) || visibility.as_ref().is_none_or(|test| test.shows(center, reach))
    };
    let keeps = visibility.is_some().then_some(&shows as PointFilter<'_>);
    Ok(copc.kept_points_of(&selection.nodes, (columns, keeps), io_options)?)
}

/// Returns the row in the file of each point that was read from `nodes`. If points were skipped, `read.rows` has each
/// point's row among all decoded points of these nodes.
fn rows(copc: &Copc, nodes: &[u32], read: &PointCloud, path: &Path) -> Result<Vec<u32>, Error> {
    // The plane `index` uses 4294967295 for pixels without a splat.
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

/// Returns a note that describes which nodes weren't read, the reason, and the option that changes it. `limit` names
/// the option for the point budget, in the note.
fn note(report: &LevelReport, limit: &str) -> String {
    let mebibytes = report.bytes.map(|bytes| bytes as f64 / f64::from(1 << 20));
    let (error_px, finer) = (report.error_px, "`lod_error` draws finer ones");
    let why = match report.end {
        StopReason::Points => format!("{limit} at splats of {error_px:.1} px"),
        StopReason::EnoughPoints => format!("more than 5 points a pixel at splats of {error_px:.2} px; {finer}"),
        StopReason::Error => format!("splats of {error_px:.2} px at most; {finer}"),
    };
    format!(
        "drawn by levels: {} of {} nodes, {:.1} of {:.1} MiB read ({why}; `all_levels` draws all points)",
        report.nodes[0], report.nodes[1], mebibytes[0], mebibytes[1]
    )
}

/// Returns a selection of LOD nodes for views of an object with the transformation `world_from_object`. Projected splat
/// radii are at most `error_px` pixels, unless the point budget is too small. No point of the selected nodes is skipped
/// for being outside of the view frustum.
pub fn views_of(views: &[View], world_from_object: DAffine3, error_px: f64) -> Levels {
    ViewSelection { views, error_px, margin_px: None }.levels(world_from_object)
}
