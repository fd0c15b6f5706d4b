//! Reader of OFF, the Object File Format of Geomview, as text: a mesh, or points if there are no faces.

use crate::ascii::{Lines, number, words};
use crate::color::linear_of_unit;
use crate::columns::measured_positions;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, quote};
use crate::face_colors;
use crate::polygons::Triangulator;
use crate::words::counted;
use glam::{DVec3, Vec3};
use surfel_model::{Column3, Mesh, PointCloud};

/// Attributes of vertices in addition to the position. The letters before the keyword OFF state them.
#[derive(Clone, Copy, Default)]
struct Kind {
    textured: bool,
    normals: bool,
    homogeneous: bool,
}

/// Parses the first word of a file. Returns the attributes that it states, and the rest of the word. Returns `None` if
/// the file isn't OFF.
fn keyword(word: &[u8]) -> Option<(Kind, &[u8])> {
    let mut kind = Kind::default();
    let mut rest = word;
    if let Some(after) = rest.strip_prefix(b"ST") {
        (kind.textured, rest) = (true, after);
    }
    rest = rest.strip_prefix(b"C").unwrap_or(rest);
    if let Some(after) = rest.strip_prefix(b"N") {
        (kind.normals, rest) = (true, after);
    }
    if let Some(after) = rest.strip_prefix(b"4") {
        (kind.homogeneous, rest) = (true, after);
    }
    // Some files lack the blank or line end after the keyword.
    rest.strip_prefix(b"OFF").filter(|after| after.iter().all(u8::is_ascii_digit)).map(|after| (kind, after))
}

/// True if `head` is the start of an OFF file.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    content_lines(head).next().is_some_and(|(_, line)| words(line).next().is_some_and(|w| keyword(w).is_some()))
}

/// Returns the numbered lines that have content, without comments.
fn content_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let content = |line: &'_ [u8]| line.iter().position(|&b| b == b'#').unwrap_or(line.len());
    Lines::new(bytes)
        .map(move |(n, line)| (n, &line[..content(line)]))
        .filter(|(_, line)| !line.trim_ascii().is_empty())
}

/// Columns of the vertices that were read so far.
#[derive(Default)]
struct Vertices {
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    /// Red, green, blue and alpha (NaN if missing) as the file states them, of the vertices that have a colour. They
    /// are used only if all vertices have one.
    colors: Vec<[f64; 4]>,
}

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut lines = content_lines(bytes);
    let incomplete = |what: &str| {
        let problem = Problem::new(format!("the file ends within its {what}"));
        Fault::from(problem.help("copy or export the file again: it is incomplete"))
    };
    let mut line = lines.next().ok_or_else(|| incomplete("header"))?;
    let mut kind = Kind::default();
    let first = words(line.1).next().unwrap_or_default();
    if let Some((found, after)) = keyword(first) {
        kind = found;
        let start = line.1.len() - line.1.trim_ascii_start().len() + first.len() - after.len();
        line.1 = &line.1[start..];
        if line.1.trim_ascii().is_empty() {
            line = lines.next().ok_or_else(|| incomplete("header"))?;
        }
    }
    if words(line.1).next() == Some(b"BINARY") {
        let problem = Problem::new("is a binary OFF file").expected("one of text");
        return Err(problem.help("export it as text, or as PLY").into());
    }
    let mut row = Vec::new();
    numbers(line, &mut row)?;
    let [vertex_count, face_count] = [0, 1].map(|i| row.get(i).copied().unwrap_or(-1.0));
    if vertex_count < 0.0 || face_count < 0.0 || row.iter().any(|n| n.fract() != 0.0) {
        let problem = Problem::new(format!("found {} after the keyword", quote(line.1.trim_ascii())));
        return Err(problem
            .at(Location::Line(line.0))
            .expected("OFF and the numbers of vertices, faces and edges")
            .into());
    }
    let mut vertices = Vertices::default();
    for _ in 0..vertex_count as u64 {
        let line = lines.next().ok_or_else(|| incomplete("vertices"))?;
        numbers(line, &mut row)?;
        push_vertex(&mut vertices, kind, &row).ok_or_else(|| {
            let problem = Problem::new(format!("a vertex has {} numbers", row.len())).at(Location::Line(line.0));
            problem.expected("x y z, then a normal in NOFF, then a colour of 3 or 4 numbers")
        })?;
    }
    let (mut triangles, mut skipped, mut colored) = (Vec::new(), 0_usize, false);
    // Printed colour of each triangle.
    let mut colors_of: Vec<Option<[f64; 4]>> = Vec::new();
    let mut cutter = Triangulator::default();
    for _ in 0..face_count as u64 {
        let line = lines.next().ok_or_else(|| incomplete("faces"))?;
        numbers(line, &mut row)?;
        // Some programs break faces into several lines.
        while row.first().is_some_and(|corners| *corners > (row.len() - 1) as f64) {
            let Some(more) = lines.next() else { break };
            add_numbers(more, &mut row)?;
        }
        let corners = row.first().copied().filter(|n| *n >= 0.0 && *n <= (row.len() - 1) as f64 && n.fract() == 0.0);
        let Some(corners) = corners.map(|n| n as usize) else {
            let problem = Problem::new(format!("found the face {}", quote(line.1.trim_ascii())));
            return Err(problem
                .at(Location::Line(line.0))
                .expected("the number of corners and as many indices")
                .into());
        };
        let color = match row[corners + 1..] {
            [r, g, b] => Some([r, g, b, f64::NAN]),
            [r, g, b, a] => Some([r, g, b, a]),
            _ => None,
        };
        colored |= color.is_none() && row.len() > corners + 1;
        let index = |i: f64| if i >= 0.0 && i < vertex_count { Some(i as u32) } else { None };
        let polygon: Option<Vec<u32>> = row[1..=corners].iter().map(|&i| index(i)).collect();
        let polygon = polygon.ok_or_else(|| {
            let problem = Problem::new(format!("the face {} has a corner out of range", quote(line.1.trim_ascii())));
            problem.at(Location::Line(line.0)).expected(format!("indices from 0 to {}", vertex_count - 1.0))
        })?;
        let cut = cutter.cut(&polygon, |i| vertices.positions.get(i as usize).copied());
        colors_of.extend(cut.iter().map(|_| color));
        triangles.extend(cut.iter().map(|t| t.map(|place| polygon[place as usize])));
        skipped += usize::from(corners < 3);
    }
    if skipped > 0 {
        context.note(format!("skipped {} with fewer than 3 corners", counted(skipped as u64, "faces")));
    }
    if colored {
        context.note("ignored the colours of some faces: expected 3 or 4 numbers".into());
    }
    finish(vertices, triangles, &colors_of, context)
}

/// Returns the maximum of the printed colours' range: 255 if any value is above 1, else 1. A note states it.
fn color_scale<'a>(printed: impl Iterator<Item = &'a [f64; 4]>, context: &mut Context<'_>) -> f64 {
    let largest = printed.flatten().copied().filter(|c| c.is_finite()).fold(0.0, f64::max);
    let scale = if largest > 1.0 { 255.0 } else { 1.0 };
    context.note(format!("took the colours as sRGB-encoded, from 0 to {scale}"));
    scale
}

/// Converts a colour as the file states it, with levels from 0 to `scale`, to linear RGB and alpha.
fn linear(c: &[f64; 4], scale: f64) -> [f32; 4] {
    // A missing alpha is NaN.
    let alpha = if c[3].is_nan() { 1.0 } else { (c[3] / scale).clamp(0.0, 1.0) as f32 };
    let [r, g, b] = [c[0], c[1], c[2]].map(|c| linear_of_unit(c / scale));
    [r, g, b, alpha]
}

fn finish(
    vertices: Vertices,
    triangles: Vec<[u32; 3]>,
    colors_of: &[Option<[f64; 4]>],
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let n = vertices.positions.len();
    let (origin, positions) = measured_positions(&vertices.positions);
    let (mut colors, mut alphas) = (None, None);
    if n > 0 && vertices.colors.len() == n {
        let scale = color_scale(vertices.colors.iter(), context);
        let all: Vec<[f32; 4]> = vertices.colors.iter().map(|c| linear(c, scale)).collect();
        colors = Some(all.iter().map(|c| [c[0], c[1], c[2]]).collect());
        if vertices.colors.iter().all(|c| !c[3].is_nan()) {
            alphas = Some(all.iter().map(|c| c[3]).collect());
        }
    }
    let normals = (n > 0 && vertices.normals.len() == n).then_some(vertices.normals);
    if triangles.is_empty() {
        let normals = normals.map(Column3::from_f32);
        return context.points(PointCloud { origin, positions, normals, colors, alphas, ..PointCloud::default() });
    }
    let normals = normals.map(|n| n.iter().map(Vec3::to_array).collect());
    let mut mesh = Mesh { origin, positions, triangles, normals, colors, alphas, ..Mesh::default() };
    if colors_of.iter().any(Option::is_some) {
        let scale = color_scale(colors_of.iter().flatten(), context);
        let of_triangle: Vec<_> = colors_of.iter().map(|c| c.as_ref().map(|c| linear(c, scale))).collect();
        face_colors::show(&mut mesh, &of_triangle, context);
    }
    context.mesh(mesh)
}

/// Parses the numbers of a line, which replace the contents of `row`.
fn numbers(line: (usize, &[u8]), row: &mut Vec<f64>) -> Result<(), Fault> {
    row.clear();
    add_numbers(line, row)
}

/// Parses the numbers of a line, and appends them to `row`.
fn add_numbers((number_of_line, line): (usize, &[u8]), row: &mut Vec<f64>) -> Result<(), Fault> {
    for word in words(line) {
        row.push(number(word).ok_or_else(|| {
            Problem::new(format!("found {}", quote(word))).at(Location::Line(number_of_line)).expected("a number")
        })?);
    }
    Ok(())
}

/// Appends a vertex, whose numbers are in `row`; returns `None` if there are too few.
fn push_vertex(vertices: &mut Vertices, kind: Kind, row: &[f64]) -> Option<()> {
    let (position, mut rest) = row.split_at_checked(if kind.homogeneous { 4 } else { 3 })?;
    let w = position.get(3).copied().unwrap_or(1.0);
    vertices.positions.push(DVec3::new(position[0], position[1], position[2]) / w);
    if kind.normals {
        let (normal, after) = rest.split_at_checked(3)?;
        vertices.normals.push(DVec3::new(normal[0], normal[1], normal[2]).as_vec3());
        rest = after;
    }
    if kind.textured {
        rest = rest.get(..rest.len().checked_sub(2)?)?;
    }
    match *rest {
        [r, g, b] => vertices.colors.push([r, g, b, f64::NAN]),
        [r, g, b, a] => vertices.colors.push([r, g, b, a]),
        _ => {}
    }
    Some(())
}
