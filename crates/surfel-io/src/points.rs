//! Points as columns of numbers: XYZ, TXT, CSV, ASC and PTS.
//!
//! Colours of these formats are what a program displayed, so they are sRGB-encoded whether they count to 255,
//! to 65535 or to 1.

use crate::ascii::{Lines, number};
use crate::color::linear_of_unit;
use crate::columns::measured_positions;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, quote};
use glam::{DVec3, Vec3};
use surfel_model::{Column3, ExtraColumn, ExtraValues, PointCloud};

/// Most columns of a file.
const MAX_COLUMNS: usize = 64;

/// What a column holds.
#[derive(Clone, Debug, PartialEq)]
enum Role {
    Position(usize),
    Color(usize),
    Normal(usize),
    Alpha,
    Extra(String),
}

/// True if `head`, the start of a file, has a line of at least three numbers before anything else.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    let mut lines = Lines::new(head).filter(|(_, line)| !is_comment(line));
    lines.next().is_some_and(|(_, line)| fields(line).count() >= 3 && fields(line).all(|w| number(w).is_some()))
}

fn fields(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|b| b.is_ascii_whitespace() || matches!(b, b',' | b';')).filter(|w| !w.is_empty())
}

fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//")
}

pub(crate) fn read(bytes: &[u8], pts: bool, context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut comments = Vec::new();
    let mut header = None;
    let mut values: Vec<f64> = Vec::new();
    let mut width = 0;
    let mut row: Vec<f64> = Vec::with_capacity(MAX_COLUMNS);
    for (line_number, line) in Lines::new(bytes) {
        if is_comment(line) {
            if values.is_empty() && comments.len() < 1000 {
                let text = String::from_utf8_lossy(line.trim_ascii());
                let text = text.trim_start_matches(['#', '/']).trim();
                if !text.is_empty() {
                    comments.push(text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect());
                }
            }
            continue;
        }
        let at = Location::Line(line_number);
        row.clear();
        let mut bad = None;
        for word in fields(line) {
            match number(word) {
                Some(value) if row.len() < MAX_COLUMNS => row.push(value),
                Some(_) => return Err(Problem::new(format!("more than {MAX_COLUMNS} columns")).at(at).into()),
                None => {
                    bad = Some(word);
                    break;
                }
            }
        }
        if let Some(word) = bad {
            if width == 0 && header.is_none() {
                header = Some(header_roles(line).ok_or_else(|| {
                    let found = format!("found {} where points were expected", quote(word));
                    Problem::new(found).at(at).expected("x y z [intensity] [r g b] [nx ny nz], as numbers")
                })?);
                continue;
            }
            return Err(Problem::new(format!("found {}", quote(word))).at(at).expected("a number").into());
        }
        // A PTS file has the number of points before each scan.
        if row.len() == 1 && (pts || width == 0) {
            continue;
        }
        if width == 0 {
            width = row.len();
            if width < 3 {
                return Err(Problem::new(format!("found {width} numbers")).at(at).expected("at least x y z").into());
            }
        }
        if row.len() != width {
            let what = format!("found {} numbers", row.len());
            return Err(Problem::new(what).at(at).expected(format!("{width}, as in the lines before")).into());
        }
        values.extend_from_slice(&row);
    }
    if width == 0 {
        return Err(Problem::new("holds no point").expected("lines of x y z [intensity] [r g b] [nx ny nz]").into());
    }
    let header = header.filter(|roles| roles.len() == width);
    let roles = header.unwrap_or_else(|| guess_roles(&values, width));
    build(&values, width, &roles, comments, context)
}

/// Roles by a first line of names, such as `x,y,z,red,green,blue`; `None` if it names no position.
fn header_roles(line: &[u8]) -> Option<Vec<Role>> {
    let names: Vec<String> = fields(line)
        .take(MAX_COLUMNS + 1)
        .map(|w| String::from_utf8_lossy(w).trim_matches('"').to_ascii_lowercase())
        .collect();
    let roles: Vec<Role> = names
        .into_iter()
        .map(|name| match name.as_str() {
            "x" => Role::Position(0),
            "y" => Role::Position(1),
            "z" => Role::Position(2),
            "r" | "red" => Role::Color(0),
            "g" | "green" => Role::Color(1),
            "b" | "blue" => Role::Color(2),
            "a" | "alpha" => Role::Alpha,
            "nx" | "normal_x" | "normalx" => Role::Normal(0),
            "ny" | "normal_y" | "normaly" => Role::Normal(1),
            "nz" | "normal_z" | "normalz" => Role::Normal(2),
            _ => Role::Extra(name.chars().filter(|c| !c.is_control()).take(60).collect()),
        })
        .collect();
    let complete = |role: fn(usize) -> Role| {
        let counts = [0, 1, 2].map(|i| roles.iter().filter(|r| **r == role(i)).count());
        (counts == [1; 3], counts == [0; 3])
    };
    let (color, normal) = (complete(Role::Color), complete(Role::Normal));
    let alphas = roles.iter().filter(|r| **r == Role::Alpha).count();
    let ok = complete(Role::Position).0 && (color.0 || color.1) && (normal.0 || normal.1) && alphas <= 1;
    ok.then_some(roles)
}

/// Roles by the number of columns and what is in them: x y z, then an intensity if one is left over, then
/// triples that are normals if they have unit length, else colours.
fn guess_roles(values: &[f64], width: usize) -> Vec<Role> {
    let mut roles: Vec<Role> = (0..3).map(Role::Position).collect();
    let extra = |column: usize| Role::Extra(format!("column_{}", column + 1));
    if width % 3 == 1 {
        roles.push(Role::Extra("intensity".into()));
    }
    if width % 3 != 2 {
        let (mut colors, mut normals) = (false, false);
        while roles.len() + 3 <= width {
            let start = roles.len();
            let (unit, color) = triple_kind(values, width, start);
            if unit && !normals {
                normals = true;
                roles.extend((0..3).map(Role::Normal));
            } else if color && !colors {
                colors = true;
                roles.extend((0..3).map(Role::Color));
            } else {
                roles.extend((start..start + 3).map(extra));
            }
        }
    }
    while roles.len() < width {
        roles.push(extra(roles.len()));
    }
    roles
}

/// Whether three columns can be unit normals, and whether they can be colours, by up to 1000 rows.
fn triple_kind(values: &[f64], width: usize, start: usize) -> (bool, bool) {
    let rows = values.len() / width;
    let sample = values.chunks_exact(width).step_by(rows.div_ceil(1000).max(1)).map(|r| &r[start..start + 3]);
    let (mut unit, mut other, mut color) = (0, 0, true);
    for t in sample {
        let length = DVec3::new(t[0], t[1], t[2]).length();
        // Normals are printed with two digits at least; points without one have zeros.
        if (length - 1.0).abs() < 0.02 {
            unit += 1;
        } else if length != 0.0 && !length.is_nan() {
            other += 1;
        }
        color &= t.iter().all(|c| c.is_nan() || (0.0..=65_535.0).contains(c));
    }
    (unit > 0 && unit >= 19 * other, color)
}

fn build(
    values: &[f64],
    width: usize,
    roles: &[Role],
    comments: Vec<String>,
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let column = |role: &Role| roles.iter().position(|r| r == role);
    let triple = |role: fn(usize) -> Role| Some([column(&role(0))?, column(&role(1))?, column(&role(2))?]);
    let rows = || values.chunks_exact(width);
    let vectors = |[x, y, z]: [usize; 3]| rows().map(|r| DVec3::new(r[x], r[y], r[z])).collect::<Vec<_>>();
    let (origin, positions) = measured_positions(&vectors(triple(Role::Position).unwrap_or([0, 1, 2])));
    let colors = triple(Role::Color).map(|[r, g, b]| {
        let largest = rows().flat_map(|row| [row[r], row[g], row[b]]).filter(|c| c.is_finite()).fold(0.0, f64::max);
        let (scale, name) = match largest {
            m if m <= 1.0 => (1.0, "1"),
            m if m <= 255.0 => (255.0, "255"),
            _ => (65_535.0, "65535"),
        };
        context.note(format!("took the colours as sRGB-encoded, from 0 to {name}"));
        rows().map(|row| [row[r], row[g], row[b]].map(|c| linear_of_unit(c / scale))).collect()
    });
    let alphas = column(&Role::Alpha).map(|a| {
        let largest = rows().map(|r| r[a]).filter(|a| a.is_finite()).fold(0.0, f64::max);
        let scale = if largest > 1.0 { 255.0 } else { 1.0 };
        rows().map(|r| (r[a] / scale) as f32).collect()
    });
    let normals =
        triple(Role::Normal).map(|n| Column3::from_f32(vectors(n).iter().map(|n| n.as_vec3()).collect::<Vec<Vec3>>()));
    let extras = roles
        .iter()
        .enumerate()
        .filter_map(|(i, role)| match role {
            Role::Extra(name) => {
                let values = ExtraValues::F32(rows().map(|r| r[i] as f32).collect());
                Some(ExtraColumn { name: name.clone(), values })
            }
            _ => None,
        })
        .collect();
    context.points(PointCloud { origin, positions, normals, colors, alphas, extras, comments, ..PointCloud::default() })
}
