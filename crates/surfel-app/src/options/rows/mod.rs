//! The rows, a module for each part of a command line.

mod appearance;
mod camera;
mod figure;
mod ortho;
mod output;
mod points;
mod program;
mod splats;

use super::Row;

/// Returns all rows; those of a group are in the order in which help lists them.
pub(super) fn all() -> Vec<Row> {
    [output::ROWS, figure::ROWS, ortho::ROWS, camera::ROWS, appearance::ROWS, points::ROWS, splats::ROWS, program::ROWS]
        .concat()
}
