//! Reader of Wavefront OBJ with MTL materials.
//!
//! Positions are parsed without loss. Vertex colours (`v x y z r g b`) are values that a program displayed, so they are
//! sRGB-encoded. Their range is 1 or, if a value is larger, 255. `Kd` is linear and multiplies the texture.

mod mtl;
mod names;

use crate::ascii::{Lines, number, words};
use crate::color::linear_of_level;
use crate::columns::measured_positions;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, quote};
use crate::materials::{Material, Parts};
use crate::ply::colors::{ColorScale, ColorType, FloatColors};
use crate::polygons::Triangulator;
use crate::words::counted;
use glam::DVec3;
use std::collections::HashMap;
use surfel_model::PointCloud;

/// Index that marks a missing texture coordinate or normal of a face's corner.
const NONE: u32 = u32::MAX;

/// True if the first word of `head`, except comments, is a keyword of OBJ.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    let mut lines = Lines::new(head).filter_map(|(_, line)| words(line).next()).filter(|w| !w.starts_with(b"#"));
    let keywords: [&[u8]; 9] = [b"v", b"vn", b"vt", b"f", b"o", b"g", b"mtllib", b"usemtl", b"s"];
    lines.next().is_some_and(|w| keywords.contains(&w))
}

/// Contents of an OBJ file, with material names resolved to indices.
#[derive(Default)]
struct Obj {
    positions: Vec<DVec3>,
    /// Colours of the vertices as the file states them; NaN for a vertex without one. Shorter than `positions` if the
    /// last vertices have no colours.
    printed_colors: Vec<[f64; 3]>,
    /// Colours of the vertices in linear RGB; empty if the file has none.
    colors: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    /// Corners of all faces, one face after another: indices of position, texture coordinate, normal ([`NONE`] if there
    /// is none) and material.
    corners: Vec<[u32; 4]>,
    /// Number of corners of each face.
    faces: Vec<u32>,
    /// Number of corners that refer to texture coordinates that don't exist, and number of corners that refer to
    /// normals that don't exist.
    missing: [usize; 2],
    /// Largest vertex index, from 0, that a face used before the vertex was defined; and the face's line and the index
    /// as text. At the end of the file, the vertex must exist.
    ahead: Option<(u32, usize, String)>,
    /// Number of the current line, from 1, for messages.
    line: usize,
    names: HashMap<String, u32>,
    material: u32,
    libraries: Vec<String>,
    comments: Vec<String>,
    lines_ignored: usize,
}

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut obj = Obj::default();
    let mut joined: Vec<u8> = Vec::new();
    for (number, line) in Lines::new(bytes) {
        obj.line = number;
        // A backslash continues a line.
        if let Some(part) = line.strip_suffix(b"\\") {
            joined.extend_from_slice(part);
            joined.push(b' ');
        } else if joined.is_empty() {
            obj.statement(line).map_err(|p| p.at(Location::Line(number)))?;
        } else {
            joined.extend_from_slice(line);
            obj.statement(&std::mem::take(&mut joined)).map_err(|p| p.at(Location::Line(number)))?;
        }
    }
    if !joined.is_empty() {
        obj.statement(&joined)?;
    }
    if obj.positions.is_empty() {
        return Err(Problem::new("holds no vertex").expected("OBJ lines 'v X Y Z'").into());
    }
    if obj.lines_ignored > 0 {
        context.note(format!("ignored {} curves, lines or other elements that are not polygons", obj.lines_ignored));
    }
    obj.decode_colors(context);
    obj.check_corners(context)?;
    if obj.faces.is_empty() { obj.points(context) } else { obj.mesh(context) }
}

impl Obj {
    fn statement(&mut self, line: &[u8]) -> Result<(), Problem> {
        let mut words = words(line);
        let Some(keyword) = words.next() else { return Ok(()) };
        match keyword {
            b"v" => self.vertex(words)?,
            b"vt" => {
                let [u, v] = numbers(&mut words, "vt U V", 1)?;
                self.uvs.push([u as f32, 1.0 - v as f32]);
            }
            b"vn" => {
                let n: [f64; 3] = numbers(&mut words, "vn X Y Z", 3)?;
                self.normals.push(n.map(|x| x as f32));
            }
            b"f" => self.face(words)?,
            b"usemtl" => {
                let name = rest_of(line, keyword);
                if self.names.is_empty() && !self.faces.is_empty() {
                    // Faces before the first material are white. Their index 0 is that of a material without name.
                    self.names.insert(String::new(), 0);
                }
                let next = u32::try_from(self.names.len()).unwrap_or(NONE);
                self.material = *self.names.entry(name).or_insert(next);
            }
            b"mtllib" => self.libraries.push(rest_of(line, keyword)),
            b"l" | b"curv" | b"curv2" | b"surf" => self.lines_ignored += 1,
            _ if keyword.starts_with(b"#") && self.positions.is_empty() && self.comments.len() < 1000 => {
                let text = String::from_utf8_lossy(line);
                let text = text.trim().trim_start_matches('#').trim();
                if !text.is_empty() {
                    self.comments.push(text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect());
                }
            }
            // Groups, smoothing and free-form parameters have no effect on shape or colour.
            _ => {}
        }
        Ok(())
    }

    fn vertex<'a>(&mut self, mut words: impl Iterator<Item = &'a [u8]>) -> Result<(), Problem> {
        self.positions.push(DVec3::from(numbers::<3>(&mut words, "v X Y Z", 3)?));
        let mut rest = [0.0; 4];
        let mut count = 0;
        for word in words.take(4) {
            rest[count] = number(word).ok_or_else(|| bad_number(word, "v X Y Z [R G B]"))?;
            count += 1;
        }
        // One additional number is a weight, which polygons don't have; three or four are a colour.
        if count >= 3 {
            self.printed_colors.resize(self.positions.len() - 1, [f64::NAN; 3]);
            self.printed_colors.push([rest[0], rest[1], rest[2]]);
        }
        Ok(())
    }

    /// Converts the printed colours to linear ones, by their range. Vertices without a colour become white.
    fn decode_colors(&mut self, context: &mut Context<'_>) {
        let mut printed = std::mem::take(&mut self.printed_colors);
        if printed.is_empty() {
            return;
        }
        let all = || printed.as_flattened().iter().copied().filter(|c| c.is_finite());
        let largest = all().fold(0.0, f64::max);
        let scale = ColorScale::of(ColorType::Float, largest, all().all(|c| c.fract() == 0.0), FloatColors::Displayed);
        let most = if let ColorScale::Encoded(most) = scale { most } else { 1.0 };
        if largest > 1.0 {
            let beyond = if largest > most { ", and clamped larger ones" } else { "" };
            context.note(format!("took the colours as sRGB-encoded, from 0 to {most}{beyond}"));
        }
        printed.resize(self.positions.len(), [f64::NAN; 3]);
        let linear = |c: f64| if c.is_nan() { 1.0 } else { linear_of_level(c, most) };
        self.colors = printed.into_iter().map(|c| c.map(linear)).collect();
    }

    fn face<'a>(&mut self, words: impl Iterator<Item = &'a [u8]>) -> Result<(), Problem> {
        let start = self.corners.len();
        for word in words {
            let mut parts = word.split(|&b| b == b'/');
            // An index may refer to an element that is defined later.
            let mut index = |count: usize| {
                let text = parts.next().unwrap_or(b"");
                let value: Option<i64> = std::str::from_utf8(text).ok().and_then(|t| t.parse().ok());
                let resolved = value.and_then(|v| if v < 0 { v.checked_add(count as i64) } else { v.checked_sub(1) });
                let resolved = resolved.and_then(|i| u32::try_from(i).ok()).filter(|i| *i != NONE);
                (text, value.is_some() || text.is_empty(), resolved)
            };
            let count = self.positions.len();
            let (text, _, Some(position)) = index(count) else {
                let text = word.split(|&b| b == b'/').next().unwrap_or_default();
                return Err(no_such_vertex(text, count));
            };
            if position as usize >= count && self.ahead.as_ref().is_none_or(|(last, ..)| *last < position) {
                self.ahead = Some((position, self.line, String::from_utf8_lossy(text).into_owned()));
            }
            let (mut others, counts) = ([NONE; 2], [self.uvs.len(), self.normals.len()]);
            for (kind, (other, count)) in others.iter_mut().zip(counts).enumerate() {
                let (text, is_number, resolved) = index(count);
                if !is_number {
                    let what = format!("a face refers to {} {}", KINDS[kind], quote(text));
                    return Err(Problem::new(what).expected("'V', 'V/VT', 'V//VN' or 'V/VT/VN', as whole numbers"));
                }
                *other = resolved.unwrap_or(NONE);
                self.missing[kind] += usize::from(resolved.is_none() && !text.is_empty());
            }
            self.corners.push([position, others[0], others[1], self.material]);
        }
        self.faces.push((self.corners.len() - start) as u32);
        Ok(())
    }

    /// Checks that faces refer to existing vertices. References to texture coordinates or normals that don't exist are
    /// removed, with a note.
    fn check_corners(&mut self, context: &mut Context<'_>) -> Result<(), Problem> {
        let count = self.positions.len();
        if let Some((_, line, text)) = self.ahead.take().filter(|(last, ..)| *last as usize >= count) {
            return Err(no_such_vertex(text.as_bytes(), count).at(Location::Line(line)));
        }
        let counts = [self.uvs.len(), self.normals.len()];
        for corner in &mut self.corners {
            for ((index, count), missing) in corner[1..3].iter_mut().zip(counts).zip(&mut self.missing) {
                if *index != NONE && *index as usize >= count {
                    (*index, *missing) = (NONE, *missing + 1);
                }
            }
        }
        for (kind, missing) in KINDS.iter().zip(self.missing) {
            if missing > 0 {
                let corners = counted(missing as u64, "corners");
                context.note(format!("the file lacks the {kind}s of {corners}: faces are drawn without them"));
            }
        }
        Ok(())
    }

    fn points(self, context: &mut Context<'_>) -> Result<Content, Fault> {
        let (origin, positions) = measured_positions(&self.positions);
        let n = positions.len();
        let colors = (!self.colors.is_empty()).then_some(self.colors);
        // Without faces, normals belong to vertices in order, as point exporters write them.
        let normals = (self.normals.len() == n)
            .then(|| surfel_model::Column3::from_f32(self.normals.iter().map(|&n| n.into()).collect()));
        let comments = self.comments;
        context.points(PointCloud { origin, positions, normals, colors, comments, ..PointCloud::default() })
    }

    fn mesh(mut self, context: &mut Context<'_>) -> Result<Content, Fault> {
        let (mut materials, textures) = mtl::resolve(&self.libraries, &self.names, context);
        let has_uvs = self.corners.iter().any(|c| c[1] != NONE);
        let has_normals = self.corners.iter().any(|c| c[2] != NONE);
        if has_uvs {
            self.assign_untextured_materials(&mut materials);
        }
        // If there are no materials to distinguish, corners needn't be separate vertices.
        if materials.is_empty() {
            self.corners.iter_mut().for_each(|c| c[3] = 0);
        }
        let n = self.positions.len();
        let mut parts = Parts { exact: true, comments: std::mem::take(&mut self.comments), ..Parts::default() };
        let mut indices: Vec<u32> = Vec::with_capacity(self.corners.len());
        if !has_uvs && !has_normals && materials.is_empty() {
            indices.extend(self.corners.iter().map(|c| c[0]));
            parts.positions = self.positions;
            parts.materials_of = vec![0; n];
            if !self.colors.is_empty() {
                parts.colors = Some(self.colors.iter().map(|c| [c[0], c[1], c[2], 1.0]).collect());
            }
        } else {
            self.split(has_uvs, has_normals, &mut parts, &mut indices);
        }
        let (mut rest, mut skipped, mut cutter) = (indices.as_slice(), 0, Triangulator::default());
        for &count in &self.faces {
            let (face, after) = rest.split_at(rest.len().min(count as usize));
            rest = after;
            let triangles = cutter.cut(face, |i| parts.positions.get(i as usize).copied());
            parts.triangles.extend(triangles.iter().map(|t| t.map(|place| face[place as usize])));
            skipped += usize::from(face.len() < 3);
        }
        if skipped > 0 {
            context.note(format!("skipped {} with fewer than 3 corners", counted(skipped as u64, "faces")));
        }
        context.parts(parts, &materials, &textures)
    }

    /// Gives each textured face that has a corner without texture coordinate a copy of its material, without textures.
    fn assign_untextured_materials(&mut self, materials: &mut Vec<Material>) {
        let mut plain: HashMap<u32, u32> = HashMap::new();
        let mut rest = self.corners.as_mut_slice();
        for &count in &self.faces {
            let (face, after) = rest.split_at_mut(rest.len().min(count as usize));
            rest = after;
            let Some(material) = face.first().filter(|_| face.iter().any(|c| c[1] == NONE)).map(|c| c[3]) else {
                continue;
            };
            let Some(textured) = materials.get(material as usize) else { continue };
            if textured.texture.is_none() && textured.normal_map.is_none() {
                continue;
            }
            let untextured = Material { texture: None, normal_map: None, ..textured.clone() };
            let index = *plain.entry(material).or_insert_with(|| {
                materials.push(untextured);
                materials.len() as u32 - 1
            });
            face.iter_mut().for_each(|c| c[3] = index);
        }
    }

    /// Creates a vertex in `parts` for each distinct corner, in order of first use. Appends the index of each corner's
    /// vertex to `indices`.
    fn split(&self, has_uvs: bool, has_normals: bool, parts: &mut Parts, indices: &mut Vec<u32>) {
        let mut index: HashMap<[u32; 4], u32> = HashMap::with_capacity(self.positions.len());
        let (mut uvs, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
        for corner in &self.corners {
            let mut key = *corner;
            if !has_normals {
                key[2] = NONE;
            }
            let next = parts.positions.len() as u32;
            indices.push(*index.entry(key).or_insert_with(|| {
                let [position, uv, normal, material] = key.map(|i| i as usize);
                parts.positions.push(self.positions[position]);
                parts.materials_of.push(material as u32);
                if has_uvs {
                    uvs.push(self.uvs.get(uv).copied().unwrap_or_default());
                }
                if has_normals {
                    normals.push(self.normals.get(normal).copied().unwrap_or_default());
                }
                if !self.colors.is_empty() {
                    let c = self.colors.get(position).copied().unwrap_or([1.0; 3]);
                    colors.push([c[0], c[1], c[2], 1.0]);
                }
                next
            }));
        }
        parts.uvs = has_uvs.then_some(uvs);
        parts.normals = has_normals.then_some(normals);
        parts.colors = (!self.colors.is_empty()).then_some(colors);
    }
}

/// Names, for messages, of the elements that corners refer to in addition to vertices.
const KINDS: [&str; 2] = ["texture coordinate", "normal"];

fn no_such_vertex(text: &[u8], count: usize) -> Problem {
    let expected = format!("1 to {count}, or -{count} to -1");
    Problem::new(format!("a face refers to vertex {} of {count}", quote(text))).expected(expected)
}

/// Returns the rest of a line after its keyword: a name or path, which may contain blanks.
fn rest_of(line: &[u8], keyword: &[u8]) -> String {
    let line = line.trim_ascii();
    String::from_utf8_lossy(line[keyword.len().min(line.len())..].trim_ascii()).into_owned()
}

/// Parses `N` numbers, of which the first `needed` are required; missing ones are 0. `form` is the statement's form for
/// messages.
fn numbers<'a, const N: usize>(
    words: &mut impl Iterator<Item = &'a [u8]>,
    form: &str,
    needed: usize,
) -> Result<[f64; N], Problem> {
    let mut values = [0.0; N];
    for (i, value) in values.iter_mut().enumerate() {
        match words.next() {
            Some(word) => *value = number(word).ok_or_else(|| bad_number(word, form))?,
            None if i >= needed => {}
            None => return Err(Problem::new(format!("found {i} numbers")).expected(format!("'{form}'"))),
        }
    }
    Ok(values)
}

fn bad_number(word: &[u8], form: &str) -> Problem {
    Problem::new(format!("found {}, which is not a number", quote(word))).expected(format!("'{form}'"))
}
