//! Rows of the options table, one module for each group of options.

mod appearance;
mod camera;
mod figure;
mod ortho;
mod output;
mod points;
mod program;
mod splats;

use super::Row;

/// Returns all rows. Rows of one group are in the order in which help lists them.
pub(super) fn all() -> Vec<Row> {
    [output::ROWS, figure::ROWS, ortho::ROWS, camera::ROWS, appearance::ROWS, points::ROWS, splats::ROWS, program::ROWS]
        .concat()
}
