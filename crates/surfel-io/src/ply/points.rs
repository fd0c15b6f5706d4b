//! The vertices of a PLY file that contains only points, for reading block by block.

use super::body::{number_type, push_word};
use super::colors::{self, FloatColors};
use super::comments::interpret_comments;
use super::encoding::PlyEncoding;
use super::header::{self, ElementDef, Header, Kind, ScalarType};
use crate::ascii::{each_line, words};
use crate::bytes::Bytes;
use crate::crs::Crs;
use crate::error::{Fault, Location, Problem, quote, unwritable};
use crate::point_columns::{Named, Roles};
use crate::strided::{NumberType, Strided};
use std::io::Write;
use surfel_model::Up;

/// Names of properties of splats. Vertices that have one of them aren't read as points.
const SPLAT_PROPERTIES: [&str; 7] = ["radius", "su", "packed_position", "scale_0", "rot_0", "f_dc_0", "clip_mode"];

/// The header of a PLY file of points, and the position of the vertices in the file.
pub(crate) struct Vertices {
    header: Header,
    /// Index of the element `vertex` among the header's elements.
    element: usize,
    /// Byte offset of the first vertex.
    start: usize,
    /// Number of header lines, for the line numbers of messages.
    lines: usize,
}

impl Vertices {
    /// Parses the header of a file and finds its vertices. Returns `None` if the file contains faces or splats, or if
    /// the vertices lack coordinates or a part of their normals or colours. Also returns `None` if rows before or in
    /// the vertices vary in length, and for a text file in which another element comes first.
    pub(crate) fn of(bytes: Bytes<'_>) -> Result<Option<Self>, Fault> {
        let head = bytes.at_most(0, header::MAX_HEADER_BYTES + header::MAX_LINE_BYTES + 1);
        let header = header::parse(&head)?;
        let is_face = |e: &ElementDef| ["face", "tristrips"].contains(&e.name.as_str()) && e.count > 0;
        let Some(element) = header.elements.iter().position(|e| e.name == "vertex") else { return Ok(None) };
        let (before, vertices) = (&header.elements[..element], &header.elements[element]);
        let has = |name: &str| vertices.properties.iter().any(|p| p.name == name);
        let is_whole = |set: [&str; 3]| !set.iter().any(|name| has(name)) || set.iter().all(|name| has(name));
        let are_points = vertices.is_fixed()
            && !header.elements.iter().any(is_face)
            && !SPLAT_PROPERTIES.iter().any(|name| has(name))
            && has("x")
            && [["x", "y", "z"], ["nx", "ny", "nz"], ["red", "green", "blue"]].into_iter().all(is_whole);
        let skipped = match header.encoding {
            PlyEncoding::Ascii => (element == 0).then_some(0),
            _ => before.iter().try_fold(0_u64, |sum, e| {
                let bytes = e.is_fixed().then(|| e.count.checked_mul(row_bytes(e) as u64)).flatten()?;
                sum.checked_add(bytes)
            }),
        };
        let start = skipped.and_then(|skipped| header.body.checked_add(usize::try_from(skipped).ok()?));
        let Some(start) = start.filter(|_| are_points) else { return Ok(None) };
        let lines = head[..header.body].split(|b| *b == b'\n').count() - 1;
        Ok(Some(Self { header, element, start, lines }))
    }

    fn vertices(&self) -> &ElementDef {
        &self.header.elements[self.element]
    }

    pub(crate) fn points(&self) -> u64 {
        self.vertices().count
    }

    pub(crate) fn has(&self, property: &str) -> bool {
        self.vertices().properties.iter().any(|p| p.name == property)
    }

    /// Returns the minimum number of bytes that the vertices take in the file, by which a damaged header is recognised.
    pub(crate) fn least_bytes(&self) -> u64 {
        let row = match self.header.encoding {
            // A digit and a separator.
            PlyEncoding::Ascii => 2 * self.vertices().properties.len(),
            _ => row_bytes(self.vertices()),
        };
        self.points().saturating_mul(row as u64)
    }

    /// Returns the up axis, if a comment in the header states it.
    pub(crate) fn up(&self) -> Option<Up> {
        interpret_comments(&self.header.comments).ok()?.0
    }

    /// Returns the encoding of colours that are stored as floats.
    pub(crate) fn float_colors(&self) -> FloatColors {
        FloatColors::of_comments(&self.header.comments)
    }

    /// Returns the coordinate reference system that comments of the file state ([`Crs::of_comments`]).
    pub(crate) fn crs(&self) -> Crs {
        Crs::of_comments(&self.header.comments).unwrap_or_default()
    }

    fn cut(&self, bytes: Bytes<'_>, whole: u64) -> Problem {
        let count = self.points();
        let (end, name) = (bytes.len(), quote(&self.vertices().in_file));
        let what = format!("the file ends at byte {end}, within element {name} number {whole} of {count}");
        Problem::new(what).help("copy or export the file again: it is incomplete, or its header counts too many")
    }

    /// Writes the vertices of a text file to `out`, as rows of little-endian binary numbers. Writes nothing and returns
    /// false if the file is binary already.
    pub(crate) fn unpack(&self, bytes: Bytes<'_>, out: &mut dyn Write) -> Result<bool, Fault> {
        if self.header.encoding != PlyEncoding::Ascii {
            return Ok(false);
        }
        let properties = &self.vertices().properties;
        let (mut rows, mut row) = (0, Vec::new());
        let body = bytes.part(self.start..bytes.len()).unwrap_or(Bytes::Memory(&[]));
        each_line(body, |line, text| {
            let mut words = words(text).peekable();
            if rows == self.points() || words.peek().is_none() {
                return Ok(());
            }
            let wrong = |what: String| Problem::new(what).at(Location::Line(self.lines + line));
            row.clear();
            for property in properties {
                let kind = scalar(property.kind);
                let word = words.next().unwrap_or_default();
                push_word(kind, word, &mut row).ok_or_else(|| {
                    let what = format!("found {} as {} of vertex {rows}", quote(word), quote(&property.in_file));
                    wrong(what).expected("a number of the type that the header gives, and a line for each vertex")
                })?;
            }
            if words.next().is_some() {
                let name = quote(&self.vertices().in_file);
                let what = format!("element {name} number {rows} has more values than the header has properties");
                return Err(wrong(what).expected(format!("{} values on a line", properties.len())).into());
            }
            rows += 1;
            Ok(out.write_all(&row).map_err(unwritable)?)
        })?;
        if rows < self.points() { Err(self.cut(bytes, rows).into()) } else { Ok(true) }
    }

    /// Returns the columns of the vertices, and the roles of these columns, such as position or colour. `bytes` is the
    /// output of [`Self::unpack`] if `is_unpacked`, else the file.
    pub(crate) fn columns<'a>(&self, bytes: Bytes<'a>, is_unpacked: bool) -> Result<(Vec<Named<'a>>, Roles), Fault> {
        let vertices = self.vertices();
        let (stride, start) = (row_bytes(vertices), if is_unpacked { 0 } else { self.start });
        let mut offset = start;
        let big_endian = !is_unpacked && self.header.encoding == PlyEncoding::BinaryBigEndian;
        let mut columns = Vec::new();
        for property in &vertices.properties {
            let kind = scalar(property.kind);
            let rows = usize::try_from(vertices.count).unwrap_or(usize::MAX);
            let values = Strided::new(bytes, offset, stride, rows, number_type(kind), big_endian);
            let whole = bytes.len().saturating_sub(start) / stride.max(1);
            let values = values.ok_or_else(|| self.cut(bytes, whole as u64))?;
            columns.push(Named { name: property.name.clone(), values });
            offset += kind.bytes();
        }
        // Names must match exactly, as in the reader that has the whole file in memory.
        let find = |name: &str| columns.iter().position(|c| c.name == name);
        let set = |[a, b, c]: [&str; 3]| Some([find(a)?, find(b)?, find(c)?]);
        let is_packed = |i: &usize| {
            let values = &columns[*i].values;
            let rows = values.len();
            let some = (0..rows).step_by(rows.div_ceil(1000).max(1));
            match values.kind() {
                NumberType::F32 => some.map(|row| values.at(row)).all(|v| colors::is_packed(v as f32)),
                kind => matches!(kind, NumberType::I32 | NumberType::U32),
            }
        };
        let packed = ["rgb", "rgba"].into_iter().find_map(find).filter(is_packed).map(|i| (i, false));
        let roles = Roles {
            position: set(["x", "y", "z"]).unwrap_or_default(),
            color: set(["red", "green", "blue"]),
            normal: set(["nx", "ny", "nz"]),
            packed_color: packed.filter(|_| find("red").is_none()),
            alpha: find("alpha"),
            ..Roles::default()
        };
        Ok((columns, roles))
    }
}

/// Returns the scalar type of a property of an element that has no lists.
fn scalar(kind: Kind) -> ScalarType {
    match kind {
        Kind::Scalar(kind) | Kind::List { count: kind, .. } => kind,
    }
}

fn row_bytes(element: &ElementDef) -> usize {
    element.properties.iter().map(|p| scalar(p.kind).bytes()).sum()
}
