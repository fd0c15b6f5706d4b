//! Columns of a PLY element, which readers remove by name. A group of properties, such as nx, ny and nz, must be
//! complete or absent.

use crate::columns;
use crate::columns::Numbers;
use crate::context::Context;
use crate::error::{Fault, Problem, list};
use crate::strided::NumberType;
use glam::DVec3;
use surfel_model::Column3;

/// Columns of a PLY element that were read, with the name of each.
#[derive(Debug, Default)]
pub(crate) struct Table<'a> {
    pub(crate) scalars: Vec<(String, Numbers<'a>)>,
    pub(crate) lists: Vec<(String, Lists<u32>)>,
    /// Texture coordinates of MeshLab's faces: for each face, u and v of each corner in turn.
    pub(crate) coordinates: Option<Lists<f32>>,
}

impl<'a> Table<'a> {
    /// Removes a scalar column, by its name, and returns it.
    pub(crate) fn take(&mut self, name: &str) -> Option<Numbers<'a>> {
        let index = self.scalars.iter().position(|(n, _)| n == name)?;
        Some(self.scalars.remove(index).1)
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.scalars.iter().any(|(n, _)| n == name)
    }
}

/// A column of lists, whose items are stored one after another. Negative integers become `u32::MAX`.
#[derive(Debug, Default)]
pub(crate) struct Lists<T> {
    pub(crate) lengths: Vec<u32>,
    pub(crate) items: Vec<T>,
}

impl<T> Lists<T> {
    /// Appends a list with these items.
    pub(super) fn push(&mut self, items: impl ExactSizeIterator<Item = T>) {
        let length = items.len();
        self.items.extend(items);
        self.end(length);
    }

    /// Completes a list, whose `length` items have been appended to `items`.
    pub(super) fn end(&mut self, length: usize) {
        self.lengths.push(u32::try_from(length).unwrap_or(u32::MAX));
    }

    /// Iterates over the lists.
    pub(super) fn iter(&self) -> impl Iterator<Item = &[T]> {
        let mut rest = self.items.as_slice();
        self.lengths.iter().map(move |&length| {
            let (list, after) = rest.split_at(rest.len().min(length as usize));
            rest = after;
            list
        })
    }
}

/// Removes x, y and z, which must exist, from a table. Returns an origin, and positions relative to it. Adds a note if
/// the positions are coarsely rounded.
pub(super) fn take_positions(table: &mut Table<'_>, context: &mut Context<'_>) -> Result<(DVec3, Column3), Fault> {
    let columns = take(table, ["x", "y", "z"])?;
    let are_rounded = columns.iter().all(|c| c.kind() == NumberType::F32);
    let (origin, positions) = columns::positions(columns);
    if are_rounded {
        context.note_rounding(positions.high());
    }
    Ok((origin, positions))
}

/// Removes columns from a table, and returns them in the order of `names`. Returns an error if one is missing.
pub(super) fn take<'a, const N: usize>(table: &mut Table<'a>, names: [&str; N]) -> Result<[Numbers<'a>; N], Fault> {
    require(table, &names)?;
    let columns: Vec<_> = names.iter().filter_map(|n| table.take(n)).collect();
    columns.try_into().map_err(|_| Problem::new(format!("the properties {} are incomplete", list(&names))).into())
}

/// Removes a set of columns from a table, and returns them in the order of `names`; `None` if none exists. Returns an
/// error if only some exist.
pub(super) fn take_set<'a, const N: usize>(
    table: &mut Table<'a>,
    names: [&str; N],
) -> Result<Option<[Numbers<'a>; N]>, Fault> {
    if names.iter().any(|n| table.has(n)) { take(table, names).map(Some) } else { Ok(None) }
}

/// Checks that a table has all of the columns `names`.
pub(super) fn require(table: &Table<'_>, names: &[&str]) -> Result<(), Fault> {
    let (found, missing): (Vec<&str>, Vec<&str>) = names.iter().partition(|n| table.has(n));
    if missing.is_empty() {
        return Ok(());
    }
    let what = if found.is_empty() {
        let all: Vec<&str> = table.scalars.iter().map(|(n, _)| n.as_str()).collect();
        format!("its vertices lack {}; they have {}", list(&missing), list(&all))
    } else {
        format!("its vertices have {} but lack {}", list(&found), list(&missing))
    };
    Err(Problem::new(what).expected(format!("all of {}", names.join(" "))).help(EXPECTED_SETS).into())
}

/// List of the sets of properties that vertices may have, for messages about incomplete sets.
const EXPECTED_SETS: &str = "splats need x y z and nx ny nz radius, or x y z and su sv sw tu tv tw; points need x y z";
