//! COPC 1.0 (copc.io): a LAZ file whose chunks are the nodes of an octree. Each point belongs to one node. A node and
//! its ancestors together sample their part of the cloud at the node's spacing, which halves with each level.

mod build;
mod cache;
mod hierarchy;
mod octants;
mod output;
mod records;
mod spill;
mod write;

pub use super::RADIUS;
pub use cache::{FileState, NodeCache};
pub use hierarchy::{Copc, CopcNode, LevelValues, NodeColumns, NodePoints, PointFilter};
pub use write::{
    CopcOptions, CopcReport, MIN_MEMORY, PointSplat, Prepare, resume_folder, save_copc, save_temporary_copc,
};

use crate::format::Format;
use std::path::Path;
use surfel_model::{TableColumns, Up};

/// Returns the format of a non-LAS file that can be converted to COPC, its up axis, and true if the file states the
/// axis. Otherwise the axis is the format's default. Returns `None` for other files. `columns` is as in
/// [`crate::LoadOptions`].
pub fn up_of_columns(path: &Path, columns: Option<&TableColumns>) -> Option<(Format, Up, bool)> {
    let survey = crate::column_file::survey(path, columns)?;
    Some((survey.format, survey.up.unwrap_or(survey.format.default_up(false)), survey.up.is_some()))
}

/// Number of bytes of the COPC info record's data.
const INFO_BYTES: usize = 160;
/// Number of bytes of an `Entry` of the COPC hierarchy.
const ENTRY_BYTES: usize = 32;
/// Byte offset of the COPC info record's data in the file: after the 375-byte header and the record's own 54-byte
/// header.
const INFO_AT: usize = 375 + 54;

/// Names of the extra bytes with a point's own normal.
const NORMALS: [&str; 3] = ["NormalX", "NormalY", "NormalZ"];
/// Names of the extra bytes with the mean colour of the points that a point represents at its level of the octree.
pub const LEVEL_COLORS: [&str; 3] = ["level_red", "level_green", "level_blue"];
/// Names of the extra bytes with the mean normal of the points that a point represents at its level of the octree.
pub const LEVEL_NORMALS: [&str; 3] = ["level_normal_x", "level_normal_y", "level_normal_z"];
