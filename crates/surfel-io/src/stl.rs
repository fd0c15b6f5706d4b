//! Reader of STL, text or binary: unconnected triangles. Corners at exactly the same position become one vertex.
//!
//! Binary triangles have two attribute bytes with two conventions. VisCAM and SolidView set bit 15 of a triangle with a
//! colour, with red from bit 10 on. Materialise Magics states a colour for all triangles in the header (`COLOR=` and
//! four bytes). It clears bit 15 of a triangle with its own colour, with red in the lowest bits. Both are sRGB-encoded.

use crate::ascii::{Lines, number_f32, words};
use crate::color::linear_of_8_bit;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, quote};
use crate::face_colors::{self, FaceColor};
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use surfel_model::{Column3, Mesh};

/// Number of bytes of a binary file before its triangles: an arbitrary header and the number of triangles.
const HEADER_BYTES: usize = 84;
/// Number of bytes of a triangle in a binary file: normal, three corners, attribute.
const TRIANGLE_BYTES: usize = 50;

/// True if the content of a file is STL, as text or binary.
pub(crate) fn looks_like(bytes: &[u8]) -> bool {
    is_text(bytes) || binary_count(bytes).is_some_and(|n| bytes.len() == HEADER_BYTES + n * TRIANGLE_BYTES)
}

fn binary_count(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(80..HEADER_BYTES)?;
    Some(u32::from_le_bytes(count.try_into().ok()?) as usize)
}

/// True if an STL file is text. Binary files may start with "solid", too; text has "facet" or "endsolid" within the
/// first 1024 bytes.
fn is_text(bytes: &[u8]) -> bool {
    let head = bytes[..bytes.len().min(1024)].trim_ascii_start();
    let has = |word: &[u8]| head.windows(word.len()).any(|w| w.eq_ignore_ascii_case(word));
    head.len() >= 5 && head[..5].eq_ignore_ascii_case(b"solid") && (has(b"facet") || has(b"endsolid"))
}

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut corners = Corners::default();
    if is_text(bytes) {
        read_text(bytes, &mut corners)?;
    } else {
        read_binary(bytes, &mut corners, context)?;
    }
    if corners.triangles.is_empty() {
        return Err(Problem::new("holds no triangle").expected("STL facets").into());
    }
    if !is_text(bytes) {
        context.note_rounding(&corners.positions);
    }
    let positions = Column3::from_f32(corners.positions);
    let mut mesh = Mesh { origin: DVec3::ZERO, positions, triangles: corners.triangles, ..Mesh::default() };
    if let Some((of_triangle, program)) = colors(bytes, mesh.triangles.len()).filter(|_| !is_text(bytes)) {
        context.note(format!("took the two bytes of its triangles as their colours, as {program}"));
        face_colors::show(&mut mesh, &of_triangle, context);
    }
    context.mesh(mesh)
}

/// Returns the colours of a binary file's triangles, and the programs that write them in this way; `None` if there are
/// none.
fn colors(bytes: &[u8], count: usize) -> Option<(Vec<Option<FaceColor>>, &'static str)> {
    let triangles = bytes.get(HEADER_BYTES..)?.chunks_exact(TRIANGLE_BYTES).take(count);
    let attributes = triangles.map(|raw| u16::from_le_bytes([raw[48], raw[49]]));
    let table = linear_of_8_bit();
    // Expands five bits to eight.
    let linear = |bits: u16| table[((u32::from(bits & 31) * 255 + 15) / 31) as usize];
    let color = |bits: u16, red: u16, blue: u16| [linear(bits >> red), linear(bits >> 5), linear(bits >> blue), 1.0];
    if let Some([r, g, b, a]) = color_of_all(bytes) {
        let [r, g, b] = [r, g, b].map(|level| table[usize::from(level)]);
        // A colour with alpha 0 isn't meant to be invisible, and a blank ends a colour without alpha.
        let of_all = [r, g, b, if matches!(a, 0 | b' ') { 1.0 } else { f32::from(a) / 255.0 }];
        // If all attributes are 0, they are unused and don't mean black.
        let are_used = attributes.clone().any(|bits| bits != 0);
        let own = |bits: u16| if are_used && bits & 0x8000 == 0 { color(bits, 0, 10) } else { of_all };
        return Some((attributes.map(|bits| Some(own(bits))).collect(), "Materialise Magics writes them"));
    }
    let own: Vec<_> = attributes.map(|bits| (bits & 0x8000 != 0).then(|| color(bits, 10, 0))).collect();
    own.iter().any(Option::is_some).then_some((own, "VisCAM and SolidView write them"))
}

/// Returns the RGBA colour, stated in the header by Materialise Magics, of all triangles without their own colour.
fn color_of_all(bytes: &[u8]) -> Option<[u8; 4]> {
    const KEY: &[u8] = b"COLOR=";
    let header = &bytes[..HEADER_BYTES - 4];
    let at = header.windows(KEY.len()).position(|word| word == KEY)? + KEY.len();
    header.get(at..at + 4)?.try_into().ok()
}

#[derive(Default)]
struct Corners {
    index: HashMap<[u32; 3], u32>,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Corners {
    fn vertex(&mut self, p: [f32; 3]) -> u32 {
        let next = self.positions.len() as u32;
        // −0 and +0 are one position; adding +0 changes no other number.
        let p = p.map(|x| x + 0.0);
        *self.index.entry(p.map(f32::to_bits)).or_insert_with(|| {
            self.positions.push(p.into());
            next
        })
    }

    fn triangle(&mut self, p: [[f32; 3]; 3]) {
        let triangle = p.map(|p| self.vertex(p));
        self.triangles.push(triangle);
    }
}

fn read_binary(bytes: &[u8], corners: &mut Corners, context: &mut Context<'_>) -> Result<(), Fault> {
    let Some(count) = binary_count(bytes) else {
        let what = format!("is too short for STL: {} bytes", bytes.len());
        return Err(Problem::new(what).expected("text from 'solid' on, or at least 84 bytes").into());
    };
    let body = &bytes[HEADER_BYTES..];
    if body.len() / TRIANGLE_BYTES < count {
        let what = format!("the STL file ends within triangle {} of {count}", body.len() / TRIANGLE_BYTES);
        let expected = format!("{} bytes, found {}", HEADER_BYTES as u64 + count as u64 * 50, bytes.len());
        let help = "copy or export the file again: it is incomplete, or not STL";
        return Err(Problem::new(what).at(Location::Byte(bytes.len())).expected(expected).help(help).into());
    }
    let rest = body.len() - count * TRIANGLE_BYTES;
    if rest > 0 {
        context.note(format!("ignored {rest} bytes after the last triangle"));
    }
    corners.triangles.reserve_exact(count);
    corners.index.reserve(count / 2);
    for raw in body.chunks_exact(TRIANGLE_BYTES).take(count) {
        let number = |i: usize| f32::from_le_bytes([raw[i], raw[i + 1], raw[i + 2], raw[i + 3]]);
        corners.triangle([12, 24, 36].map(|i| [number(i), number(i + 4), number(i + 8)]));
    }
    Ok(())
}

/// Returns the text without a last line that may be truncated: one without a line end, except `endsolid`.
fn complete_lines(bytes: &[u8]) -> &[u8] {
    let start = bytes.iter().rposition(|b| matches!(b, b'\n' | b'\r')).map_or(0, |at| at + 1);
    let last = bytes[start..].trim_ascii_start();
    let is_end = last.get(..8).is_some_and(|word| word.eq_ignore_ascii_case(b"endsolid"));
    if is_end { bytes } else { &bytes[..start] }
}

fn read_text(bytes: &[u8], corners: &mut Corners) -> Result<(), Fault> {
    let (mut polygon, mut complete) = (Vec::with_capacity(3), false);
    for (line_number, line) in Lines::new(complete_lines(bytes)) {
        let at = Location::Line(line_number);
        let mut words = words(line);
        let Some(first) = words.next() else { continue };
        match first.to_ascii_lowercase().as_slice() {
            b"vertex" => {
                let mut p = [0.0; 3];
                for x in &mut p {
                    let word = words.next().unwrap_or(b"");
                    *x = number_f32(word).ok_or_else(|| {
                        Problem::new(format!("found {} as a coordinate", quote(word))).at(at).expected("a number")
                    })?;
                }
                if polygon.len() == 3 {
                    return Err(Problem::new("a facet has more than three vertices").at(at).expected("three").into());
                }
                polygon.push(p);
            }
            b"endloop" | b"endfacet" if !polygon.is_empty() => {
                let [a, b, c] = polygon[..] else {
                    let what = format!("a facet has {} vertices", polygon.len());
                    return Err(Problem::new(what).at(at).expected("three").into());
                };
                corners.triangle([a, b, c]);
                polygon.clear();
            }
            b"endsolid" => complete = true,
            b"solid" | b"facet" | b"outer" | b"endloop" | b"endfacet" | b"color" => {}
            // The solid's name may have several lines before the first facet.
            _ if corners.triangles.is_empty() && polygon.is_empty() => {}
            _ => {
                let problem = Problem::new(format!("found {}", quote(first))).at(at);
                return Err(problem.expected("facet, outer loop, vertex, endloop, endfacet or endsolid").into());
            }
        }
    }
    if !polygon.is_empty() || !complete {
        let problem = Problem::new(format!("the STL file ends within facet {}", corners.triangles.len()));
        return Err(problem
            .expected("a line 'endsolid'")
            .help("copy or export the file again: it is incomplete")
            .into());
    }
    Ok(())
}
