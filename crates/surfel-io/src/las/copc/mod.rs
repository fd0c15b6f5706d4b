//! COPC 1.0 (copc.io): a LAZ file whose chunks are the nodes of an octree. Every point is in one node; a node and those
//! above it hold its part of the cloud at the node's spacing, half of which the nodes below have.

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
pub use hierarchy::{Copc, CopcNode, Keeps, LevelValues, NodeColumns, NodePoints};
pub use write::{
    CopcOptions, CopcReport, LEAST_MEMORY, PointSplat, Prepare, resume_folder, save_copc, save_temporary_copc,
};

use crate::format::Format;
use std::path::Path;
use surfel_model::{TableColumns, Up};

/// The format of a file that can be written by levels and isn't LAS, which axis is up in it, and whether it says so.
/// `columns` as [`crate::LoadOptions`] has them.
pub fn up_of_columns(path: &Path, columns: Option<&TableColumns>) -> Option<(Format, Up, bool)> {
    let survey = crate::column_file::survey(path, columns)?;
    Some((survey.format, survey.up.unwrap_or(survey.format.default_up(false)), survey.up.is_some()))
}

/// Bytes of the record with the octree's place, and of its entries in the hierarchy.
const INFO_BYTES: usize = 160;
const ENTRY_BYTES: usize = 32;
/// Where that record is: it is the first, and the header has 375 bytes.
const INFO_AT: usize = 375 + 54;

/// Names of the extra bytes with a point's normal.
const NORMALS: [&str; 3] = ["NormalX", "NormalY", "NormalZ"];
/// Of those with the mean colour of the points that one stands for at its level.
pub const LEVEL_COLORS: [&str; 3] = ["level_red", "level_green", "level_blue"];
/// Of those with their mean normal.
pub const LEVEL_NORMALS: [&str; 3] = ["level_normal_x", "level_normal_y", "level_normal_z"];
