//! Writing of splat clouds as PLY, without loss.

use super::comments::{are_colors_linear, comment_interior_weight, comment_up, is_oriented};
use super::encoding::PlyEncoding;
use crate::atomic;
use crate::color::exact_8_bit;
use crate::error::IoError;
use glam::DVec3;
use std::collections::HashSet;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;
use surfel_model::{ClipMode, CloudData, Column3, ExtraColumn, ExtraValues, Shape, SplatCloud};

/// Number of rows that are encoded in memory at a time.
const BLOCK_ROWS: usize = 4096;

/// Writes a splat cloud in Surfel's PLY profile to a file, atomically.
///
/// Disks and ellipses lose nothing but labels and row numbers. Balls and dots also lose stored light, and are read as
/// points with radii. Positions and vectors are `double` if the cloud stores them with more precision than f32, else
/// `float`. Positions of a cloud with an origin are `double` and include the origin. Colours are linear `float`, which
/// the comment `colors linear` states, or `uchar` if all are exactly 8-bit sRGB levels. Uninterpreted properties are
/// copied, and so are comments that don't contradict the cloud, up to 8000 characters each.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`].
pub fn save_splat_ply(path: &Path, overwrite: bool, cloud: &SplatCloud, encoding: PlyEncoding) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_splat_ply(out, cloud, encoding))
}

/// Writes a splat cloud like [`save_splat_ply`], to any sink.
///
/// # Errors
/// [`io::Error`] if `out` fails.
pub fn write_splat_ply(out: &mut dyn Write, cloud: &SplatCloud, encoding: PlyEncoding) -> io::Result<()> {
    let columns = columns(cloud.data());
    out.write_all(header(cloud, encoding, &columns).as_bytes())?;
    let mut block = Vec::new();
    for start in (0..cloud.len()).step_by(BLOCK_ROWS) {
        block.clear();
        for row in start..cloud.len().min(start + BLOCK_ROWS) {
            for (i, (_, values)) in columns.iter().enumerate() {
                match encoding {
                    PlyEncoding::Ascii => {
                        if i > 0 {
                            block.push(b' ');
                        }
                        values.text(row, &mut block)?;
                    }
                    PlyEncoding::BinaryLittleEndian => values.bytes::<false>(row, &mut block),
                    PlyEncoding::BinaryBigEndian => values.bytes::<true>(row, &mut block),
                }
            }
            if encoding == PlyEncoding::Ascii {
                block.push(b'\n');
            }
        }
        out.write_all(&block)?;
    }
    Ok(())
}

fn header(cloud: &SplatCloud, encoding: PlyEncoding, columns: &[(String, Values<'_>)]) -> String {
    let data = cloud.data();
    let mut text = format!("ply\nformat {} 1.0\n", encoding.name());
    // The cloud's own values have priority over contradicting comments of its source.
    let (mut up, mut weight, mut oriented) = (data.up, data.interior_weight, data.oriented);
    for comment in &data.comments {
        if let Some(said) = comment_up(comment) {
            if data.up != Some(said) {
                continue;
            }
            up = None;
        }
        if let Some(said) = comment_interior_weight(comment) {
            if said.ok() != data.interior_weight {
                continue;
            }
            weight = None;
        }
        if are_colors_linear(comment) {
            continue;
        }
        if is_oriented(comment) {
            if !data.oriented {
                continue;
            }
            oriented = false;
        }
        // A line break would end the comment and start a header line.
        let line: String = comment.chars().map(|c| if c.is_control() { ' ' } else { c }).take(8000).collect();
        let _ = writeln!(text, "comment {line}");
    }
    // Writing to a string can't fail.
    if let Some(up) = up {
        let _ = writeln!(text, "comment up {up}");
    }
    if let Some(weight) = weight {
        let _ = writeln!(text, "comment interior_weight {weight}");
    }
    if oriented {
        text.push_str("comment oriented\n");
    }
    if columns.iter().any(|(name, values)| name == "red" && matches!(values, Values::F32(_))) {
        text.push_str("comment colors linear\n");
    }
    let _ = writeln!(text, "element vertex {}", cloud.len());
    for (name, values) in columns {
        let _ = writeln!(text, "property {} {name}", values.type_name());
    }
    text.push_str("end_header\n");
    text
}

/// Column to be written: a function that returns the value of a row, or a column in memory.
enum Values<'a> {
    F32(Box<dyn Fn(usize) -> f32 + 'a>),
    F64(Box<dyn Fn(usize) -> f64 + 'a>),
    U8(Box<dyn Fn(usize) -> u8 + 'a>),
    Extra(&'a ExtraValues),
}

macro_rules! each {
    ($values:expr, $v:ident => $body:expr) => {
        match $values {
            ExtraValues::I8($v) => $body,
            ExtraValues::U8($v) => $body,
            ExtraValues::I16($v) => $body,
            ExtraValues::U16($v) => $body,
            ExtraValues::I32($v) => $body,
            ExtraValues::U32($v) => $body,
            ExtraValues::F32($v) => $body,
            ExtraValues::F64($v) => $body,
        }
    };
}

impl Values<'_> {
    fn type_name(&self) -> &'static str {
        match self {
            Self::F32(_) | Self::Extra(ExtraValues::F32(_)) => "float",
            Self::F64(_) | Self::Extra(ExtraValues::F64(_)) => "double",
            Self::U8(_) | Self::Extra(ExtraValues::U8(_)) => "uchar",
            Self::Extra(ExtraValues::I8(_)) => "char",
            Self::Extra(ExtraValues::I16(_)) => "short",
            Self::Extra(ExtraValues::U16(_)) => "ushort",
            Self::Extra(ExtraValues::I32(_)) => "int",
            Self::Extra(ExtraValues::U32(_)) => "uint",
        }
    }

    /// Writes a row's value as text; Rust prints the shortest decimal that reads back as the same number.
    fn text(&self, row: usize, out: &mut Vec<u8>) -> io::Result<()> {
        match self {
            Self::F32(f) => write!(out, "{}", f(row)),
            Self::F64(f) => write!(out, "{}", f(row)),
            Self::U8(f) => write!(out, "{}", f(row)),
            Self::Extra(values) => each!(values, v => write!(out, "{}", v[row])),
        }
    }

    fn bytes<const BIG: bool>(&self, row: usize, out: &mut Vec<u8>) {
        macro_rules! put {
            ($x:expr) => {
                out.extend_from_slice(&if BIG { $x.to_be_bytes() } else { $x.to_le_bytes() })
            };
        }
        match self {
            Self::F32(f) => put!(f(row)),
            Self::F64(f) => put!(f(row)),
            Self::U8(f) => put!(f(row)),
            Self::Extra(values) => each!(values, v => put!(v[row])),
        }
    }
}

fn columns(data: &CloudData) -> Vec<(String, Values<'_>)> {
    let mut columns = Vec::new();
    vector(&mut columns, ["x", "y", "z"], &data.centers, data.origin);
    match &data.shape {
        Shape::Balls { radii, .. } => columns.push(("radius".into(), Values::F32(Box::new(move |i| radii[i])))),
        Shape::Disks { normals, radii } => {
            vector(&mut columns, ["nx", "ny", "nz"], normals, DVec3::ZERO);
            columns.push(("radius".into(), Values::F32(Box::new(move |i| radii[i]))));
        }
        Shape::Ellipses { s, t } => {
            vector(&mut columns, ["su", "sv", "sw"], s, DVec3::ZERO);
            vector(&mut columns, ["tu", "tv", "tw"], t, DVec3::ZERO);
            if let Some(normals) = &data.shading_normals {
                vector(&mut columns, ["nx", "ny", "nz"], normals, DVec3::ZERO);
            }
        }
    }
    if let Some(colors) = &data.colors {
        let levels = colors.iter().flatten().all(|&c| exact_8_bit(c).is_some());
        for (k, name) in ["red", "green", "blue"].into_iter().enumerate() {
            let values = if levels {
                Values::U8(Box::new(move |i| exact_8_bit(colors[i][k]).unwrap_or_default()))
            } else {
                Values::F32(Box::new(move |i| colors[i][k]))
            };
            columns.push((name.into(), values));
        }
    }
    if let Some(alphas) = &data.alphas {
        let level = |a: f32| (a * 255.0).round() as u8;
        let values = if alphas.iter().all(|&a| (f64::from(level(a)) / 255.0) as f32 == a) {
            Values::U8(Box::new(move |i| level(alphas[i])))
        } else {
            Values::F32(Box::new(move |i| alphas[i]))
        };
        columns.push(("alpha".into(), values));
    }
    clips(&mut columns, data);
    let mut known: HashSet<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    for extra in data.extras.iter().filter(|extra| !is_radius(extra, &data.shape)) {
        // A blank would end the name, and a duplicate name would make the file unreadable.
        let blank = |c: char| c.is_whitespace() || c.is_control();
        let mut name: String = extra.name.chars().map(|c| if blank(c) { '_' } else { c }).take(200).collect();
        while name.is_empty() || !known.insert(name.clone()) {
            name.push('_');
        }
        columns.push((name, Values::Extra(&extra.values)));
    }
    columns
}

/// True if an extra column only repeats the radii of disks. Such a column isn't written.
fn is_radius(extra: &ExtraColumn, shape: &Shape) -> bool {
    let (Shape::Disks { radii, .. }, ExtraValues::F32(values)) = (shape, &extra.values) else { return false };
    ["radius", "radii"].iter().any(|name| extra.name.eq_ignore_ascii_case(name)) && values == radii
}

fn vector<'a>(columns: &mut Vec<(String, Values<'a>)>, names: [&str; 3], column: &'a Column3, origin: DVec3) {
    let double = column.low().is_some() || origin != DVec3::ZERO;
    for (k, name) in names.into_iter().enumerate() {
        let values = if double {
            Values::F64(Box::new(move |i| (origin + column.get(i))[k]))
        } else {
            Values::F32(Box::new(move |i| column.high()[i][k]))
        };
        columns.push((name.into(), values));
    }
}

fn clips<'a>(columns: &mut Vec<(String, Values<'a>)>, data: &'a CloudData) {
    let Some(clips) = &data.clips else { return };
    let mut float = |name: String, f: Box<dyn Fn(usize) -> f32 + 'a>| columns.push((name, Values::F32(f)));
    if let Some(c) = &clips.curves {
        float("clip_theta1".into(), Box::new(move |i| c[i].theta1));
        float("clip_theta3".into(), Box::new(move |i| c[i].theta3));
        float("clip_u".into(), Box::new(move |i| c[i].u));
        float("clip_v".into(), Box::new(move |i| c[i].v));
        float("clip_w".into(), Box::new(move |i| c[i].w));
    }
    if let Some(lines) = &clips.lines {
        // Clip lines that no splat uses aren't written. The first is always written, to show that the cloud has lines.
        let used = |k: usize| lines.iter().any(|l| !(l[k].a.is_nan() && l[k].b.is_nan() && l[k].c.is_nan()));
        for k in (0..4).filter(|&k| k == 0 || used(k)) {
            float(format!("clip_line{k}_a"), Box::new(move |i| lines[i][k].a));
            float(format!("clip_line{k}_b"), Box::new(move |i| lines[i][k].b));
            float(format!("clip_line{k}_c"), Box::new(move |i| lines[i][k].c));
        }
    }
    if let Some(modes) = &clips.modes {
        columns.push(("clip_mode".into(), Values::U8(Box::new(move |i| u8::from(modes[i] == ClipMode::Or)))));
    }
}
