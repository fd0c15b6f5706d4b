//! Conversion of the points of all scans of an E57 file to rows of a temporary file, for reading block by block.

use super::layout::Layout;
use super::{File, columns, guarded, none_valid, note_missing};
use crate::bytes::Bytes;
use crate::crs::Crs;
use crate::error::{Fault, Problem, unwritable};
use crate::point_columns::{Named, Roles};
use crate::strided::{NumberType, Strided};
use crate::survey::Source;
use glam::DVec3;
use std::collections::HashMap;
use std::io::Write;

/// Maximum number of columns of all scans together. Files with more are refused.
const MAX_COLUMNS: usize = 100;

/// Description of the rows that [`unpack`] writes. Their coordinates have the scans' poses applied, and are as exact as
/// in the file.
pub(crate) struct Table {
    names: Vec<String>,
    kinds: Vec<NumberType>,
    /// For each column, true if [`Self::columns`] returns it: position, colour and normal always, others only if a row
    /// has a nonzero value.
    used: Vec<bool>,
    rows: usize,
    roles: Roles,
    /// Position of the scanner, if the file is a single scan from one position.
    pub(crate) viewpoint: Option<DVec3>,
    pub(crate) crs: Crs,
}

impl Table {
    fn push(&mut self, name: &str, kind: NumberType) -> usize {
        self.names.push(name.to_owned());
        self.kinds.push(kind);
        self.used.push(false);
        self.names.len() - 1
    }

    fn triple(&mut self, names: [&str; 3], kind: NumberType) -> [usize; 3] {
        let at = names.map(|name| self.push(name, kind));
        at.iter().for_each(|i| self.used[*i] = true);
        at
    }

    /// Returns the columns of the rows that [`unpack`] wrote, and their roles. `data` contains the rows.
    pub(crate) fn columns<'a>(&self, data: Bytes<'a>) -> (Vec<Named<'a>>, Roles) {
        let stride = self.kinds.iter().map(|kind| kind.bytes()).sum();
        let (mut offset, mut columns) = (0, Vec::new());
        for ((name, kind), used) in self.names.iter().zip(&self.kinds).zip(&self.used) {
            let column = Strided::new(data, offset, stride, self.rows, *kind, false).filter(|_| *used);
            columns.extend(column.map(|values| Named { name: name.clone(), values }));
            offset += kind.bytes();
        }
        (columns, self.roles.clone())
    }
}

/// Returns the number of points that a file states, but at most as many as fit into the file's size.
pub(crate) fn survey(source: &mut dyn Source) -> Result<u64, Fault> {
    guarded(|| {
        let mut file = File::open(source, false)?;
        let scans = std::mem::take(&mut file.scans);
        let layouts = file.layouts(&scans, &mut Vec::new())?;
        Ok(layouts.iter().map(|layout| file.most_points(layout)).fold(0, u64::saturating_add))
    })
}

/// Writes the valid points of all scans to `out`, as rows of binary numbers. Returns the description of the rows.
pub(crate) fn unpack(source: &mut dyn Source, out: &mut dyn Write, notes: &mut Vec<String>) -> Result<Table, Fault> {
    guarded(|| unpack_scans(source, out, notes))
}

fn unpack_scans(source: &mut dyn Source, out: &mut dyn Write, notes: &mut Vec<String>) -> Result<Table, Fault> {
    let mut file = File::open(source, false)?;
    let scans = std::mem::take(&mut file.scans);
    let layouts = file.layouts(&scans, notes)?;
    let mut table = Table {
        names: Vec::new(),
        kinds: Vec::new(),
        used: Vec::new(),
        rows: 0,
        roles: Roles::default(),
        viewpoint: if let [layout] = &layouts[..] { layout.viewpoint() } else { None },
        crs: file.crs(),
    };
    table.roles.position = table.triple(["x", "y", "z"], NumberType::F64);
    let colors: Vec<_> = layouts.iter().filter_map(|layout| layout.color).collect();
    let are_bytes = colors.iter().all(|(_, ranges)| *ranges == [(0.0, 255.0); 3]);
    if !colors.is_empty() {
        let kind = if are_bytes { NumberType::U8 } else { NumberType::U16 };
        table.roles.color = Some(table.triple(["red", "green", "blue"], kind));
    }
    if layouts.iter().any(|layout| layout.normal.is_some()) {
        table.roles.normal = Some(table.triple(["nx", "ny", "nz"], NumberType::F32));
    }
    let columns = columns(&layouts)?;
    note_missing(&layouts, &columns, notes);
    file.check_decoded(&layouts, &columns)?;
    let extras: Vec<(usize, String)> =
        columns.into_iter().map(|(name, kind)| (table.push(&name, kind), name)).collect();
    let scan = (layouts.len() > 1).then(|| table.push("scan", NumberType::U32));
    if table.names.len() > MAX_COLUMNS {
        let what = format!("has {} columns", table.names.len());
        return Err(Problem::new(what).expected(format!("at most {MAX_COLUMNS}, to be written by levels")).into());
    }
    let (mut invalid, mut colorless, mut bytes) = (0, 0, Vec::new());
    file.read(&layouts, false, notes, |layout, batch| {
        bytes.clear();
        let by_name: HashMap<&str, _> = layout.extras.iter().rev().map(|e| (e.name.as_str(), e)).collect();
        let found: Vec<_> = extras.iter().map(|(i, name)| (*i, by_name.get(name.as_str()).copied())).collect();
        for row in batch.chunks_exact(layout.scan.prototype.len()) {
            if !layout.is_valid(row) {
                invalid += 1;
                continue;
            }
            table.rows += 1;
            layout.place(row).to_array().iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            if table.roles.color.is_some() {
                let levels = layout.levels(row);
                colorless += u64::from(levels.is_none());
                push_color(layout, levels, are_bytes, &mut bytes);
            }
            if table.roles.normal.is_some() {
                layout.normal(row).to_array().iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            }
            let values = found.iter().map(|(i, extra)| (*i, extra.map_or(0.0, |extra| layout.extra(row, extra))));
            for (i, value) in values.chain(scan.map(|i| (i, f64::from(layout.index)))) {
                table.used[i] |= value != 0.0;
                push(value, table.kinds[i], &mut bytes);
            }
        }
        out.write_all(&bytes).map_err(unwritable)
    })?;
    if table.rows == 0 {
        return Err(none_valid(invalid).into());
    }
    file.note_left_out(invalid, colorless, notes);
    Ok(table)
}

/// Appends a colour's three channels to a row, as bytes (0–255) or as 16-bit numbers (0–65535). `levels` are in the
/// ranges that the scan's layout states. Points without a colour get white.
fn push_color(layout: &Layout<'_>, levels: Option<[f64; 3]>, are_bytes: bool, bytes: &mut Vec<u8>) {
    for k in 0..3 {
        let range = layout.color.map_or((0.0, 1.0), |(_, ranges)| ranges[k]);
        let level = levels.map_or(1.0, |levels| (levels[k] - range.0) / (range.1 - range.0)).clamp(0.0, 1.0);
        match are_bytes {
            true => bytes.push((level * 255.0).round() as u8),
            false => bytes.extend(((level * 65_535.0).round() as u16).to_le_bytes()),
        }
    }
}

fn push(value: f64, kind: NumberType, bytes: &mut Vec<u8>) {
    match kind {
        NumberType::U8 => bytes.push(value as u8),
        NumberType::U16 => bytes.extend((value as u16).to_le_bytes()),
        NumberType::I32 => bytes.extend((value as i32).to_le_bytes()),
        NumberType::U32 => bytes.extend((value as u32).to_le_bytes()),
        NumberType::F32 => bytes.extend((value as f32).to_le_bytes()),
        _ => bytes.extend(value.to_le_bytes()),
    }
}
